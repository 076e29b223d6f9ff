"""Normal equations of the block with the ground points eliminated (thesis eqs. 5.44-5.49).

Per image point, with residual v = observed - computed and weight w = (robust weight) / sigma²::

    v = A da + B dx        A (2, p): image parameters,  B (2, 3): east, north, up of the point, metres

    | N  W | |da|   |n|      N  blocks (p, p) of the images,   V  blocks (3, 3) of the points,
    | W' V | |dx| = |m|      W  one block (p, 3) per image point

The points are eliminated block by block: (N - W V^-1 W') da = n - W V^-1 m, then dx = V^-1 (m - W' da).
No matrix over all observations is ever formed: the points are grouped by their number of image points, so that
every step is a batched product of small blocks. The pattern of the reduced matrix is found once (`Structure`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..geodesy import ground_difference_m
from ..refinement.model import Linearise
from .observations import Observations

FREE_POINT_SIGMA_M = 1e4  # prior of a point without survey about its start (C_G): only keeps V regular
PAIRS_PER_BATCH = 400_000  # bounds the temporaries of the elimination


class Linearisation(NamedTuple):
    """Residuals (n, 2) and derivatives of all image points at one state; weights (n,) in 1/px²."""

    residual: np.ndarray
    by_values: np.ndarray
    by_ground: np.ndarray


class Batch(NamedTuple):
    """Points with the same number k of image points: ``rows (m, k)``, and the image-pair block of each (m * k * k,)."""

    points: np.ndarray
    rows: np.ndarray
    pair_block: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """Which images share points: block pattern of the reduced matrix and the batches to fill it."""

    images: int
    parameters: int
    block_row: np.ndarray
    block_column: np.ndarray
    batches: tuple[Batch, ...]

    @property
    def blocks(self) -> int:
        return len(self.block_row)

    def matrix(self, blocks: np.ndarray) -> sparse.csc_matrix:
        """Return the sparse matrix of blocks ``(blocks, p, p)``."""
        p = self.parameters
        if p == 0:
            return sparse.csc_matrix((0, 0))
        indptr = np.searchsorted(self.block_row, np.arange(self.images + 1))
        size = self.images * p
        return sparse.bsr_matrix((blocks, self.block_column, indptr), shape=(size, size)).tocsc()

    @property
    def diagonal(self) -> np.ndarray:
        """Indices of the diagonal blocks, in the order of the images."""
        return np.flatnonzero(self.block_row == self.block_column)


def structure(observations: Observations, parameters: int) -> Structure:
    """Find the block pattern: every pair of images that share a point, and every image with itself."""
    count = len(observations.images)
    groups = []
    keys = [np.arange(count, dtype=np.int64) * (count + 1)]
    for length, points in observations.by_length.items():
        step = max(1, PAIRS_PER_BATCH // length**2)
        for start in range(0, len(points), step):
            some = points[start : start + step]
            rows = observations.first[some][:, None] + np.arange(length)
            image = observations.image[rows]
            pairs = (image[:, :, None] * count + image[:, None, :]).ravel()
            groups.append((some, rows, pairs))
            keys.append(np.unique(pairs))
    blocks = np.unique(np.concatenate(keys))
    batches = tuple(Batch(some, rows, np.searchsorted(blocks, pairs)) for some, rows, pairs in groups)
    return Structure(count, parameters, blocks // count, blocks % count, batches)


def linearise(
    observations: Observations, linearisers: list[Linearise], values: np.ndarray, ground: np.ndarray
) -> Linearisation:
    """Evaluate residuals and derivatives of all image points at ``values (images, p)`` and ``ground (m, 3)``."""
    n, p = observations.count, values.shape[1]
    result = Linearisation(np.empty((n, 2)), np.empty((n, 2, p)), np.empty((n, 2, 3)))
    for rows, equations, image_values in zip(observations.by_image, linearisers, values, strict=True):
        if len(rows):
            computed, by_values, by_ground = equations(image_values, ground[observations.point[rows]])
            result.residual[rows] = observations.xy[rows] - computed
            result.by_values[rows], result.by_ground[rows] = by_values, by_ground
    return result


class PointBlocks(NamedTuple):
    """Inverse blocks V^-1 (m, 3, 3) of the points and their right-hand sides m (m, 3)."""

    inverse: np.ndarray
    right: np.ndarray


def point_blocks(
    observations: Observations, linear: Linearisation, weight: np.ndarray, ground: np.ndarray, start: np.ndarray
) -> PointBlocks:
    """Return the points' own normal blocks from image points, surveys and the weak prior about ``start``."""
    weighted = linear.by_ground * weight[:, None, None]
    first = observations.first[:-1]
    blocks = np.add.reduceat(np.einsum("nci,ncj->nij", weighted, linear.by_ground), first, axis=0)
    right = np.add.reduceat(np.einsum("nci,nc->ni", weighted, linear.residual), first, axis=0)
    free = 1.0 / FREE_POINT_SIGMA_M**2
    own = observations.survey_weight + free
    blocks[:, range(3), range(3)] += own
    right += free * ground_difference_m(start, ground)
    surveyed = observations.surveyed
    right[surveyed] += observations.survey_weight[surveyed] * ground_difference_m(
        observations.survey[surveyed], ground[surveyed]
    )
    return PointBlocks(np.linalg.inv(blocks), right)


