"""Relative geometry of two images from their overviews: the offset between their RPCs and the heights of the ground.

Features of the two overviews are matched within bands along the epipolar lines; the width of the band is the error of
the RPCs, and is increased if nothing is found. Matches that agree with one offset across the lines determine this
offset, and their positions along the lines the heights of the ground: *apparent* heights, which contain the errors of
the RPCs along the lines. If there is a DEM, it provides the shape of the ground.

If too few features agree, the second image may be a negative of the first, or of another band, in which some bright
objects are dark: its features are then compared as those of its negative, and of both together. The descriptors of a
negative follow from those of the image, without reading its pixels again.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...block.block import Image
from ...block.sliding_footprints import GroundRange
from ...camera.rpc import RPC
from ...foundation.robust_scale import MAD_TO_SIGMA, robust_sigma
from ...foundation.thresholds import GRIDS, MEMORY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ...foundation.workers.scheduling import PartResult
from ...surface.dem import HeightSurface, Status, intersect_surface
from ..reference.predicted_patches import BIAS
from ..tile_matching.epipolar import check_rpc_consistency, compute_epipolar_deviation, transfer
from ..tile_matching.features import invert_descriptors
from ..tile_matching.types import HeightGrid, TilePairGeometry
from .overview import EpipolarLines, detect_features, match_in_bands
from .windows import ImageWindow, predict_window, read_tile

_CONTRASTS = "simulated pairs of other contrast, 2026-11-22"


@thresholds
class COARSE:
    """Conditions for matches of two overviews, and accuracy of the offsets and heights derived from them."""

    enough: int = threshold(
        60, "matches", "number that makes a pair certain: no other contrast is tried, no loop is needed", _CONTRASTS
    )
    enough_share: float = threshold(0.1, "", "… and share of the features; a negative gives 0.03 by chance", _CONTRASTS)
    band_growth: tuple[float, float, float] = threshold((1.0, 4.0, 16.0), "", "search ranges, relative to `margin_px`")
    floor_px: float = threshold(1.0, "px of the overview", "smallest standard deviation of a match")
    same_view_px: float = threshold(2.0, "px", "smallest parallax from which heights are estimated")


@dataclass(frozen=True, eq=False)
class CoarseJob:
    """A pair of overviews: images, reduction factors ``steps``, range of heights, largest error of the RPCs (px)."""

    first: Image
    second: Image
    steps: tuple[int, int]
    heights: GroundRange
    margin_px: float
    terrain_m: np.ndarray | None = None  #: heights of a DEM at `place_height_nodes` of the first image, NaN if unknown


def place_height_nodes(size: tuple[int, int]) -> tuple[np.ndarray, tuple[int, int], float]:
    """Return the positions ``(n, 2)`` of the nodes of an image's height grid, its shape and its spacing (px)."""
    spacing = max(max(size) / (GRIDS.fine - 1.0), 32.0)
    columns, rows = (int(np.ceil(length / spacing)) + 1 for length in size)
    nodes = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) * spacing
    return nodes, (rows, columns), spacing


def sample_terrain(image: Image, surface: HeightSurface) -> np.ndarray:
    """Return the heights of a surface at an image's height nodes; NaN for nodata."""
    ground, status = intersect_surface(image.rpc, place_height_nodes(image.known_size)[0], surface)
    return np.where(status == Status.FOUND, ground[:, 2], np.nan)


def reduce_rpc(rpc: RPC, step: int) -> RPC:
    """Return the RPC of an image's overview, whose pixels are means of ``step`` x ``step`` pixels."""
    middle = (step - 1) / 2.0
    return rpc.resample((step, step), (middle, middle))


