"""Rasters opened by GDAL, refused in words where they are none or larger than any."""

import os

from osgeo import gdal

from ...foundation.errors import InputError
from .budgets import require_raster
from .datasets import check_advice, open_dataset


def open_raster(path: str) -> gdal.Dataset:
    """Return an image opened by GDAL; raise `InputError` where it is none."""
    dataset, message = open_dataset(path)
    if dataset is None and not path.startswith("/vsi") and ":" not in path and not os.path.exists(path):
        raise InputError(f"{path}: no such file: check the path")
    if dataset is None or dataset.RasterCount < 1:
        reason = f" ({message})" if message else ""
        raise InputError(f"{path}: neither an image nor an RPC file{reason}: {check_advice(path, 'check the file')}")
    require_raster(path, dataset)
    return dataset
