"""Orthoimages as sources of a mosaic, its labels on disk, and their areas as polygons."""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from osgeo import gdal, gdal_array, ogr
from shapely import wkb
from shapely.geometry import Polygon

from ...foundation.errors import OutputError
from ..opening.datasets import gdal_messages
from ..opening.files import read_pixels
from ..safety.replacing import open_hidden_folder
from .ortho_warp import CHUNKS, OrthoSource, Pixels, mark_invalid
from .orthoimages import Grid

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
            self._left < column + columns and column < self._left + self._size[0]
            and self._top < row + rows and row < self._top + self._size[1]
        )  # fmt: skip

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
        options = ["TILED=YES", f"BLOCKXSIZE={CHUNKS.tile_px}", f"BLOCKYSIZE={CHUNKS.tile_px}", "COMPRESS=LZW",
                   "BIGTIFF=IF_SAFER", "SPARSE_OK=TRUE"]  # fmt: skip
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
