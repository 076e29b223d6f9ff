"""`surface-model`: heights of an adjusted block by dense matching of its best pairs, as one raster.

Tiles are matched one by one and stored; when all are there, the biases of the pairs are known, and the tiles are fused
and written. A stopped run continues with the tiles that it has.
"""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import pyproj

from ..hrsi_engine.block.stereo_pairs import STEREO, StereoPair
from ..hrsi_engine.dense.gridding import FusedHeights, estimate_pair_biases, fuse_heights, measure_differences
from ..hrsi_engine.dense.tiles import DenseBlock, PairHeights, limit_search, match_coarse_surface, match_surface_tile
from ..hrsi_engine.foundation.errors import InputError, SolveError
from ..hrsi_engine.foundation.progress import advance, stage
from ..hrsi_engine.foundation.version import VERSION
from ..hrsi_engine.foundation.workers.scheduling import digest, open_calls
from ..hrsi_engine.foundation.workers.threads import one_thread_calls, one_thread_filters
from ..hrsi_engine.ground.crs_operations import operations_of
from ..hrsi_engine.io.pages.report import name_crs_unit, read_picture, write_page, write_text
from ..hrsi_engine.io.rasters.dems import open_dem
from ..hrsi_engine.io.rasters.images import GdalRaster
from ..hrsi_engine.io.rasters.orthoimages import OrthoFormat
from ..hrsi_engine.io.rasters.surface_models import (
    STYLE,
    SURFACE_BANDS,
    HeightOffsets,
    ShadedSurface,
    find_vertical_crs,
    limit_block_cache,
    write_surface,
)
from ..hrsi_engine.io.safety.array_files import PartStore
from ..hrsi_engine.io.safety.content_marks import content_mark
from ..hrsi_engine.ortho.grid import GridWindow, MapGrid, choose_map_crs, round_resolution
from ..hrsi_engine.results.drawings import LARGEST_PICTURE_PX
from ..hrsi_engine.surface.dem import HeightSurface, surface_heights
from .block_steps.adjusted_block import AdjustedBlock, read_adjusted_block
from .block_steps.plausibility import describe_differences
from .declarations.orthoimages import DIFFERENCE_FILE, SURFACE_FILE, SurfaceModelOptions
from .files.orthoimage_plan import label_crs, parse_box
from .files.result_folder import PAGE_FILE, REPORT_FILE, check_folder, plan, stage_results
from .hand_over import pair_entry
from .interface.declare import Context, Report

UNFINISHED_TILES = "unfinished_surface"  #: folder of finished tiles in the output directory, until the run has ended
MOST_SAMPLES = 2_000_000  #: cells that are compared with a reference; of more, evenly chosen ones


class TileJob(NamedTuple):
    """All that a worker needs for the heights of a tile, and the key of its result."""

    key: str
    block: DenseBlock
    window: GridWindow
    plane: np.ndarray
    heights_m: tuple[float, float]


@dataclass
class MatchedTiles:
    """The stored tiles of a run, with the figures of all.

    differences : per tile, of `measure_differences`; sigmas : per tile, median of each pair (m), NaN without heights
    error_px : largest error of rectification of each pair
    """

    store: PartStore
    jobs: list[TileJob] = field(default_factory=list)
    differences: list[np.ndarray] = field(default_factory=list)
    sigmas: list[np.ndarray] = field(default_factory=list)
    error_px: list[np.ndarray] = field(default_factory=list)

    def add(self, job: TileJob, tile: PairHeights) -> None:
        """Add a stored tile."""
        self.jobs.append(job)
        self.differences.append(measure_differences(tile.height))
        self.sigmas.append(np.array([np.nanmedian(one) if np.isfinite(one).any() else np.nan for one in tile.sigma]))
        self.error_px.append(tile.error_px)

    @cached_property
    def sigmas_m(self) -> np.ndarray:
        """Median standard deviation of each pair, (pairs,); infinite without heights."""
        known = [one[np.isfinite(one)] for one in np.array(self.sigmas).T]
        return np.array([np.median(one) if one.size else np.inf for one in known])

    @cached_property
    def biases_m(self) -> np.ndarray:
        """Height bias of each pair, (pairs,)."""
        return estimate_pair_biases(np.array(self.differences), self.sigmas_m)

    def fuse(self) -> Iterator[tuple[GridWindow, FusedHeights]]:
        """Yield the fused heights of all tiles, from the store, without the biases of the pairs."""
        biases = self.biases_m[:, None, None].astype(np.float32)
        for job in self.jobs:
            tile = self.store.load(job.key)
            if tile is None:
                raise InputError(f"{self.store.folder}: a finished tile was removed meanwhile: run again")
            yield job.window, fuse_heights(tile["height"] - biases, tile["sigma"])


