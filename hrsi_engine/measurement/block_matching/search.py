"""The rounds of a search for tie points: pairs to be matched, their options, and accepted links."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...block.block import Image, PyramidRaster
from ...foundation.errors import InputError, list_ids
from ...foundation.progress import Progress, stage
from ...foundation.thresholds import GRIDS, GROUND, MEMORY
from ...foundation.version import VERSION
from ...foundation.workers.scheduling import PartResult, ResultStore, Scheduler, WorkPart, digest, run_parts
from ...surface.dem import HeightSurface
from ..tie_options import AUTOMATIC_CELLS, TIE_SEARCH, TieOptions
from ..tile_matching.options import TileMatchOptions
from . import coarse, joining, overlaps
from .links import LINKS, ImageLink, drop_unreliable_links, find_displaced_images, judge_links
from .overlaps import CHOICE, choose_probes, compute_central_views, compute_convergence_deg, find_likely_overlaps
from .overview import OverviewFeatures, OverviewJob, choose_overview_step, detect_overview_features
from .pair_choice import PairChoice, Probe, ProbeJob, probe_pairs
from .relative_cameras import estimate_relative_cameras
from .star import Partner, StarJob, TransferJob, is_matched_everywhere, match_stars, plan_cells, transfer_star

EVERY = 1_000_000  # larger than any number of points in a cell, or of cells in an image


def choose_match_options(
    options: TieOptions, image: Image, linked: bool = False, predicted: bool = False
) -> TileMatchOptions:
    """Return the options for matching windows of a reference image.

    linked : its block has many pairs to choose from; predicted : points are searched at predicted positions only
    """
    if options.dense:
        return options.match_dense
    if not is_matched_everywhere(image):
        return options.match_sampled
    match_options = options.match_linked if linked else options.match
    return replace(match_options, features=0) if predicted else match_options


def count_points_per_cell(options: TieOptions, image: Image) -> int:
    """Return the number of points wanted in a cell of an image."""
    if options.per_cell != AUTOMATIC_CELLS:
        return options.per_cell
    if options.dense:
        return EVERY
    return TIE_SEARCH.full_per_cell if is_matched_everywhere(image) else TIE_SEARCH.sampled_per_cell


class PairCandidate(NamedTuple):
    """A pair by the indices of its images, with its estimated geometry; None if the overviews have too few matches."""

    job: coarse.CoarseJob
    first: int
    second: int
    estimate: coarse.PairEstimate | None


class TieSearch:
    """State and rounds of one search for tie points."""

    def __init__(
        self,
        images: Sequence[Image],
        options: TieOptions,
        surface: HeightSurface | None,
        scheduler: Scheduler,
        keeper: ResultStore | None,
        marked: bool = True,
        earlier: Collection[str] = (),
    ) -> None:
        self.images, self.options, self.surface = images, options, surface
        self.usable = [index for index, image in enumerate(images) if image.raster is not None]
        if len(self.usable) < 2:
            raise InputError(
                "these inputs give no tie points: fewer than two of the images have pixels (RPC files have none). Give "
                "image files, or measured points (`tie_points`, or `tracks` of evaluate); one image with GCPs is "
                "refined by refine-rpc"
            )
        self._scheduler, self._keeper = scheduler, keeper
        self.earlier = frozenset(earlier)  #: ids of images that were already matched with each other
        self._marks = {}  # identify an image and the state of its file
        for index in self.usable if marked else ():
            image = images[index]
            content = image.raster.content_mark() if isinstance(image.raster, PyramidRaster) else ""
            self._marks[index] = digest(image.id, image.path, image.size, image.rpc, content)
        self._features: OverviewFeatures | None = None  # features of the overviews, if pairs are probed
        self._terrain: dict[int, np.ndarray] = {}
        self._results: list[tuple[int, PartResult]] = []
        self._matched = 0  # number of pairs whose windows were matched
        self.choice: PairChoice | None = None  #: chooses the pairs, if there are too many to match all
        self.pairs: list[PairCandidate] = []
        self.reasons: dict[int, str] = {}  #: reasons for excluding images

    def find_overlaps_of_images(self) -> list[overlaps.Overlap]:
        """Return the pairs of usable images that overlap; raise `InputError` if there are none."""
        images = [self.images[index] for index in self.usable]
        self._ranges = overlaps.find_ground_ranges(images, self.surface, GROUND.margin_m)
        overlapping = find_likely_overlaps(images, self._ranges, self.surface, self.options.smallest_overlap)
        if self.earlier:
            overlapping = [
                pair for pair in overlapping if not {images[pair.first].id, images[pair.second].id} <= self.earlier
            ]
        if not overlapping:
            raise InputError(
                f"no two images of {list_ids(image.id for image in images)} overlap between the heights of their RPCs: "
                "check that they show the same area, "
                + ("and the unit of the DEM's heights" if self.surface else "or name a DEM with `dem`")
            )
        return overlapping

    def choose_pairs(self, progress: Progress) -> None:
        """Find the pairs to be matched and estimate their geometry; raise `InputError` if there are none."""
        overlapping = self.find_overlaps_of_images()
        images = [self.images[index] for index in self.usable]
        self._coarseness = [overlaps.rank_resolution(image) for image in images]
        probed = 2 * len(overlapping) > self.options.most_partners * len(images)
        self._steps = [choose_overview_step(image.known_size, probed) for image in images]
        if not probed:
            self._estimate_pairs([self._order_pair(pair.first, pair.second) for pair in overlapping], progress)
            return
        self.choice = self._probe_overlaps(overlapping, stage(progress, 0.0, 0.5))
        rounds = 0
        while pairs := self.choice.choose_round():
            rounds += 1
            self._estimate_pairs(sorted(pairs), stage(progress, 1.0 - 0.5**rounds, 1.0 - 0.5 ** (rounds + 1)))
        offsets = {
            (pair.first, pair.second): float(np.hypot(*pair.estimate.geometry.bias_px))
            for pair in self.pairs
            if pair.estimate is not None
        }
        for number, offset_px in find_displaced_images(offsets).items():
            self.reasons[number] = (
                f"its RPC differs from those of the other images by about {offset_px:.0f} px; correct it first, for "
                "example with refine-rpc and GCPs"
            )
        self.pairs = [pair for pair in self.pairs if not {pair.first, pair.second} & set(self.reasons)]

    def _order_pair(self, first: int, second: int) -> tuple[int, int]:
        """Return two usable images with the coarser one first, as the reference."""
        a, b = sorted((first, second), key=lambda index: (-self._coarseness[index], index))
        return a, b

    def _make_overview_part(self, index: int) -> WorkPart:
        """Return the part that detects a usable image's features, or returns those already detected."""
        if self._features is not None:
            return self._features.part(index)
        image, step = self.images[self.usable[index]], self._steps[index]
        key = f"overview-{digest(VERSION, self._marks[self.usable[index]], step)}"
        job = OverviewJob(image, step)
        return WorkPart(key, detect_overview_features, job, keep=False, label=f"looking at {image.id}")

    def _probe_overlaps(self, overlapping: list[overlaps.Overlap], progress: Progress) -> PairChoice:
        """Probe the promising ones of the overlapping pairs; return the chooser of pairs."""
        images = [self.images[index] for index in self.usable]
        parts = [self._make_overview_part(index) for index in range(len(images))]
        self._features = OverviewFeatures(parts, self._scheduler, self._keeper)
        self._features.find(CHOICE.features, stage(progress, 0.0, 0.7))
        directions = compute_central_views(images)
        first, second = (np.array([getattr(pair, name) for pair in overlapping]) for name in ("first", "second"))
        angle = compute_convergence_deg(directions, first, second)
        partners: dict[int, list[tuple[int, float]]] = {}
        for row in choose_probes(overlapping, angle).tolist():
            a, b = self._order_pair(int(first[row]), int(second[row]))
            partners.setdefault(a, []).append((b, float(angle[row])))
        probing = []
        for a, candidates in partners.items():
            numbers = [b for b, _ in candidates]
            job = ProbeJob(
                images[a],
                tuple(images[b] for b in numbers),
                tuple(self._steps[k] for k in (a, *numbers)),
                tuple(overlaps.intersect_heights(self._ranges[a], self._ranges[b]) for b in numbers),
                self.options.margin_px,
                tuple(self._features.strongest[k] for k in (a, *numbers)),
            )
            probing.append(WorkPart(f"probe-{a}", probe_pairs, job, keep=False, label=f"probing {images[a].id}"))
        results = run_parts(
            probing, [part.key for part in probing], self._scheduler, self._keeper, stage(progress, 0.7, 1.0)
        )
        probes = [
            Probe(a, b, int(answer["agreeing"][k]), convergence, tuple(answer["cells"][k]))
            for a, candidates in partners.items()
            for answer in (results[f"probe-{a}"],)
            for k, (b, convergence) in enumerate(candidates)
        ]
        trees = max(1, self.options.most_partners // 2)
        return PairChoice(len(images), probes, trees, (trees + 1) * len(images))

    def _estimate_pairs(self, pairs: Sequence[tuple[int, int]], progress: Progress) -> None:
        """Compare the overviews of pairs of usable images, and append the results to ``pairs``."""
        for start in range(0, len(pairs), MEMORY.images):
            ends = (min(start + offset, len(pairs)) / len(pairs) for offset in (0, MEMORY.images))
            jobs = {(a, b): self._make_job(a, b) for a, b in pairs[start : start + MEMORY.images]}
            overviews = {index: self._make_overview_part(index) for pair in jobs for index in pair}
            marks = {index: self._marks[self.usable[index]] for index in overviews}
            parts = {
                (a, b): WorkPart(
                    f"pair-{digest(VERSION, marks[a], marks[b], job.steps, tuple(job.heights), job.margin_px)}",
                    coarse.match_overviews,
                    job,
                    (overviews[a].key, overviews[b].key),
                    label=f"comparing {job.first.id} and {job.second.id}",
                )
                for (a, b), job in jobs.items()
            }
            keys = [part.key for part in parts.values()]
            features = run_parts(
                [*overviews.values(), *parts.values()], keys, self._scheduler, self._keeper, stage(progress, *ends)
            )
            for (a, b), part in parts.items():
                estimate = coarse.estimate_pair(jobs[a, b], features[part.key])
                self.pairs.append(PairCandidate(jobs[a, b], self.usable[a], self.usable[b], estimate))
                if self.choice is not None:
                    self.choice.tell((a, b), estimate is not None)

    def _make_job(self, a: int, b: int) -> coarse.CoarseJob:
        """Return the job of comparing the overviews of two usable images."""
        first, second = (self.images[self.usable[index]] for index in (a, b))
        if self.surface is not None and a not in self._terrain:
            self._terrain[a] = coarse.sample_terrain(first, self.surface)
        heights = overlaps.intersect_heights(self._ranges[a], self._ranges[b])
        steps = self._steps[a], self._steps[b]
        return coarse.CoarseJob(first, second, steps, heights, self.options.margin_px, self._terrain.get(a))

    def replace_links(self, links: Sequence[ImageLink], progress: Progress) -> bool:
        """Replace pairs whose links are not reliable by others; return whether there are any."""
        if self.choice is None:
            return False
        place = {number: index for index, number in enumerate(self.usable)}
        sound = {(link.first, link.second) for link in links if link.sound}
        for pair in self.pairs:
            self.choice.tell((place[pair.first], place[pair.second]), (pair.first, pair.second) in sound)
        new = [
            pair
            for pair in self.choice.choose_round()
            if not {self.usable[index] for index in pair} & set(self.reasons)
        ]
        self._estimate_pairs(new, progress)
        return bool(new)

    def count_trials(self) -> dict[int, int]:
        """Return the number of tried pairs of each image."""
        if self.choice is None:
            numbers = [number for pair in self.pairs for number in (pair.first, pair.second)]
        else:
            numbers = [self.usable[index] for pair in self.choice.found | self.choice.failed for index in pair]
        return dict(Counter(numbers))

    def judge(self) -> tuple[joining.BlockMatches, list[ImageLink]]:
        """Return the matches that pass the tests of pairs and heights, and the links formed by them."""
        fitting = joining.drop_outliers(joining.collect_matches(self._results), self.images, self.options.dense)
        consistent = joining.drop_contradictions(fitting, self.images)
        return consistent, judge_links(consistent)

    def match_pairs(self, progress: Progress) -> None:
        """Match the windows of all pairs that are not yet matched."""
        self._match_windows(self.pairs[self._matched :], self.choice is not None, progress)
        self._matched = len(self.pairs)

    def match_weak_images(self, links: Sequence[ImageLink], progress: Progress) -> bool:
        """Match pairs of images with few links with the options of small blocks; return whether there are any."""
        if self.choice is None:
            return False
        sound = [(link.first, link.second) for link in links if link.sound]
        link_count = Counter(number for pair in sound for number in pair)
        hard = [
            pair
            for pair in self.pairs
            if (pair.first, pair.second) not in sound
            and min(link_count[pair.first], link_count[pair.second]) <= LINKS.strong_links
        ]
        return self._match_windows(hard, False, progress)

    def match_by_cameras(self, matches: joining.BlockMatches, links: Sequence[ImageLink], progress: Progress) -> bool:
        """Match images with few links with their most similar images, at positions predicted from all matches."""
        if self.choice is None:
            return False
        cameras = estimate_relative_cameras(drop_unreliable_links(matches, links), self.images)
        if cameras is None:
            return False
        sound = {(link.first, link.second) for link in links if link.sound}
        link_count = Counter(number for pair in sound for number in pair)
        weak = [
            index
            for index, number in enumerate(self.usable)
            if link_count[number] <= LINKS.strong_links and number not in self.reasons
        ]
        pairs: dict[tuple[int, int], PairCandidate] = {}
        for index in weak:
            for a, b in self.choice.list_similar_pairs(index):
                first, second = self.usable[a], self.usable[b]
                partner = second if a == index else first
                if link_count[partner] <= LINKS.strong_links or (first, second) in sound:
                    continue
                job = self._make_job(a, b)
                pairs[a, b] = PairCandidate(job, first, second, cameras.estimate(job, first, second))
                enough = LINKS.strong_links + CHOICE.last_tries  # sufficient though some of them fail
                if sum(index in pair for pair in pairs) == enough or len(pairs) >= self.choice.room:
                    break
        for pair in pairs:
            self.choice.tell(pair, True)
        numbers = {(pair.first, pair.second) for pair in pairs.values()}
        self.pairs = [pair for pair in self.pairs if (pair.first, pair.second) not in numbers] + list(pairs.values())
        return self._match_windows(list(pairs.values()), False, progress, predicted=True)

    def complete(self, matches: joining.BlockMatches, progress: Progress) -> bool:
        """Search points in images without them, at positions predicted from all matches; return whether any were."""
        # Matched pairs of images that are matched everywhere, in both orders
        places = {}
        for pair in self.pairs:
            images_of_pair = self.images[pair.first], self.images[pair.second]
            everywhere = pair.estimate is not None and all(map(is_matched_everywhere, images_of_pair))
            if everywhere and overlaps.compute_resolution_step(*images_of_pair) == 1:
                places[pair.first, pair.second] = pair.job
                places[pair.second, pair.first] = replace(pair.job, first=images_of_pair[1], second=images_of_pair[0])
        can_miss = len(self.usable) > 2 and not self.options.dense
        cameras = estimate_relative_cameras(matches, self.images) if can_miss else None
        if cameras is None:
            return False
        parts = []
        for (first, second), job in places.items():
            estimate = cameras.estimate(job, first, second)
            is_there = np.isin(cameras.tracks, matches.track[matches.second == second])
            lacking = (cameras.partners >= TIE_SEARCH.completed_partners) & ~is_there
            in_first = matches.first == first
            track, row = np.unique(matches.track[in_first], return_index=True)
            is_lacking = np.isin(track, cameras.tracks[lacking])
            if estimate is None or not is_lacking.any():
                continue
            xy = matches.first_xy[in_first][row[is_lacking]]
            height = cameras.ground[np.searchsorted(cameras.tracks, track[is_lacking]), 2]
            windows = tuple(cell.own[0] for row in plan_cells(job.first, self.options.cells, 0) for cell in row)
            partner = Partner(second, job.second, estimate.geometry)
            options = choose_match_options(self.options, job.first)
            options = replace(options, largest_sigma_px=TIE_SEARCH.completed_sigma_px)
            transfer = TransferJob(first, job.first, windows, xy, height, partner=partner, options=options)
            key = digest(VERSION, self._marks[first], self._marks[second], estimate.geometry, xy, height, options)
            parts.append(WorkPart(f"points-{key}", transfer_star, transfer, label=f"completing {job.first.id}"))
        if parts:
            transferred = run_parts(parts, [part.key for part in parts], self._scheduler, self._keeper, progress)
            self._results += [(part.job.number, transferred[part.key]) for part in parts]
        return bool(parts)

    def _match_windows(
        self, pairs: Sequence[PairCandidate], linked: bool, progress: Progress, predicted: bool = False
    ) -> bool:
        """Match the windows of pairs with an estimated geometry; return whether there are any."""
        partners: dict[int, list[Partner]] = {}
        for pair in pairs:
            if pair.estimate is not None:
                step = overlaps.compute_resolution_step(self.images[pair.first], self.images[pair.second])
                partner = Partner(pair.second, self.images[pair.second], pair.estimate.geometry, step)
                partners.setdefault(pair.first, []).append(partner)
        parts = []
        for number, partner_list in partners.items():
            image = self.images[number]
            cells_of_image = EVERY if self.options.dense else self.options.cells
            rows = plan_cells(image, cells_of_image, count_points_per_cell(self.options, image))
            cells = [cell for row in rows for cell in row]
            partner_marks = [
                (candidate.number, self._marks[candidate.number], candidate.geometry, candidate.step)
                for candidate in partner_list
            ]
            options = choose_match_options(self.options, image, linked, predicted)
            per_part = GRIDS.cells if linked or not is_matched_everywhere(image) else 1
            for start in range(0, len(cells), per_part):
                job = StarJob(number, image, tuple(cells[start : start + per_part]), tuple(partner_list), options)
                key = digest(VERSION, self._marks[number], number, job.cells, partner_marks, job.options)
                label = f"matching {image.id}"
                parts.append(WorkPart(f"windows-{key}", match_stars, job, label=label, cost=float(len(partner_list))))
        if parts:
            matched = run_parts(parts, [part.key for part in parts], self._scheduler, self._keeper, progress)
            self._results += [(part.job.number, matched[part.key]) for part in parts]
        return bool(parts)
