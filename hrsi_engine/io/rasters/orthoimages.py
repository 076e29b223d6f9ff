"""Orthoimages on disk: written in chunks, completed as COG or GeoTIFF, and replaced in one step.

Chunks may be made (`make_chunk`) by threads or on other machines. Since they are written in a fixed order, the bytes of
the file are the same.

The metadata of an orthoimage contain the fingerprint of its inputs and options: a later run with the same fingerprint
keeps the file.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from osgeo import gdal

from ...foundation.errors import OutputError
from ...foundation.json_values import json_text
from ...foundation.progress import Progress, advance, stage
from ...foundation.workers.threads import thread_count
from ..opening.datasets import config_option, gdal_messages, metadata_of, open_dataset
from ..rpc_files.write import create_copy
from ..safety.content_marks import content_mark
from ..safety.replacing import open_hidden_folder, replacing
from .ortho_warp import CHUNKS, OrthoSource, Pixels, Warp, warp_chunk

#: Metadata items; in the default domain, because GDAL's COG driver drops the others.
FINGERPRINT, FIGURES = "HRSI_ORTHO_FINGERPRINT", "HRSI_ORTHO_FIGURES"
WARPED_SHARE = 0.85  # of the running time of a COG; the rest writes the final format
TILED = ("TILED=YES", f"BLOCKXSIZE={CHUNKS.tile_px}", f"BLOCKYSIZE={CHUNKS.tile_px}", "BIGTIFF=IF_SAFER")
INTERNAL_MASK = "GDAL_TIFF_INTERNAL_MASK", "YES"  # a mask file would have to be renamed, too
#: By the choice of `format`: GDAL driver, and its options besides the compression.
FORMATS: dict[str, tuple[str, tuple[str, ...]]] = {
    "cog": ("COG", (f"BLOCKSIZE={CHUNKS.tile_px}", "OVERVIEWS=AUTO", "BIGTIFF=IF_SAFER")),  # overviews are copied
    "gtiff": ("GTiff", TILED),
}
COMPRESSION = ("deflate", "lzw", "zstd", "none")
#: Resampling of overviews by that of the orthoimage, if it is not the mean: classes must not be averaged.
OVERVIEW_RESAMPLING = {"near": "NEAREST", "mode": "MODE"}


Grid = Any  # `ortho.MapGrid`: crs as WKT, columns, rows, GDAL's geotransform, and chunks (column, row, columns, rows)
MapChunk = Callable[[Any], Any]  # window -> `ortho.ChunkMapping`, None if the image does not cover it


class OrthoChunk(NamedTuple):
    """A window of an orthoimage.

    pixels : None if the image does not cover any of them
    errors_px : (k,) distances between interpolated and exact positions
    unknown : number of pixels within the image without terrain height; hidden : those that the terrain hides
    """

    window: Any
    pixels: Pixels | None
    errors_px: np.ndarray
    unknown: int
    hidden: int = 0


def make_chunk(source: OrthoSource, map_chunk: MapChunk, warp: Warp, window: Any) -> OrthoChunk:
    """Return a window of an orthoimage: its mapping and its warped pixels."""
    mapping = map_chunk(window)
    if mapping is None:
        return OrthoChunk(window, None, np.empty(0), 0)
    pixels = warp_chunk(source, mapping, window.columns, window.rows, warp)
    return OrthoChunk(window, pixels, mapping.errors_px, mapping.unknown, mapping.hidden)


def chunk_windows(grid: Grid, warp: Warp) -> Iterator[Any]:
    """Yield the windows of an orthoimage's chunks in the order in which they are written: tile by tile."""
    rows = CHUNKS.tile_px
    # Part of the image that a chunk needs: not larger than a tile
    while rows > CHUNKS.least_rows and rows * warp.scale > CHUNKS.tile_px:
        rows //= 2
    for tiles in grid.chunks(CHUNKS.columns_per_row * CHUNKS.tile_px, CHUNKS.tile_px):
        yield from tiles.parts(CHUNKS.columns_per_row * rows, rows)