class Reduced(NamedTuple):
    """Blocks of the reduced camera matrix ``(blocks, p, p)`` and its right-hand side ``(images, p)``."""

    blocks: np.ndarray
    right: np.ndarray


def reduce(
    pattern: Structure, observations: Observations, linear: Linearisation, weight: np.ndarray, points: PointBlocks
) -> Reduced:
    """Eliminate the points: accumulate ``N - W V^-1 W'`` and ``n - W V^-1 m``.

    Points that do not contribute (check points) are passed over by giving their measurements no weight here.
    """
    p = pattern.parameters
    weight = weight * observations.contributes
    blocks = np.zeros((pattern.blocks, p * p))
    right = np.zeros((pattern.images, p))
    own = np.einsum("nci,ncj->nij", linear.by_values * weight[:, None, None], linear.by_values)
    own_right = np.einsum("nci,nc->ni", linear.by_values * weight[:, None, None], linear.residual)
    for k, rows in enumerate(observations.by_image):
        blocks[pattern.diagonal[k]] += own[rows].sum(axis=0).ravel()
        right[k] += own_right[rows].sum(axis=0)
    for batch in pattern.batches:
        cross = cross_blocks(linear, weight, batch)
        gain = cross @ points.inverse[batch.points][:, None]
        products = np.einsum("aipx,ajqx->aijpq", gain, cross).reshape(len(batch.pair_block), p * p)
        summing = sparse.csr_matrix(
            (np.ones(len(products)), (batch.pair_block, np.arange(len(products)))), (pattern.blocks, len(products))
        )
        blocks -= summing @ products
        reduction = np.einsum("aipx,ax->aip", gain, points.right[batch.points])
        np.subtract.at(right, observations.image[batch.rows].ravel(), reduction.reshape(batch.rows.size, p))
    return Reduced(blocks.reshape(pattern.blocks, p, p), right)


def cross_blocks(linear: Linearisation, weight: np.ndarray, batch: Batch) -> np.ndarray:
    """Return the blocks W of a batch, ``(m, k, p, 3)``."""
    return np.einsum(
        "akcp,akcx->akpx",
        linear.by_values[batch.rows] * weight[batch.rows][..., None, None],
        linear.by_ground[batch.rows],
    )


def back_substitute(
    observations: Observations, linear: Linearisation, weight: np.ndarray, points: PointBlocks, step: np.ndarray
) -> np.ndarray:
    """Return the points' steps ``(m, 3)`` in metres for the images' ``step (images, p)``."""
    moved = np.einsum("ncp,np->nc", linear.by_values, step[observations.image])
    pulled = np.einsum("nci,nc->ni", linear.by_ground, moved * weight[:, None])
    right = points.right - np.add.reduceat(pulled, observations.first[:-1], axis=0)
    return np.einsum("mij,mj->mi", points.inverse, right)
