"""Chunks of orthoimages by GDAL's warper, which gets the finished mapping instead of an RPC.

The target of each chunk has a geolocation array of image positions, at every pixel or, on constant height, at nodes
between which GDAL interpolates bilinearly: the warper transforms target pixels to image pixels by a table. Therefore
all its resampling kernels, data types and masks can be used, without the cost of the RPC at every pixel. Only the
window of the image that a chunk needs is read.

Quick-looks: small images on a map, warped by an RPC at one height, to look at a result within seconds.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from osgeo import gdal, gdal_array

from ...block.block import Image
from ...camera.rpc import RPC
from ...foundation.errors import InputError, OutputError
from ...foundation.pixel_filters import STRETCH
from ...foundation.thresholds import EQUALITY, threshold, thresholds
from ..opening.datasets import config_option, gdal_messages
from ..opening.files import open_raster, read_pixels
from ..rpc_files.fields import gdal_metadata
from .images import GdalRaster

#: Resampling methods of GDAL's warper, with their radius in image pixels.
RESAMPLING = {
    "near": 1, "bilinear": 1, "cubic": 2, "cubicspline": 2, "lanczos": 3, "average": 1, "rms": 1, "mode": 1, "max": 1,
    "min": 1, "med": 1, "q1": 1, "q3": 1,
}  # fmt: skip

OUTSIDE_PX = 1e7  #: a position outside every image


@thresholds
class CHUNKS:
    """Division of an orthoimage into chunks that are warped and written."""

    tile_px: int = threshold(512, "px", "side of the tiles of a file", "GDAL's COG driver")
    columns_per_row: int = threshold(
        2, "px/px", "columns of a chunk for each row", "what GDAL does once for a chunk costs as much as about 50 rows"
    )
    least_rows: int = threshold(128, "px", "smallest number of rows of a chunk")


class Pixels(NamedTuple):
    """Pixels of a chunk ``(bands, rows, columns)`` and, if the orthoimage has a mask, ``valid (rows, columns)``."""

    values: np.ndarray
    valid: np.ndarray | None


class OrthoSource:
    """A raw image that several threads warp by chunks at the same time."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._raster = GdalRaster(path)
        self.size = self._raster.size
        dataset = self._raster.dataset
        bands = [dataset.GetRasterBand(number) for number in range(1, dataset.RasterCount + 1)]
        self._alpha = [b.GetColorInterpretation() == gdal.GCI_AlphaBand for b in bands]
        self.bands = [number for number, alpha in enumerate(self._alpha, 1) if not alpha]
        if not self.bands:
            raise InputError(f"{path}: has an alpha band only: name an image with grey values")
        self.data_type = bands[self.bands[0] - 1].DataType
        for number in self.bands:
            self.data_type = gdal.DataTypeUnion(self.data_type, bands[number - 1].DataType)
        self.nodata = [bands[number - 1].GetNoDataValue() for number in self.bands]
        self.masked = bool(bands[self.bands[0] - 1].GetMaskFlags() & gdal.GMF_PER_DATASET)

    @property
    def dataset(self) -> gdal.Dataset:
        """The GDAL dataset of the calling thread."""
        return self._raster.dataset

    @property
    def has_gaps(self) -> bool:
        """Whether some pixels may be invalid."""
        return self.masked or any(value is not None for value in self.nodata)

    @property
    def type_name(self) -> str:
        """GDAL's name of the data type of the pixels."""
        return str(gdal.GetDataTypeName(self.data_type))

    def holds(self, value: float) -> bool:
        """Return whether the data type can represent a value."""
        dtype = gdal_array.GDALTypeCodeToNumericTypeCode(self.data_type)
        if not self.is_integer:
            return True
        limits = np.iinfo(dtype)
        return bool(limits.min <= value <= limits.max and value == int(value)) if np.isfinite(value) else False

    @cached_property
    def is_integer(self) -> bool:
        return self.data_type not in (gdal.GDT_Float32, gdal.GDT_Float64, gdal.GDT_CFloat32, gdal.GDT_CFloat64)

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[list[np.ndarray], np.ndarray | None]:
        """Return the bands of a window, and its mask if the image has a mask or an alpha band."""
        return read_pixels(self.path, self.dataset, self.bands, (sample, line, samples, lines), self.masked)


@dataclass(frozen=True)
class Warp:
    """Parameters of the warping of chunks.

    resampling : a name of `RESAMPLING`; scale : pixels of the image per pixel of the map
    nodata : value of pixels outside the image; None if the orthoimage has a mask
    """

    resampling: str
    scale: float
    nodata: float | None

    @property
    def reach_px(self) -> int:
        """Distance around a position within which the kernel reads the image."""
        return math.ceil(RESAMPLING[self.resampling] * max(1.0, self.scale)) + 2


