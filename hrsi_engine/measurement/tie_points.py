"""Automatic tie points of a block: windows that overlap are matched where the RPCs predict, and joined into tracks.

Three rounds of independent parts, run by any scheduler: features of every image at a low resolution; how the images of
every pair lie to one another, from these; and the windows of every image with all its partners (`block_matching`).
Memory holds a few windows a thread and the matches found, whatever the size of the images.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..block.block import Image
from ..block.points import ImagePoints
from ..foundation.errors import InputError, list_ids
from ..foundation.progress import Progress, silent, stage
from ..foundation.scheduling import Keeper, Result, Scheduler, WorkPart, digest, open_scheduler, run_parts
from ..foundation.version import VERSION
from ..surface.dem import HeightSurface
from .block_matching import coarse, joining, overlaps, plan
from .block_matching.overview import OverviewJob, overview_features, overview_step
from .block_matching.star import Partner, StarJob, match_stars
from .block_matching.windows import PyramidRaster
from .tie_options import AUTOMATIC_CELLS, FULL_PER_CELL, SAMPLED_PER_CELL, TieOptions
from .tile_matching.options import TileMatchOptions

EVERY = 1_000_000  # more than there can be of points in a cell, and of cells that fit into an image
CELLS_PER_PART = 12  # of a star job: about a second of work
DEM_MARGIN_M = 50.0  # buildings, trees, the DEM's own errors, and what the RPCs are off


def choose_match_options(options: TieOptions, image: Image) -> TileMatchOptions:
    """Return how windows of a reference image are matched."""
    if options.dense:
        return options.match_dense
    return options.match if plan.is_matched_everywhere(image) else options.match_sampled


def points_of_a_cell(options: TieOptions, image: Image) -> int:
    """Return how many points a cell of an image is to have."""
    if options.per_cell != AUTOMATIC_CELLS:
        return options.per_cell
    if options.dense:
        return EVERY
    return FULL_PER_CELL if plan.is_matched_everywhere(image) else SAMPLED_PER_CELL


class PairSummary(NamedTuple):
    """A pair of images by their ids: matches that were kept, and the offset across the epipolar lines (px)."""

    first: str
    second: str
    matches: int
    offset_px: float


class TiePoints(NamedTuple):
    """Tie points of a block.

    Parameters
    ----------
    image_points : ImagePoints
        The measurements of all tracks.
    ground : (tracks, 3) ndarray
        Approximate lon, lat, height, in the order of ids.
    pairs : tuple of PairSummary
        What was found between each two images.
    warnings : tuple of str
        What a user should know.
    """

    image_points: ImagePoints
    ground: np.ndarray
    pairs: tuple[PairSummary, ...]
    warnings: tuple[str, ...]


def find_tie_points(
    images: Sequence[Image],
    options: TieOptions | None = None,
    progress: Progress = silent,
    *,
    surface: HeightSurface | None = None,
    scheduler: Scheduler | None = None,
    keeper: Keeper | None = None,
) -> TiePoints:
    """Find tie points between all overlapping images with pixels.

    Parameters
    ----------
    images : sequence of Image
        At least two of them with pixels.
    options : TieOptions, optional
        How to find them.
    progress : Progress
        Callback; False cancels.
    surface : HeightSurface, optional
        The ground, where it is known; else heights come out of the matching.
    scheduler : Scheduler, optional
        Who does the work; threads without.
    keeper : Keeper, optional
        Keeps the results of finished parts, so that a run that was stopped continues.

    Returns
    -------
    TiePoints
        Tracks over two images or more.

    Raises
    ------
    InputError
        Fewer than two images have pixels, or no two of them overlap.
    Cancelled
        When ``progress`` asks to stop.
    """
    search = _Search(images, options or TieOptions(), surface, scheduler or open_scheduler(), keeper)
    pairs = search.estimated_pairs(stage(progress, 0.0, 0.3))
    matches = search.matches(pairs, stage(progress, 0.3, 0.97))
    good = joining.without_contradictions(joining.without_outliers(matches, images, search.options.dense), images)
    room = {k: points_of_a_cell(search.options, image) for k, image in enumerate(images)}
    points, ground = joining.to_image_points(good, images, search.options.cells, room)
    summaries = _summaries(pairs, good, images)
    # Name the images without any tie point, and the pairs that overlap and gave nothing
    tied = set(points.image_ids.tolist())
    lonely = [images[index].id for index in search.usable if images[index].id not in tied]
    warnings = [
        f"{name}: no tie points: it overlaps no other image, or shows nothing that the others show" for name in lonely
    ]
    for pair in summaries:
        if not pair.matches and pair.first not in lonely and pair.second not in lonely:
            warnings.append(f"{pair.first} and {pair.second}: no matches")
    return TiePoints(points, ground, summaries, tuple(warnings))


class _EstimatedPair(NamedTuple):
    job: coarse.CoarseJob
    first: int
    second: int
    estimate: coarse.PairEstimate | None


class _Search:
    """The rounds of one search."""

    def __init__(
        self,
        images: Sequence[Image],
        options: TieOptions,
        surface: HeightSurface | None,
        scheduler: Scheduler,
        keeper: Keeper | None,
    ) -> None:
        self.images, self.options, self.surface = images, options, surface
        self.usable = [index for index, image in enumerate(images) if image.raster is not None]
        if len(self.usable) < 2:
            raise InputError("tie points need two images with pixels: give image files, or `tie_points` none or FILE")
        self._scheduler, self._keeper = scheduler, keeper
        self._marks = {index: _mark(images[index]) for index in self.usable}

    def estimated_pairs(self, progress: Progress) -> list[_EstimatedPair]:
        """Return the pairs to match with what is known of each; raise `InputError` where there are none."""
        jobs = self._coarse_jobs()
        steps = {index: overview_step(self.images[index].size) for pair in jobs for index in pair}  # type: ignore[arg-type]
        overviews = {
            index: WorkPart(
                f"overview-{digest(self._marks[index], step)}", overview_features,
                OverviewJob(self.images[index], step), keep=False,
            )
            for index, step in steps.items()
        }  # fmt: skip
        parts = {
            (a, b): WorkPart(
                f"pair-{digest(VERSION, self._marks[a], self._marks[b], job.steps, tuple(job.heights), job.margin_px)}",
                coarse.match_overviews, job, (overviews[a].key, overviews[b].key),
                label=f"comparing {self.images[a].id} and {self.images[b].id}",
            )
            for (a, b), job in jobs.items()
        }  # fmt: skip
        wanted = [part.key for part in parts.values()]
        found = run_parts([*overviews.values(), *parts.values()], wanted, self._scheduler, self._keeper, progress)
        return [_EstimatedPair(jobs[a, b], a, b, coarse.estimate_pair(jobs[a, b], found[part.key]))
                for (a, b), part in parts.items()]  # fmt: skip

    def _coarse_jobs(self) -> dict[tuple[int, int], coarse.CoarseJob]:
        """Return the pairs that overlap, by the numbers of the reference and the other image."""
        images = [self.images[index] for index in self.usable]
        ranges = overlaps.ground_ranges(images, self.surface, DEM_MARGIN_M)
        found = overlaps.find_overlaps(images, ranges, self.surface, self.options.smallest_overlap)
        chosen = overlaps.choose_pairs(found, len(images), self.options.most_partners)
        if not chosen:
            raise InputError(
                f"no two images of {list_ids(image.id for image in images)} overlap between the heights of their RPCs: "
                "check that they show the same area, or name the terrain's heights with `dem`"
            )
        coarseness = [overlaps.coarseness(image) for image in images]
        terrain: dict[int, np.ndarray] = {}
        jobs = {}
        for pair in chosen:
            a, b = sorted((pair.first, pair.second), key=lambda index: (-coarseness[index], index))
            if self.surface is not None and a not in terrain:
                terrain[a] = coarse.terrain_at_nodes(images[a], self.surface)
            steps = overview_step(images[a].size), overview_step(images[b].size)  # type: ignore[arg-type]
            heights = overlaps.common_heights(ranges[a], ranges[b])
            job = coarse.CoarseJob(images[a], images[b], steps, heights, self.options.margin_px, terrain.get(a))
            jobs[self.usable[a], self.usable[b]] = job
        return jobs

    def matches(self, pairs: Sequence[_EstimatedPair], progress: Progress) -> joining.BlockMatches:
        """Return the matches of all windows of all references."""
        partners: dict[int, list[Partner]] = {}
        for pair in pairs:
            if pair.estimate is not None:
                step = overlaps.resolution_step(self.images[pair.first], self.images[pair.second])
                partner = Partner(pair.second, self.images[pair.second], pair.estimate.geometry, step)
                partners.setdefault(pair.first, []).append(partner)
        parts = [part for number, own in partners.items() for part in self._parts_of(number, own)]
        wanted = [part.key for part in parts]
        found: dict[str, Result] = {}
        if parts:
            found = run_parts(parts, wanted, self._scheduler, self._keeper, progress)
        return joining.collect_matches([(part.job.number, found[part.key]) for part in parts])

    def _parts_of(self, number: int, partners: list[Partner]) -> list[WorkPart]:
        image = self.images[number]
        cells_of_image = EVERY if self.options.dense else self.options.cells
        rows = plan.cell_rows(image, cells_of_image, points_of_a_cell(self.options, image))
        cells = [cell for row in rows for cell in row]
        known = [(other.number, self._marks[other.number], other.geometry, other.step) for other in partners]
        parts = []
        for start in range(0, len(cells), CELLS_PER_PART):
            chosen = tuple(cells[start : start + CELLS_PER_PART])
            job = StarJob(number, image, chosen, tuple(partners), choose_match_options(self.options, image))
            key = digest(VERSION, self._marks[number], number, job.cells, known, job.options)
            parts.append(WorkPart(f"windows-{key}", match_stars, job, label=f"matching {image.id}"))
        return parts


def _mark(image: Image) -> str:
    """Return what tells an image from another one, and from itself after a change of its file."""
    content = image.raster.content_mark() if isinstance(image.raster, PyramidRaster) else ""
    return digest(image.id, image.path, image.size, image.rpc, content)


def _summaries(
    pairs: Sequence[_EstimatedPair], good: joining.BlockMatches, images: Sequence[Image]
) -> tuple[PairSummary, ...]:
    count = {pair: len(rows) for pair, rows in joining.pair_rows(good).items()}
    return tuple(
        PairSummary(
            images[pair.first].id, images[pair.second].id, count.get((pair.first, pair.second), 0),
            float("nan") if pair.estimate is None else float(np.hypot(*pair.estimate.geometry.bias_px)),
        )
        for pair in pairs
    )  # fmt: skip