@limit_block_cache()
def run(options: SurfaceModelOptions, context: Context) -> Report:
    """Choose pairs and grid, match tile by tile, fuse the pairs, and write the surface."""
    start = time.monotonic()
    check_folder(options.folder, context)
    adjusted = read_adjusted_block(options.result, options.dem, options.height_datum)
    pairs = choose_pairs(adjusted, options)
    block = plan_grid(adjusted, pairs, options)
    crs, offsets = find_vertical_crs(block.grid.crs, options.vertical)
    reference = None if options.reference is None else open_dem(options.reference, options.reference_datum)
    windows = list(block.grid.chunks(options.dense.tile_cells))
    output = options.folder.output_dir.rstrip("/")
    if context.dry_run:
        names = [SURFACE_FILE, SURFACE_FILE.replace(".tif", ".qml"), *([DIFFERENCE_FILE] if reference else [])]
        names += [PAGE_FILE] if options.report else []
        counts = {"images": len(block.images), "pairs": len(pairs), "tiles": len(windows)}
        return plan(context, output, [REPORT_FILE, *names], counts, adjusted.warnings)
    store = PartStore(f"{output}/{UNFINISHED_TILES}")
    tiles = match_tiles(block, adjusted, windows, store, options, context.stage(0.0, 0.85))
    report = report_surface(block, pairs, tiles, crs, options, context)
    report["warnings"] = [*adjusted.warnings, *list_date_warnings(adjusted, pairs)]
    surface = SurfaceBands(block.grid, tiles, offsets, options.dense.largest_sigma_m)
    form = OrthoFormat("cog", options.compression)
    lineage = {"HRSI_VERSION": report["version"], "HRSI_ALGORITHM": report["algorithm"]}
    with stage_results(options.folder, report, context, discarded=(str(store.folder),)) as staged:
        path, progress = str(staged / SURFACE_FILE), stage(context.progress, 0.85, 0.95)
        write = partial(write_surface, form=form, lineage=lineage)
        write(path, block.grid, crs, names=SURFACE_BANDS, tiles=surface.tiles(), progress=progress)
        write_text(path.replace(".tif", ".qml"), STYLE)
        report["cells_with_height"], report["sigma_median_m"] = surface.count, surface.median_sigma_m
        if reference is not None:
            compare, progress = ReferenceComparison(block.grid, reference), stage(context.progress, 0.95, 0.99)
            parts = ((window, [compare.subtract(window, fused.height)]) for window, fused in tiles.fuse())
            path, names = str(staged / DIFFERENCE_FILE), ["surface - reference"]
            write(path, block.grid, block.grid.crs, names=names, tiles=parts, progress=progress)
            report["reference"] = {"path": options.reference, **compare.summary()}
            report["images"]["difference"] = {
                "path": options.reference,
                "output": os.path.join(output, DIFFERENCE_FILE),
            }
        report["seconds"] = {"total": round(time.monotonic() - start, 3)}
        if options.report:
            shown: list[tuple[str, GdalRaster]] = [("surface", ShadedSurface(str(staged / SURFACE_FILE)))]
            shown += [("difference", GdalRaster(path))] if reference is not None else []
            side_px = 4 * LARGEST_PICTURE_PX
            pictures = [read_picture(raster, key, k, side_px) for k, (key, raster) in enumerate(shown)]
            write_page(str(staged / PAGE_FILE), "surface.html.j2", report, pictures=[one for one in pictures if one])
    return report


def report_surface(
    block: DenseBlock,
    pairs: Sequence[StereoPair],
    tiles: MatchedTiles,
    crs: str,
    options: SurfaceModelOptions,
    context: Context,
) -> Report:
    """Return the report of a surface before it is written."""
    grid, name = block.grid, label_crs(block.grid.crs)
    columns = zip(pairs, tiles.biases_m, tiles.sigmas_m, np.max(tiles.error_px, axis=0), strict=True)
    output = os.path.join(options.folder.output_dir.rstrip("/"), SURFACE_FILE)
    return {
        **context.record, "crs": {**context.record["crs"], "map": name},
        "grid": {"crs": name, "wkt": crs, "vertical": options.vertical, "resolution": grid.resolution,
                 "columns": grid.columns, "rows": grid.rows, "bounds": list(grid.bounds)},
        "pairs": [{**pair_entry(pair, block.cell_m), "bias_m": float(bias), "sigma_m": float(sigma),
                   "rectification_px": float(error)} for pair, bias, sigma, error in columns],
        "cells": grid.columns * grid.rows,
        "images": {"surface": {"path": options.result, "output": output}},
    }  # fmt: skip