@dataclass(frozen=True)
class OrthoFormat:
    """Storage format of orthoimages.

    name : one of `FORMATS`; compression : one of `COMPRESSION`
    """

    name: str
    compression: str

    def creation_options(self, data_type: int) -> list[str]:
        """Return GDAL's creation options for the format, ``NAME=VALUE``; the threads of the run compress."""
        driver, options = FORMATS[self.name]
        creation = [*options, f"COMPRESS={self.compression.upper()}", f"NUM_THREADS={thread_count()}"]
        if self.compression != "none":
            is_float = data_type in (gdal.GDT_Float32, gdal.GDT_Float64)
            creation.append("PREDICTOR=YES" if driver == "COG" else f"PREDICTOR={3 if is_float else 2}")
        return creation


@dataclass
class OrthoFigures:
    """Figures of a written orthoimage: pixels shown, without terrain, hidden, and errors of random pixels (px)."""

    shown: int = 0
    unknown: int = 0
    hidden: int = 0
    errors_px: list[np.ndarray] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """Return the figures as in the report."""
        errors = np.concatenate([np.empty(0), *self.errors_px])
        none = not len(errors)
        return {
            "shown_pixels": self.shown,
            "unknown_pixels": self.unknown,
            "hidden_pixels": self.hidden,
            "checked": len(errors),
            "position_error_max_px": None if none else float(errors.max()),
            "position_error_p99_px": None if none else float(np.percentile(errors, 99.0)),
            "position_error_rms_px": None if none else float(np.sqrt(np.mean(errors**2))),
        }


def fingerprint(made_from: Mapping[str, Any]) -> str:
    """Return a short text that differs if any input or option of an orthoimage differs."""
    return hashlib.sha256(json_text(made_from, sort_keys=True).encode()).hexdigest()[:32]


def stamp_of(path: str) -> str | None:
    """Return the fingerprint in an orthoimage's metadata; None if it has none or cannot be read."""
    dataset, _ = open_dataset(path) if os.path.exists(path) else (None, "")
    return None if dataset is None else metadata_of(dataset).get(FINGERPRINT)


def read_figures(path: str) -> dict[str, Any]:
    """Return the figures in an orthoimage's metadata, `OrthoFigures.summary` of its computation."""
    dataset, message = open_dataset(path)
    if dataset is None:
        raise OutputError(f"{path}: cannot be read ({message}): remove it and run again")
    return dict(json.loads(metadata_of(dataset)[FIGURES]))


def file_state(path: str) -> list[Any]:
    """Return absolute path and content mark of a dataset."""
    return [os.path.abspath(path), content_mark(path)]


def write_orthoimage(
    path: str,
    source: OrthoSource,
    grid: Grid,
    chunks: Iterator[OrthoChunk],
    warp: Warp,
    form: OrthoFormat,
    made_from: Mapping[str, Any],
    progress: Progress,
    lineage: Mapping[str, str] | None = None,
) -> OrthoFigures:
    """Write an orthoimage; return its figures.

    path : the file, replaced in one step; source : the image; grid : pixels of the map
    chunks : those of `chunk_windows`, in that order; only as many as the orthoimage has are used
    warp : interpolation of grey values; form : storage format
    made_from : inputs and options, whose fingerprint is stored
    progress : callback; False cancels; lineage : metadata items on the origin
    Result: figures of the written orthoimage.
    Raises `OutputError`: the file cannot be written; `Cancelled`: ``progress`` returned False.
    """
    figures, total = OrthoFigures(), sum(1 for _ in chunk_windows(grid, warp))

    def fill(dataset: gdal.Dataset, part: Progress) -> None:
        for number, origin in enumerate(source.bands, 1):
            copy_band_properties(source.dataset.GetRasterBand(origin), dataset.GetRasterBand(number), warp.nodata)
        if warp.nodata is None:
            with config_option(*INTERNAL_MASK):
                dataset.CreateMaskBand(gdal.GMF_PER_DATASET)
        for chunks_done, chunk in enumerate(islice(chunks, total)):
            advance(part, chunks_done / total, f"writing {os.path.basename(path)}")
            figures.unknown += chunk.unknown
            figures.hidden += chunk.hidden
            figures.errors_px.append(chunk.errors_px)
            if chunk.pixels is not None:
                figures.shown += _write_chunk(dataset, chunk.window, chunk.pixels, warp)
        figures_text = json_text(figures.summary())
        dataset.SetMetadata({FINGERPRINT: fingerprint(made_from), FIGURES: figures_text, **(lineage or {})})

    layout = TileLayout(grid, grid.crs, len(source.bands), source.data_type)
    overviews = OVERVIEW_RESAMPLING.get(warp.resampling, "AVERAGE")
    write_tiles(path, layout, fill, form, progress=progress, overviews=overviews)
    return figures


