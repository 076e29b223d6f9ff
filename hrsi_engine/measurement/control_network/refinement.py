"""Final positions by least-squares matching; outliers are found by neighbours and affine epipolar geometry."""

from typing import NamedTuple

import numpy as np

from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import threshold, thresholds
from ..window_matching.least_squares_matching import match_patches
from ..window_matching.windows import DONE, LsmOptions
from .leaves import NETWORK_PAIRS
from .network import LocalAffine, Network, fit_local_affine
from .views import NetworkWindow

LSM = LsmOptions(window_px=21)  # what differs from its surroundings, as roofs do, is small


@thresholds
class REFINEMENT:
    """Which nodes least-squares matching, neighbours and epipolar geometry confirm."""

    least_correlation: float = threshold(0.75, "", "smallest correlation of matched windows", NETWORK_PAIRS)
    largest_move_px: float = threshold(2.0, "px", "largest distance from the interest point", NETWORK_PAIRS)
    largest_sigma_px: float = threshold(0.3, "px", "largest standard deviation of a coordinate")
    outlier_floor_px: float = threshold(0.75, "px", "smallest epipolar residual of an outlier", NETWORK_PAIRS)
    outlier_sigmas: float = threshold(4.0, "sigma", "smallest epipolar residual of an outlier")
    most_rounds: int = threshold(8, "rounds", "most rounds of rejection")


class NodePositions(NamedTuple):
    """Matched positions: ``first`` and ``second`` (k, 2), sigma (k,) px, correlation (k,), residual (k,) px.

    residual_px : distance from the local affine map of the neighbours; epipolar_px : signed distance (k,) from the
    affine epipolar geometry of all
    """

    first: np.ndarray
    second: np.ndarray
    sigma_px: np.ndarray
    correlation: np.ndarray
    residual_px: np.ndarray
    epipolar_px: np.ndarray


def refine_matches(
    network: Network, first: NetworkWindow, second: NetworkWindow, consistency_px: float
) -> tuple[Network, NodePositions]:
    """Return the nodes that least-squares matching confirms, and their positions."""
    around = fit_local_affine(network.first, network.first, network.second, network.matrix)
    centre = np.floor(network.first + 0.5)
    start = network.second + np.einsum("nij,nj->ni", around.A, centre - network.first)
    found = match_patches(first.match_image, second.match_image, centre.astype(np.int64), start, around.A, LSM)
    sigma = found.sigma_px
    moved = np.hypot(*(found.xy - start).T)
    good = (
        (found.status == DONE)
        & (found.correlation >= REFINEMENT.least_correlation)
        & (moved <= REFINEMENT.largest_move_px)
    )
    good &= np.nan_to_num(sigma, nan=np.inf) <= REFINEMENT.largest_sigma_px
    good, residual, across = select_consistent(centre, found.xy, good, network.matrix, consistency_px)
    positions = NodePositions(centre, found.xy, sigma, found.correlation, residual, across)
    return network.select(good), NodePositions(*(column[good] for column in positions))


def select_consistent(
    first: np.ndarray, second: np.ndarray, good: np.ndarray, matrix: np.ndarray, consistency_px: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mask of good pairs that agree with their neighbours and the epipolar geometry, and both residuals."""
    good = good.copy()
    residual, across = np.full(len(first), np.nan), np.full(len(first), np.nan)
    for _ in range(REFINEMENT.most_rounds):
        rows = np.flatnonzero(good)
        if len(rows) < 6:
            return np.zeros(len(first), dtype=bool), residual, across
        around: LocalAffine = fit_local_affine(first[rows], first[rows], second[rows], matrix, np.arange(len(rows)))
        residual[rows] = np.hypot(*(second[rows] - around.predicted).T)
        across[rows] = compute_epipolar_residuals(first[rows], second[rows])
        sigma = robust_sigma(across[rows])
        keep = residual[rows] <= consistency_px + 2.0 * np.minimum(around.spread_px, consistency_px)
        keep &= np.abs(across[rows]) <= max(REFINEMENT.outlier_sigmas * sigma, REFINEMENT.outlier_floor_px)
        good[rows[~keep]] = False
        if keep.all():
            break
    return good, residual, across


def compute_epipolar_residuals(first: np.ndarray, second: np.ndarray, iterations: int = 10) -> np.ndarray:
    """Return the signed distances ``(n,)`` px of pairs from their robust affine epipolar geometry.

    Points of two views by parallel rays fulfil ``a x + b y + c x' + d y' + e = 0`` whatever the relief (Koenderink
    and van Doorn 1991); over a window, that holds for satellite images to a fraction of a pixel. The normal is
    the direction of least spread of the four coordinates, weights after Cauchy; the distance is that of one image.
    """
    joint = np.column_stack([first, second])
    weight = np.ones(len(joint))
    for _ in range(iterations):
        middle = np.average(joint, axis=0, weights=weight)
        centred = joint - middle
        normal = np.linalg.eigh((centred * weight[:, None]).T @ centred)[1][:, 0]
        distance = centred @ normal
        distance -= np.median(distance)
        scale = max(float(robust_sigma(distance)), 0.05)
        weight = 1.0 / (1.0 + (distance / (2.0 * scale)) ** 2)
    return distance / max(float(np.hypot(*normal[2:])), 0.1)
