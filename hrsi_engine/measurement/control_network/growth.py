"""Interest-point matching (thesis §3.3.3): the network grows by sub-networks until nothing is added.

Every interest point is grouped with its closest node. In the sub-network of that node, the direction to the node's
father is the starting point, and each point has a distance and an angle; in the other image the points within the
tolerances of both are its candidates. The thesis takes the closest one. On real relief 3-37 % of those are wrong, so a
candidate must also look alike (`correlate_patches`, under the local affine map of the nodes around) and agree with
where the nodes around put it; the one that looks most alike is taken if the choice is mutual. New nodes join the
network, and points that have got a closer node are matched again.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.progress import Progress, advance, silent
from ...foundation.thresholds import threshold, thresholds
from .leaves import Tolerance, find_mutual_best, rotate_offset, wrap_angle
from .network import Network, fit_local_affine
from .views import NetworkWindow, correlate_patches


@thresholds
class GROWTH:
    """How the rounds of growth search and end."""

    most_candidates: int = threshold(12, "points", "most candidates of a point")
    most_rounds: int = threshold(200, "rounds", "most rounds of all stages")
    closer: float = threshold(0.75, "", "ratio of distances from which a point is matched again under a nearer node")


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
            before, network = len(network), network.join(new)
            network = network.select(agrees_with_neighbours(network, options.consistency_px, before))
    return network


def agrees_with_neighbours(network: Network, allowed_px: float, first_new: int = 0) -> np.ndarray:
    """Return the mask of nodes that agree with the local affine map of their neighbours, without themselves.

    Nodes before ``first_new`` are not asked.
    """
    agree = np.ones(len(network), dtype=bool)
    if len(network) < 4:
        return agree
    rows = np.arange(first_new, len(network))
    around = fit_local_affine(network.first[rows], network.first, network.second, network.matrix, rows)
    away = np.hypot(*(network.second[rows] - around.predicted).T)
    agree[rows] = away <= np.maximum(allowed_px, 3.0 * np.minimum(around.spread_px, allowed_px))
    return agree


def _grow_once(
    network: Network, first: NetworkWindow, second: NetworkWindow, options: GrowthOptions, stage: GrowthStage,
    last_px: np.ndarray,
) -> Network:  # fmt: skip
    """Return the new nodes of one round; ``last_px`` is updated with the distance of each point from its node."""
    free = np.ones(len(first.xy), dtype=bool)
    free[network.first_row] = False
    rows = np.flatnonzero(free)
    distance, node = cKDTree(network.first).query(first.xy[rows])
    fresh = (distance <= stage.reach_px) & (distance < GROWTH.closer * last_px[rows])
    last_px[rows[fresh]] = distance[fresh]
    rows, node = rows[fresh], node[fresh]
    point, other = _find_candidates(network, first, second, rows, node, stage.tolerance)
    if not len(point):
        return network.select(np.zeros(len(network), dtype=bool))
    around = fit_local_affine(first.xy[rows], network.first, network.second, network.matrix)
    correlation = correlate_patches(first, second, first.xy[rows[point]], second.xy[other], around.A[point])
    # Which candidates agree with the local affine map as far as the network reaches already
    distance = np.hypot(*(first.xy[rows] - network.first[node]).T)
    allowed = options.consistency_px + 2.0 * np.minimum(around.spread_px, options.consistency_px)
    allowed = allowed + stage.tolerance.gradient * distance
    fits = np.hypot(*(second.xy[other] - around.predicted[point]).T) <= allowed[point]
    alike = np.flatnonzero(fits & (correlation >= options.correlation))
    chosen = alike[find_mutual_best(point[alike], other[alike], -correlation[alike])]
    father = node[point[chosen]]
    return Network(
        rows[point[chosen]], other[chosen], father, network.generation[father] + 1, correlation[chosen],
        first.xy[rows[point[chosen]]], second.xy[other[chosen]], network.matrix,
    )  # fmt: skip


def _find_candidates(
    network: Network, first: NetworkWindow, second: NetworkWindow, rows: np.ndarray, node: np.ndarray,
    tolerance: Tolerance,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return index into ``rows`` and row in the second view of every pair within both tolerances."""
    free = np.ones(len(second.xy), dtype=bool)
    free[network.second_row] = False
    others = np.flatnonzero(free)
    if not len(others) or not len(rows):
        return np.empty(0, dtype=int), np.empty(0, dtype=int)
    rotation, scale = network.compute_starting_directions()
    arm = first.xy[rows] - network.first[node]
    distance = np.hypot(*arm.T)
    allowed = tolerance.limit_px(distance) * np.maximum(scale[node], 1.0)
    predicted = network.second[node] + rotate_offset(arm, rotation[node], scale[node])
    near, place = cKDTree(second.xy[others]).query(
        predicted, k=min(GROWTH.most_candidates, len(others)), distance_upper_bound=float(1.5 * allowed.max())
    )
    place = place.reshape(len(rows), -1)
    point, column = np.nonzero(np.isfinite(near.reshape(len(rows), -1)))
    other = others[place[point, column]]
    leaf = second.xy[other] - network.second[node[point]]
    stretch = np.abs(np.hypot(*leaf.T) - scale[node[point]] * distance[point])
    here = predicted[point] - network.second[node[point]]
    turn = np.abs(wrap_angle(np.arctan2(leaf[:, 1], leaf[:, 0]) - np.arctan2(here[:, 1], here[:, 0])))
    within = (stretch <= allowed[point]) & (turn * np.hypot(*here.T) <= allowed[point])
    return point[within], other[within]
