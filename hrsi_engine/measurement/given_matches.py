"""Matches of another program, measured again by least-squares matching and tested like the program's own.

Learned matchers match pairs on which others fail, with an accuracy of one or two pixels, and half-precision files round
their positions. They are therefore used as approximate positions only. Matches that share keypoints are joined to
tracks; the image of a track with the coarsest pixels is its reference, and the pixel nearest to its keypoint is matched
in all other images. The results pass the tests of windows (`tile_matching`), pairs, links and tracks
(`block_matching`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..block.block import Image
from ..block.points import ImagePoints
from ..foundation.errors import InputError
from ..foundation.progress import Progress, silent
from ..foundation.thresholds import MEMORY, threshold, thresholds
from ..foundation.workers.scheduling import PartResult, Scheduler, WorkPart, open_scheduler, run_parts
from .block_matching import joining
from .block_matching.links import drop_unreliable_links, judge_links, summarise_connections
from .block_matching.overlaps import compute_resolution_step, rank_resolution
from .block_matching.search import EVERY
from .block_matching.star import PartnerMatches, stack_matches
from .block_matching.windows import ImageWindow, read_tile
from .tie_options import TieOptions
from .tie_points import PairSummary, TiePoints
from .tile_matching.epipolar import check_rpc_consistency, compute_epipolar_deviation, transfer
from .tile_matching.options import TileMatchOptions
from .tile_matching.pair_matching import refine_points
from .tile_matching.types import TilePairGeometry

_LEARNED = "errors of learned matchers are 1 or 2 px, of half-precision files 4 px; 2026-11-22"


@thresholds
class EXTERNAL:
    """Windows for measuring given matches again, and their largest errors."""

    error_px: float = threshold(6.0, "px", "largest error of given matches: half side of the search", _LEARNED)
    height_margin_m: float = threshold(10.0, "m", "margin of the search beyond the heights of the given matches")


@dataclass(frozen=True, eq=False)
class ExternalPair:
    """Matches of another program between a window of the reference and the image ``number`` of the block, (n, 2)."""

    number: int
    image: Image
    first_xy: np.ndarray
    second_xy: np.ndarray


@dataclass(frozen=True, eq=False)
class ExternalMatchJob:
    """A window of image ``number`` of the block, and the matches of another program in it."""

    number: int
    reference: Image
    window: ImageWindow
    pairs: tuple[ExternalPair, ...]


def refine_given_matches(
    images: Sequence[Image],
    given_points: ImagePoints,
    options: TieOptions | None = None,
    progress: Progress = silent,
    *,
    scheduler: Scheduler | None = None,
) -> TiePoints:
    """Measure given matches (tracks, accurate to a few pixels) again, test them, and return the resulting tracks.

    Raises `InputError` if no match is between two images with pixels, `Cancelled` if ``progress`` returns False.
    """
    options, scheduler = options or TieOptions(), scheduler or open_scheduler()
    jobs = list(_divide_into_jobs(images, given_points))
    if not jobs:
        raise InputError(
            f"{given_points.source}: contains no match between two images of the block that have pixels: check the "
            "image "
            "names"
        )
    label = "measuring matches of"
    parts = [
        WorkPart(f"given-{k}", measure_external_matches, job, keep=False, label=f"{label} {job.reference.id}")
        for k, job in enumerate(jobs)
    ]
    results = run_parts(parts, [part.key for part in parts], scheduler, None, progress)
    matches = joining.collect_matches([(job.number, results[part.key]) for job, part in zip(jobs, parts, strict=True)])
    accepted_matches = joining.drop_contradictions(joining.drop_outliers(matches, images, options.dense), images)
    links = judge_links(accepted_matches)
    accepted_matches = drop_unreliable_links(accepted_matches, links)
    room = dict.fromkeys(range(len(images)), options.per_cell or EVERY)  # all are kept, unless an option limits them
    points, ground = joining.to_image_points(accepted_matches, images, options.cells, room)
    trials: dict[tuple[int, int], int] = {}
    for job in jobs:
        for pair in job.pairs:
            trials[job.number, pair.number] = trials.get((job.number, pair.number), 0) + len(pair.first_xy)
    accepted = {pair: len(rows) for pair, rows in joining.group_by_pair(accepted_matches).items()}
    pairs = [PairSummary(images[a].id, images[b].id, accepted.get((a, b), 0), float("nan")) for a, b in sorted(trials)]
    usable = [number for number, image in enumerate(images) if image.raster is not None]
    of_image = {number: sum(number in pair for pair in trials) for number in usable}
    holds = summarise_connections(images, usable, links, of_image, {})
    total = sum(trials.values())
    warnings = [f"{hold.image}: none of the given matches passes the tests" for hold in holds if not hold.links]
    if 2 * sum(accepted.values()) < total:
        warnings.append(
            f"{given_points.source}: {sum(accepted.values())} of {total} given matches pass the tests: check that "
            "they belong "
            "to these images, in pixels of the full images"
        )
    return TiePoints(points, ground, tuple(pairs), tuple(warnings), holds)


def _divide_into_jobs(images: Sequence[Image], given_points: ImagePoints) -> Iterator[ExternalMatchJob]:
    """Yield windows of reference images, each with the matches in it."""
    number_of = {image.id: number for number, image in enumerate(images) if image.raster is not None}
    given_points = given_points.select(np.isin(given_points.image_ids, list(number_of)))
    if not len(given_points):
        return
    _, track = np.unique(given_points.ids, return_inverse=True)
    number = np.array([number_of[name] for name in given_points.image_ids.tolist()])
    # The reference of a track is its image with the coarsest pixels, of several such images the first
    rank = np.array([(-rank_resolution(image), k) for k, image in enumerate(images)])
    order = np.lexsort((*rank[number].T[::-1], track))
    heads = np.r_[True, track[order][1:] != track[order][:-1]]
    reference = np.empty(track.max() + 1, dtype=np.int64)
    reference[track[order][heads]] = order[heads]
    head = reference[track]
    rows = np.flatnonzero(number != number[head])
    cell = np.floor(given_points.xy[head[rows]] / MEMORY.part_px).astype(np.int64)
    keys, job = np.unique(np.column_stack([number[head[rows]], cell]), axis=0, return_inverse=True)
    for index, (first, column, row) in enumerate(keys.tolist()):
        rows_of_job = rows[job.ravel() == index]
        side = MEMORY.part_px
        window = ImageWindow(column * side, row * side, side, side)
        pairs = tuple(
            ExternalPair(second, images[second], given_points.xy[head[partner_rows]], given_points.xy[partner_rows])
            for second in np.unique(number[rows_of_job]).tolist()
            for partner_rows in (rows_of_job[number[rows_of_job] == second],)
        )
        yield ExternalMatchJob(first, images[first], window, pairs)


def measure_external_matches(job: ExternalMatchJob) -> PartResult:
    """Measure the matches of a job; return the results in the columns of `block_matching.star.match_stars`."""
    rows = []
    tile = read_tile(job.reference, job.window.grow(MEMORY.border_px))
    for pair in () if tile is None else job.pairs:
        # The matches of a pair that are consistent with the geometry of its RPCs
        start, rpcs = float(np.mean(job.reference.rpc.height_range)), (job.reference.rpc, pair.image.rpc)
        consistent = check_rpc_consistency(*rpcs, pair.first_xy, pair.second_xy, start, floor_px=EXTERNAL.error_px).good
        agreed = replace(pair, first_xy=pair.first_xy[consistent], second_xy=pair.second_xy[consistent])
        if not len(agreed.first_xy):
            continue
        # Read only the area of consistent matches: one wrong match could extend it to the complete image
        border = MEMORY.border_px * compute_resolution_step(job.reference, pair.image)
        low, high = np.floor(agreed.second_xy.min(axis=0)), np.floor(agreed.second_xy.max(axis=0)) + 1.0
        place = ImageWindow(*low.astype(int).tolist(), *(high - low).astype(int).tolist()).grow(border)
        inside = place.contains(pair.second_xy)
        partner_tile = read_tile(pair.image, place, compute_resolution_step(job.reference, pair.image))
        if tile is None or partner_tile is None:
            continue
        # Geometry of the pair from its matches: range of heights, offset of the RPCs, and search margin
        heights = compute_epipolar_deviation(*rpcs, agreed.first_xy, agreed.second_xy, start).height_m
        low_m, high_m = float(heights.min()) - EXTERNAL.height_margin_m, float(heights.max()) + EXTERNAL.height_margin_m
        difference = agreed.second_xy - transfer(*rpcs, agreed.first_xy, heights)
        bias = np.median(difference, axis=0)
        margin = float(np.abs(difference - bias).max()) + EXTERNAL.error_px
        geometry = TilePairGeometry(*rpcs, low_m, high_m, (float(bias[0]), float(bias[1])), (margin, margin))
        options = TileMatchOptions(reach_px=(EXTERNAL.error_px,) * 2, across_px=EXTERNAL.error_px)
        refined = refine_points(tile, partner_tile, geometry, pair.first_xy[inside], pair.second_xy[inside], options)
        rows.append(PartnerMatches(pair.number, refined))
    return stack_matches(rows)
