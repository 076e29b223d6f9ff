"""Finders of candidates: which points of two windows of nearly the same geometry may be the same.

A finder gets the first window and the second one resampled to the geometry of the first (`TileFrame.resampled`), both
as `ImageTile` in pixels of the first window, and how far a point may be displaced. It returns candidates: many may be
wrong, RPC geometry and least-squares matching decide. To add one, write a function and enter it in `MATCHERS`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from ...block.block import ArrayRaster
from ..control_network.matching import match_windows
from ..control_network.options import ControlNetworkOptions as NetworkOptions
from .features import SIFT_CONTRAST, root_sift, stretch_to_byte
from .options import TileMatchOptions
from .patch_finder import distinct_places, seek
from .rpc_consistency import mutual_matches
from .types import ImageTile

LENIENT_RATIO = 0.9  # lenient: geometry rejects what is wrong


class CandidateMatches(NamedTuple):
    """Positions ``(n, 2)`` (column, row) of possibly equal points, both in pixels of the first window."""

    first: np.ndarray
    second: np.ndarray


Finder = Callable[[ImageTile, ImageTile, float, TileMatchOptions], CandidateMatches]


def no_candidates() -> CandidateMatches:
    """Return an empty table."""
    return CandidateMatches(np.empty((0, 2)), np.empty((0, 2)))


def find_sift(first: ImageTile, second: ImageTile, reach_px: float, options: TileMatchOptions) -> CandidateMatches:
    """SIFT (Lowe 2004) with square-rooted descriptors, mutual nearest neighbours and a lenient ratio test."""
    detector = cv2.SIFT_create(options.features, contrastThreshold=SIFT_CONTRAST)
    found = [_features(tile, detector) for tile in (first, second)]
    if any(len(xy) < 2 for xy, _ in found):
        return no_candidates()
    (xy1, d1), (xy2, d2) = found
    i, j = mutual_matches(root_sift(d1), root_sift(d2), LENIENT_RATIO)
    return _near(xy1[i], xy2[j], reach_px)


def find_akaze(first: ImageTile, second: ImageTile, reach_px: float, options: TileMatchOptions) -> CandidateMatches:
    """AKAZE (Alcantarilla 2013) with binary descriptors, mutual nearest neighbours."""
    detector = cv2.AKAZE_create(threshold=2e-4, max_points=options.features)
    found = [_features(tile, detector) for tile in (first, second)]
    if any(len(xy) < 2 for xy, _ in found):
        return no_candidates()
    (xy1, d1), (xy2, d2) = found
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(d1, d2)
    i, j = np.array([(m.queryIdx, m.trainIdx) for m in matches], dtype=np.int64).reshape(-1, 2).T
    return _near(xy1[i], xy2[j], reach_px)


def find_patches(first: ImageTile, second: ImageTile, reach_px: float, options: TileMatchOptions) -> CandidateMatches:
    """A few distinct windows sought by correlation: quick where the prediction is known to some ten pixels."""
    places = distinct_places(first.pixels, first.valid)
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
    return _near(result.positions.first + first.origin_px, result.positions.second + second.origin_px, reach_px)


def _features(tile: ImageTile, detector: cv2.Feature2D) -> tuple[np.ndarray, np.ndarray]:
    grey = stretch_to_byte(tile.pixels, tile.valid)
    if grey is None:
        return np.empty((0, 2)), np.empty((0, 1))
    mask = None if tile.valid.all() else cv2.erode(tile.valid.astype(np.uint8), np.ones((9, 9), np.uint8)) * 255
    keypoints, descriptors = detector.detectAndCompute(grey, mask)
    if not keypoints:
        return np.empty((0, 2)), np.empty((0, 1))
    return np.array([point.pt for point in keypoints], dtype=np.float64) + tile.origin_px, descriptors


def _near(first: np.ndarray, second: np.ndarray, reach_px: float) -> CandidateMatches:
    near = np.linalg.norm(first - second, axis=1) <= 1.5 * reach_px
    return CandidateMatches(first[near], second[near])


MATCHERS: dict[str, Finder] = {
    "sift": find_sift,
    "akaze": find_akaze,
    "patches": find_patches,
    "control-network": partial(find_by_network, "harris"),
    "centres": partial(find_by_network, "centres"),
}
