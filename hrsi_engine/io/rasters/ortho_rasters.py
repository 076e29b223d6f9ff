"""Finished orthoimages, opened for comparison: their georeference, and resampling to the grid of another one.

`open_reference` opens any georeferenced raster that GDAL reads, in any CRS, as a reference.

Orthoimages as sources of a mosaic, its labels on disk, and their areas as polygons.
"""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj
from osgeo import gdal, gdal_array, ogr
from shapely import wkb
from shapely.geometry import Polygon

from ...block.orthoimage import Orthoimage
from ...foundation.errors import InputError, OutputError
from ...ground.crs_operations import operations_of
from ...ground.geodesy import metres_per_degree
from ..opening.datasets import gdal_messages
from ..opening.files import read_pixels
from ..opening.georeference import Georeference
from ..safety.replacing import open_hidden_folder
from .images import GdalRaster
from .ortho_warp import CHUNKS, OrthoSource, Pixels, mark_invalid
from .orthoimages import Grid


@dataclass(frozen=True, eq=False)
class OrthoRaster:
    """The first band of an orthoimage, north up, with its CRS (WKT) and GDAL's geotransform."""

    path: str
    raster: GdalRaster
    crs: str
    geotransform: tuple[float, ...]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north in units of the CRS."""
        west, step_x, _, north, _, step_y = self.geotransform
        columns, rows = self.raster.size
        return west, north + rows * step_y, west + columns * step_x, north

    def lonlat(self, pixels: np.ndarray) -> np.ndarray:
        """Return lon, lat ``(n, 2)`` of column, row ``(n, 2)``; (0, 0) is the centre of the first pixel."""
        west, step_x, _, north, _, step_y = self.geotransform
        x, y = west + (pixels[:, 0] + 0.5) * step_x, north + (pixels[:, 1] + 0.5) * step_y
        return operations_of(self.crs).to_wgs84(np.column_stack([x, y, np.zeros(len(x))]))[:, :2]

    def pixel_m(self) -> tuple[float, float]:
        """Return width and height of a pixel in metres."""
        crs = pyproj.CRS.from_wkt(self.crs)
        size = np.abs([self.geotransform[1], self.geotransform[5]])
        if not crs.is_geographic:
            width, height = (size * crs.axis_info[0].unit_conversion_factor).tolist()
            return width, height
        middle = np.column_stack([self.lonlat(np.array([self.raster.size]) / 2.0), [0.0]])
        width, height = (size * metres_per_degree(middle)[0, :2]).tolist()
        return width, height


def open_ortho(path: str) -> OrthoRaster:
    """Open an orthoimage.

    path : any raster that GDAL opens
    Result: its grid and pixels.
    Raises `InputError`: it is not georeferenced, or not north up.
    """
    raster = GdalRaster(path)
    dataset = raster.dataset
    wkt, geotransform = dataset.GetProjection(), dataset.GetGeoTransform(can_return_null=True)
    if not wkt or geotransform is None:
        raise InputError(f"{path}: is no orthoimage: it has no CRS or geotransform; use hrsi orthorectify first")
    if geotransform[2] or geotransform[4] or geotransform[1] <= 0.0 or geotransform[5] >= 0.0:
        raise InputError(f"{path}: is not north up: warp it first (gdalwarp)")
    return OrthoRaster(path, raster, wkt, tuple(geotransform))


def offset_of(first: OrthoRaster, second: OrthoRaster) -> tuple[int, int] | None:
    """Return column and row of the second orthoimage's first pixel in the first one; None if their grids differ."""
    if not pyproj.CRS.from_wkt(first.crs).equals(pyproj.CRS.from_wkt(second.crs), ignore_axis_order=True):
        return None
    size = np.array([first.geotransform[1], first.geotransform[5]])
    second_size = np.array([second.geotransform[1], second.geotransform[5]])
    if np.abs(second_size / size - 1.0).max() > 1e-7:
        return None
    offset = np.array([second.geotransform[k] - first.geotransform[k] for k in (0, 3)]) / size
    rounded = np.rint(offset)
    return (int(rounded[0]), int(rounded[1])) if np.abs(offset - rounded).max() <= 0.01 else None  # equal grids


