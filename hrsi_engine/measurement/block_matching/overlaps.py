"""Which images of a block overlap, at the true height of the ground, without looking at every pair.

Footprints between the lowest and highest ground that an image may see are boxes; boxes that touch are found through
a grid of cells as wide as footprints are, and only those pairs are looked at through their RPCs. Where no DEM tells
how high the ground is, a pair counts at the height where it overlaps most: matching finds the true one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import minimum_spanning_tree

from ...block.block import Image
from ...foundation.errors import InputError
from ...ground.geodesy import wrap_degrees
from ...surface.dem import HeightSurface, surface_heights

OVERLAP_GRID = 8  # points along each side of an image by which overlaps are measured
SEA_LEVEL_TO_EVEREST_M = (-500.0, 9000.0)


class Overlap(NamedTuple):
    """Two images (indices) and the larger of the two shares (0 to 1) that one sees of the other."""

    first: int
    second: int
    share: float


class GroundRange(NamedTuple):
    """Lowest and highest ground that an image may see, ellipsoidal metres."""

    low_m: float
    high_m: float


def ground_ranges(images: Sequence[Image], surface: HeightSurface | None, margin_m: float) -> list[GroundRange]:
    """Return the range of heights under each image: by the surface with a margin, else the RPC's own.

    Raises `InputError` where the surface has no height below any image.
    """
    ranges = [_ground_range(image, surface, margin_m) for image in images]
    if surface is not None and not any(ranges):
        raise InputError("the DEM has no heights below the images: name a DEM of their area")
    return [known or _rpc_range(image) for image, known in zip(images, ranges, strict=True)]


def _rpc_range(image: Image) -> GroundRange:
    low, high = image.rpc.height_range
    return GroundRange(max(low, SEA_LEVEL_TO_EVEREST_M[0]), min(high, SEA_LEVEL_TO_EVEREST_M[1]))


def _ground_range(image: Image, surface: HeightSurface | None, margin_m: float) -> GroundRange | None:
    """Return the heights of a surface below an image; None without any."""
    if surface is None:
        return None
    ground = image.rpc.localize(image.grid_px(24, 24), image.rpc.height_off).ground
    heights = surface_heights(surface, ground[np.isfinite(ground).all(axis=1), :2])
    known = heights[np.isfinite(heights)]
    if not len(known):
        return None
    return GroundRange(float(known.min()) - margin_m, float(known.max()) + margin_m)


def candidate_pairs(images: Sequence[Image], ranges: Sequence[GroundRange]) -> list[tuple[int, int]]:
    """Return index pairs of images whose footprints, anywhere between their heights, have touching boxes."""
    boxes = np.array([_box(image, heights) for image, heights in zip(images, ranges, strict=True)]).reshape(-1, 4)
    known = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    if not len(known):
        return []
    boxes[known, :2] = boxes[known[0], 0] + wrap_degrees(boxes[known, :2] - boxes[known[0], 0])
    pairs = _sharing_a_cell(boxes[known])
    first, second = boxes[known[pairs[:, 0]]], boxes[known[pairs[:, 1]]]
    touch = np.ones(len(pairs), dtype=bool)
    for low, high in ((0, 1), (2, 3)):
        touch &= (first[:, low] <= second[:, high]) & (second[:, low] <= first[:, high])
    return [(int(known[a]), int(known[b])) for a, b in pairs[touch]]


def _box(image: Image, heights: GroundRange) -> tuple[float, float, float, float]:
    """Return the smallest and largest longitude and latitude of an image's outline at both ends of the range."""
    outline = image.outline_px(3)
    ground = np.concatenate([image.rpc.localize(outline, height).ground for height in heights])
    ground = ground[np.isfinite(ground).all(axis=1)]
    if not len(ground):
        return (np.nan,) * 4
    lon = ground[0, 0] + wrap_degrees(ground[:, 0] - ground[0, 0])
    return lon.min(), lon.max(), ground[:, 1].min(), ground[:, 1].max()


def _sharing_a_cell(boxes: np.ndarray) -> np.ndarray:
    """Return pairs of boxes ``(k, 2)``, first < second, that lie in a common cell of a grid as wide as boxes are."""
    size = np.array([np.median(boxes[:, 1] - boxes[:, 0]), np.median(boxes[:, 3] - boxes[:, 2])]) + 1e-9
    members: dict[tuple[int, int], list[int]] = {}
    low = np.floor(boxes[:, [0, 2]] / size).astype(np.int64)
    high = np.floor(boxes[:, [1, 3]] / size).astype(np.int64)
    for index in range(len(boxes)):
        for column in range(low[index, 0], high[index, 0] + 1):
            for row in range(low[index, 1], high[index, 1] + 1):
                members.setdefault((column, row), []).append(index)
    parts = [np.array(cell)[np.column_stack(np.triu_indices(len(cell), 1))] for cell in members.values()]
    return np.unique(np.concatenate(parts), axis=0) if parts else np.empty((0, 2), dtype=np.int64)


def overlap_share(first: Image, second: Image, heights: GroundRange, surface: HeightSurface | None = None) -> float:
    """Return the larger share that one image sees of the other; without surface at the height where it is largest.

    The shares come from a grid of points, so that an overlap below about one in a hundred may count as none.
    """
    if surface is not None:
        return max(_share_on(first, second, surface, heights), _share_on(second, first, surface, heights))
    levels = _heights_to_try(first, second, heights)
    return max(_largest_share(first, second, levels), _largest_share(second, first, levels))