def warp_chunk(source: OrthoSource, mapping: Any, columns: int, rows: int, warp: Warp) -> Pixels | None:
    """Return the pixels of a chunk, None if the image does not cover any of it.

    mapping : `ortho.ChunkMapping`
    """
    low, high, step = mapping.low, mapping.high, str(mapping.step)
    # First sample and line, samples and lines of the required part of the image
    if np.isnan(low).any():
        return None
    first = np.clip(np.floor(low) - warp.reach_px, 0, source.size)
    extent = np.clip(np.ceil(high) + warp.reach_px + 1, 0, source.size) - first
    if not (extent > 0.0).all():
        return None
    sample, line, samples, lines = np.r_[first, extent].astype(int).tolist()
    is_complete = not source.has_gaps and mapping.is_complete
    is_complete = is_complete and bool((low >= 0.0).all() and (high <= np.array(source.size) - 1.0).all())
    # A window of the image as a dataset in memory, with its mask as an alpha band
    bands, mask = source.read(sample, line, samples, lines)
    image = gdal.GetDriverByName("MEM").Create("", samples, lines, len(bands), source.data_type)
    image.SetGeoTransform((sample - 0.5, 1.0, 0.0, line - 0.5, 0.0, 1.0))  # the table has positions in the whole image
    for number, values in enumerate(bands, 1):
        image.GetRasterBand(number).WriteArray(values)
    if mask is not None:
        image.AddBand(source.data_type)
        opaque = 1 if source.data_type != gdal.GDT_Byte else 255
        image.GetRasterBand(len(bands) + 1).WriteArray((mask != 0) * opaque)
        image.GetRasterBand(len(bands) + 1).SetColorInterpretation(gdal.GCI_AlphaBand)
    target = _make_target(source, columns, rows, warp.nodata or 0.0, _with_alpha(source, warp, is_complete))
    positions = _fill_unknown(mapping)
    _, table_rows, table_columns = positions.shape
    size = f"PIXELS={table_columns},LINES={table_rows},BANDS=2,DATATYPE=Float64"
    table = f"MEM:::DATAPOINTER={positions.ctypes.data},{size}"
    nodes = {  # at the centres of every ``step``-th pixel
        "X_DATASET": table,
        "X_BAND": "1",
        "Y_DATASET": table,
        "Y_BAND": "2",
        "SRS": "",
        "PIXEL_OFFSET": str(0.5 - mapping.first[0]),
        "LINE_OFFSET": str(0.5 - mapping.first[1]),
        "PIXEL_STEP": step,
        "LINE_STEP": step,
        "GEOREFERENCING_CONVENTION": "TOP_LEFT_CORNER",
    }
    target.SetMetadata(nodes, "GEOLOCATION")
    with (
        gdal_messages() as messages,
        config_option("CPL_TMPDIR", "/vsimem"),
        config_option("GDAL_MEM_ENABLE_OPEN", "YES"),  # of GDAL 3.10
    ):
        warped = gdal.Warp(target, image, options=_warp_options(source, warp, is_complete))
    if not warped:
        raise OutputError(f"{source.path}: GDAL cannot warp it ({messages.reason})")
    count = len(source.bands)
    values = target.ReadAsArray().reshape(-1, target.RasterYSize, target.RasterXSize)
    valid = values[count] != 0 if _with_alpha(source, warp, is_complete) else None
    values = values[:count]
    if warp.nodata is None:
        return Pixels(values, np.ones(values.shape[1:], dtype=bool) if valid is None else valid)
    if (is_complete or valid is not None) and not np.isnan(warp.nodata):
        change_nodata_values(values, warp.nodata, valid)
    return Pixels(values, None)


def mark_invalid(values: np.ndarray, valid: np.ndarray, nodata: float | None) -> Pixels:
    """Return grey values ``(bands, rows, columns)`` with nodata where they are not valid, or with a mask for None."""
    if nodata is None:
        return Pixels(np.where(valid, values, 0).astype(values.dtype), valid)
    change_nodata_values(values, nodata, valid)
    return Pixels(np.where(valid, values, np.array(nodata)).astype(values.dtype), None)


def change_nodata_values(values: np.ndarray, nodata: float, valid: np.ndarray | None) -> None:
    """Change grey values ``(bands, rows, columns)`` of valid pixels that equal nodata by the smallest step."""
    is_nodata_value = values == nodata
    if valid is not None:
        is_nodata_value &= valid
    if is_nodata_value.any():
        dtype = values.dtype  # by the smallest step that it has
        if np.issubdtype(dtype, np.integer):
            values[is_nodata_value] = nodata - 1 if nodata == np.iinfo(dtype).max else nodata + 1
        else:
            values[is_nodata_value] = np.nextafter(dtype.type(nodata), dtype.type(np.inf))


def _with_alpha(source: OrthoSource, warp: Warp, is_complete: bool) -> bool:
    """Return whether an alpha band of GDAL marks the pixels of a chunk that the image covers.

    This is so for an orthoimage with a mask, and if only the border of the image excludes pixels: GDAL's kernels are
    several times as fast without nodata values.
    """
    return not is_complete and (warp.nodata is None or not source.has_gaps)


