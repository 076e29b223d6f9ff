"""How many correspondences two roots can have at most, for every rotation, by voting over leaf pairs.

Every root's leaves are counted in a histogram over distance and direction. A rotation shifts the directions, so the
number of leaves of one root that meet a leaf of the other is a circular correlation of two histograms, summed over the
distances. After a Fourier transform over the directions it is one matrix product a frequency for all pairs of roots at
once. The second histogram is widened by the tolerances and by the bins, so that no correspondence is lost: the votes
bound the true number from above.

Cost for m and n roots with R bins of distance and B of direction: ``O(m n B (R + log B))``, whatever the number of
leaves, against ``O(m n l^4)`` for the exhaustive search over l leaves a root.
"""

from collections.abc import Iterator

import numpy as np
from scipy import fft

from ...foundation.thresholds import threshold, thresholds
from .polar import find_leaves
from .tolerances import Tolerance


@thresholds
class VOTING:
    """Bins of the histograms by which pairs of roots are bounded."""

    directions: int = threshold(256, "bins", "bins of direction")
    ring_px: float = threshold(4.0, "px", "width of a bin of distance")
    pairs_per_batch: int = threshold(40_000, "pairs", "pairs of roots in memory at a time, about 120 MB")


def bound_votes(
    first: np.ndarray, second: np.ndarray, tolerance: Tolerance, reach_px: float, scale: float = 1.0
) -> np.ndarray:
    """Return the largest possible number of correspondences of each pair of roots, leaves only, ``(m, n)`` int.

    first : (m, 2), second : (n, 2) positions; scale : px of the second image for one of the first
    """
    counts = _transform_leaf_counts(first, reach_px)
    bounds = np.zeros((len(first), len(second)), dtype=np.int32)
    for part, widened in _transform_batches(second / scale, tolerance, reach_px, len(first)):
        votes = np.matmul(counts, widened)
        bounds[:, part] = np.rint(fft.irfft(votes, VOTING.directions, axis=0).max(axis=0)).astype(np.int32)
    return bounds


def _count_rings(reach_px: float) -> int:
    return int(np.ceil(reach_px / VOTING.ring_px)) + 1


def _transform_leaf_counts(points: np.ndarray, reach_px: float) -> np.ndarray:
    """Return the conjugate spectrum of the leaves' counts by root, ``(frequencies, roots, rings)`` complex64."""
    counts = np.zeros((len(points), _count_rings(reach_px), VOTING.directions), dtype=np.float32)
    for root in range(len(points)):
        leaves = find_leaves(points, root, reach_px)
        ring = (leaves.distance_px / VOTING.ring_px).astype(int)
        direction = np.floor(leaves.angle_rad / _STEP).astype(int) % VOTING.directions
        np.add.at(counts[root], (ring, direction), 1.0)
    return np.ascontiguousarray(np.conj(fft.rfft(counts, axis=2)).transpose(2, 0, 1))


_STEP = 2.0 * np.pi / VOTING.directions


def _transform_batches(
    points: np.ndarray, tolerance: Tolerance, reach_px: float, roots: int
) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield spectra ``(frequencies, rings, roots)`` of where a leaf would find a partner, some roots at a time."""
    step = max(1, VOTING.pairs_per_batch // max(roots, 1))
    for start in range(0, len(points), step):
        stop = min(start + step, len(points))
        found = np.stack([_widen_leaves(points, root, tolerance, reach_px) for root in range(start, stop)])
        yield slice(start, stop), np.ascontiguousarray(fft.rfft(found, axis=2).transpose(2, 1, 0))


def _widen_leaves(points: np.ndarray, root: int, tolerance: Tolerance, reach_px: float) -> np.ndarray:
    """Return 1 in the bins ``(rings, directions)`` of which a leaf may meet one of this root's leaves, else 0."""
    rings = _count_rings(reach_px)
    inner = np.arange(rings) * VOTING.ring_px
    allowed = tolerance.limit_px(inner + VOTING.ring_px)  # grows outwards, that of the angle inwards
    angle = np.minimum(tolerance.limit_rad(np.maximum(inner, 1e-3)), np.pi)
    leaves = find_leaves(points, root, reach_px + float(allowed[-1]))
    nearest, farthest = (inner - allowed)[:, None], (inner + VOTING.ring_px + allowed)[:, None]
    ring, leaf = np.nonzero((leaves.distance_px >= nearest) & (leaves.distance_px <= farthest))
    # The rotation may lie half a bin to either side, and the first leaf anywhere in its bin.
    low = np.ceil((leaves.angle_rad[leaf] - angle[ring]) / _STEP - 1.5).astype(int)
    high = np.floor((leaves.angle_rad[leaf] + angle[ring]) / _STEP + 0.5).astype(int)
    # 1 in the bins ``low … high`` of each arc, float32, directions wrapped
    change = np.zeros((rings, 3 * VOTING.directions + 1), dtype=np.int32)
    start = low % VOTING.directions
    np.add.at(change, (ring, start), 1)
    np.add.at(change, (ring, start + (np.minimum(high, low + VOTING.directions - 1) - low) + 1), -1)
    covered = change.cumsum(axis=1)[:, : 3 * VOTING.directions].reshape(rings, 3, VOTING.directions).sum(axis=1)
    return (covered > 0).astype(np.float32)
