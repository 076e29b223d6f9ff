"""Which images of a block overlap, at the true height of the ground, without looking at every pair.

Polygons hold what an image may see between its lowest and highest ground; those that touch are found through a tree,
and only of those pairs the footprints are intersected. Where no DEM tells how high the ground is, a pair counts at the
height where it overlaps most: matching finds the true one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from shapely.geometry import Polygon

from ...block.block import Image
from ...block.footprints import (
    OUTLINE_PER_SIDE,
    footprint,
    footprint_between,
    footprints_at,
    overlap_shares,
    touching_pairs,
)
from ...foundation.errors import InputError
from ...surface.dem import HeightSurface, surface_heights

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
        raise InputError("`dem` has no heights below the images: name a DEM of their area")
    return [known or _rpc_range(image) for image, known in zip(images, ranges, strict=True)]


def _rpc_range(image: Image) -> GroundRange:
    low, high = image.rpc.height_range
    return GroundRange(max(low, SEA_LEVEL_TO_EVEREST_M[0]), min(high, SEA_LEVEL_TO_EVEREST_M[1]))


def _ground_range(image: Image, surface: HeightSurface | None, margin_m: float) -> GroundRange | None:
    """Return the heights of a surface below an image; None without any."""
    if surface is None:
        return None
    ground = image.rpc.localize(image.grid_px(24, 24), image.middle_height_m).ground
    heights = surface_heights(surface, ground[np.isfinite(ground).all(axis=1), :2])
    known = heights[np.isfinite(heights)]
    if not len(known):
        return None
    return GroundRange(float(known.min()) - margin_m, float(known.max()) + margin_m)


def candidate_pairs(images: Sequence[Image], ranges: Sequence[GroundRange]) -> list[tuple[int, int]]:
    """Return index pairs of images whose footprints touch, anywhere between their heights."""
    return touching_pairs([footprint_between(image, *heights) for image, heights in zip(images, ranges, strict=True)])


def overlap_share(first: Image, second: Image, heights: GroundRange, surface: HeightSurface | None = None) -> float:
    """Return the larger share that one image sees of the other; without surface at the height where it is largest."""
    if surface is not None:
        return max(overlap_shares(*(_footprint_on(image, surface, heights) for image in (first, second))))
    # Heights between which the two footprints slide past one another by at most a tenth of an image
    centre = first.centre_px[None]
    ends = [second.rpc.project(first.rpc.localize(centre, height).ground)[0] for height in heights]
    slide = np.abs(ends[1] - ends[0]) / (2.0 * second.half_size_px)
    steps = 1 if not np.isfinite(slide).all() else int(np.clip(np.ceil(10.0 * slide.max()), 1, 40))
    levels = np.linspace(*heights, steps + 1)
    return max(
        max(overlap_shares(*both))
        for both in zip(*(footprints_at(image, levels) for image in (first, second)), strict=True)
    )


def _footprint_on(image: Image, surface: HeightSurface, heights: GroundRange) -> Polygon:
    """Return the footprint on a surface: each point's height is looked up where it lies at that height."""
    outline = image.outline_px(OUTLINE_PER_SIDE)
    height = np.full(len(outline), 0.5 * (heights.low_m + heights.high_m))
    for _ in range(3):
        terrain = surface_heights(surface, image.rpc.localize(outline, height).ground[:, :2])
        height = np.where(np.isfinite(terrain), terrain, height)
    return footprint(image, height)


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


# ---- resolutions ---------------------------------------------------------------------------------------------------


def mean_ground_sample_m(image: Image) -> float:
    """Return the side of a square as large as a pixel on the ground, in the middle of an image."""
    ground = image.rpc.localize(image.centre_px[None], image.middle_height_m).ground
    if not np.isfinite(ground).all():
        return 1.0
    return float(1.0 / max(image.rpc.px_per_m(ground)[0], 1e-6))


def coarseness(image: Image) -> int:
    """Return a rank of an image's pixel size, in factors of two: of a pair the coarser image is the reference."""
    return round(np.log2(mean_ground_sample_m(image)))


def resolution_step(first: Image, second: Image) -> int:
    """Return how many pixels of the second image make one as large as the first's."""
    return max(1, round(mean_ground_sample_m(first) / mean_ground_sample_m(second)))
