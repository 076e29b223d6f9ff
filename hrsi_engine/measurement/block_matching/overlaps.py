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
    compute_footprint,
    compute_footprint_hull,
    compute_overlap,
    find_touching_pairs,
    make_polygon,
)
from ...foundation.errors import InputError
from ...ground.geodesy import wrap_degrees
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


def find_ground_ranges(images: Sequence[Image], surface: HeightSurface | None, margin_m: float) -> list[GroundRange]:
    """Return the range of heights under each image: by the surface with a margin, else the RPC's own.

    Raises `InputError` where the surface has no height below any image.
    """
    ranges = [_find_surface_range(image, surface, margin_m) for image in images]
    if surface is not None and not any(ranges):
        raise InputError("`dem` has no heights below the images: name a DEM of their area")
    lowest, highest = SEA_LEVEL_TO_EVEREST_M
    by_rpc = (image.rpc.height_range for image in images)
    return [
        known or GroundRange(max(low, lowest), min(high, highest))
        for known, (low, high) in zip(ranges, by_rpc, strict=True)
    ]


def _find_surface_range(image: Image, surface: HeightSurface | None, margin_m: float) -> GroundRange | None:
    """Return the heights of a surface below an image; None without any."""
    if surface is None:
        return None
    ground = image.rpc.localize(image.grid_px(24, 24), image.middle_height_m).ground
    heights = surface_heights(surface, ground[np.isfinite(ground).all(axis=1), :2])
    known = heights[np.isfinite(heights)]
    if not len(known):
        return None
    return GroundRange(float(known.min()) - margin_m, float(known.max()) + margin_m)


def find_candidate_pairs(images: Sequence[Image], ranges: Sequence[GroundRange]) -> list[tuple[int, int]]:
    """Return index pairs of images whose footprints touch, anywhere between their heights."""
    return find_touching_pairs(
        [compute_footprint_hull(image, *heights) for image, heights in zip(images, ranges, strict=True)]
    )


class SlidingFootprint:
    """The footprint of an image at any height: its rays are straight, so two heights tell all others.

    It slides by ``slide (2,)`` degrees of lon, lat per metre of height; ``extent`` is the shorter side of its box.
    ``box (2, 4)`` has least and greatest lon, lat at the lower height, and what they change by per metre.

    Parameters
    ----------
    image : Image
        The image.
    heights : GroundRange
        Two heights of the ground.
    """

    def __init__(self, image: Image, heights: GroundRange) -> None:
        at = (image.rpc.localize(image.outline_px(OUTLINE_PER_SIDE), height).ground[:, :2] for height in heights)
        self._heights, (self._low, high) = heights, at
        rise = high - self._low
        rise[:, 0] = wrap_degrees(rise[:, 0])
        self._rise = rise / max(heights.high_m - heights.low_m, 1e-9)
        known = np.isfinite(rise).all(axis=1)
        self.slide = np.median(self._rise[known], axis=0) if known.any() else np.zeros(2)
        around = self._low[known] - self._low[known][:1]
        around[:, 0] = wrap_degrees(around[:, 0])
        self.extent = float(np.min(np.ptp(around, axis=0))) if known.any() else 0.0
        self.box = np.full((2, 4), np.nan)
        if known.any():
            corner = self._low[known][0]
            self.box[:] = np.r_[corner + around.min(axis=0), corner + around.max(axis=0)], np.tile(self.slide, 2)

    def outline(self, height_m: float) -> np.ndarray:
        """Return the outline's lon, lat at a height, ``(k, 2)``."""
        return self._low + (height_m - self._heights.low_m) * self._rise


def compute_overlap_share(first: SlidingFootprint, second: SlidingFootprint, heights: GroundRange) -> float:
    """Return the larger share that one image sees of the other, at the height where it is largest."""
    # Heights between which the two footprints slide past one another by at most a tenth of an image
    slide = float(np.abs(first.slide - second.slide).max()) * (heights.high_m - heights.low_m)
    steps = int(np.clip(np.ceil(10.0 * slide / max(min(first.extent, second.extent), 1e-9)), 1, 40))
    return max(
        max(compute_overlap(*(make_polygon(footprint.outline(level)) for footprint in (first, second))))
        for level in np.linspace(*heights, steps + 1)
    )


