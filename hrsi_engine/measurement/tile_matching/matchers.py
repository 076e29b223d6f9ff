"""Finders of candidates: which points of two windows of nearly the same geometry may be the same.

A finder gets the first window and the second one resampled to the geometry of the first (`TileFrame.resampled`), both
as `ImageTile` in pixels of the first window, and how far a point may be displaced. It returns candidates: many may be
wrong, RPC geometry and least-squares matching decide. To add one, write a function and enter it in `MATCHERS`.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from ...block.block import ArrayRaster
from ...foundation.pixel_filters import box_mean, compute_smaller_eigenvalue, erode, largest_within, slopes
from ...foundation.thresholds import threshold, thresholds
from ..control_network.matching import match_windows
from ..control_network.options import ControlNetworkOptions as NetworkOptions
from ..window_matching.correlation import correlate_template, locate_vertex
from .epipolar import match_descriptors
from .features import FEATURES, compute_root_sift, detect_sift_features
from .options import TileMatchOptions
from .types import ImageTile


@thresholds
class FINDER:
    """Distinct windows of a tile, and when one is found by correlation."""

    half_px: int = threshold(12, "px", "half the side of a window")
    most: int = threshold(36, "places", "sought in a tile")
    corner_px: int = threshold(7, "px", "side of the square over which slopes make a corner")
    corner_share: float = threshold(0.02, "", "of the strongest corner, below which a place is not distinct")
    correlation: float = threshold(0.6, "", "below which a place is not found")
    rival: float = threshold(0.9, "", "correlation over the best one, above which a second peak makes it ambiguous")
    rival_px: int = threshold(4, "px", "from the best peak, beyond which a peak is a second one")


SOBEL = np.array([1.0, 2.0, 1.0]) / 4.0, np.array([-1.0, 0.0, 1.0]) / 2.0


def find_distinct_places(pixels: np.ndarray, valid: np.ndarray, most: int = FINDER.most) -> np.ndarray:
    """Return columns and rows ``(n, 2)`` of distinct corners whose window lies on valid pixels, evenly spread."""
    usable = erode(valid, 2 * FINDER.half_px + 1, outside=False)
    if not usable.any():
        return np.empty((0, 2), dtype=np.int64)
    by_x, by_y = slopes(pixels, *SOBEL)
    xx, yy, xy = (box_mean(product, FINDER.corner_px) for product in (by_x * by_x, by_y * by_y, by_x * by_y))
    strength = compute_smaller_eigenvalue(xx, yy, xy)
    strong = strength > FINDER.corner_share * strength[usable].max()
    rows, columns = np.nonzero(usable & strong & (strength >= largest_within(strength, 1.5)))
    order = np.argsort(-strength[rows, columns], kind="stable")
    candidates = np.column_stack([columns, rows])[order]
    distance = np.sqrt(pixels.size / (2.0 * most))
    chosen: list[np.ndarray] = []
    while len(candidates) and len(chosen) < most:
        chosen.append(candidates[0])
        candidates = candidates[np.linalg.norm(candidates - candidates[0], axis=1) >= distance]
    return np.array(chosen, dtype=np.int64).reshape(-1, 2)


def seek(
    pixels: np.ndarray, places: np.ndarray, other: np.ndarray, known: np.ndarray, offset: tuple[float, float],
    reach_px: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return which places are found in another array of the same geometry, and where, in pixels of the first.

    ``offset`` is where the other's first pixel lies in the first; a place is sought within ``reach_px`` of where it is
    expected, that is, at the same position. Places with a rival, or at the edge of the search, are not found.
    """
    half, reach, found, where = FINDER.half_px, int(np.ceil(reach_px)) + 1, [], []
    middle: np.ndarray = places - np.round(offset).astype(np.int64)
    place: np.ndarray
    at: np.ndarray
    for number, (place, at) in enumerate(zip(places, middle, strict=True)):
        low, high = np.maximum(at - half - reach, 0), np.minimum(at + half + reach + 1, other.shape[::-1])
        if ((high - low) < 2 * half + 4).any() or not known[low[1] : high[1], low[0] : high[0]].all():
            continue
        window = pixels[place[1] - half : place[1] + half + 1, place[0] - half : place[0] + half + 1]
        surface = correlate_template(window, other[low[1] : high[1], low[0] : high[0]])
        peak = _find_clear_peak(surface)
        if peak is not None:
            found.append(number)
            where.append(peak + low + half + np.round(offset))
    return np.array(found, dtype=np.int64), np.array(where, dtype=np.float64).reshape(-1, 2)


