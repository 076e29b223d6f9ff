"""Similarity of two windows of unknown cameras from scale-invariant features.

SIFT features (Lowe 2004) that pass the ratio test vote for one similarity by random samples (RANSAC; Fischler and
Bolles 1981). Its scale is that of the networks searched. Where those find no root, as in small windows with little
overlap and few common super points, a clear vote gives the place where the network begins.
"""

from typing import NamedTuple

import numpy as np

from ...block.block import Raster
from ...foundation.pixel_filters import reduce_by_area, reduce_mask
from ...foundation.thresholds import threshold, thresholds
from ..interest_points.windows import Area
from ..tile_matching.features import SiftFeatures, compute_root_sift, detect_sift_features
from ..tile_matching.rpc_consistency import match_descriptors
from .tolerances import NETWORK_PAIRS


@thresholds
class SCALE:
    """How features vote for the similarity of two windows."""

    features: int = threshold(6000, "features", "most features of a window")
    ratio: float = threshold(
        0.85, "", "largest ratio of the two nearest descriptors; the vote rejects what is wrong", "Lowe 2004: 0.8"
    )
    vote_px: float = threshold(4.0, "px", "largest residual of a pair that votes, relief included")
    samples: int = threshold(5000, "samples", "random samples of two pairs")
    shortest_base_px: float = threshold(20.0, "px", "smallest distance of the two points of a sample")
    fewest_votes: int = threshold(10, "pairs", "fewest votes that tell the scale", NETWORK_PAIRS)
    clear_votes: int = threshold(15, "pairs", "votes from which a network may begin (chance: 4 at most)", NETWORK_PAIRS)
    unknown_scales: tuple[float, float] = threshold((0.6, 1.7), "", "scales searched where features tell nothing")
    margin: float = threshold(1.05, "", "factor to both sides of the scale found")
    glance_px: int = threshold(500_000, "px", "area of a window that features are first found in")
    look_px: int = threshold(16_000_000, "px", "and where that fails")


class FeatureVote(NamedTuple):
    """Similarity that the features of two windows vote for.

    scales : range of pixels of the second window for one of the first, in which the true scale lies
    affine : (2, 3) similarity from positions of the first image to those of the second; None without a clear vote
    """

    scales: tuple[float, float] = SCALE.unknown_scales
    affine: np.ndarray | None = None


def vote_by_features(
    first: Raster, second: Raster, first_window: Area, second_window: Area, most_px: int = SCALE.glance_px
) -> FeatureVote:
    """Return the similarity that features vote for; `SCALE.unknown_scales` where they do not agree.

    Both windows are reduced alike until the larger has at most ``most_px`` pixels: that is quick, and enough where they
    overlap well.
    """
    areas = first_window, second_window
    largest = max((area.right - area.left) * (area.bottom - area.top) for area in areas)
    reduction = max(float(np.sqrt(largest / most_px)), 1.0)
    here, there = (_detect_features(*seen, reduction) for seen in zip((first, second), areas, strict=True))
    i, j = match_descriptors(compute_root_sift(here.descriptors), compute_root_sift(there.descriptors), SCALE.ratio)
    found = _find_common_similarity(here.xy[i], there.xy[j])
    if found is None:
        return FeatureVote()
    matrix, shift, votes = found
    scale = float(np.hypot(*matrix[:, 0]))
    # From the reduced windows' pixels to those of the images
    origins = [np.array([area.left, area.top], dtype=np.float64) for area in areas]
    shift = origins[1] - 0.5 + reduction * (shift + 0.5 - 0.5 * matrix.sum(axis=1)) - matrix @ (origins[0] - 0.5)
    return FeatureVote(
        (scale / SCALE.margin, scale * SCALE.margin),
        np.column_stack([matrix, shift]) if votes >= SCALE.clear_votes else None,
    )


def _find_common_similarity(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Return matrix ``(2, 2)``, shift ``(2,)`` and votes of the similarity that most pairs ``(n, 2)`` agree with.

    None where too few do. A similarity is ``w = a z + b`` in complex numbers; two pairs are a sample.
    """
    if len(first) < SCALE.fewest_votes:
        return None
    z, w = (np.ascontiguousarray(xy, dtype=np.float64).view(np.complex128)[:, 0] for xy in (first, second))
    one, other = np.random.default_rng(1).integers(0, len(z), (2, SCALE.samples))
    apart = np.abs(z[one] - z[other]) > SCALE.shortest_base_px
    one, other = one[apart], other[apart]
    a = (w[one] - w[other]) / (z[one] - z[other])
    b = w[one] - a * z[one]
    votes = [int(np.sum(np.abs(w - (a_k * z + b_k)) <= SCALE.vote_px)) for a_k, b_k in zip(a, b, strict=True)]
    if not votes or max(votes) < SCALE.fewest_votes:
        return None
    best = int(np.argmax(votes))
    agree = np.abs(w - (a[best] * z + b[best])) <= SCALE.vote_px
    (a_all, b_all), *_ = np.linalg.lstsq(np.column_stack([z[agree], np.ones(max(votes))]), w[agree], rcond=None)
    matrix = np.array([[a_all.real, -a_all.imag], [a_all.imag, a_all.real]])
    return matrix, np.array([b_all.real, b_all.imag]), max(votes)


def _detect_features(raster: Raster, area: Area, reduction: float) -> SiftFeatures:
    """Return the features of a reduced window."""
    grey, valid = raster.read(area.left, area.top, area.right - area.left, area.bottom - area.top)
    if reduction > 1.0:
        size = int(grey.shape[1] / reduction), int(grey.shape[0] / reduction)
        grey, valid = reduce_by_area(np.asarray(grey, np.float32), size), reduce_mask(valid, size)
    return detect_sift_features(grey, valid, SCALE.features)
