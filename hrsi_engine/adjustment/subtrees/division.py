"""Leaves and separators of a block: each point belongs to one leaf, each camera to one leaf or separator.

The tree is that of the factors (`equations.nested_dissection`), cut off where its parts are small enough. The cameras
of a point see one another, so they lie on one way from a leaf up to the root; the point belongs to that leaf. It
follows from the block alone, never from the workers at hand, and with it all sums and the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations import Pattern
from ..equations.nested_dissection import dissect
from ..observations import Observations

LEAVES = 16  # of a block of middle size; enough for eight workers or so to be busy
LEAST_LEAF, MOST_LEAF = 8, 3000  # cameras


@dataclass(frozen=True, eq=False)
class Node:
    """A leaf or a separator of the tree: its own cameras, and the numbers of its children; a leaf has none."""

    own: np.ndarray
    children: tuple[int, ...]

    @property
    def is_leaf(self) -> bool:
        return not self.children


@dataclass(frozen=True, eq=False)
class Division:
    """Nodes, children before parents, and the leaf below each node where points of its own cameras alone go."""

    nodes: tuple[Node, ...]
    node_of_camera: np.ndarray
    leaf_below: np.ndarray

    @property
    def leaves(self) -> list[int]:
        """Numbers of the nodes that are leaves."""
        return [number for number, node in enumerate(self.nodes) if node.is_leaf]

    def leaf_of_points(self, observations: Observations) -> np.ndarray:
        """Return the leaf of each point ``(m,)``."""
        deepest = np.minimum.reduceat(self.node_of_camera[observations.camera], observations.first[:-1])
        return np.asarray(self.leaf_below[deepest])

    def leaf_of_pairs(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the leaf where something is said of pairs of cameras ``(k,)``, by the same rule as for points."""
        return np.asarray(self.leaf_below[np.minimum(self.node_of_camera[rows], self.node_of_camera[columns])])


def divide(pattern: Pattern, most: int = 0) -> Division:
    """Return the division of a block into leaves of at most so many cameras (0: as suits the block)."""
    most = most or int(np.clip(-(-pattern.cameras // LEAVES), LEAST_LEAF, MOST_LEAF))
    fronts = dissect(pattern.graph, most, pattern.position)
    number = {id(front): k for k, front in enumerate(fronts)}
    nodes = tuple(Node(front.own, tuple(number[id(child)] for child in front.children)) for front in fronts)
    node_of_camera, leaf_below = np.empty(pattern.cameras, dtype=np.int64), np.empty(len(nodes), dtype=np.int64)
    for k, node in enumerate(nodes):
        node_of_camera[node.own] = k
        leaf_below[k] = k if node.is_leaf else leaf_below[node.children[0]]
    return Division(nodes, node_of_camera, leaf_below)
