"""How far two RPCs are apart on the image, and whether a file gives back what was written."""

import numpy as np

from ...block.block import Image
from ...camera.rpc import RPC
from ...foundation.errors import OutputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import metadata_of
from ..opening.raster_datasets import open_raster
from .fields import ERRORS, POLYNOMIALS, SCALARS, numbers_of, rpc_from_gdal
from .find import read_rpc_file


@thresholds
class READ_BACK:
    """When a written RPC is read back as it was written."""

    gdal_rounding_px: float = threshold(1e-4, "px", "largest difference by GDAL's rounding to 15 digits")


def difference_px(reference: RPC, other: RPC, size: tuple[int, int] | None = None) -> float:
    """Return the largest distance (px) between the image points of two RPCs.

    Compared on a 9 x 9 grid over the image (its ``size``, else OFF and SCALE) at the lowest, middle and highest
    height of ``reference``; infinite where ``reference`` cannot be inverted and the two are not the same.
    """
    if same_numbers(reference, other):
        return 0.0
    grid = Image("", reference, size).grid_px(9, 9)
    largest = -np.inf
    for height in (*reference.height_range, reference.height_off):
        ground, converged = reference.localize(grid, height)
        if converged.any():
            apart = other.project(ground[converged]) - reference.project(ground[converged])
            largest = max(largest, float(np.hypot(*apart.T).max()))
    return largest if np.isfinite(largest) else float("inf")


def same_numbers(wanted: RPC, found: RPC) -> bool:
    """Return whether the 90 numbers that make the camera are the same doubles."""
    return numbers_of(wanted)[len(ERRORS) :] == numbers_of(found)[len(ERRORS) :]


def require_same(path: str, wanted: RPC, found: RPC) -> None:
    """Raise `OutputError` naming the first field whose doubles did not come back."""
    if same_numbers(wanted, found):
        return
    for field in (*SCALARS, *POLYNOMIALS):
        if not np.array_equal(getattr(wanted, field), getattr(found, field)):
            raise OutputError(f"{path}: {field} did not read back as it was written: the disk or GDAL is at fault")


def read_back_px(path: str, rpc: RPC) -> float:
    """Return how far the RPC that GDAL gives for a written image is from ``rpc`` (px); our reader's for RPC files.

    GDAL rounds the doubles of a GeoTIFF tag to 15 digits. Raises `OutputError` where GDAL finds no RPC or one farther
    away than that can make it (`READ_BACK.gdal_rounding_px`): then something beside the image wins.
    """
    found = read_rpc_file(path)
    if found is not None:
        return difference_px(rpc, found.rpc)
    dataset = open_raster(path)
    metadata = metadata_of(dataset, "RPC")
    if not metadata:
        raise OutputError(f"{path}: GDAL finds no RPC in it: check the version of GDAL")
    apart = difference_px(rpc, rpc_from_gdal(path, metadata), (dataset.RasterXSize, dataset.RasterYSize))
    if not apart <= READ_BACK.gdal_rounding_px:
        raise OutputError(f"{path}: GDAL gives another RPC, {apart:.3g} px away: remove older RPC files beside it")
    return apart