def match_overviews(job: CoarseJob, first: PartResult, second: PartResult) -> PartResult:
    """Return ``first_xy``, ``second_xy (n, 2)`` (full-resolution px) of the consistent matches, and ``contrasts``.

    If the overviews have too few, windows of a higher resolution are compared.
    """
    agreement = _match_in_any_contrast(job, first, second)
    if len(agreement["first_xy"]) < SAMPLES.tested and max(job.steps) > 1:
        finer = replace(job, steps=(max(1, job.steps[0] // BIAS.growth), max(1, job.steps[1] // BIAS.growth)))
        probed = _match_in_any_contrast(finer, *_detect_in_windows(finer))
        agreement = max(agreement, probed, key=lambda matches: len(matches["first_xy"]))
    return agreement


def _match_in_any_contrast(job: CoarseJob, first: PartResult, second: PartResult) -> PartResult:
    """Return the consistent matches with the second image; if they are few, also with its negative or with both."""
    matches = _match_features(job, first, second) | {"contrasts": np.array([1])}
    fewer = min(len(first["xy"]), len(second["xy"]))
    if len(matches["first_xy"]) >= max(COARSE.enough, COARSE.enough_share * fewer):
        return matches
    negative = second | {"descriptors": invert_descriptors(second["descriptors"])}
    both_contrasts = {name: np.concatenate([second[name], negative[name]]) for name in ("xy", "descriptors")}
    alternatives = [
        _match_features(job, first, features) | {"contrasts": np.array(contrasts)}
        for features, contrasts in ((negative, [-1]), (both_contrasts, [1, -1]))
    ]
    return max((matches, *alternatives), key=lambda result: len(result["first_xy"]))


def _match_features(job: CoarseJob, first: PartResult, second: PartResult) -> PartResult:
    """Return the matches of features that are consistent with one offset between the images."""
    rpcs = [reduce_rpc(image.rpc, step) for image, step in zip((job.first, job.second), job.steps, strict=True)]
    xy = [(part["xy"] - (step - 1) / 2.0) / step for part, step in zip((first, second), job.steps, strict=True)]
    lines = compute_epipolar_lines(rpcs[0], rpcs[1], xy[0], job.heights)
    size = np.array(job.second.size) / job.steps[1]
    best = np.empty((0, 2), dtype=np.int64)
    for growth in COARSE.band_growth:
        margin = growth * job.margin_px / job.steps[1] + COARSE.floor_px
        # Lines that intersect the second image, and its features near them
        low, high = lines.bounds(margin)
        first_rows = np.flatnonzero(((high >= 0.0) & (low <= size - 1.0)).all(axis=1))
        low_corner = low[first_rows].min(axis=0, initial=np.inf)
        high_corner = high[first_rows].max(axis=0, initial=-np.inf)
        second_rows = np.flatnonzero(((xy[1] >= low_corner) & (xy[1] <= high_corner)).all(axis=1))
        of_first, of_second = first["descriptors"][first_rows], second["descriptors"][second_rows]
        pairs = match_in_bands(of_first, of_second, lines.select(first_rows), xy[1][second_rows], margin)
        pairs = np.column_stack([first_rows[pairs[:, 0]], second_rows[pairs[:, 1]]])
        if len(pairs) >= SAMPLES.tested:
            middle = 0.5 * (job.heights.low_m + job.heights.high_m)
            places = xy[0][pairs[:, 0]], xy[1][pairs[:, 1]]
            pairs = pairs[check_rpc_consistency(rpcs[0], rpcs[1], *places, middle, COARSE.floor_px).good]
        if len(pairs) > len(best):
            best = pairs
        if len(best) >= SAMPLES.tested:
            break
    return {"first_xy": first["xy"][best[:, 0]], "second_xy": second["xy"][best[:, 1]]}


def _detect_in_windows(job: CoarseJob) -> tuple[PartResult, PartResult]:
    """Return the features of windows of the first image and of the parts of the second that can show them."""
    geometry = TilePairGeometry(
        job.first.rpc,
        job.second.rpc,
        *job.heights,
        margin_px=(COARSE.band_growth[1] * job.margin_px, COARSE.band_growth[1] * job.margin_px),
    )
    parts_by_image: tuple[list[PartResult], list[PartResult]] = ([], [])
    side = MEMORY.window_px * job.steps[0]
    for centre in job.first.grid_px(GRIDS.parts, GRIDS.parts, margin=-1.0 / GRIDS.parts).round().astype(int):
        window = ImageWindow(int(centre[0]) - side // 2, int(centre[1]) - side // 2, side, side)
        places = window, predict_window(geometry, window, 0)
        tiles = [
            read_tile(image, place, step)
            for image, place, step in zip((job.first, job.second), places, job.steps, strict=True)
        ]
        for features, tile in zip(parts_by_image, tiles, strict=True):
            if all(part_tile is not None for part_tile in tiles) and tile is not None:
                features.append(detect_features(tile, SAMPLES.large))
    nothing: PartResult = {"xy": np.empty((0, 2)), "descriptors": np.empty((0, 128), np.uint8)}
    first, second = (
        {name: np.concatenate([part[name] for part in (nothing, *parts)]) for name in nothing}
        for parts in parts_by_image
    )
    return first, second


def compute_epipolar_lines(first: RPC, second: RPC, xy: np.ndarray, heights: GroundRange) -> EpipolarLines:
    """Return the epipolar lines of points between two heights; NaN for points without a ground position there."""
    low, high = (transfer(first, second, xy, height) for height in heights)
    along = 0.5 * (high - low)
    reach = np.linalg.norm(along, axis=1)
    direction = np.where(reach[:, None] > 1e-6, along / np.maximum(reach, 1e-6)[:, None], (1.0, 0.0))
    return EpipolarLines(0.5 * (low + high), direction, reach)


# ---- from matches to geometry --------------------------------------------------------------------------------------


class PairEstimate(NamedTuple):
    """The estimated geometry of a pair, and the number of matches used for it."""

    geometry: TilePairGeometry
    matches: int


def estimate_pair(job: CoarseJob, matches: PartResult) -> PairEstimate | None:
    """Return the offset and the heights estimated from matches; None if there are too few."""
    first_xy, second_xy = matches["first_xy"], matches["second_xy"]
    if len(first_xy) < SAMPLES.tested:
        return None
    first, second = job.first.rpc, job.second.rpc
    middle = 0.5 * (job.heights.low_m + job.heights.high_m)
    miss = compute_epipolar_deviation(first, second, first_xy, second_xy, middle)
    noise_px = COARSE.floor_px * max(job.steps)
    stretch, contrasts = float(np.median(miss.stretch)), tuple(matches["contrasts"].tolist())
    if stretch * (job.heights.high_m - job.heights.low_m) < COARSE.same_view_px:
        # No parallax: an offset in both directions, and no information on heights
        difference = second_xy - transfer(first, second, first_xy, middle)
        offset = np.nanmedian(difference, axis=0)
        margin = SIGNIFICANCE.sigmas * MAD_TO_SIGMA * float(np.nanmedian(np.abs(difference - offset))) + noise_px
        margins = margin, margin
        geometry = TilePairGeometry(first, second, *job.heights, tuple(offset.tolist()), margins, contrasts=contrasts)
        return PairEstimate(geometry, len(first_xy))
    across = float(np.median(miss.across_px))
    # The mean direction across the epipolar lines, with the sign of `compute_epipolar_deviation`
    slope = transfer(first, second, first_xy, middle + 1.0) - transfer(first, second, first_xy, middle - 1.0)
    direction = np.nanmean(slope / np.linalg.norm(slope, axis=1, keepdims=True), axis=0)
    direction /= np.linalg.norm(direction)
    normal = np.array([-direction[1], direction[0]])
    across_sigma = float(robust_sigma(miss.across_px - across))
    grid, sigma = estimate_height_grid(job, first_xy, miss.height_m)
    sigma = max(sigma, 0.5 * noise_px / stretch)
    reach = SIGNIFICANCE.sigmas * sigma + noise_px / stretch
    low, high = np.percentile(miss.height_m, (1.0, 99.0))
    geometry = TilePairGeometry(
        first=first,
        second=second,
        lowest_m=min(low, float(grid.heights_m.min())) - reach,
        highest_m=max(high, float(grid.heights_m.max())) + reach,
        bias_px=(across * normal[0], across * normal[1]),
        margin_px=(noise_px, SIGNIFICANCE.sigmas * across_sigma + noise_px),
        heights=grid,
        height_sigma_m=sigma,
        contrasts=contrasts,
        seeds=np.column_stack([first_xy, second_xy]),
    )
    return PairEstimate(geometry, len(first_xy))


def estimate_height_grid(job: CoarseJob, xy: np.ndarray, height_m: np.ndarray) -> tuple[HeightGrid, float]:
    """Return apparent heights over the first image, from matches or from a DEM shifted to them, and their sigma (m)."""
    nodes, shape, spacing = place_height_nodes(job.first.known_size)
    candidates = [interpolate_median(xy, height_m, nodes)]
    if job.terrain_m is not None and np.isfinite(job.terrain_m).any():
        has_height = np.isfinite(job.terrain_m)
        terrain = (
            job.terrain_m
            if has_height.all()
            else interpolate_median(nodes[has_height], job.terrain_m[has_height], nodes, 1)
        )
        terrain_at_matches = HeightGrid(terrain.reshape(shape), (0.0, 0.0), spacing).interpolate(xy)
        candidates.insert(0, terrain + float(np.median(height_m - terrain_at_matches)))
    grids = [HeightGrid(heights.reshape(shape), (0.0, 0.0), spacing) for heights in candidates]
    sigmas = [float(robust_sigma(height_m - grid.interpolate(xy))) for grid in grids]
    return min(zip(grids, sigmas, strict=True), key=lambda pair: pair[1])


def interpolate_median(
    xy: np.ndarray, values: np.ndarray, places: np.ndarray, count: int = SAMPLES.tested, skipped: int = 0
) -> np.ndarray:
    """Return at each place the median of the ``count`` nearest values, without the ``skipped`` nearest ones."""
    count = min(count + skipped, len(xy))
    _, neighbours = cKDTree(xy).query(places, k=np.arange(1, count + 1))
    return np.asarray(np.median(values[neighbours[:, min(skipped, count - 1) :]], axis=1))
