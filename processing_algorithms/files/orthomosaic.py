"""The mosaic of a block's orthoimages, and the layer of its seamlines.

The image of every pixel is determined first and stored in a file of labels, tile by tile; then the grey values are
levelled, blended and written, as those of an orthoimage. Memory does not grow with the mosaic.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyproj
from shapely.ops import transform

from ...hrsi_engine.block.imaging_geometry import ViewDirection
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.foundation.progress import Progress, advance, stage
from ...hrsi_engine.foundation.workers.scheduling import open_calls
from ...hrsi_engine.ground.crs_operations import operations_of
from ...hrsi_engine.ground.geodesy import WGS84
from ...hrsi_engine.io.catalogue.lineage import versions
from ...hrsi_engine.io.geopackage.declared_layers import SeamlineRows
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.rasters.ortho_rasters import LabelFile, MosaicSource, open_labels
from ...hrsi_engine.io.rasters.ortho_warp import Warp
from ...hrsi_engine.io.rasters.orthoimages import (
    OrthoChunk,
    chunk_windows,
    fingerprint,
    read_figures,
    stamp_of,
    write_orthoimage,
)
from ...hrsi_engine.ortho import mosaicking
from ...hrsi_engine.ortho.grid import GridWindow, MapGrid
from ..declarations.orthoimages import MOSAIC_FILE, SEAMLINES_FILE, SEAMLINES_LAYER, OrthorectifyOptions
from ..interface.declare import Report
from .orthoimage_plan import DECISIVE, BlockPlan, OrthoJob

LABELLED_SHARE = 0.4  # of the running time, until the mosaic is written
MANY_IMAGES = 8  # from which seamlines are searched at a lower resolution, so that memory does not grow
BLEND_REACH = int(np.ceil(4.0 * mosaicking.MOSAIC.blend_px)) + 1  # pixels around a window with influence on it


@dataclass(frozen=True, eq=False)
class MosaicPlan:
    """The mosaic of finished orthoimages: its grid, and incidence angles of the images at their middle."""

    jobs: Sequence[OrthoJob]
    grid: MapGrid
    incidence_deg: Sequence[float]
    path: str
    made_from: Mapping[str, Any]

    @property
    def seamlines(self) -> str:
        """Path of the layer of seamlines."""
        return os.path.join(os.path.dirname(self.path), SEAMLINES_FILE)

    @property
    def key(self) -> str:
        """Fingerprint that the mosaic will contain."""
        return fingerprint(self.made_from)

    @property
    def is_finished(self) -> bool:
        """Whether the mosaic and its seamlines exist, made from the same orthoimages."""
        return stamp_of(self.path) == self.key and os.path.exists(self.seamlines)


def plan_mosaic(jobs: Sequence[OrthoJob], plan: BlockPlan, options: OrthorectifyOptions) -> MosaicPlan:
    """Return the mosaic of all orthoimages; raise `InputError` if their bands differ."""
    first = jobs[0]
    for job in jobs:
        for name, one, other in (
            ("number of bands", len(job.source.bands), len(first.source.bands)),
            ("data type", job.source.type_name, first.source.type_name),
            ("nodata", str(job.warp.nodata), str(first.warp.nodata)),
        ):
            if one != other:
                raise InputError(
                    f"`mosaic` needs images of one kind: the {name} of {job.image.id} is {one}, and that of "
                    f"{first.image.id} {other}: make the mosaics in two runs, or set `nodata`"
                )
    grids = [job.grid for job in jobs]
    left, top = min(grid.left for grid in grids), max(grid.top for grid in grids)
    right, bottom = max(grid.left + grid.columns for grid in grids), min(grid.top - grid.rows for grid in grids)
    grid = MapGrid(first.grid.crs, first.grid.resolution, left, top, right - left, top - bottom)
    incidence = [ViewDirection(job.image, plan.terrain.surface).geometry().incidence_deg for job in jobs]
    used = versions()
    made_from = {
        "orthoimages": [job.key for job in jobs],
        "format": first.form.name,
        "compression": first.form.compression,
        "versions": {name: used[name] for name in DECISIVE},
    }
    return MosaicPlan(jobs, grid, incidence, os.path.join(options.folder.output_dir, MOSAIC_FILE), made_from)


def make_mosaic(plan: MosaicPlan, options: OrthorectifyOptions, progress: Progress, record: Report) -> Report:
    """Make the mosaic and its seamlines unless they exist; return the entry of the report."""
    entry = {
        "output": plan.path,
        "seamlines": plan.seamlines,
        "columns": plan.grid.columns,
        "rows": plan.grid.rows,
        "bounds": list(plan.grid.bounds),
        "incidence_deg": {job.image.id: angle for job, angle in zip(plan.jobs, plan.incidence_deg, strict=True)},
    }
    if plan.is_finished:
        return {**entry, "status": "kept", **_select_counts(read_figures(plan.path))}
    with ExitStack() as stack:
        sources = [MosaicSource(job.path, job.grid, plan.grid) for job in plan.jobs]
        for source in sources:
            stack.callback(source.close)
        mosaic = _Mosaic(plan, sources)
        labels = stack.enter_context(open_labels(options.folder.output_dir, plan.grid))
        calls = stack.enter_context(open_calls())
        windows = list(chunk_windows(plan.grid, mosaic.warp))
        for number, (window, part) in enumerate(zip(windows, calls.answers(mosaic.label, windows), strict=True)):
            advance(progress, LABELLED_SHARE * number / len(windows), "choosing the image of each pixel")
            labels.write(window.column, window.row, part)
        write_geopackage(plan.seamlines, [_make_seamlines(plan, labels)])
        lineage = {
            "HRSI_VERSION": record["version"],
            "HRSI_ALGORITHM": record["algorithm"],
            "HRSI_SOURCE": ", ".join(os.path.basename(job.path) for job in plan.jobs),
        }
        parts = ((window, labels.read(_enlarge(window, plan.grid, BLEND_REACH))) for window in windows)
        figures = write_orthoimage(
            plan.path,
            sources[0].pixels,
            plan.grid,
            chunks=calls.answers(mosaic.make_chunk, parts),
            warp=mosaic.warp,
            form=plan.jobs[0].form,
            made_from=plan.made_from,
            progress=stage(progress, LABELLED_SHARE, 1.0),
            lineage=lineage,
        )
    levels = {job.image.id: level.tolist() for job, level in zip(plan.jobs, mosaic.levels, strict=True)}
    return {**entry, "status": "made", **_select_counts(figures.summary()), "gain_offset": levels}


def _select_counts(figures: Mapping[str, Any]) -> Report:
    return {"shown_pixels": figures["shown_pixels"], "unfilled_pixels": figures["unknown_pixels"]}


def _enlarge(window: GridWindow, grid: MapGrid, reach: int) -> GridWindow:
    """Return a window enlarged by a number of pixels on each side, within a grid."""
    column, row = max(0, window.column - reach), max(0, window.row - reach)
    right = min(grid.columns, window.column + window.columns + reach)
    bottom = min(grid.rows, window.row + window.rows + reach)
    return GridWindow(column, row, right - column, bottom - row)


class _Mosaic:
    """The computation of windows of a mosaic; several threads may call it.

    areas : (rows, columns) image of each area, at reduced resolution; levels : (n, bands, 2) gain and offset
    """

    def __init__(self, plan: MosaicPlan, sources: Sequence[MosaicSource]) -> None:
        self._plan, self._sources = plan, sources
        self.warp = Warp("average", 1.0, plan.jobs[0].warp.nodata)
        limit = mosaicking.MOSAIC.reduced_px / max(1.0, len(sources) / MANY_IMAGES)
        factor = max(1.0, float(np.sqrt(plan.grid.columns * plan.grid.rows / limit)))
        columns, rows = (max(1, round(count / factor)) for count in (plan.grid.columns, plan.grid.rows))
        levels, grey = [], np.zeros((len(sources), rows, columns), dtype=np.float32)
        for band in range(len(sources[0].pixels.bands)):
            values = np.array([source.read_overview(band, columns, rows) for source in sources])
            levels.append(mosaicking.fit_levels(values))
            gain, offset = levels[-1].astype(np.float32).T[..., None, None]
            grey += gain * values + offset
        self.levels = np.stack(levels, axis=1)
        self.areas = mosaicking.find_seams(grey, plan.incidence_deg)

    def label(self, window: GridWindow) -> np.ndarray:
        """Return the image of each pixel of a window; -1: none."""
        box = _enlarge(window, self._plan.grid, mosaicking.ORTHO.margin_px)
        images = [number for number, source in enumerate(self._sources) if source.meets(box)]
        valid = np.zeros((len(self._sources), box.rows, box.columns), dtype=bool)
        for number in images:
            valid[number] = self._sources[number].read(box)[1]
        order = sorted(images, key=lambda number: self._plan.incidence_deg[number])
        return _cut(mosaicking.choose_images(valid, self._find_areas(box), order), box, window)

    def make_chunk(self, part: tuple[GridWindow, np.ndarray]) -> OrthoChunk:
        """Return the pixels of a window, of which the labels of the window enlarged by `BLEND_REACH` are given."""
        window, labels = part
        box = _enlarge(window, self._plan.grid, BLEND_REACH)
        present = np.unique(labels[labels != mosaicking.NONE]).tolist()
        gaps = (labels == mosaicking.NONE) & (self._find_areas(box) != mosaicking.NONE)
        unfilled = int(np.count_nonzero(_cut(gaps, box, window)))
        if not present:
            return OrthoChunk(window, None, np.empty(0), unfilled)
        gain, offset = np.moveaxis(self.levels[present].astype(np.float32), 2, 0)[..., None, None]
        read = [self._sources[number].read(box) for number in present]
        values = gain * np.array([values for values, _ in read]) + offset
        shown = _cut(labels != mosaicking.NONE, box, window)
        numbers = np.searchsorted(present, labels)
        numbers[labels == mosaicking.NONE] = mosaicking.NONE
        mosaic = _cut(mosaicking.blend(values, np.array([valid for _, valid in read]), numbers), box, window)
        return OrthoChunk(window, self._sources[0].encode(mosaic, shown), np.empty(0), unfilled)

    def _find_areas(self, box: GridWindow) -> np.ndarray:
        """Return the image of the area of each pixel of a box."""
        rows, columns = self.areas.shape
        row = (2 * (box.row + np.arange(box.rows)) + 1) * rows // (2 * self._plan.grid.rows)
        column = (2 * (box.column + np.arange(box.columns)) + 1) * columns // (2 * self._plan.grid.columns)
        return np.asarray(self.areas[np.ix_(row, column)])


def _cut(values: np.ndarray, box: GridWindow, window: GridWindow) -> np.ndarray:
    """Return the part of the values ``(..., rows, columns)`` of a box that belongs to a window in it."""
    top, left = window.row - box.row, window.column - box.column
    return values[..., top : top + window.rows, left : left + window.columns]


def _make_seamlines(plan: MosaicPlan, labels: LabelFile) -> Layer:
    """Return the layer of the areas of each image, in the CRS of the mosaic, or in WGS84 if it has no EPSG code."""
    areas = labels.find_areas()
    polygons = [polygon for _, polygon in areas]
    if (code := pyproj.CRS.from_wkt(plan.grid.crs).to_epsg()) is None:
        to_wgs84 = operations_of(plan.grid.crs).to_wgs84
        polygons = [
            transform(lambda x, y: to_wgs84(np.array([x, y, np.zeros(len(x))]).T)[:, :2].T, polygon)
            for polygon in polygons
        ]
    rows = [
        {"id": plan.jobs[number].image.id, "path": plan.jobs[number].path, "incidence_deg": plan.incidence_deg[number]}
        for number, _ in areas
    ]
    return Layer(SEAMLINES_LAYER, "Polygon", code or WGS84, polygons, SeamlineRows.of_entries(rows))
