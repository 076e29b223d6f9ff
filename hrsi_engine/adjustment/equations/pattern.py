"""Block pattern of the reduced normal equations: pairs of cameras with common points.

The reduced matrix has a block for every pair of cameras that measured a common point, and one on the diagonal for
every camera. It is symmetric, so only the blocks with row <= column are stored, in the order of the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ...ground.geodesy import wrap_degrees
from ..observations import Observations


@dataclass(frozen=True, eq=False)
class Pattern:
    """Upper block pattern in compressed rows: row i has the columns ``columns[start[i]:start[i + 1]]``.

    The first column of a row is its diagonal. ``parameters`` is the size p of a block, ``position (cameras, 2)`` are
    approximate positions of the scenes (for the order of elimination).
    """

    cameras: int
    parameters: int
    start: np.ndarray
    columns: np.ndarray
    position: np.ndarray

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return len(self.columns)

    @cached_property
    def rows(self) -> np.ndarray:
        """Row of each block, ``(blocks,)``."""
        return np.repeat(np.arange(self.cameras, dtype=self.columns.dtype), np.diff(self.start))

    @property
    def diagonal(self) -> np.ndarray:
        """Indices of the diagonal blocks, in the order of the cameras, ``(cameras,)``."""
        return self.start[:-1]

    def find_blocks(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the indices ``(k,)`` of existing blocks at ``row`` and ``column``, ``row <= column``."""
        keys = self.rows.astype(np.int64) * self.cameras + self.columns
        return np.searchsorted(keys, row.astype(np.int64) * self.cameras + column)

    @cached_property
    def graph(self) -> sparse.csr_matrix:
        """Symmetric adjacency matrix of the cameras, including the diagonal."""
        shape = (self.cameras, self.cameras)
        upper = sparse.csr_matrix((np.ones(self.blocks, dtype=np.int8), self.columns, self.start), shape=shape)
        return sparse.csr_matrix(upper + sparse.triu(upper, 1).T)

    def extend_by(self, observations: Observations) -> Pattern:
        """Return the pattern extended by the pairs of cameras that measured a common point of other observations."""
        wide = sparse.csr_matrix(sparse.triu(self.graph.astype(np.float32) + _count_common_points(observations)))
        if wide.nnz == self.blocks:
            return self
        wide.sort_indices()
        return replace(self, start=wide.indptr.astype(np.int64), columns=wide.indices.astype(np.int32))


def find_pattern(
    observations: Observations, parameters: int, extra_pairs: Sequence[tuple[np.ndarray, np.ndarray]] = ()
) -> Pattern:
    """Return the pattern of the cameras of all measurements, and of ``extra_pairs`` pairs (rows <= columns)."""
    adjacency = _count_common_points(observations)
    for pairs in extra_pairs:
        adjacency += sparse.csr_matrix((np.ones(len(pairs[0]), dtype=np.float32), pairs), shape=adjacency.shape)
    upper = sparse.triu(adjacency, format="csr")
    upper.sort_indices()
    # East and north of each camera's scene from the first one's, in degrees of latitude
    middle = np.array([[image.rpc.long_off, image.rpc.lat_off] for image in observations.images])
    place = np.zeros((observations.cameras, 2))
    place[observations.camera_of_image[::-1], 0] = wrap_degrees(middle[::-1, 0] - middle[0, 0])
    place[observations.camera_of_image[::-1], 1] = middle[::-1, 1]
    place[:, 0] *= np.cos(np.radians(place[:, 1]))
    start, columns = upper.indptr.astype(np.int64), upper.indices.astype(np.int32)
    return Pattern(observations.cameras, parameters, start, columns, place)


def _count_common_points(observations: Observations) -> sparse.csr_matrix:
    """Return the numbers of common points of all pairs of cameras, with one more for each camera with itself."""
    count, points = observations.cameras, len(observations.points)
    incidence = sparse.csr_matrix(
        (np.ones(observations.count, dtype=np.float32), observations.camera, observations.first), shape=(points, count)
    )
    return sparse.csr_matrix(incidence.T @ incidence + sparse.identity(count, dtype=np.float32))


def make_diagonal_pattern(cameras: int, parameters: int) -> Pattern:
    """Return the pattern of cameras without common points."""
    number = np.arange(cameras + 1, dtype=np.int64)
    return Pattern(cameras, parameters, number, number[:-1].astype(np.int32), np.zeros((cameras, 2)))
