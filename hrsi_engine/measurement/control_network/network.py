"""The control network: nodes measured in both images, and each node's father."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .polar import wrap_angle
from .tolerances import NETWORK

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
            gone = (father != NO_FATHER) & ~keep[father]
            if not gone.any():
                break
            father[gone] = self.father[father[gone]]
        number = np.append(np.cumsum(keep) - 1, NO_FATHER)  # -1 stays -1
        columns = {
            name: getattr(self, name)[keep]
            for name in ("first_row", "second_row", "generation", "correlation", "first", "second")
        }
        return replace(self, father=number[father[keep]], **columns)

    def join(self, other: Network) -> Network:
        """Return this network with more nodes, whose fathers are rows of this one."""
        columns = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in ("first_row", "second_row", "father", "generation", "correlation", "first", "second")
        }
        return replace(self, **columns)

    def compute_starting_directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (rad) and scale ``(k,)`` at each node: from the direction to its father in both images.

        A father too near to give a direction hands over to his own; without any ancestor far enough the whole
        network's rotation and scale stand.
        """
        overall = np.arctan2(self.matrix[1, 0], self.matrix[0, 0])
        rotation = np.full(len(self), overall)
        scale = np.full(len(self), float(np.hypot(*self.matrix[:, 0])))
        ancestor, open_ = self.father.copy(), np.ones(len(self), dtype=bool)
        for _ in range(NETWORK.ancestors):
            open_ &= ancestor != NO_FATHER
            ours, theirs = self.first[ancestor] - self.first, self.second[ancestor] - self.second
            distance = np.hypot(*ours.T)
            here = open_ & (distance >= NETWORK.shortest_arm_px)
            turn = np.arctan2(theirs[:, 1], theirs[:, 0]) - np.arctan2(ours[:, 1], ours[:, 0])
            rotation[here] = overall + wrap_angle(turn[here] - overall)
            open_ &= ~here
            ancestor = np.where(open_, self.father[ancestor], NO_FATHER)
        return rotation, scale
