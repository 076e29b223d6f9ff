"""What a raster without RPC is, by its content: heights, a picture on a map, a mask, or none of them."""

import os
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import pyproj
from osgeo import gdal

from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
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

    sample: int = threshold(600, "pixels", "largest number of values along a side that are read")
    mask_values: int = threshold(3, "values", "largest number of different values of a mask")


@dataclass(frozen=True, eq=False)
class RasterFacts:
    """Kind of a raster, its columns and rows, number of bands, CRS, and the surface of its heights.

    nodata : value that is no height and is not declared as nodata, None if there is none
    surface : ellipsoidal heights, as stored if the CRS does not state their datum; None for other kinds
    """

    kind: RasterKind
    size: tuple[int, int]
    bands: int
    crs: pyproj.CRS | None = None
    nodata: float | None = None
    surface: GridSurface | None = None


def find_raster_kind(path: str) -> RasterFacts | None:
    """Return what a raster is; None if GDAL opens no raster."""
    dataset, _ = open_dataset(path)
    if dataset is None or dataset.RasterCount == 0:
        return None
    size, bands = (dataset.RasterXSize, dataset.RasterYSize), dataset.RasterCount
    try:
        crs = Georeference(dataset, path, "raster").crs
    except InputError:
        return RasterFacts(RasterKind.UNPLACED, size, bands)
    name, band = os.path.basename(path).lower(), dataset.GetRasterBand(1)
    if name.endswith(".gtx") or "geoid" in name or "undulation" in name:
        return RasterFacts(RasterKind.GEOID, size, bands, crs)
    values = _sample_values(band)
    if bands == 1 and band.DataType not in (gdal.GDT_Byte, gdal.GDT_UInt16):
        nodata = _find_fill_value(values[values != band.GetNoDataValue()])
        heights = dataset if nodata is None else gdal.Translate("", dataset, format="VRT", noData=nodata)
        datum = "layer" if has_heights(crs) else "ellipsoidal"
        surface = surface_of_dataset(heights, path, datum, None)
        return RasterFacts(RasterKind.HEIGHTS, size, bands, crs, nodata, surface)
    is_mask = bands == 1 and len(np.unique(values)) <= RASTER_KINDS.mask_values
    return RasterFacts(RasterKind.MASK if is_mask else RasterKind.PICTURE, size, bands, crs)


def _sample_values(band: Any) -> np.ndarray:
    step = max(1, max(band.XSize, band.YSize) // RASTER_KINDS.sample)
    values = band.ReadAsArray(buf_xsize=-(-band.XSize // step), buf_ysize=-(-band.YSize // step))
    return np.empty(0) if values is None else np.asarray(values).ravel()


def _find_fill_value(values: np.ndarray) -> float | None:
    """Return the only value that is no height of the ground; None if there is none, or several."""
    wrong = (values < GROUND_HEIGHTS.lowest_m) | (values > GROUND_HEIGHTS.highest_m)
    fills = np.unique(values[wrong | (values == GROUND_HEIGHTS.no_data_m)])
    return float(fills[0]) if len(fills) == 1 else None


def write_with_nodata(path: str, nodata: float, target: str) -> None:
    """Write a virtual raster of a file that declares its nodata value."""
    dataset, _ = open_dataset(path)
    gdal.Translate(target, dataset, format="VRT", noData=nodata)
