"""What a raster without RPC is, by its content: heights, a picture on a map, a mask, or none of them."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pyproj
from osgeo import gdal

from ...block.imaging_geometry import GEOMETRY
from ...foundation.errors import InputError
from ...foundation.thresholds import MEMORY, threshold, thresholds
from ...ground.proj_operations import has_heights
from ...surface.grid_surface import GridSurface
from ..opening.budgets import GROUND_HEIGHTS
from ..opening.datasets import open_dataset
from ..opening.georeference import Georeference
from .dems import surface_of_dataset


class RasterKind(StrEnum):
    """What a raster is."""

    HEIGHTS = "heights"
    PICTURE = "picture"
    MASK = "mask"
    GEOID = "geoid grid"
    UNPLACED = "raster without position"


@thresholds
class RASTER_KINDS:
    """Sampling of a raster whose kind is determined."""

    mask_values: int = threshold(3, "values", "largest number of different values of a mask")


@dataclass(eq=False)
class RasterFacts:
    """Kind of a raster, its columns and rows, number of bands, CRS, and the surface of its heights.

    centre, cell : (2,) x, y of the middle, and size of a cell in x and y, in the CRS; None without geotransform
    nodata : value that is no height and is not declared as nodata, None if there is none
    surface : ellipsoidal heights, as stored if the CRS does not state their datum; None for other kinds
    """

    kind: RasterKind
    size: tuple[int, int]
    bands: int
    crs: pyproj.CRS | None = None
    centre: tuple[float, float] | None = None
    cell: tuple[float, float] = (1.0, 1.0)
    nodata: float | None = None
    surface: GridSurface | None = None


def find_raster_kind(path: str, crs: str = "") -> RasterFacts | None:
    """Return what a raster is; None if GDAL opens no raster. ``crs`` is that of a raster that states none."""
    dataset, _ = open_dataset(path)
    if dataset is None or dataset.RasterCount == 0:
        return None
    if crs:
        dataset = gdal.Translate("", dataset, format="VRT", outputSRS=crs)
    facts = RasterFacts(RasterKind.UNPLACED, (dataset.RasterXSize, dataset.RasterYSize), dataset.RasterCount)
    transform = dataset.GetGeoTransform(can_return_null=True)
    if transform is not None:
        facts.centre = tuple(gdal.ApplyGeoTransform(transform, 0.5 * facts.size[0], 0.5 * facts.size[1]))
        facts.cell = transform[1], transform[5]
    try:
        facts.crs = Georeference(dataset, path, "raster").crs
    except InputError:
        return facts
    name, band = os.path.basename(path).lower(), dataset.GetRasterBand(1)
    if name.endswith(".gtx") or "geoid" in name or "undulation" in name:
        facts.kind = RasterKind.GEOID
        return facts
    step = max(1, max(band.XSize, band.YSize) // MEMORY.window_px)
    values = band.ReadAsArray(buf_xsize=-(-band.XSize // step), buf_ysize=-(-band.YSize // step))
    values = np.empty(0) if values is None else np.asarray(values).ravel()
    if facts.bands == 1 and band.DataType not in (gdal.GDT_Byte, gdal.GDT_UInt16):
        facts.kind, facts.nodata = RasterKind.HEIGHTS, _find_fill_value(values[values != band.GetNoDataValue()])
        heights = dataset if facts.nodata is None else gdal.Translate("", dataset, format="VRT", noData=facts.nodata)
        datum = "layer" if has_heights(facts.crs) else "ellipsoidal"
        facts.surface = surface_of_dataset(heights, path, datum, None)
        return facts
    is_mask = facts.bands == 1 and len(np.unique(values)) <= RASTER_KINDS.mask_values
    facts.kind = RasterKind.MASK if is_mask else RasterKind.PICTURE
    return facts


def _find_fill_value(values: np.ndarray) -> float | None:
    """Return the only value that is no height of the ground; None if there is none, or several."""
    is_impossible = (values <= GROUND_HEIGHTS.no_data_m) | (values > GEOMETRY.highest_height_m)
    fills = np.unique(values[is_impossible])
    return float(fills[0]) if len(fills) == 1 else None


def write_virtual_raster(paths: Sequence[str], target: str, crs: str = "", nodata: float | None = None) -> None:
    """Write a virtual raster of one or several files, with the CRS and the nodata value that they do not state."""
    gdal.BuildVRT(target, list(paths), outputSRS=crs or None, srcNodata=nodata, VRTNodata=nodata)
