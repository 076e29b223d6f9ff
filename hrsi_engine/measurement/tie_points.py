"""Automatic tie points of a block: windows that overlap are matched where the RPCs predict, and joined into tracks.

Rounds of independent parts, run by any scheduler: features of every image at a low resolution; where more images
overlap than can be matched with one another, probes of the pairs, which say who is matched with whom; how the images of
every pair lie to one another; and the windows of every image with all its partners (`block_matching`). Links between
images that contradict others are left out, and other pairs are tried in their place.
Memory holds a few windows a thread and the matches found, whatever the size of the images.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ..block.block import Image
from ..block.points import ImagePoints
from ..foundation.errors import list_ids
from ..foundation.progress import Progress, silent, stage
from ..foundation.workers.scheduling import Keeper, Scheduler, open_scheduler
from ..surface.dem import HeightSurface
from .block_matching import joining
from .block_matching.links import ImageHold, cut_weak_bridges, drop_unsound_links, find_bridges, summarise_holds
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
        Approximate lon, lat, height, in the order of ids.
    pairs : tuple of PairSummary
        What was found between each two images.
    warnings : tuple of str
        What a user should know.
    holds : tuple of ImageHold
        How each image with pixels is connected to the others.
    """

    image_points: ImagePoints
    ground: np.ndarray
    pairs: tuple[PairSummary, ...]
    warnings: tuple[str, ...]
    holds: tuple[ImageHold, ...] = ()

    def __repr__(self) -> str:
        return f"<TiePoints: {len(self.ground)} points, {len(self.image_points)} measurements, {len(self.pairs)} pairs>"


def find_tie_points(
    images: Sequence[Image], options: TieOptions | None = None, progress: Progress = silent, *,
    surface: HeightSurface | None = None, scheduler: Scheduler | None = None, keeper: Keeper | None = None,
    earlier: Collection[str] = (),
) -> TiePoints:  # fmt: skip
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
    earlier : collection of str
        Ids of images that were matched with one another before: their pairs are left alone.

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
    search = TieSearch(images, options or TieOptions(), surface, scheduler or open_scheduler(), keeper,
                       earlier=earlier)  # fmt: skip
    search.choose_pairs(stage(progress, 0.0, 0.3))
    search.match_pairs(stage(progress, 0.3, 0.85))
    good, links = search.judge()
    # Links that came out false or weak make room for others, once; images that hang on few are matched thoroughly
    replaced = search.replace_links(links, stage(progress, 0.85, 0.88))
    if replaced:
        search.match_pairs(stage(progress, 0.88, 0.92))
        good, links = search.judge()
    if search.match_weak_images(links, stage(progress, 0.92, 0.97)):
        good, links = search.judge()
    if search.match_by_cameras(good, links, stage(progress, 0.97, 1.0)):
        good, links = search.judge()
    if search.choice is not None:
        links = cut_weak_bridges(links)
    elif search.complete(good, progress):
        good, _ = search.judge()
    good = drop_unsound_links(good, links)
    room = {k: count_points_per_cell(search.options, image) for k, image in enumerate(images)}
    points, ground = joining.to_image_points(good, images, search.options.cells, room)
    count = {pair: len(rows) for pair, rows in joining.group_by_pair(good).items()}
    summaries = tuple(
        PairSummary(
            images[pair.first].id, images[pair.second].id,
            count.get((pair.first, pair.second), 0) + count.get((pair.second, pair.first), 0),
            float("nan") if pair.estimate is None else float(np.hypot(*pair.estimate.geometry.bias_px)),
        )
        for pair in search.pairs
    )  # fmt: skip
    holds = summarise_holds(images, search.usable, links, search.count_trials(), search.reasons)
    # Name the images without any tie point, and the pairs that overlap and gave nothing
    tied = set(points.image_ids.tolist())
    lonely = [hold.image for hold in holds if hold.image not in tied | search.earlier]
    reasons = {images[number].id: reason for number, reason in search.reasons.items()}
    warnings = [
        f"{name}: no tie points: " + reasons.get(name, "it overlaps no other image, or has no matches with the others")
        for name in lonely
    ]
    if search.choice is not None:
        warnings += [
            f"{list_ids(images[number].id for number in held)}: connected by the single link {images[link.first].id} - "
            f"{images[link.second].id} of {link.matches} matches, which no third image confirms: they may have a "
            "common error"
            for link, held in find_bridges(links)
            if not {images[number].id for number in held} <= search.earlier
        ]
    else:
        for pair in summaries:
            if not pair.matches and pair.first not in lonely and pair.second not in lonely:
                warnings.append(f"{pair.first} and {pair.second}: no matches")
    return TiePoints(points, ground, summaries, tuple(warnings), holds)


def find_overlapping_pairs(
    images: Sequence[Image], options: TieOptions | None = None, surface: HeightSurface | None = None,
    earlier: Collection[str] = (),
) -> list[tuple[str, str]]:  # fmt: skip
    """Return the ids of the images that may show common ground, pair by pair, before any pixel is looked at.

    Parameters are those of `find_tie_points`. Raises `InputError` where fewer than two images have pixels, or no two of
    them overlap.
    """
    search = TieSearch(images, options or TieOptions(), surface, open_scheduler(), None, marked=False, earlier=earlier)
    found = search.find_overlaps_of_images()
    own = [images[index].id for index in search.usable]
    return [(own[pair.first], own[pair.second]) for pair in found]
