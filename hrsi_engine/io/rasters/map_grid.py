"""Images on the grid of a map: whether their RPC is that of these pixels, or stayed on after an orthorectification.

Products in map projection (IKONOS Geo, ORStandard, QuickBird Standard) have an RPC of their own: from the pixel to the
map, from there through the RPC, one comes back to the pixel, up to a shift. The RPC of the raw image, which programs
copy into orthoimages, comes to another place: turned by the direction of flight, stretched by another pixel.
"""

import numpy as np
from osgeo import gdal

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from .georeference import Georeference


@thresholds
class MAP_GRID:
    """When an image on a map's grid has the RPC of these pixels."""

    step_share: float = threshold(
        0.03, "", "by which a step of a pixel may come back as another one through map and RPC",
        "products in map projection stay below 0.002",
    )  # fmt: skip


def map_grid_doubt(path: str, dataset: gdal.Dataset, rpc: RPC) -> str:
    """Return a warning where an image lies on a map grid that its RPC does not follow; else an empty text."""
    if dataset.GetGeoTransform(can_return_null=True) is None or not dataset.GetProjection():
        return ""
    try:
        grid = Georeference(dataset, path, "image")
    except InputError:
        return ""
    half = 0.25 * np.array([dataset.RasterXSize, dataset.RasterYSize])
    middle = 2.0 * half - 0.5
    pixels = middle + half * [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]]
    lonlat = grid.to_lonlat(pixels)
    seen = rpc.project(np.column_stack([lonlat, np.full(4, rpc.height_off)]))
    steps = np.column_stack([seen[1] - seen[0], seen[3] - seen[2]]) / (2.0 * half)  # sample, line of a step of a pixel
    if not np.isfinite(steps).all() or np.abs(steps - np.eye(2)).max() < MAP_GRID.step_share:
        return ""
    turn = np.degrees(np.arctan2(steps[1, 0] - steps[0, 1], steps[0, 0] + steps[1, 1]))
    size = float(np.sqrt(abs(np.linalg.det(steps))))
    return (
        f"its pixels are on the grid of a map ({grid.horizontal.name}) that its RPC does not follow: turned by "
        f"{abs(turn):.0f} degrees, {size:.3g} of its pixels long. If it is an orthoimage that kept the RPC of the "
        "raw image, name the raw image"
    )
