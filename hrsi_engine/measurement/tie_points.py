"""Automatic tie points of a block: windows that overlap are matched where the RPCs predict, and joined into tracks.

Rounds of independent parts, run by any scheduler: features of every image at a low resolution; where more images
overlap than can be matched with one another, probes of the pairs, which say who is matched with whom; how the images of
every pair lie to one another; and the windows of every image with all its partners (`block_matching`). Links between
images that contradict others are left out, and other pairs are tried in their place.
Memory holds a few windows a thread and the matches found, whatever the size of the images.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..block.block import Image
from ..block.points import ImagePoints
from ..foundation.errors import InputError, list_ids
from ..foundation.progress import Progress, silent, stage
from ..foundation.scheduling import Keeper, PartResult, Scheduler, WorkPart, digest, open_scheduler, run_parts
from ..foundation.version import VERSION
from ..surface.dem import HeightSurface
from .block_matching import coarse, joining, overlaps, plan
from .block_matching.links import ImageHold, ImageLink, find_displaced, hold_images, judge_links, without_links
from .block_matching.overview import OverviewJob, hand_over, overview_features, overview_step
from .block_matching.pair_choice import PairChoice
from .block_matching.probes import (
    Probe,
    ProbeJob,
    angles_deg,
    choose_probed,
    probe_pairs,
    strongest,
    view_directions,
)
from .block_matching.star import Partner, StarJob, match_stars
from .block_matching.windows import PyramidRaster
from .tie_options import AUTOMATIC_CELLS, FULL_PER_CELL, SAMPLED_PER_CELL, TieOptions
from .tile_matching.options import TileMatchOptions

FEW_LINKS = 3  # of an image: below, its pairs are matched thoroughly
EVERY = 1_000_000  # more than there can be of points in a cell, and of cells that fit into an image
CELLS_PER_PART = 12  # of a star job: about a second of work, as is one cell of an image that is matched everywhere
DEM_MARGIN_M = 50.0  # buildings, trees, the DEM's own errors, and what the RPCs are off


def choose_match_options(options: TieOptions, image: Image, linked: bool = False) -> TileMatchOptions:
    """Return how windows of a reference image are matched; ``linked``: its block has many pairs to choose from."""
    if options.dense:
        return options.match_dense
    if not plan.is_matched_everywhere(image):
        return options.match_sampled
    return options.match_linked if linked else options.match


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
    holds : tuple of ImageHold
        What holds each image with pixels.
    """

    image_points: ImagePoints
    ground: np.ndarray
    pairs: tuple[PairSummary, ...]
    warnings: tuple[str, ...]
    holds: tuple[ImageHold, ...] = ()

    def __repr__(self) -> str:
        return f"<TiePoints: {len(self.ground)} points, {len(self.image_points)} measurements, {len(self.pairs)} pairs>"


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
    search.choose_pairs(stage(progress, 0.0, 0.3))
    search.match_pairs(stage(progress, 0.3, 0.85))
    good, links = search.judge()
    # Links that came out false or weak make room for others, once; images that hang on few are matched thoroughly
    replaced = search.replace_links(links, stage(progress, 0.85, 0.88))
    if replaced:
        search.match_pairs(stage(progress, 0.88, 0.92))
        good, links = search.judge()
    if search.match_thoroughly(links, stage(progress, 0.92, 0.97)):
        good, links = search.judge()
    good = without_links(good, links)
    room = {k: points_of_a_cell(search.options, image) for k, image in enumerate(images)}
    points, ground = joining.to_image_points(good, images, search.options.cells, room)
    summaries = _summaries(search.pairs, good, images)
    holds = hold_images(images, search.usable, links, search.tried_of_image(), search.reasons)
    # Name the images without any tie point, and the pairs that overlap and gave nothing
    tied = set(points.image_ids.tolist())
    lonely = [hold.image for hold in holds if hold.image not in tied]
    reasons = {images[number].id: reason for number, reason in search.reasons.items()}
    warnings = [
        f"{name}: no tie points: "
        + reasons.get(name, "it overlaps no other image, or shows nothing that the others show")
        for name in lonely
    ]
    if search.choice is not None:
        warnings += [
            f"{hold.image}: held by a single link, which no other one checks: its position may be wrong"
            for hold in holds
            if hold.links == 1
        ]
    else:
        for pair in summaries:
            if not pair.matches and pair.first not in lonely and pair.second not in lonely:
                warnings.append(f"{pair.first} and {pair.second}: no matches")
    return TiePoints(points, ground, summaries, tuple(warnings), holds)


