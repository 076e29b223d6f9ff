"""Automatic tie points of a block: overlapping windows are matched at positions predicted by the RPCs, and joined.

The work consists of rounds of independent parts, run by any scheduler: features of every image at a low resolution;
test matches of pairs, if more images overlap than can be matched with each other, for the choice of pairs; the
relative orientation of every pair; and the windows of every image with all its partners (`block_matching`). Links
between images that contradict others are excluded, and replaced by other pairs.
Memory contains a few windows per thread and the matches found, for any size of the images.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ..block.block import Image
from ..block.points import ImagePoints
from ..foundation.errors import list_ids
from ..foundation.progress import Progress, silent, stage
from ..foundation.workers.scheduling import ResultStore, Scheduler, open_scheduler
from ..surface.dem import HeightSurface
from .block_matching import joining
from .block_matching.links import (
    ImageConnection,
    cut_weak_bridges,
    drop_unreliable_links,
    find_bridges,
    summarise_connections,
)
from .block_matching.search import TieSearch, count_points_per_cell
from .tie_options import TieOptions


class PairSummary(NamedTuple):
    """A pair of images by their ids, the number of accepted matches, and the offset across the epipolar lines (px)."""

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
        Approximate lon, lat, height of the tracks, in the order of ids.
    pairs : tuple of PairSummary
        Results of each pair of images.
    warnings : tuple of str
        Warnings for the user.
    holds : tuple of ImageConnection
        Connection of each image with pixels to the others.
    """

    image_points: ImagePoints
    ground: np.ndarray
    pairs: tuple[PairSummary, ...]
    warnings: tuple[str, ...]
    holds: tuple[ImageConnection, ...] = ()

    def __repr__(self) -> str:
        return f"<TiePoints: {len(self.ground)} points, {len(self.image_points)} measurements, {len(self.pairs)} pairs>"


def find_tie_points(
    images: Sequence[Image], options: TieOptions | None = None, progress: Progress = silent, *,
    surface: HeightSurface | None = None, scheduler: Scheduler | None = None, keeper: ResultStore | None = None,
    earlier: Collection[str] = (),
) -> TiePoints:  # fmt: skip
    """Find tie points between all overlapping images with pixels.

    Parameters
    ----------
    images : sequence of Image
        At least two of them with pixels.
    options : TieOptions, optional
        Options of the search.
    progress : Progress
        Callback; False cancels.
    surface : HeightSurface, optional
        The terrain, if known; else heights are determined by the matching.
    scheduler : Scheduler, optional
        Runs the work; by default threads.
    keeper : ResultStore, optional
        Stores the results of finished parts, so that an interrupted run can continue.
    earlier : collection of str
        Ids of images that were already matched with each other; their pairs are not matched again.

    Returns
    -------
    TiePoints
        Tracks in two images or more.

    Raises
    ------
    InputError
        Fewer than two images have pixels, or no two of them overlap.
    Cancelled
        ``progress`` returned False.
    """
    search = TieSearch(images, options or TieOptions(), surface, scheduler or open_scheduler(), keeper, earlier=earlier)
    search.choose_pairs(stage(progress, 0.0, 0.2))
    search.match_pairs(stage(progress, 0.2, 0.85))
    matches, links = search.judge()
    # False or weak links are replaced by others, once; images with few links are matched more thoroughly
    replaced = search.replace_links(links, stage(progress, 0.85, 0.88))
    if replaced:
        search.match_pairs(stage(progress, 0.88, 0.92))
        matches, links = search.judge()
    if search.match_weak_images(links, stage(progress, 0.92, 0.97)):
        matches, links = search.judge()
    if search.match_by_cameras(matches, links, stage(progress, 0.97, 1.0)):
        matches, links = search.judge()
    if search.choice is not None:
        links = cut_weak_bridges(links)
    elif search.complete(matches, progress):
        matches, _ = search.judge()
    matches = drop_unreliable_links(matches, links)
    room = {k: count_points_per_cell(search.options, image) for k, image in enumerate(images)}
    points, ground = joining.to_image_points(matches, images, search.options.cells, room)
    count = {pair: len(rows) for pair, rows in joining.group_by_pair(matches).items()}
    summaries = tuple(
        PairSummary(
            images[pair.first].id,
            images[pair.second].id,
            count.get((pair.first, pair.second), 0) + count.get((pair.second, pair.first), 0),
            float("nan") if pair.estimate is None else float(np.hypot(*pair.estimate.geometry.bias_px)),
        )
        for pair in search.pairs
    )
    holds = summarise_connections(images, search.usable, links, search.count_trials(), search.reasons)
    # Warn of images without tie points, and of overlapping pairs without matches
    tied = set(points.image_ids.tolist())
    lonely = [hold.image for hold in holds if hold.image not in tied | search.earlier]
    reasons = {images[number].id: reason for number, reason in search.reasons.items()}
    warnings = [
        f"{name}: no tie points: " + reasons.get(name, "it overlaps no other image, or has no matches with the others")
        for name in lonely
    ]
    if search.choice is not None:
        warnings += [
            f"{list_ids(images[number].id for number in bridged)}: connected by the single link "
            f"{images[link.first].id} - {images[link.second].id} of {link.matches} matches, which no third "
            "image confirms: they may have a common error"
            for link, bridged in find_bridges(links)
            if not {images[number].id for number in bridged} <= search.earlier
        ]
    else:
        warnings += [
            f"{pair.first} and {pair.second}: no matches"
            for pair in summaries
            if not pair.matches and pair.first not in lonely and pair.second not in lonely
        ]
    return TiePoints(points, ground, summaries, tuple(warnings), holds)


def find_overlapping_pairs(
    images: Sequence[Image],
    options: TieOptions | None = None,
    surface: HeightSurface | None = None,
    earlier: Collection[str] = (),
) -> list[tuple[str, str]]:
    """Return the ids of pairs of images that may show common ground, before any pixel is read.

    Parameters are those of `find_tie_points`. Raises `InputError` if fewer than two images have pixels, or no two of
    them overlap.
    """
    search = TieSearch(images, options or TieOptions(), surface, open_scheduler(), None, marked=False, earlier=earlier)
    overlapping = search.find_overlaps_of_images()
    ids = [images[index].id for index in search.usable]
    return [(ids[pair.first], ids[pair.second]) for pair in overlapping]
