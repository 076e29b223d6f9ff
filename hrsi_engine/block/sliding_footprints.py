"""Footprints as a function of the ground height, and the overlap of two images if that height is unknown."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..ground.geodesy import wrap_degrees
from .block import Image
from .imaging_geometry import OUTLINE_PER_SIDE, compute_overlap, make_polygon


class GroundRange(NamedTuple):
    """Lowest and highest ground height that an image may show, ellipsoidal metres."""

    low_m: float
    high_m: float


class SlidingFootprint:
    """The footprint of an image at any height, interpolated linearly between two heights, since rays are straight.

    It moves by ``slide (2,)`` degrees of lon, lat per metre of height; ``extent`` is the shorter side of its bounding
    box. ``box (2, 4)`` contains the minimum and maximum lon, lat at the lower height, and their changes per metre.
    """

    def __init__(self, image: Image, heights: GroundRange) -> None:
        outlines = (image.rpc.localize(image.outline_px(OUTLINE_PER_SIDE), height).ground[:, :2] for height in heights)
        self._heights, (self._low, high) = heights, outlines
        rise = high - self._low
        rise[:, 0] = wrap_degrees(rise[:, 0])
        self._rise = rise / max(heights.high_m - heights.low_m, 1e-9)
        finite = np.isfinite(rise).all(axis=1)
        self.slide = np.median(self._rise[finite], axis=0) if finite.any() else np.zeros(2)
        outline = self._low[finite] - self._low[finite][:1]
        outline[:, 0] = wrap_degrees(outline[:, 0])
        self.extent = float(np.min(np.ptp(outline, axis=0))) if finite.any() else 0.0
        self.box = np.full((2, 4), np.nan)
        if finite.any():
            corner = self._low[finite][0]
            self.box[:] = (np.r_[corner + outline.min(axis=0), corner + outline.max(axis=0)], np.tile(self.slide, 2))

    def outline(self, height_m: float) -> np.ndarray:
        """Return the lon, lat ``(k, 2)`` of the outline at a height."""
        return self._low + (height_m - self._heights.low_m) * self._rise


def compute_overlap_share(first: SlidingFootprint, second: SlidingFootprint, heights: GroundRange) -> float:
    """Return the larger one of the two overlap shares (0 to 1), at the height where it is largest."""
    # Height steps in which the footprints move relative to each other by at most a tenth of an image
    slide = float(np.abs(first.slide - second.slide).max()) * (heights.high_m - heights.low_m)
    steps = int(np.clip(np.ceil(10.0 * slide / max(min(first.extent, second.extent), 1e-9)), 1, 40))
    return max(
        max(compute_overlap(*(make_polygon(footprint.outline(level)) for footprint in (first, second))))
        for level in np.linspace(*heights, steps + 1)
    )


def intersect_heights(first: GroundRange, second: GroundRange) -> GroundRange:
    """Return the intersection of two height ranges; if it is empty, the range that contains both."""
    low, high = max(first.low_m, second.low_m), min(first.high_m, second.high_m)
    return GroundRange(low, high) if low < high else GroundRange(min(*first, *second), max(*first, *second))


def estimate_overlap_shares(
    footprints: Sequence[SlidingFootprint], ranges: Sequence[GroundRange], pairs: Sequence[tuple[int, int]]
) -> np.ndarray:
    """Return approximations of `compute_overlap_share` of pairs, ``(pairs,)``, from bounding boxes at three heights."""
    box, slide = np.array([footprint.box for footprint in footprints]).transpose(1, 0, 2)
    first, second = np.array(pairs, dtype=np.int64).T
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
    return share