def overlapping_pairs(
    images: Sequence[Image], options: TieOptions | None = None, surface: HeightSurface | None = None
) -> list[tuple[str, str]]:
    """Return the ids of the images that may show common ground, pair by pair, before any pixel is looked at.

    Parameters
    ----------
    images : sequence of Image
        The block.
    options : TieOptions, optional
        How tie points would be found.
    surface : HeightSurface, optional
        The ground, where it is known.

    Returns
    -------
    list of tuple of str
        The pairs.

    Raises
    ------
    InputError
        Fewer than two images have pixels, or no two of them overlap.
    """
    search = _Search(images, options or TieOptions(), surface, open_scheduler(), None, marked=False)
    found = search.find_overlapping()
    own = [images[index].id for index in search.usable]
    return [(own[pair.first], own[pair.second]) for pair in found]


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
        marked: bool = True,
    ) -> None:
        self.images, self.options, self.surface = images, options, surface
        self.usable = [index for index, image in enumerate(images) if image.raster is not None]
        if len(self.usable) < 2:
            raise InputError("tie points need two images with pixels: give image files, or `tie_points` none or FILE")
        self._scheduler, self._keeper = scheduler, keeper
        self._marks = {index: _mark(images[index]) for index in self.usable} if marked else {}
        self._features: list[PartResult] = []  # of the overviews, where pairs are probed
        self._terrain: dict[int, np.ndarray] = {}
        self._results: list[tuple[int, PartResult]] = []
        self._matched = 0  # pairs whose windows were matched
        self.choice: PairChoice | None = None  #: who chooses the pairs, where there are more than can be matched
        self.pairs: list[_EstimatedPair] = []
        self.reasons: dict[int, str] = {}  #: why images are left out

    def find_overlapping(self) -> list[overlaps.Overlap]:
        """Return the pairs of usable images that overlap; raise `InputError` where there are none."""
        images = [self.images[index] for index in self.usable]
        self._ranges = overlaps.ground_ranges(images, self.surface, DEM_MARGIN_M)
        found = overlaps.find_overlaps(images, self._ranges, self.surface, self.options.smallest_overlap)
        if not found:
            raise InputError(
                f"no two images of {list_ids(image.id for image in images)} overlap between the heights of their RPCs: "
                "check that they show the same area, or name the terrain's heights with `dem`"
            )
        return found

    def choose_pairs(self, progress: Progress) -> None:
        """Find the pairs to match, with what is known of each; raise `InputError` where there are none."""
        found = self.find_overlapping()
        images = [self.images[index] for index in self.usable]
        self._coarseness = [overlaps.coarseness(image) for image in images]
        self._steps = [overview_step(image.known_size) for image in images]
        if 2 * len(found) <= self.options.most_partners * len(images):
            self._estimate([self._reference_first(pair.first, pair.second) for pair in found], progress)
            return
        self.choice = self._probed(found, stage(progress, 0.0, 0.5))
        rounds = 0
        while pairs := self.choice.next_round():
            rounds += 1
            self._estimate(pairs, stage(progress, 1.0 - 0.5**rounds, 1.0 - 0.5 ** (rounds + 1)))
        offsets = {(pair.first, pair.second): float(np.hypot(*pair.estimate.geometry.bias_px))
                   for pair in self.pairs if pair.estimate is not None}  # fmt: skip
        for number, offset_px in find_displaced(offsets).items():
            self.reasons[number] = (
                f"its RPC lies about {offset_px:.0f} px beside those of the other images; correct it first, for "
                "instance by refine-rpc with GCPs"
            )
        self.pairs = [pair for pair in self.pairs if not {pair.first, pair.second} & set(self.reasons)]

    def _reference_first(self, first: int, second: int) -> tuple[int, int]:
        """Return two usable images with the coarser one, the reference, first."""
        a, b = sorted((first, second), key=lambda index: (-self._coarseness[index], index))
        return a, b

    def _overview_part(self, index: int) -> WorkPart:
        """Return the part that finds a usable image's features, or hands over those that were found."""
        image, step = self.images[self.usable[index]], self._steps[index]
        key = f"overview-{digest(self._marks[self.usable[index]], step)}"
        if self._features:
            return WorkPart(key, hand_over, self._features[index], keep=False)
        return WorkPart(key, overview_features, OverviewJob(image, step), keep=False)

    def _probed(self, found: list[overlaps.Overlap], progress: Progress) -> PairChoice:
        """Probe the overlapping pairs that may be worth it; return who chooses among them."""
        images = [self.images[index] for index in self.usable]
        parts = [self._overview_part(index) for index in range(len(images))]
        features = run_parts(
            parts, [part.key for part in parts], self._scheduler, self._keeper, stage(progress, 0.0, 0.7)
        )  # fmt: skip
        self._features = [features[part.key] for part in parts]
        directions = view_directions(images)
        first, second = (np.array([getattr(pair, name) for pair in found]) for name in ("first", "second"))
        angle = angles_deg(directions, first, second)
        partners: dict[int, list[tuple[int, float]]] = {}
        for row in choose_probed(found, angle, len(images)).tolist():
            a, b = self._reference_first(int(first[row]), int(second[row]))
            partners.setdefault(a, []).append((b, float(angle[row])))
        probing = []
        for a, others in partners.items():
            numbers = [b for b, _ in others]
            job = ProbeJob(
                images[a], tuple(images[b] for b in numbers), tuple(self._steps[k] for k in (a, *numbers)),
                tuple(overlaps.common_heights(self._ranges[a], self._ranges[b]) for b in numbers),
                self.options.margin_px, tuple(strongest(self._features[k]) for k in (a, *numbers)),
            )  # fmt: skip
            probing.append(WorkPart(f"probe-{a}", probe_pairs, job, keep=False, label=f"probing {images[a].id}"))
        told = run_parts(
            probing, [part.key for part in probing], self._scheduler, self._keeper, stage(progress, 0.7, 1.0)
        )  # fmt: skip
        probes = [
            Probe(a, b, int(told[f"probe-{a}"]["agreeing"][k]), convergence, tuple(told[f"probe-{a}"]["cells"][k]))
            for a, others in partners.items()
            for k, (b, convergence) in enumerate(others)
        ]
        trees = max(1, self.options.most_partners // 2)
        return PairChoice(len(images), probes, trees, (trees + 1) * len(images))

    def _estimate(self, pairs: Sequence[tuple[int, int]], progress: Progress) -> None:
        """Compare the overviews of pairs of usable images, and enter what was found."""
        jobs = {}
        for a, b in pairs:
            first, second = (self.images[self.usable[index]] for index in (a, b))
            if self.surface is not None and a not in self._terrain:
                self._terrain[a] = coarse.terrain_at_nodes(first, self.surface)
            heights = overlaps.common_heights(self._ranges[a], self._ranges[b])
            steps = self._steps[a], self._steps[b]
            jobs[a, b] = coarse.CoarseJob(first, second, steps, heights, self.options.margin_px, self._terrain.get(a))
        overviews = {index: self._overview_part(index) for pair in jobs for index in pair}
        marks = {index: self._marks[self.usable[index]] for index in overviews}
        parts = {
            (a, b): WorkPart(
                f"pair-{digest(VERSION, marks[a], marks[b], job.steps, tuple(job.heights), job.margin_px)}",
                coarse.match_overviews, job, (overviews[a].key, overviews[b].key),
                label=f"comparing {job.first.id} and {job.second.id}",
            )
            for (a, b), job in jobs.items()
        }  # fmt: skip
        wanted = [part.key for part in parts.values()]
        found = run_parts([*overviews.values(), *parts.values()], wanted, self._scheduler, self._keeper, progress)
        for (a, b), part in parts.items():
            estimate = coarse.estimate_pair(jobs[a, b], found[part.key])
            self.pairs.append(_EstimatedPair(jobs[a, b], self.usable[a], self.usable[b], estimate))
            if self.choice is not None:
                self.choice.tell((a, b), estimate is not None)

    def replace_links(self, links: Sequence[ImageLink], progress: Progress) -> bool:
        """Take other pairs for those whose links are not sound; tell whether there are any."""
        if self.choice is None:
            return False
        place = {number: index for index, number in enumerate(self.usable)}
        sound = {(link.first, link.second) for link in links if link.sound}
        for pair in self.pairs:
            self.choice.tell((place[pair.first], place[pair.second]), (pair.first, pair.second) in sound)
        new = [pair for pair in self.choice.next_round()
               if not {self.usable[index] for index in pair} & set(self.reasons)]  # fmt: skip
        self._estimate(new, progress)
        return bool(new)

    def tried_of_image(self) -> dict[int, int]:
        """Return how many pairs of each image were tried."""
        if self.choice is None:
            numbers = [number for pair in self.pairs for number in (pair.first, pair.second)]
        else:
            numbers = [self.usable[index] for pair in self.choice.found | self.choice.failed for index in pair]
        return dict(Counter(numbers))

    def judge(self) -> tuple[joining.BlockMatches, list[ImageLink]]:
        """Return the matches that pass the tests of pairs and heights, and the links that they make."""
        matches = joining.collect_matches(self._results)
        fitting = joining.without_outliers(matches, self.images, self.options.dense)
        good = joining.without_contradictions(fitting, self.images)
        return good, judge_links(good)

    def match_pairs(self, progress: Progress) -> None:
        """Match the windows of all pairs that were not matched yet."""
        self._match(self.pairs[self._matched :], self.choice is not None, progress)
        self._matched = len(self.pairs)

    def match_thoroughly(self, links: Sequence[ImageLink], progress: Progress) -> bool:
        """Match the pairs of images that few links hold as those of small blocks are; tell whether there are any."""
        if self.choice is None:
            return False
        sound = [(link.first, link.second) for link in links if link.sound]
        held = Counter(number for pair in sound for number in pair)
        hard = [
            pair
            for pair in self.pairs
            if (pair.first, pair.second) not in sound and min(held[pair.first], held[pair.second]) < FEW_LINKS
        ]
        return self._match(hard, False, progress)

    def _match(self, pairs: Sequence[_EstimatedPair], linked: bool, progress: Progress) -> bool:
        """Match the windows of pairs, as far as they were estimated; tell whether there are any."""
        partners: dict[int, list[Partner]] = {}
        for pair in pairs:
            if pair.estimate is not None:
                step = overlaps.resolution_step(self.images[pair.first], self.images[pair.second])
                partner = Partner(pair.second, self.images[pair.second], pair.estimate.geometry, step)
                partners.setdefault(pair.first, []).append(partner)
        parts = [part for number, own in partners.items() for part in self._parts_of(number, own, linked)]
        if parts:
            found = run_parts(parts, [part.key for part in parts], self._scheduler, self._keeper, progress)
            self._results += [(part.job.number, found[part.key]) for part in parts]
        return bool(parts)

    def _parts_of(self, number: int, partners: list[Partner], linked: bool) -> list[WorkPart]:
        image = self.images[number]
        cells_of_image = EVERY if self.options.dense else self.options.cells
        rows = plan.cell_rows(image, cells_of_image, points_of_a_cell(self.options, image))
        cells = [cell for row in rows for cell in row]
        known = [(other.number, self._marks[other.number], other.geometry, other.step) for other in partners]
        parts = []
        per_part = 1 if plan.is_matched_everywhere(image) else CELLS_PER_PART
        for start in range(0, len(cells), per_part):
            chosen = tuple(cells[start : start + per_part])
            job = StarJob(
                number,
                image,
                chosen,
                tuple(partners),
                choose_match_options(self.options, image, self.choice is not None),
            )
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