def resample_to_grid(ortho: OrthoRaster, like: OrthoRaster) -> OrthoRaster:
    """Return an orthoimage on the grid and extent of another; warped (cubic) when it is read.

    If the datums differ, GDAL uses PROJ's best operation between them for the extent. It equals that of `operations_of`
    if it passes through WGS84; a direct one, as from GDA94 to GDA2020, is better than two that state metres.
    """
    path = f"/vsimem/hrsi-{secrets.token_hex(8)}.vrt"
    result = None
    with gdal_messages() as messages:
        result = gdal.Warp(
            path, ortho.path, format="VRT", outputBounds=like.bounds, width=like.raster.size[0],
            height=like.raster.size[1], dstSRS=like.crs, resampleAlg="cubic", errorThreshold=0.0, dstAlpha=True,
        )  # fmt: skip
    if result is None:
        raise InputError(f"{ortho.path}: cannot be brought onto the pixels of {like.path} ({messages.reason})")
    del result
    return OrthoRaster(ortho.path, GdalRaster(path), like.crs, like.geotransform)


@dataclass(frozen=True, eq=False)
class BandMean:
    """The mean of an image's bands, which approximates a panchromatic band; valid where all bands are."""

    bands: tuple[GdalRaster, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Number of samples and lines."""
        return self.bands[0].size

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """As `Raster.read`."""
        total, valid = np.zeros((lines, samples), dtype=np.float32), np.ones((lines, samples), dtype=bool)
        for band in self.bands:
            grey, is_valid = band.read(sample, line, samples, lines)
            total += np.where(is_valid, grey, 0)
            valid &= is_valid
        return np.where(valid, total / np.float32(len(self.bands)), np.float32(0.0)), valid


def open_reference(path: str, band: int | None = None, epoch: float | None = None) -> Orthoimage:
    """Open an orthoimage.

    path : any raster that GDAL opens, with a CRS and a geotransform
    band : number of the band, from 1; by default the mean of all bands except alpha
    epoch : year at which coordinates in a plate-fixed CRS are transformed to WGS84
    Result: its grey values on the ground.
    Raises `InputError`: it cannot be opened, or has no CRS or geotransform.
    """
    first = GdalRaster(path, band or 1)
    place = Georeference(first.dataset, path, "orthoimage", epoch=epoch)
    meanings = [first.dataset.GetRasterBand(n + 1).GetColorInterpretation() for n in range(first.dataset.RasterCount)]
    colour_bands = [number for number, meaning in enumerate(meanings, 1) if meaning != gdal.GCI_AlphaBand]
    several = band is None and len(colour_bands) > 1
    raster = BandMean(tuple(GdalRaster(path, number) for number in colour_bands)) if several else first
    uses = place.operations.uses_at(path, place.nodes_lonlat())
    return Orthoimage(raster, place.to_grid, place.to_lonlat, path, uses)


Box = tuple[int, int, int, int]  # first column, first row, columns, rows of the mosaic


class MosaicSource:
    """An orthoimage as a part of a mosaic, on whose grid it is read; several threads may read.

    path : the orthoimage; own, grid : its grid and that of the mosaic, on one lattice
    """

    def __init__(self, path: str, own: Grid, grid: Grid) -> None:
        self._left, self._top = own.left - grid.left, grid.top - own.top
        self._size = own.columns, own.rows
        self._view = f"/vsimem/hrsi-{secrets.token_hex(8)}.vrt"
        size = {"outputBounds": grid.bounds, "xRes": grid.resolution, "yRes": grid.resolution}
        with gdal_messages() as messages:
            built = gdal.BuildVRT(self._view, [path], **size)
        if built is None:
            raise OutputError(f"{path}: cannot be read for the mosaic ({messages.reason}): remove it and run again")
        del built
        self.pixels = OrthoSource(self._view)

    def meets(self, box: Box) -> bool:
        """Return whether the orthoimage and a box of the mosaic have common pixels."""
        column, row, columns, rows = box
        return (
            self._left < column + columns
            and column < self._left + self._size[0]
            and self._top < row + rows
            and row < self._top + self._size[1]
        )

    def read(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Return the grey values ``(bands, rows, columns)``, float32, of a box of the mosaic, and which are valid."""
        bands, mask = self.pixels.read(*box)
        values = np.array(bands, dtype=np.float32)
        if mask is not None:
            return values, mask != 0
        nodata = self.pixels.nodata[0]
        if nodata is None:
            return values, np.ones(values.shape[1:], dtype=bool)
        return values, ~np.isnan(values[0]) if np.isnan(nodata) else bands[0] != nodata

    def read_overview(self, band: int, columns: int, rows: int) -> np.ndarray:
        """Return a band of the complete mosaic reduced to ``(rows, columns)`` by means, NaN where there is nothing."""
        how = {"buf_xsize": columns, "buf_ysize": rows, "resample_alg": gdal.GRIORA_Average}
        window = (0, 0, *self.pixels.size)
        (values,), mask = read_pixels(self._view, self.pixels.dataset, [self.pixels.bands[band]], window, True, **how)
        return np.where(mask == 0, np.nan, values).astype(np.float32)

    def encode(self, values: np.ndarray, valid: np.ndarray) -> Pixels:
        """Return grey values ``(bands, rows, columns)`` in the data type of the image, with its mask or nodata."""
        dtype = gdal_array.GDALTypeCodeToNumericTypeCode(self.pixels.data_type)
        nodata = self.pixels.nodata[0]
        if self.pixels.is_integer:
            limits = np.iinfo(dtype)
            values = np.clip(np.rint(values), limits.min, limits.max)
        return mark_invalid(values.astype(dtype), valid, None if self.pixels.masked else nodata)

    def close(self) -> None:
        """Remove the view of the orthoimage from memory."""
        gdal.Unlink(self._view)


class LabelFile:
    """Numbers of the images that the pixels of a mosaic are taken from, from 1; 0: none. A file of tiles on disk."""

    def __init__(self, path: str, grid: Grid) -> None:
        options = [
            "TILED=YES",
            f"BLOCKXSIZE={CHUNKS.tile_px}",
            f"BLOCKYSIZE={CHUNKS.tile_px}",
            "COMPRESS=LZW",
            "BIGTIFF=IF_SAFER",
            "SPARSE_OK=TRUE",
        ]
        self._dataset = gdal.GetDriverByName("GTiff").Create(path, grid.columns, grid.rows, 1, gdal.GDT_UInt16, options)
        if self._dataset is None:
            raise OutputError(f"{path}: cannot be written: check the folder and its free space")
        self._dataset.SetGeoTransform(grid.geotransform)

    def write(self, column: int, row: int, labels: np.ndarray) -> None:
        """Write labels ``(rows, columns)``; -1 is none."""
        self._dataset.GetRasterBand(1).WriteArray((labels + 1).astype(np.uint16), column, row)

    def read(self, box: Box) -> np.ndarray:
        """Return labels ``(rows, columns)``; -1 is none."""
        return np.asarray(self._dataset.GetRasterBand(1).ReadAsArray(*box)).astype(np.int64) - 1

    def find_areas(self) -> list[tuple[int, Polygon]]:
        """Return the connected areas of equal labels as polygons in the CRS of the mosaic, with their label."""
        self._dataset.FlushCache()
        areas = ogr.GetDriverByName("Memory").CreateDataSource("")
        layer = areas.CreateLayer("areas", None, ogr.wkbPolygon)
        layer.CreateField(ogr.FieldDefn("label", ogr.OFTInteger))
        band = self._dataset.GetRasterBand(1)
        gdal.Polygonize(band, band, layer, 0)
        return [(one.GetField(0) - 1, wkb.loads(bytes(one.GetGeometryRef().ExportToWkb()))) for one in layer]


@contextmanager
def open_labels(folder: str, grid: Grid) -> Iterator[LabelFile]:
    """Yield a file of labels in a hidden folder, which is removed at the end."""
    with open_hidden_folder(folder) as hidden_folder:
        yield LabelFile(str(Path(hidden_folder) / "labels.tif"), grid)