class SurfaceBands:
    """The bands of a surface model by tiles, and counts of what they contain.

    offsets : ellipsoidal heights of the vertical datum; None for ellipsoidal heights
    largest_sigma_m : cells with a larger standard deviation become nodata; None keeps all
    """

    def __init__(
        self, grid: MapGrid, tiles: MatchedTiles, offsets: HeightOffsets | None, largest_sigma_m: float | None
    ) -> None:
        self._grid, self._tiles, self._offsets, self._largest = grid, tiles, offsets, largest_sigma_m
        self.count, self._sigmas = 0, list[float]()

    def tiles(self) -> Iterator[tuple[GridWindow, Sequence[np.ndarray]]]:
        """Yield windows with height, standard deviation and number of pairs."""
        for window, (height, sigma, pairs) in self._tiles.fuse():
            if self._largest is not None:
                height = np.where(sigma <= self._largest, height, np.float32(np.nan))
            row, column = np.nonzero(np.isfinite(height))
            if len(row):
                self.count += len(row)
                self._sigmas.append(float(np.median(sigma[row, column])))
            if len(row) and self._offsets is not None:
                left, step, _, top, _, _ = self._grid.geotransform
                x, y = left + (window.column + column + 0.5) * step, top - (window.row + row + 0.5) * step
                height[row, column] -= self._offsets(np.column_stack([x, y]))
            yield window, (height, sigma, pairs)

    @property
    def median_sigma_m(self) -> float:
        """Median of the standard deviations (m), by tiles."""
        return float(np.median(self._sigmas or [np.nan]))


def choose_pairs(adjusted: AdjustedBlock, options: SurfaceModelOptions) -> list[StereoPair]:
    """Return the pairs to be matched; raise `InputError` with the geometry of all pairs if none is useful."""
    if pairs := adjusted.choose_pairs(options.dense.most_pairs):
        return pairs
    angles = [
        f"{one.first} and {one.second}: convergence "
        + ("unknown" if one.convergence_deg is None else f"{one.convergence_deg:.2f} deg")
        + f", overlap {min(one.overlap):.0%}"
        for one in adjusted.geometries
    ]
    least, *_, most = STEREO.convergence_deg
    raise InputError(
        f"{options.result}: no pair gives heights ("
        f"{'; '.join(angles[:10]) or 'no two images overlap'}): "
        f"add images that overlap under {least:g} to {most:g} degrees"
    )


def list_date_warnings(adjusted: AdjustedBlock, pairs: Sequence[StereoPair]) -> list[str]:
    """Return a warning for each pair of images from different days: what changed between them has no height."""
    days = [(pair, adjusted.times[pair.left], adjusted.times[pair.right]) for pair in pairs]
    return [
        f"{pair.left} and {pair.right} are {abs((first - second).days)} days apart: what changed between them becomes "
        "nodata, or has the height of another pair"
        for pair, first, second in days
        if first and second and abs((first - second).days) >= 1
    ]


def plan_grid(adjusted: AdjustedBlock, pairs: Sequence[StereoPair], options: SurfaceModelOptions) -> DenseBlock:
    """Return the images of the pairs, and the map grid of the surface."""
    outline = np.pad(np.array(adjusted.common_area(list(pairs)).convex_hull.exterior.coords)[:, :2], ((0, 0), (0, 1)))
    crs = choose_map_crs(outline, options.crs)
    map_crs = pyproj.CRS.from_wkt(crs)
    if not map_crs.is_projected:
        raise InputError(f"`crs` {options.crs!r} is not projected: give one in metres, or leave it out")
    unit_m = float(map_crs.axis_info[0].unit_conversion_factor)
    names = dict.fromkeys(name for pair in pairs for name in (pair.left, pair.right))
    images = tuple(image for image in adjusted.images if image.id in names)
    views = [adjusted.views[image.id].geometry() for image in images]
    finest = min(float(np.sqrt(view.gsd_sample_m * view.gsd_line_m)) for view in views)
    resolution = options.resolution or round_resolution(finest / unit_m)
    if options.extent:
        bounds = parse_box(options.extent, crs, "", "the CRS of the map")
    else:
        x, y = operations_of(crs).from_wgs84(outline).T
        bounds = (x.min(), y.min(), x.max(), y.max())
    index = {image.id: number for number, image in enumerate(images)}
    numbers = tuple((index[pair.left], index[pair.right]) for pair in pairs)
    return DenseBlock(images, numbers, MapGrid.from_bounds(crs, resolution, bounds), resolution * unit_m)


