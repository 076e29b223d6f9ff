"""Overlapping pairs of a block's images, at the true height of the ground, without a test of every pair.

Polygons hold what an image may see between its lowest and highest ground; those that touch are found through a tree,
and only of those pairs the footprints are intersected. Where no DEM tells how high the ground is, a pair counts at the
height where it overlaps most: matching finds the true one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from shapely.geometry import Polygon

from ...block.block import Image
from ...block.columns import rank_in_groups
from ...block.imaging_geometry import (
    OUTLINE_PER_SIDE,
    compute_footprint,
    compute_footprint_hull,
    compute_overlap,
    compute_view_directions,
    find_touching_pairs,
    make_polygon,
)
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ...ground.geodesy import wrap_degrees
from ...surface.dem import HeightSurface, surface_heights

_YEAR = "rank correlation with matches 0.96, simulated year, 2026-11-22"


@thresholds
class CHOICE:
    """Which of many overlapping pairs are probed and matched."""

    features: int = threshold(600, "features", "of an image that are compared", _YEAR)
    agreeing_px: float = threshold(4.0, "px of the overview", "between offsets across the lines that are one")
    cells: int = threshold(3, "cells", "along each side of an image, for the ground that a pair covers")
    partners: int = threshold(40, "images", "with which an image is probed at most")
    measured_partners: int = threshold(60, "images", "whose overlap is measured; of more it is estimated")
    angle_scale_deg: float = threshold(20.0, "°", "between views, over which similarity falls to 1/e")
    chance: int = threshold(5, "features", "that agree by chance: a probe with no more is not significant", _YEAR)
    narrow_deg: float = threshold(1.5, "°", "angle between views below which a pair determines no heights")
    narrow_worth: float = threshold(0.6, "", "worth of such a pair over that of another")
    wanted_angle_deg: float = threshold(5.0, "°", "angle that one pair of each image should have")
    last_tries: int = threshold(3, "pairs", "tried of an image of which no probe is above chance")
    rounds: int = threshold(6, "rounds", "of new trees after failed pairs")
    found_worth: float = threshold(1e6, "features", "added to the worth of pairs that matched: they stay in new trees")


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
    ranges: list[GroundRange | None] = []
    for image in images:
        known = np.empty(0)
        if surface is not None:
            ground = image.rpc.localize(image.grid_px(24, 24), image.middle_height_m).ground
            heights = surface_heights(surface, ground[np.isfinite(ground).all(axis=1), :2])
            known = heights[np.isfinite(heights)]
        low_high = (float(known.min()) - margin_m, float(known.max()) + margin_m) if len(known) else None
        ranges.append(None if low_high is None else GroundRange(*low_high))
    if surface is not None and not any(ranges):
        raise InputError("`dem` has no heights below the images: name a DEM of their area")
    lowest, highest = SEA_LEVEL_TO_EVEREST_M
    by_rpc = (image.rpc.height_range for image in images)
    return [
        known or GroundRange(max(low, lowest), min(high, highest))
        for known, (low, high) in zip(ranges, by_rpc, strict=True)
    ]


def find_candidate_pairs(images: Sequence[Image], ranges: Sequence[GroundRange]) -> list[tuple[int, int]]:
    """Return index pairs of images whose footprints touch, anywhere between their heights."""
    hulls = [compute_footprint_hull(image, *heights) for image, heights in zip(images, ranges, strict=True)]
    return find_touching_pairs(hulls)


class SlidingFootprint:
    """The footprint of an image at any height: its rays are straight, so two heights tell all others.

    It slides by ``slide (2,)`` degrees of lon, lat per metre of height; ``extent`` is the shorter side of its box.
    ``box (2, 4)`` has least and greatest lon, lat at the lower height, and what they change by per metre.
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


def intersect_heights(first: GroundRange, second: GroundRange) -> GroundRange:
    """Return the heights that both images may see; all of both where they exclude one another."""
    low, high = max(first.low_m, second.low_m), min(first.high_m, second.high_m)
    return GroundRange(low, high) if low < high else GroundRange(min(*first, *second), max(*first, *second))


def find_likely_overlaps(
    images: list[Image], ranges: Sequence[GroundRange], surface: HeightSurface | None, smallest: float
) -> list[Overlap]:
    """Return the pairs that share at least ``smallest``; of images that touch very many, those that may be probed."""
    candidates = find_candidate_pairs(images, ranges)
    if 2 * len(candidates) > CHOICE.measured_partners * len(images):
        # Approximate overlaps by the boxes around the footprints: the largest of three heights
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
        rough = [Overlap(*pair, part) for pair, part in zip(candidates, share.tolist(), strict=True)]
        first, second = np.array(candidates).T
        angle_deg = compute_convergence_deg(compute_central_views(images), first, second)
        rows = choose_probes(rough, angle_deg, CHOICE.measured_partners)
        candidates = [candidates[row] for row in rows.tolist()]
    # Pairs that share at least so much of one of them
    if surface is not None:
        outlines = [_compute_footprint(image, surface, heights) for image, heights in zip(images, ranges, strict=True)]
    else:
        sliding = [SlidingFootprint(image, heights) for image, heights in zip(images, ranges, strict=True)]
    found = []
    for a, b in find_candidate_pairs(images, ranges) if candidates is None else candidates:
        if surface is not None:
            of_pair = max(compute_overlap(outlines[a], outlines[b]))
        else:
            of_pair = compute_overlap_share(sliding[a], sliding[b], intersect_heights(ranges[a], ranges[b]))
        if of_pair >= smallest:
            found.append(Overlap(a, b, of_pair))
    return found


def choose_probes(overlaps: list[Overlap], angle_deg: np.ndarray, most: int = CHOICE.partners) -> np.ndarray:
    """Return the indices of the overlaps that are probed: of each image those that overlap most and look most alike.

    So the cost grows with the number of images, not with that of their pairs.
    """
    first, second = (np.array([getattr(pair, name) for pair in overlaps], np.int64) for name in ("first", "second"))
    prior = np.array([pair.share for pair in overlaps]) * np.exp(-angle_deg / CHOICE.angle_scale_deg)
    image, row = np.r_[first, second], np.tile(np.arange(len(overlaps)), 2)
    order = np.lexsort((-prior[row], image))
    return np.unique(row[order[rank_in_groups(image[order]) < most]])


def compute_central_views(images: list[Image]) -> np.ndarray:
    """Return unit vectors ``(n, 3)`` east, north, up from the middle of each image's ground to its satellite."""
    found = []
    for image in images:
        ground = image.rpc.localize(image.centre_px[None], image.rpc.height_off).ground
        is_known = np.isfinite(ground).all()
        found.append(compute_view_directions(image.rpc, ground)[0] if is_known else np.array([0.0, 0.0, 1.0]))
    return np.array(found)


def compute_convergence_deg(directions: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angles between the lines of sight of pairs of images."""
    cosine = np.einsum("nk,nk->n", directions[first], directions[second])
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


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