def _heights_to_try(first: Image, second: Image, heights: GroundRange) -> np.ndarray:
    """Return heights between which the two footprints slide past one another by at most a tenth of an image."""
    centre = first.centre_px[None]
    ends = [second.rpc.project(first.rpc.localize(centre, height).ground)[0] for height in heights]
    slide = np.abs(ends[1] - ends[0]) / (2.0 * second.half_size_px)
    steps = 1 if not np.isfinite(slide).all() else int(np.clip(np.ceil(10.0 * slide.max()), 1, 40))
    return np.linspace(*heights, steps + 1)


def _largest_share(first: Image, second: Image, heights_m: np.ndarray) -> float:
    """Return the share of the first image that the second shows, at the height where it is largest."""
    cells = _cells(first)
    ground = first.rpc.localize(np.tile(cells, (len(heights_m), 1)), np.repeat(heights_m, len(cells))).ground
    return float(_seen(second, ground).reshape(len(heights_m), -1).mean(axis=1).max())


def _share_on(first: Image, second: Image, surface: HeightSurface, heights: GroundRange) -> float:
    """Return the share on a surface: each point's height is looked up where it lies at that height."""
    cells = _cells(first)
    height = np.full(len(cells), 0.5 * (heights.low_m + heights.high_m))
    for _ in range(3):
        ground = first.rpc.localize(cells, height).ground
        terrain = surface_heights(surface, ground[:, :2])
        height = np.where(np.isfinite(terrain), terrain, height)
    return float(_seen(second, first.rpc.localize(cells, height).ground).mean())


def _seen(image: Image, ground: np.ndarray) -> np.ndarray:
    """Tell which ground points an image shows; those that are not finite it does not."""
    first_sample, last_sample, first_line, last_line = image.domain_px
    sample, line = image.rpc.project(np.nan_to_num(ground)).T
    seen = (sample >= first_sample) & (sample <= last_sample) & (line >= first_line) & (line <= last_line)
    return np.asarray(seen & np.isfinite(ground).all(axis=1))


def _cells(image: Image) -> np.ndarray:
    return image.grid_px(OVERLAP_GRID, OVERLAP_GRID, margin=-1.0 / OVERLAP_GRID)


def find_overlaps(
    images: Sequence[Image], ranges: Sequence[GroundRange], surface: HeightSurface | None, smallest: float
) -> list[Overlap]:
    """Return the pairs of images that share at least ``smallest`` (0 to 1) of one of them."""
    found = []
    for a, b in candidate_pairs(images, ranges):
        heights = common_heights(ranges[a], ranges[b])
        share = overlap_share(images[a], images[b], heights, surface)
        if share >= smallest:
            found.append(Overlap(a, b, share))
    return found


def common_heights(first: GroundRange, second: GroundRange) -> GroundRange:
    """Return the heights that both images may see; all of both where they exclude one another."""
    low, high = max(first.low_m, second.low_m), min(first.high_m, second.high_m)
    return GroundRange(low, high) if low < high else GroundRange(min(*first, *second), max(*first, *second))


def choose_pairs(overlaps: Sequence[Overlap], images: int, most_partners: int) -> list[Overlap]:
    """Return the pairs to match: each image's largest overlaps, and what keeps the block in one piece.

    Pairs among the ``most_partners`` largest of either image stay, and those of the tree of largest overlaps.
    """
    if not overlaps:
        return []
    first, second = (np.array([getattr(pair, name) for pair in overlaps]) for name in ("first", "second"))
    share = np.array([pair.share for pair in overlaps])
    place = np.minimum(*np.split(_place_among_own(np.r_[first, second], np.r_[share, share]), 2))
    tree = minimum_spanning_tree(coo_matrix((2.0 - share, (first, second)), shape=(images, images))).tocoo()
    needed = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    return [pair for pair, number in zip(overlaps, place, strict=True)
            if number < most_partners or (pair.first, pair.second) in needed]  # fmt: skip


def _place_among_own(image: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return each row's place, from 0, among the rows of its image by falling share."""
    order = np.lexsort((-share, image))
    _, start = np.unique(image[order], return_index=True)
    place = np.empty(len(image), dtype=np.int64)
    place[order] = np.arange(len(image)) - np.repeat(start, np.diff(np.r_[start, len(image)]))
    return place


# ---- resolutions ---------------------------------------------------------------------------------------------------


def mean_ground_sample_m(image: Image) -> float:
    """Return the side of a square as large as a pixel on the ground, in the middle of an image."""
    ground = image.rpc.localize(image.centre_px[None], image.rpc.height_off).ground
    if not np.isfinite(ground).all():
        return 1.0
    _, by_ground = image.rpc.project_with_metric_jacobian(ground)
    return float(1.0 / np.sqrt(max(abs(np.linalg.det(by_ground[0, :, :2])), 1e-12)))


def coarseness(image: Image) -> int:
    """Return a rank of an image's pixel size, in factors of two: of a pair the coarser image is the reference."""
    return round(np.log2(mean_ground_sample_m(image)))


def resolution_step(first: Image, second: Image) -> int:
    """Return how many pixels of the second image make one as large as the first's."""
    return max(1, round(mean_ground_sample_m(first) / mean_ground_sample_m(second)))