def match_tiles(
    block: DenseBlock,
    adjusted: AdjustedBlock,
    windows: Sequence[GridWindow],
    store: PartStore,
    options: SurfaceModelOptions,
    context: Context,
) -> MatchedTiles:
    """Match the tiles that are not stored yet, and store them; return all of them."""
    if stored := len(store):
        context.log(f"continues with {stored} finished tiles in {store.folder}")
    mark = [(content_mark(image.path), image.rpc) for image in block.images]
    with ExitStack() as limits:
        limits.enter_context(one_thread_calls())
        limits.enter_context(one_thread_filters())
        advance(context.progress, 0.0, "coarse surface")
        heights = adjusted.points.ground[:, 2]
        coarse = match_coarse_surface(block, heights[np.isfinite(heights)])
        limited = [(window, limit_search(block, coarse, window)) for window in windows]
        jobs = [
            TileJob(digest(VERSION, mark, block.pairs, block.grid, list(window), *limit), block, window, *limit)
            for window, limit in limited
            if limit is not None
        ]
        tiles = MatchedTiles(store)
        missing = [job for job in jobs if store.load(job.key) is None]
        scheduler = options.workers.scheduler if missing else None
        with open_calls(scheduler, certificates=options.workers.certificates) as calls:
            for number, (job, tile) in enumerate(zip(missing, calls.answers(_match_job, missing), strict=True)):
                store.save(job.key, tile._asdict())
                done, count = number + 1, len(missing)
                advance(context.progress, done / count, f"matching tiles ({done} of {count})")
        for job in jobs:
            if (stored_tile := store.load(job.key)) is not None:
                tiles.add(job, PairHeights(**stored_tile))
    if not tiles.jobs or np.isnan(tiles.sigmas).all():
        raise SolveError("no pair gives a height: check `extent`, the pixels of the images, and the adjustment")
    return tiles


def _match_job(job: TileJob) -> PairHeights:
    """Return the heights of a tile; a function of the module, so that other processes can be sent it."""
    return match_surface_tile(job.block, job.window, job.plane, job.heights_m)


class ReferenceComparison:
    """Differences of a surface to a reference on a grid; a sample of them for the figures."""

    def __init__(self, grid: MapGrid, reference: HeightSurface) -> None:
        self._grid, self._reference = grid, reference
        self._step = max(1, int(np.ceil(grid.columns * grid.rows / MOST_SAMPLES)))
        self._samples: list[np.ndarray] = []

    def subtract(self, window: GridWindow, height: np.ndarray) -> np.ndarray:
        """Return ellipsoidal heights minus those of the reference, NaN where either is missing."""
        row, column = np.nonzero(np.isfinite(height))
        lonlat = self._grid.lonlat(np.column_stack([window.column + column, window.row + row]).astype(float))
        result = np.full(height.shape, np.nan, np.float32)
        result[row, column] = height[row, column] - surface_heights(self._reference, lonlat)
        self._samples.append(result[np.isfinite(result)][:: self._step])
        return result

    def summary(self) -> Report:
        """Return bias, NMAD and LE90 (m) as in the report; None without common cells."""
        values = np.concatenate([np.empty(0), *self._samples])
        return describe_differences(values, ("compared", "bias_m", "nmad_m", "le90_m"))


def summarise(report: Report) -> str:
    """Return the pairs, the grid, the share of heights, and the comparison."""
    grid, reference = report["grid"], report.get("reference")
    lines = [
        f"{pair['left']} {pair['right']}: convergence {pair['convergence_deg']:.1f} deg, bias {pair['bias_m']:+.2f} m, "
        f"sigma {pair['sigma_m']:.2f} m, rectified to {pair['rectification_px']:.3f} px"
        for pair in report["pairs"]
    ]
    share, unit = report["cells_with_height"] / report["cells"], name_crs_unit(grid["crs"])
    lines.append(
        f"{grid['columns']} x {grid['rows']} cells of {grid['resolution']:g} {unit} in {grid['crs']}, "
        f"{grid['vertical']} heights in {share:.0%} of them, median sigma {report['sigma_median_m']:.2f} m"
    )
    if reference and reference["compared"]:
        lines.append(
            f"against {reference['path']}: bias {reference['bias_m']:+.2f} m, NMAD {reference['nmad_m']:.2f} m, "
            f"LE90 {reference['le90_m']:.2f} m"
        )
    lines += [f"warning: {text}" for text in report["warnings"]]
    return "\n".join(lines)
