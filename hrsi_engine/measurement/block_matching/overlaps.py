"""Overlapping pairs of a block's images, at the true height of the ground, without a test of every pair.

Polygons contain the area that an image can show between its lowest and highest ground; those that touch are found by a
spatial index, and footprints are intersected for these pairs only. Without a DEM, the overlap of a pair is that at the
height where it is largest; the height is determined later by matching.
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
)
from ...block.sliding_footprints import (
    GroundRange,
    SlidingFootprint,
    compute_overlap_share,
    estimate_overlap_shares,
    intersect_heights,
)
from ...foundation.errors import InputError
from ...foundation.thresholds import EQUALITY, threshold, thresholds
from ...surface.dem import HeightSurface, surface_heights

_YEAR = "rank correlation with matches 0.96, simulated year, 2026-11-22"


@thresholds
class CHOICE:
    """Selection of the pairs to be compared and matched in large blocks."""

    features: int = threshold(600, "features", "largest number of features of an image", _YEAR)
    agreeing_px: float = threshold(4.0, "px of the overview", "range of the offsets across epipolar lines that agree")
    partners: int = threshold(40, "images", "most images with which an image is compared")
    measured_partners: int = threshold(60, "images", "most overlaps of an image that are computed; beyond, estimated")
    chance: int = threshold(5, "features", "number that agree by chance; a comparison with no more is not used", _YEAR)
    wanted_angle_deg: float = threshold(5.0, "°", "smallest angle of one of each image's pairs")
    last_tries: int = threshold(
        3, "pairs", "pairs tried without significant comparisons, and examined if no pair matches; pairs that may fail"
    )
    rounds: int = threshold(6, "rounds", "largest number of selections after failed pairs")


SEA_LEVEL_TO_EVEREST_M = (-500.0, 9000.0)


class Overlap(NamedTuple):
    """Two images (indices) and the larger one of their two overlap shares (0 to 1)."""

    first: int
    second: int
    share: float


def find_ground_ranges(images: Sequence[Image], surface: HeightSurface | None, margin_m: float) -> list[GroundRange]:
    """Return the range of heights of each image: that of the surface with a margin, else the RPC's own.

    Raises `InputError` if the surface has no height in any image.
    """
    ranges: list[GroundRange | None] = []
    for image in images:
        terrain_heights = np.empty(0)
        if surface is not None:
            ground = image.rpc.localize(image.grid_px(24, 24), image.middle_height_m).ground
            heights = surface_heights(surface, ground[np.isfinite(ground).all(axis=1), :2])
            terrain_heights = heights[np.isfinite(heights)]
        low_high = (
            (float(terrain_heights.min()) - margin_m, float(terrain_heights.max()) + margin_m)
            if len(terrain_heights)
            else None
        )
        ranges.append(None if low_high is None else GroundRange(*low_high))
    if surface is not None and not any(ranges):
        raise InputError("`dem` has no heights below the images: name a DEM of their area")
    lowest, highest = SEA_LEVEL_TO_EVEREST_M
    by_rpc = (image.rpc.height_range for image in images)
    return [
        terrain_heights or GroundRange(max(low, lowest), min(high, highest))
        for terrain_heights, (low, high) in zip(ranges, by_rpc, strict=True)
    ]


def _compute_footprint(image: Image, surface: HeightSurface, heights: GroundRange) -> Polygon:
    """Return the footprint on a surface; the height of each outline point is iterated three times."""
    outline = image.outline_px(OUTLINE_PER_SIDE)
    height = np.full(len(outline), 0.5 * (heights.low_m + heights.high_m))
    for _ in range(3):
        terrain = surface_heights(surface, image.rpc.localize(outline, height).ground[:, :2])
        height = np.where(np.isfinite(terrain), terrain, height)
    return compute_footprint(image, height)


def find_likely_overlaps(
    images: list[Image], ranges: Sequence[GroundRange], surface: HeightSurface | None, smallest: float
) -> list[Overlap]:
    """Return pairs that overlap by at least ``smallest``; for images with very many, those selected for probes."""
    hulls = [compute_footprint_hull(image, *heights) for image, heights in zip(images, ranges, strict=True)]
    candidates = find_touching_pairs(hulls)
    are_many = 2 * len(candidates) > CHOICE.measured_partners * len(images)
    if are_many or surface is None:
        sliding = [SlidingFootprint(image, heights) for image, heights in zip(images, ranges, strict=True)]
    if are_many:
        share = estimate_overlap_shares(sliding, ranges, candidates)
        rough = [Overlap(*pair, part) for pair, part in zip(candidates, share.tolist(), strict=True)]
        first, second = np.array(candidates).T
        angle_deg = compute_convergence_deg(compute_central_views(images), first, second)
        candidates = [candidates[row] for row in choose_probes(rough, angle_deg, CHOICE.measured_partners).tolist()]
    # Pairs that overlap by the smallest share or more of one of the images
    if surface is not None:
        outlines = [_compute_footprint(image, surface, heights) for image, heights in zip(images, ranges, strict=True)]
    overlapping = []
    for a, b in candidates:
        if surface is not None:
            of_pair = max(compute_overlap(outlines[a], outlines[b]))
        else:
            of_pair = compute_overlap_share(sliding[a], sliding[b], intersect_heights(ranges[a], ranges[b]))
        if of_pair >= smallest:
            overlapping.append(Overlap(a, b, of_pair))
    return overlapping


def choose_probes(overlaps: list[Overlap], angle_deg: np.ndarray, limit: int = CHOICE.partners) -> np.ndarray:
    """Return the indices of the overlaps to be probed: of each image those with the largest prior of similarity.

    The prior is overlap times a function of the angle. The cost grows with the number of images, not of pairs.
    """
    first, second = (np.array([getattr(pair, name) for pair in overlaps], np.int64) for name in ("first", "second"))
    prior = np.array([pair.share for pair in overlaps]) * np.exp(-angle_deg / EQUALITY.direction_deg)
    image, row = np.r_[first, second], np.tile(np.arange(len(overlaps)), 2)
    order = np.lexsort((-prior[row], image))
    return np.unique(row[order[rank_in_groups(image[order]) < limit]])


def compute_central_views(images: list[Image]) -> np.ndarray:
    """Return unit vectors ``(n, 3)`` east, north, up from the centre of each image's ground to its satellite."""
    directions = []
    for image in images:
        ground = image.rpc.localize(image.centre_px[None], image.rpc.height_off).ground
        is_known = np.isfinite(ground).all()
        directions.append(compute_view_directions(image.rpc, ground)[0] if is_known else np.array([0.0, 0.0, 1.0]))
    return np.array(directions)


def compute_convergence_deg(directions: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angles in degrees between the lines of sight of pairs of images."""
    return np.degrees(np.arccos(np.clip(np.einsum("nk,nk->n", directions[first], directions[second]), -1.0, 1.0)))


# ---- resolutions ---------------------------------------------------------------------------------------------------


def mean_ground_sample_m(image: Image) -> float:
    """Return the side (m) of a square with the ground area of a pixel, at the centre of an image."""
    ground = image.rpc.localize(image.centre_px[None], image.middle_height_m).ground
    if not np.isfinite(ground).all():
        return 1.0
    return float(1.0 / max(image.rpc.px_per_m(ground)[0], 1e-6))


def rank_resolution(image: Image) -> int:
    """Return a rank of an image's pixel size, in factors of two; the image with the larger rank is the reference."""
    return round(np.log2(mean_ground_sample_m(image)))


def compute_resolution_step(first: Image, second: Image) -> int:
    """Return the ratio of the pixel sizes of two images as an integer, at least 1."""
    return max(1, round(mean_ground_sample_m(first) / mean_ground_sample_m(second)))
