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
from ..control_network.matching import match_windows
from ..control_network.options import ControlNetworkOptions as NetworkOptions
from .features import FEATURES, compute_root_sift, detect_sift_features
from .options import TileMatchOptions
from .patch_finder import find_distinct_places, seek
from .rpc_consistency import match_descriptors
from .types import ImageTile


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
