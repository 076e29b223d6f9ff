"""Interest-point matching (thesis §3.3.3): the network grows by sub-networks until nothing is added.

Every interest point is grouped with its closest node. In the sub-network of that node, the direction to the node's
father is the starting point, and each point has a distance and an angle; in the other image the points within the
tolerances of both are its candidates. The thesis takes the closest one. On real relief 3-37 % of those are wrong, so a
candidate must also look similar (`correlate_patches`, under the local affine map of the nodes around) and agree with
where the nodes around put it; the one that looks most similar is taken if the choice is mutual. New nodes join the
network, and points that have got a closer node are matched again.

Final positions come from least-squares matching; outliers are found by neighbours and affine epipolar geometry.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.progress import Progress, advance, silent
from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import threshold, thresholds
from ...measurement.window_matching.least_squares_matching import match_patches
from ...measurement.window_matching.windows import DONE, LsmOptions
from .leaves import NETWORK_PAIRS, Tolerance, find_mutual_best, rotate_offset, wrap_angle
from .network import LocalAffine, Network, fit_local_affine
from .views import NetworkWindow, correlate_patches


@thresholds
class GROWTH:
    """Rounds of growth of a control network, and tests of its nodes by matching, neighbours and geometry."""

    most_candidates: int = threshold(12, "points", "largest number of candidates of a point")
    most_rounds: int = threshold(200, "rounds", "largest number of rounds in all stages")
    closer: float = threshold(0.75, "", "largest ratio of distances to a new and the former node for another match")
    least_correlation: float = threshold(0.75, "", "smallest correlation of matched windows", NETWORK_PAIRS)
    largest_move_px: float = threshold(2.0, "px", "largest shift of a point by matching", NETWORK_PAIRS)
    largest_sigma_px: float = threshold(0.3, "px", "largest standard deviation of a coordinate")
    outlier_floor_px: float = threshold(0.75, "px", "smallest epipolar residual of an outlier …", NETWORK_PAIRS)
    outlier_sigmas: float = threshold(4.0, "sigma", "… in standard deviations (both are exceeded)")
    rejection_rounds: int = threshold(8, "rounds", "largest number of rounds of rejection")


class GrowthStage(NamedTuple):
    """Tolerance of position and angle in a sub-network; points farther than ``reach_px`` from their node wait."""

    tolerance: Tolerance
    reach_px: float


@dataclass(frozen=True)
class GrowthOptions:
    """How the network grows.

    stages : one after the other, each until nothing is added: from gentle ground and short distances to cliffs and gaps
    correlation : least coefficient of two patches; consistency_px : most that a node may differ from the local affine
    map of its neighbours, beyond their own spread
    """

    stages: tuple[GrowthStage, ...]
    correlation: float = 0.6
    consistency_px: float = 1.5


def grow_network(
    network: Network, first: NetworkWindow, second: NetworkWindow, options: GrowthOptions, progress: Progress = silent
) -> Network:
    """Return the network with all interest points that can be matched."""
    rounds = 0
    for stage in options.stages:
        last_px = np.full(len(first.xy), np.inf)  # distance of the node under which each point was last matched
        while len(network) >= 3 and rounds < GROWTH.most_rounds:
            rounds += 1
            advance(progress, 1.0 - 1.0 / (1.0 + rounds / 8.0), f"control network: {len(network)} correspondences")
            new = _grow_once(network, first, second, options, stage, last_px)
            if not len(new):
                break
            old_count, network = len(network), network.join(new)
            network = network.select(agrees_with_neighbours(network, options.consistency_px, old_count))
    return network


def agrees_with_neighbours(network: Network, allowed_px: float, first_new: int = 0) -> np.ndarray:
    """Return the mask of nodes that agree with the local affine map of their neighbours, without themselves.

    Nodes before ``first_new`` are not asked.
    """
    agree = np.ones(len(network), dtype=bool)
    if len(network) < 4:
        return agree
    rows = np.arange(first_new, len(network))
    local = fit_local_affine(network.first[rows], network.first, network.second, network.matrix, rows)
    distance_px = np.hypot(*(network.second[rows] - local.predicted).T)
    agree[rows] = distance_px <= np.maximum(allowed_px, 3.0 * np.minimum(local.spread_px, allowed_px))
    return agree


def _grow_once(
    network: Network,
    first: NetworkWindow,
    second: NetworkWindow,
    options: GrowthOptions,
    stage: GrowthStage,
    last_px: np.ndarray,
) -> Network:
    """Return the new nodes of one round; ``last_px`` is updated with the distance of each point from its node."""
    free = np.ones(len(first.xy), dtype=bool)
    free[network.first_row] = False
    rows = np.flatnonzero(free)
    distance, node = cKDTree(network.first).query(first.xy[rows])
    fresh = (distance <= stage.reach_px) & (distance < GROWTH.closer * last_px[rows])
    last_px[rows[fresh]] = distance[fresh]
    rows, node = rows[fresh], node[fresh]
    point, candidate = _find_candidates(network, first, second, rows, node, stage.tolerance)
    if not len(point):
        return network.select(np.zeros(len(network), dtype=bool))
    local = fit_local_affine(first.xy[rows], network.first, network.second, network.matrix)
    correlation = correlate_patches(first, second, first.xy[rows[point]], second.xy[candidate], local.A[point])
    # Which candidates agree with the local affine map as far as the network reaches already
    distance = np.hypot(*(first.xy[rows] - network.first[node]).T)
    allowed = options.consistency_px + 2.0 * np.minimum(local.spread_px, options.consistency_px)
    allowed = allowed + stage.tolerance.gradient * distance
    fits = np.hypot(*(second.xy[candidate] - local.predicted[point]).T) <= allowed[point]
    similar = np.flatnonzero(fits & (correlation >= options.correlation))
    selected = similar[find_mutual_best(point[similar], candidate[similar], -correlation[similar])]
    father = node[point[selected]]
    return Network(
        rows[point[selected]],
        candidate[selected],
        father,
        generation=network.generation[father] + 1,
        correlation=correlation[selected],
        first=first.xy[rows[point[selected]]],
        second=second.xy[candidate[selected]],
        matrix=network.matrix,
    )


def _find_candidates(
    network: Network,
    first: NetworkWindow,
    second: NetworkWindow,
    rows: np.ndarray,
    node: np.ndarray,
    tolerance: Tolerance,
) -> tuple[np.ndarray, np.ndarray]:
    """Return index into ``rows`` and row in the second view of every pair within both tolerances."""
    free = np.ones(len(second.xy), dtype=bool)
    free[network.second_row] = False
    free_rows = np.flatnonzero(free)
    if not len(free_rows) or not len(rows):
        return np.empty(0, dtype=int), np.empty(0, dtype=int)
    rotation, scale = network.compute_starting_directions()
    arm = first.xy[rows] - network.first[node]
    distance = np.hypot(*arm.T)
    allowed = tolerance.limit_px(distance) * np.maximum(scale[node], 1.0)
    predicted = network.second[node] + rotate_offset(arm, rotation[node], scale[node])
    neighbours, place = cKDTree(second.xy[free_rows]).query(
        predicted, k=min(GROWTH.most_candidates, len(free_rows)), distance_upper_bound=float(1.5 * allowed.max())
    )
    place = place.reshape(len(rows), -1)
    point, column = np.nonzero(np.isfinite(neighbours.reshape(len(rows), -1)))
    candidate = free_rows[place[point, column]]
    leaf = second.xy[candidate] - network.second[node[point]]
    stretch = np.abs(np.hypot(*leaf.T) - scale[node[point]] * distance[point])
    predicted_arm = predicted[point] - network.second[node[point]]
    turn = np.abs(wrap_angle(np.arctan2(leaf[:, 1], leaf[:, 0]) - np.arctan2(predicted_arm[:, 1], predicted_arm[:, 0])))
    is_within = (stretch <= allowed[point]) & (turn * np.hypot(*predicted_arm.T) <= allowed[point])
    return point[is_within], candidate[is_within]


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
    local = fit_local_affine(network.first, network.first, network.second, network.matrix)
    centre = np.floor(network.first + 0.5)
    start = network.second + np.einsum("nij,nj->ni", local.A, centre - network.first)
    small = LsmOptions(window_px=21)  # what differs from its surroundings, as roofs do, is small
    matches = match_patches(first.match_image, second.match_image, centre.astype(np.int64), start, local.A, small)
    sigma = matches.sigma_px
    move_px = np.hypot(*(matches.xy - start).T)
    is_valid = (
        (matches.status == DONE)
        & (matches.correlation >= GROWTH.least_correlation)
        & (move_px <= GROWTH.largest_move_px)
    )
    is_valid &= np.nan_to_num(sigma, nan=np.inf) <= GROWTH.largest_sigma_px
    is_valid, residual, across = select_consistent(centre, matches.xy, is_valid, network.matrix, consistency_px)
    positions = NodePositions(centre, matches.xy, sigma, matches.correlation, residual, across)
    return network.select(is_valid), NodePositions(*(column[is_valid] for column in positions))


def select_consistent(
    first: np.ndarray, second: np.ndarray, is_valid: np.ndarray, matrix: np.ndarray, consistency_px: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mask of good pairs that agree with their neighbours and the epipolar geometry, and both residuals."""
    is_valid = is_valid.copy()
    residual, across = np.full(len(first), np.nan), np.full(len(first), np.nan)
    for _ in range(GROWTH.rejection_rounds):
        rows = np.flatnonzero(is_valid)
        if len(rows) < 6:
            return np.zeros(len(first), dtype=bool), residual, across
        local: LocalAffine = fit_local_affine(first[rows], first[rows], second[rows], matrix, np.arange(len(rows)))
        residual[rows] = np.hypot(*(second[rows] - local.predicted).T)
        across[rows] = compute_epipolar_residuals(first[rows], second[rows])
        sigma = robust_sigma(across[rows])
        keep = residual[rows] <= consistency_px + 2.0 * np.minimum(local.spread_px, consistency_px)
        keep &= np.abs(across[rows]) <= max(GROWTH.outlier_sigmas * sigma, GROWTH.outlier_floor_px)
        is_valid[rows[~keep]] = False
        if keep.all():
            break
    return is_valid, residual, across


def compute_epipolar_residuals(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the signed distances ``(n,)`` px of pairs from their robust affine epipolar geometry.

    Points of two views by parallel rays fulfil ``a x + b y + c x' + d y' + e = 0`` whatever the relief (Koenderink
    and van Doorn 1991); over a window, that is true of satellite images to a fraction of a pixel. The normal is
    the direction of least spread of the four coordinates, weights after Cauchy; the distance is that of one image.
    """
    joint = np.column_stack([first, second])
    weight = np.ones(len(joint))
    for _ in range(10):
        middle = np.average(joint, axis=0, weights=weight)
        centred = joint - middle
        normal = np.linalg.eigh((centred * weight[:, None]).T @ centred)[1][:, 0]
        distance = centred @ normal
        distance -= np.median(distance)
        scale = max(float(robust_sigma(distance)), 0.05)
        weight = 1.0 / (1.0 + (distance / (2.0 * scale)) ** 2)
    return distance / max(float(np.hypot(*normal[2:])), 0.1)