def _compute_footprint(image: Image, surface: HeightSurface, heights: GroundRange) -> Polygon:
    """Return the footprint on a surface: each point's height is looked up where it lies at that height."""
    outline = image.outline_px(OUTLINE_PER_SIDE)
    height = np.full(len(outline), 0.5 * (heights.low_m + heights.high_m))
    for _ in range(3):
        terrain = surface_heights(surface, image.rpc.localize(outline, height).ground[:, :2])
        height = np.where(np.isfinite(terrain), terrain, height)
    return compute_footprint(image, height)


def find_overlaps(
    images: Sequence[Image],
    ranges: Sequence[GroundRange],
    surface: HeightSurface | None,
    smallest: float,
    candidates: Sequence[tuple[int, int]] | None = None,
) -> list[Overlap]:
    """Return the pairs of images, of all or of candidates, that share at least ``smallest`` (0 to 1) of one of them."""
    if surface is not None:
        outlines = [_compute_footprint(image, surface, heights) for image, heights in zip(images, ranges, strict=True)]
    else:
        sliding = [SlidingFootprint(image, heights) for image, heights in zip(images, ranges, strict=True)]
    found = []
    for a, b in find_candidate_pairs(images, ranges) if candidates is None else candidates:
        if surface is not None:
            share = max(compute_overlap(outlines[a], outlines[b]))
        else:
            share = compute_overlap_share(sliding[a], sliding[b], intersect_heights(ranges[a], ranges[b]))
        if share >= smallest:
            found.append(Overlap(a, b, share))
    return found


def estimate_overlaps(
    images: Sequence[Image], ranges: Sequence[GroundRange], candidates: Sequence[tuple[int, int]]
) -> list[Overlap]:
    """Return roughly what candidates share: boxes around footprints, where that is largest of three heights."""
    boxes = [SlidingFootprint(image, heights).box for image, heights in zip(images, ranges, strict=True)]
    box, slide = np.array(boxes).transpose(1, 0, 2)
    first, second = np.array(candidates, dtype=np.int64).T
    low, high = np.array(ranges).T
    bottom, top = np.maximum(low[first], low[second]), np.minimum(high[first], high[second])
    share = np.zeros(len(first))
    for part in (0.0, 0.5, 1.0):
        level = bottom + part * (top - bottom)
        x0, y0, x1, y1 = (box[first] + (level - low[first])[:, None] * slide[first]).T
        u0, v0, u1, v1 = (box[second] + (level - low[second])[:, None] * slide[second]).T
        turn = wrap_degrees(u0 - x0) - (u0 - x0)
        width = np.minimum(x1, u1 + turn) - np.maximum(x0, u0 + turn)
        common = np.maximum(width, 0.0) * np.maximum(np.minimum(y1, v1) - np.maximum(y0, v0), 0.0)
        smaller = np.minimum((x1 - x0) * (y1 - y0), (u1 - u0) * (v1 - v0))
        share = np.fmax(share, common / np.maximum(smaller, 1e-18))
    return [Overlap(*pair, part) for pair, part in zip(candidates, share.tolist(), strict=True)]


def intersect_heights(first: GroundRange, second: GroundRange) -> GroundRange:
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


def rank_resolution(image: Image) -> int:
    """Return a rank of an image's pixel size, in factors of two: of a pair the coarser image is the reference."""
    return round(np.log2(mean_ground_sample_m(image)))


def compute_resolution_step(first: Image, second: Image) -> int:
    """Return how many pixels of the second image make one as large as the first's."""
    return max(1, round(mean_ground_sample_m(first) / mean_ground_sample_m(second)))