def _make_target(source: OrthoSource, columns: int, rows: int, nodata: float, with_alpha: bool) -> gdal.Dataset:
    """Return an empty chunk in memory."""
    bands = len(source.bands) + with_alpha
    dataset = gdal.GetDriverByName("MEM").Create("", columns, rows, bands, source.data_type)
    if nodata:
        for number in range(1, len(source.bands) + 1):
            dataset.GetRasterBand(number).Fill(nodata)  # INIT_DEST is ignored for an existing dataset
    if with_alpha:
        dataset.GetRasterBand(bands).SetColorInterpretation(gdal.GCI_AlphaBand)
    return dataset


def _fill_unknown(mapping: Any) -> np.ndarray:
    """Return the positions ``(2, rows, columns)`` of a mapping in one piece of memory, all of them numbers.

    Unknown or hidden terrain is outside the image, on one side or the other: GDAL derives the part of the image that it
    reads from positions at the edge of the chunk, all of which may be unknown.
    """
    positions = np.ascontiguousarray(mapping.positions)
    if mapping.is_complete:
        return positions
    unknown, positions = np.isnan(positions), positions.copy()
    positions[unknown] = np.random.default_rng(0).choice([-OUTSIDE_PX, OUTSIDE_PX], np.count_nonzero(unknown))
    return positions


def _warp_options(source: OrthoSource, warp: Warp, is_complete: bool) -> gdal.GDALWarpAppOptions:
    """Return GDAL's options.

    The scale is that of the complete orthoimage: GDAL's own estimate, from the extents of the windows, differs between
    chunks. The table of the inverse, from image to map, is not needed and made as small as possible. Chunks run in
    parallel, so they need no threads of their own, each of which would copy the tables.
    """
    scale = 1.0 / warp.scale if warp.scale > (1.0 + EQUALITY.negligible) else 1.0
    options = [
        f"XSCALE={scale!r}",
        f"YSCALE={scale!r}",
        "SOURCE_EXTRA=100000",
        "SRC_FILL_RATIO_HEURISTICS=NO",
        "NUM_THREADS=1",
    ]
    if source.masked:
        options.append(f"SRC_ALPHA_MAX={255 if source.data_type == gdal.GDT_Byte else 1}")
    nodata = [value for value in source.nodata if value is not None]
    with_alpha = _with_alpha(source, warp, is_complete)
    return gdal.WarpOptions(
        transformerOptions=[
            "SRC_METHOD=GEOTRANSFORM",
            "DST_METHOD=GEOLOC_ARRAY",
            "GEOLOC_BACKMAP_OVERSAMPLE_FACTOR=0.1",
        ],
        warpOptions=options,
        errorThreshold=0.0,
        resampleAlg=warp.resampling,
        warpMemoryLimit=2000,
        srcNodata=" ".join(repr(value) for value in nodata) if len(nodata) == len(source.bands) else None,
        dstNodata=None if with_alpha or is_complete else repr(warp.nodata),
        srcAlpha=source.masked,
        dstAlpha=with_alpha,
    )


SIDE_PX = 1200  # longer side before warping


def write_quick_look(image: Image, rpc: RPC, height_m: float, path: str) -> None:
    """Write the first band of an image, warped by an RPC at an ellipsoidal height, as a GeoTIFF of bytes in WGS84.

    GDAL reads an overview of the image if it has one; the value 0 is outside. Raises `OutputError` if GDAL fails.
    """
    source = open_raster(image.path)
    size = np.array([source.RasterXSize, source.RasterYSize])
    step = max(size.max() / SIDE_PX, 1.0)
    columns, rows = np.maximum(np.round(size / step), 1).astype(int).tolist()
    with gdal_messages() as messages:
        small = gdal.Translate("", source, format="MEM", width=columns, height=rows, bandList=[1])
        grey = small.ReadAsArray().astype(np.float64)
        nodata = small.GetRasterBand(1).GetNoDataValue()
        valid_values = grey[np.isfinite(grey) & (grey != (0.0 if nodata is None else nodata))]
        black, white = np.percentile(valid_values, STRETCH.view_percent) if valid_values.size else (0.0, 1.0)
        stretched = np.clip(np.nan_to_num((grey - black) / max(white - black, 1e-9)), 0.0, 1.0)
        bytes_ = gdal.GetDriverByName("MEM").Create("", columns, rows, 1, gdal.GDT_Byte)
        bytes_.GetRasterBand(1).WriteArray((1.0 + 254.0 * stretched).astype(np.uint8))
        factor = size[0] / columns, size[1] / rows
        resampled = rpc.resample(factor, ((factor[0] - 1.0) / 2.0, (factor[1] - 1.0) / 2.0))
        bytes_.SetMetadata(gdal_metadata(resampled), "RPC")
        warped = gdal.Warp(
            path,
            bytes_,
            dstSRS="EPSG:4326",
            rpc=True,
            transformerOptions=[f"RPC_HEIGHT={height_m}"],
            resampleAlg="bilinear",
            dstNodata=0,
            creationOptions=["COMPRESS=DEFLATE", "TILED=YES"],
        )
    if warped is None:
        raise OutputError(f"{path}: GDAL cannot warp {image.path} ({messages.reason})")