class TileLayout(NamedTuple):
    """Cells of a raster on a map, its CRS (WKT), which may have a vertical part, its bands and GDAL's data type."""

    grid: Grid
    crs: str
    bands: int
    data_type: int


def write_tiles(
    path: str,
    layout: TileLayout,
    fill: Callable[[gdal.Dataset, Progress], None],
    form: OrthoFormat,
    progress: Progress,
    overviews: str = "AVERAGE",
) -> None:
    """Write a raster whose properties and pixels ``fill`` writes; a COG is a copy of a hidden file with them.

    Raises `OutputError` if it cannot be written, `Cancelled` if ``progress`` returns False.
    """
    grid, driver = layout.grid, FORMATS[form.name][0]

    def write(target: str, tile_options: Sequence[str], part: Progress) -> None:
        with gdal_messages() as messages:
            dataset = gdal.GetDriverByName("GTiff").Create(
                target, grid.columns, grid.rows, layout.bands, layout.data_type, list(tile_options)
            )
            is_created = dataset is not None
            if dataset is not None:
                dataset.SetProjection(layout.crs)
                dataset.SetGeoTransform(grid.geotransform)
                fill(dataset, part)
            del dataset  # closed here, so that failures of the last writing are noticed
        if messages or not is_created:
            raise OutputError(f"{path}: cannot be written ({messages.reason})")

    options = form.creation_options(layout.data_type)
    with open_hidden_folder(os.path.dirname(os.path.abspath(path))) as hidden_folder, replacing(path) as temporary:
        if driver == "GTiff":
            write(temporary, options, progress)
        else:
            plain = os.path.join(hidden_folder, "tiles.tif")
            write(plain, (*TILED, "SPARSE_OK=TRUE"), stage(progress, 0.0, WARPED_SHARE))
            _add_overviews(plain, overviews)
            part = stage(progress, WARPED_SHARE, 1.0)
            create_copy(gdal.Open(plain), temporary, path, driver, options, part)


def copy_band_properties(origin: gdal.Band, band: gdal.Band, nodata: float | None) -> None:
    """Copy name, colour interpretation, scale, offset and unit of a band to another one, and set its nodata value."""
    band.SetDescription(origin.GetDescription())
    band.SetColorInterpretation(origin.GetColorInterpretation())
    stated = ((band.SetScale, origin.GetScale()), (band.SetOffset, origin.GetOffset()), (band.SetNoDataValue, nodata))
    for set_value, value in (*stated, (band.SetUnitType, origin.GetUnitType() or None)):
        if value is not None:
            set_value(value)


def _write_chunk(dataset: gdal.Dataset, window: Any, pixels: Pixels, warp: Warp) -> int:
    """Write a chunk; return the number of its pixels that show the image."""
    for number, values in enumerate(pixels.values, 1):
        dataset.GetRasterBand(number).WriteArray(values, window.column, window.row)
    if pixels.valid is not None:
        mask = dataset.GetRasterBand(1).GetMaskBand()
        mask.WriteArray(np.where(pixels.valid, 255, 0).astype(np.uint8), window.column, window.row)
        return int(np.count_nonzero(pixels.valid))
    nodata = np.nan if warp.nodata is None else warp.nodata  # float types use NaN
    empty = np.isnan(pixels.values[0]) if np.isnan(nodata) else pixels.values[0] == nodata
    return int(empty.size - np.count_nonzero(empty))


def _add_overviews(plain: str, resampling: str) -> None:
    """Add overviews to the chunks, uncompressed: the COG driver would compress and decompress its own in between."""
    dataset = gdal.Open(plain, gdal.GA_Update)
    factors: list[int] = []
    while max(dataset.RasterXSize, dataset.RasterYSize) > CHUNKS.tile_px << len(factors):
        factors.append(2 << len(factors))
    if not factors:
        return
    with gdal_messages() as messages:
        dataset.BuildOverviews(resampling, factors)
        dataset.FlushCache()
    if messages:
        raise OutputError(f"{plain}: cannot be written ({messages[-1]})")
