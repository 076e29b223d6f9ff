"""Arrays of HDF5 files, read by GDAL: matches of other programs, granules of laser altimeters."""

import os

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from .budgets import FILE_BUDGETS
from .datasets import gdal_messages

HDF5_HEAD = b"\x89HDF\r\n\x1a\n"


def open_hdf5(path: str) -> gdal.Group:
    """Return the root group of a file; raise `InputError` if it cannot be read."""
    if not os.path.isfile(path):
        raise InputError(f"{path}: no such file: check the path")
    if gdal.GetDriverByName("HDF5") is None:
        raise InputError(f"{path}: this GDAL reads no HDF5: install its HDF5 driver, or give the data as CSV or text")
    root: gdal.Group | None = None
    with gdal_messages() as messages:
        dataset = gdal.OpenEx(path, gdal.OF_MULTIDIM_RASTER, allowed_drivers=["HDF5"])
        root = None if dataset is None else dataset.GetRootGroup()
    if root is None:
        raise InputError(f"{path}: cannot be read as HDF5 ({messages.reason}): obtain the file again")
    return root


def read_array(path: str, group: gdal.Group, name: str) -> np.ndarray | None:
    """Return an array of numbers of a group, or of the file if ``name`` begins with a slash; None if there is none.

    Raises `InputError` if it cannot be read, or has more numbers than any file of matches or heights.
    """
    array: gdal.MDArray | None = None
    with gdal_messages():
        array = (group.OpenMDArrayFromFullname if name.startswith("/") else group.OpenMDArray)(name)
    if array is None:
        return None
    sizes = [dimension.GetSize() for dimension in array.GetDimensions()]
    if 0 in sizes:
        return np.zeros(sizes)
    if np.prod(sizes, dtype=np.float64) > FILE_BUDGETS.array_values:
        raise InputError(f"{path}, {name}: claims {sizes} numbers, more than any file has: obtain it again")
    values: np.ndarray | None = None
    with gdal_messages() as messages:
        values = array.ReadAsArray()
    if values is None or values.dtype.kind not in "iuf":
        raise InputError(f"{path}, {name}: cannot be read ({'; '.join(messages) or 'no numbers'}): obtain it again")
    return values
