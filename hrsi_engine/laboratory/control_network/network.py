"""The control network: nodes measured in both images, each node's father, and affine maps through the nodes around.

The local maps predict where a point should be, find nodes that contradict their neighbours, and shape the patches that
are compared. A weak pull towards the similarity of the whole network keeps them determined with few or collinear nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.robust_scale import robust_sigma
from ...foundation.thresholds import threshold, thresholds
from .leaves import NETWORK, wrap_angle

NO_FATHER = -1


@dataclass(frozen=True, eq=False)
class Network:
    """Nodes, (k,) each: rows of the points in both views, father (row of this table), generation, correlation.

    matrix : (2, 2) the whole network's similarity; the positions ``first`` and ``second`` are (k, 2)
    """

    first_row: np.ndarray
    second_row: np.ndarray
    father: np.ndarray
    generation: np.ndarray
    correlation: np.ndarray
    first: np.ndarray
    second: np.ndarray
    matrix: np.ndarray

    def __len__(self) -> int:
        return len(self.first_row)

    def select(self, keep: np.ndarray) -> Network:
        """Return the nodes of a mask; where a father is removed, the nearest remaining ancestor takes its place."""
        father = self.father.copy()
        for _ in range(int(self.generation.max(initial=0)) + 1):
            is_orphan = (father != NO_FATHER) & ~keep[father]
            if not is_orphan.any():
                break
            father[is_orphan] = self.father[father[is_orphan]]
        number = np.append(np.cumsum(keep) - 1, NO_FATHER)  # -1 stays -1
        columns = {
            name: getattr(self, name)[keep]
            for name in ("first_row", "second_row", "generation", "correlation", "first", "second")
        }
        return replace(self, father=number[father[keep]], **columns)

    def join(self, addition: Network) -> Network:
        """Return this network with more nodes, whose fathers are rows of this one."""
        columns = {
            name: np.concatenate([getattr(self, name), getattr(addition, name)])
            for name in ("first_row", "second_row", "father", "generation", "correlation", "first", "second")
        }
        return replace(self, **columns)

    def compute_starting_directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (rad) and scale ``(k,)`` at each node: from the direction to its father in both images.

        A father too near to give a direction hands over to his own; without any ancestor far enough the whole
        network's rotation and scale are fixed.
        """
        overall = np.arctan2(self.matrix[1, 0], self.matrix[0, 0])
        rotation = np.full(len(self), overall)
        scale = np.full(len(self), float(np.hypot(*self.matrix[:, 0])))
        ancestor, open_ = self.father.copy(), np.ones(len(self), dtype=bool)
        for _ in range(NETWORK.ancestors):
            open_ &= ancestor != NO_FATHER
            ours, theirs = self.first[ancestor] - self.first, self.second[ancestor] - self.second
            distance = np.hypot(*ours.T)
            is_long = open_ & (distance >= NETWORK.shortest_arm_px)
            turn = np.arctan2(theirs[:, 1], theirs[:, 0]) - np.arctan2(ours[:, 1], ours[:, 0])
            rotation[is_long] = overall + wrap_angle(turn[is_long] - overall)
            open_ &= ~is_long
            ancestor = np.where(open_, self.father[ancestor], NO_FATHER)
        return rotation, scale


@thresholds
class LOCAL_AFFINE:
    """Limits for the robust affine transformation by the nodes around a point."""

    neighbours: int = threshold(12, "nodes", "number of nodes in a local transformation")
    similarity_weight: float = threshold(
        0.5, "nodes", "weight of the network's similarity transformation, at the mean distance"
    )
    iterations: int = threshold(5, "steps", "iterations with robust weights")
    scale_px: float = threshold(1.0, "px", "smallest scale of the Cauchy weights: relief")


class LocalAffine(NamedTuple):
    """Maps ``x' = predicted + A (x - point)``: ``predicted`` (n, 2), ``A`` (n, 2, 2), and the neighbours' spread (n,).

    spread_px : robust standard deviation of the neighbours about the map, px of the second image
    """

    predicted: np.ndarray
    A: np.ndarray
    spread_px: np.ndarray


def fit_local_affine(
    points: np.ndarray, first: np.ndarray, second: np.ndarray, overall: np.ndarray, leave_out: np.ndarray | None = None
) -> LocalAffine:
    """Return the robust affine maps at points ``(n, 2)`` through their nearest nodes ``first`` -> ``second`` (k, 2).

    overall : (2, 2) matrix of the whole network; leave_out : (n,) node that is not used at each point (itself)
    """
    left_out = int(leave_out is not None)
    count = min(LOCAL_AFFINE.neighbours, len(first) - left_out)
    neighbours = cKDTree(first).query(points, k=count + left_out)[1].reshape(len(points), -1)
    if leave_out is not None:
        itself = neighbours == leave_out[:, None]
        itself[~itself.any(axis=1), -1] = True
        neighbours = neighbours[~itself].reshape(len(points), count)
    dx = first[neighbours] - points[:, None, :]
    base = second[neighbours[:, 0]] - dx[:, 0] @ overall.T
    dy = second[neighbours] - base[:, None, :] - dx @ overall.T  # what the similarity leaves
    length = np.sqrt(np.mean(np.sum(dx**2, axis=2), axis=1)) + 1e-6
    design = np.concatenate([np.ones((*dx.shape[:2], 1)), dx / length[:, None, None]], axis=2)
    start = np.median(dy, axis=1)
    residual = dy - start[:, None, :]
    for _ in range(LOCAL_AFFINE.iterations):
        squared = np.sum(residual**2, axis=2)
        # Before the affine terms are known all neighbours deviate: the scale shrinks with their median.
        weight = 1.0 / (1.0 + squared / np.maximum(np.median(squared, axis=1, keepdims=True), LOCAL_AFFINE.scale_px**2))
        weighted = np.transpose(design * weight[..., None], (0, 2, 1))
        normal = weighted @ design
        normal[:, 1, 1] += LOCAL_AFFINE.similarity_weight
        normal[:, 2, 2] += LOCAL_AFFINE.similarity_weight
        normal[:, 0, 0] += 1e-9
        solution = np.linalg.solve(normal, weighted @ dy)
        residual = dy - design @ solution
    spread = robust_sigma(np.hypot(residual[..., 0], residual[..., 1]), axis=1)
    A = overall + np.transpose(solution[:, 1:], (0, 2, 1)) / length[:, None, None]
    return LocalAffine(base + solution[:, 0], A, spread)