def _find_clear_peak(surface: np.ndarray) -> np.ndarray | None:
    """Return column and row of the highest correlation to a fraction; None where it is low, at the edge or doubtful."""
    row, column = np.unravel_index(int(surface.argmax()), surface.shape)
    best = surface[row, column]
    rows, columns = surface.shape
    if not best > FINDER.correlation or not (0 < row < rows - 1 and 0 < column < columns - 1):
        return None
    top, left = max(row - FINDER.rival_px, 0), max(column - FINDER.rival_px, 0)
    rest = surface.copy()
    rest[top : row + FINDER.rival_px + 1, left : column + FINDER.rival_px + 1] = -1.0
    if rest.max() > FINDER.rival * best:
        return None
    return np.array([column, row]) + locate_vertex(surface, int(row), int(column))


class CandidateMatches(NamedTuple):
    """Positions ``(n, 2)`` (column, row) of possibly equal points, both in pixels of the first window."""

    first: np.ndarray
    second: np.ndarray


Finder = Callable[[ImageTile, ImageTile, float, TileMatchOptions], CandidateMatches]


def find_sift(first: ImageTile, second: ImageTile, reach_px: float, options: TileMatchOptions) -> CandidateMatches:
    """SIFT (Lowe 2004) with square-rooted descriptors, mutual nearest neighbours and a lenient ratio test."""
    most = options.features
    here = first.compute_once(("sift", most), lambda: detect_sift_features(first.pixels, first.valid, most))
    there = detect_sift_features(second.pixels, second.valid, most)
    ours, theirs = (compute_root_sift(features.descriptors) for features in (here, there))
    i, j = match_descriptors(ours, theirs, FEATURES.lenient_ratio)
    return _select_near(here.xy[i] + first.origin_px, there.xy[j] + second.origin_px, reach_px)


def find_patches(first: ImageTile, second: ImageTile, reach_px: float, options: TileMatchOptions) -> CandidateMatches:
    """A few distinct windows sought by correlation: quick where the prediction is known to some ten pixels."""
    places = find_distinct_places(first.pixels, first.valid)
    number, where = seek(first.pixels, places, second.pixels, second.valid, second.origin_px, reach_px)
    return CandidateMatches(places[number].astype(np.float64), where)


def find_by_network(
    detector: str, first: ImageTile, second: ImageTile, reach_px: float, options: TileMatchOptions
) -> CandidateMatches:
    """Control networks (thesis chapter 3) of the given interest points: geometry first, then grey values.

    Both windows have nearly the same geometry here, so that only what differs by height is left to the tolerances.
    """
    rasters = ArrayRaster(first.pixels, first.valid), ArrayRaster(second.pixels, second.valid)
    result = match_windows(rasters[0], rasters[1], NetworkOptions(scales=(1.0, 1.0), detector=detector, threads=1))
    return _select_near(result.positions.first + first.origin_px, result.positions.second + second.origin_px, reach_px)


def _select_near(first: np.ndarray, second: np.ndarray, reach_px: float) -> CandidateMatches:
    near = np.linalg.norm(first - second, axis=1) <= 1.5 * reach_px
    return CandidateMatches(first[near], second[near])


MATCHERS: dict[str, Finder] = {
    "sift": find_sift,
    "patches": find_patches,
    "control-network": partial(find_by_network, "harris"),
    "centres": partial(find_by_network, "centres"),
}
