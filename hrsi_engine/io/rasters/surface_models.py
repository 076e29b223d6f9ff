"""Surface models on disk: height, standard deviation and number of pairs as the three bands of a COG.

Heights above a vertical datum have a compound CRS. Ellipsoidal ones have that of the map, since GeoTIFF has no
three-dimensional projected CRS, and the metadata item `VERTICAL_DATUM`. `open_dem` reads both.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyproj
from osgeo import gdal

from ...foundation.errors import InputError
from ...foundation.pixel_filters import STRETCH
from ...foundation.progress import Progress, advance
from ...ground.crs_operations import operations_of
from ...ground.proj_operations import has_heights
from .dems import ELLIPSOIDAL_DATUM, ELLIPSOIDAL_HEIGHTS, VERTICAL_DATUM
from .images import GdalRaster
from .orthoimages import Grid, OrthoFormat, TileLayout, write_tiles

SURFACE_BANDS = ("height", "standard deviation", "pairs")
NODATA = -9999.0
#: Vertical CRS by the words of the option.
VERTICAL_CODES = {"egm96": "EPSG:5773", "egm2008": "EPSG:3855"}

HeightOffsets = Callable[[np.ndarray], np.ndarray]  # (n, 2) x, y in the map's CRS -> (n,) m to subtract


CACHE_BYTES = 256 << 20  #: for blocks of the images and of the surface


@contextmanager
def limit_block_cache() -> Iterator[None]:
    """Limit GDAL's cache of blocks, by default a twentieth of the machine's memory, to the same size anywhere."""
    usual = gdal.GetCacheMax()
    gdal.SetCacheMax(min(CACHE_BYTES, usual))
    try:
        yield
    finally:
        gdal.SetCacheMax(usual)


def find_vertical_crs(crs: str, vertical: str) -> tuple[str, HeightOffsets | None]:
    """Return the CRS of a surface model (WKT), and the ellipsoidal heights of its height 0 (None for ellipsoidal ones).

    crs : of the map, WKT; vertical : ``ellipsoidal``, ``egm96``, ``egm2008``, or a vertical CRS (EPSG:5773)
    Raises `InputError` if it is no vertical CRS, or its geoid grid is missing.
    """
    flat = pyproj.CRS.from_wkt(crs)
    if vertical == ELLIPSOIDAL_DATUM:
        return crs, None
    try:
        heights = pyproj.CRS.from_user_input(VERTICAL_CODES.get(vertical, vertical))
    except pyproj.exceptions.CRSError:
        heights = flat
    if not heights.is_vertical:
        raise InputError(
            f"`vertical` {vertical!r} is no vertical reference: give ellipsoidal, egm96, egm2008 or the EPSG code of a "
            "vertical CRS (EPSG:5773)"
        )
    compound = pyproj.crs.CompoundCRS(f"{flat.name} + {heights.name}", [flat, heights]).to_wkt()
    return str(compound), operations_of(str(compound)).height_offsets


def write_surface(
    path: str,
    grid: Grid,
    crs: str,
    names: Sequence[str],
    tiles: Iterator[tuple[Any, Sequence[np.ndarray]]],
    form: OrthoFormat,
    progress: Progress,
    lineage: Mapping[str, str],
) -> None:
    """Write a surface model, or another raster of heights.

    crs : WKT with the vertical reference; grid : its cells
    names : of the bands; tiles : windows of the grid with the bands, NaN where there is no height

    Raises `OutputError` if it cannot be written, `Cancelled` if ``progress`` returns False.
    """

    def fill(dataset: gdal.Dataset, part: Progress) -> None:
        for number, name in enumerate(names, 1):
            dataset.GetRasterBand(number).SetDescription(name)
            dataset.GetRasterBand(number).SetNoDataValue(NODATA)
            if name != SURFACE_BANDS[-1]:
                dataset.GetRasterBand(number).SetUnitType("metre")
        is_ellipsoidal = not has_heights(pyproj.CRS.from_wkt(crs))
        dataset.SetMetadata({**lineage, **({VERTICAL_DATUM: ELLIPSOIDAL_HEIGHTS} if is_ellipsoidal else {})})
        for window, bands in tiles:
            advance(part, window.row / grid.rows, "fusing pairs")
            empty = np.isnan(bands[0])
            for band, values in enumerate(bands, 1):
                filled = np.where(empty, np.float32(NODATA), values)
                dataset.GetRasterBand(band).WriteArray(filled, window.column, window.row)

    layout = TileLayout(grid, crs, len(names), gdal.GDT_Float32)
    write_tiles(path, layout, fill, form, progress=progress)


STYLE = (
    "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
    '<qgis styleCategories="Symbology"><pipe><rasterrenderer type="hillshade" band="1" azimuth="315" angle="45" '
    'zfactor="1" multidirection="1" opacity="1" alphaBand="-1"/></pipe></qgis>\n'
)  # a file of this content next to a raster is its style in QGIS


class ShadedSurface(GdalRaster):
    """A surface model as a picture for `read_picture`: brighter where it is higher, and lit from the north-west."""

    def read_means(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """As `GdalRaster.read_means`."""
        height, valid = super().read_means(step)
        down, right = np.gradient(np.where(valid, height, np.nan), self.dataset.GetGeoTransform()[1] * step)
        slope = (right + down) / np.sqrt(2.0)
        shade = slope / (1.0 + np.abs(slope))  # -1 to 1: walls and trees do not use up the range
        valid &= np.isfinite(shade)
        low, high = np.percentile(height[valid], STRETCH.view_percent) if valid.any() else (0.0, 0.0)
        tone = np.clip((height - low) / (high - low), 0.0, 1.0) if high > low else 0.5
        return np.where(valid, tone + shade, 0.0).astype(np.float32), valid
