"""Elimination of points with NumPy: products of small matrices (`elimination_kernels` is the compiled version).

Points that were measured by the same cameras are processed together. The sum over such a *group* of k cameras, ``sum W
V^-1 W'``, is one product of a matrix (k p, 3 m) with its transpose, which is fast; small groups are multiplied point by
point instead.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..observations import Observations
from .linearisation import Linearisation, Portion, take_whole_block
from .pattern import Pattern
from .states import Cofactors, Normals, PointPriors

ROWS_PER_CHUNK = 60_000  # image points whose products are in memory at once
SMALL_GROUP = 6  # points; fewer are multiplied point by point


class Chunk(NamedTuple):
    """Points with k image points each: ``rows (m, k)``, their cameras, and first points of groups of equal cameras."""

    points: np.ndarray
    rows: np.ndarray
    camera: np.ndarray
    group_start: np.ndarray


class NumpyElimination:
    """Elimination of the points by parts of the block; ``weight (n,)`` are those of all image points of the block.

    This version uses NumPy, with the whole block as one part and the derivatives by the parameters.
    """

    compiled = False  # True: derivatives are factored as in `Structure`

    def __init__(self, observations: Observations, pattern: Pattern) -> None:
        self.observations, self.pattern = observations, pattern

    @cached_property
    def _chunks(self) -> list[Chunk]:
        """The points by their number of image points; points of the same cameras are adjacent."""
        observations, chunks = self.observations, []
        for length, points in observations.by_length.items():
            camera = observations.camera[observations.first[points][:, None] + np.arange(length)]
            order = np.lexsort(camera.T[::-1])
            step = max(1, ROWS_PER_CHUNK // length)
            for begin in range(0, len(points), step):
                subset = order[begin : begin + step]
                cameras = camera[subset]
                new = np.r_[True, np.any(cameras[1:] != cameras[:-1], axis=1)]
                rows = observations.first[points[subset]][:, None] + np.arange(length)
                chunks.append(Chunk(points[subset], rows, cameras, np.flatnonzero(new)))
        return chunks

    def list_parts(self) -> list[Portion]:
        """Return the parts of the block: here only one, the whole block."""
        return [take_whole_block(self.observations)]

    def eliminate_points(
        self,
        part: Portion,
        linear: Linearisation,
        weight: np.ndarray,
        ground: np.ndarray,
        priors: PointPriors,
        contributes: np.ndarray,
        sums: Normals,
    ) -> None:
        """Add N - W V^-1 W' and n - W V^-1 m of a part to the sums; write V^-1, m and the residuals of its points.

        weight : (n,) of the image points, 1/px²; ground : (m, 3) lon, lat, height; contributes : (m,) mask of the
            points that enter the sums
        sums : ``blocks (b, t t, q q)`` and ``right (cameras, q t)`` by the coefficients (`Structure`); changed in place
        """
        observations, pattern, p = self.observations, self.pattern, sums.right.shape[1]
        sums.residual[:] = linear.residual
        matrix, point_right = _point_normals(part, linear, weight, ground, priors)
        lower = np.linalg.inv(np.linalg.cholesky(matrix))  # V^-1 = L^-T L^-1
        sums.inverse[:], sums.point_right[:] = lower.swapaxes(1, 2) @ lower, point_right
        contributing = weight * contributes[observations.point]
        by_values, blocks = _compose_derivatives(linear), sums.blocks.reshape(pattern.blocks, p, p)
        for index, rows in enumerate(observations.by_image):
            camera = observations.camera_of_image[index]
            a = by_values[rows].reshape(2 * len(rows), p)
            weighted = a * np.repeat(contributing[rows], 2)[:, None]
            blocks[pattern.diagonal[camera]] += weighted.T @ a
            sums.right[camera] += weighted.T @ linear.residual[rows].ravel()
        for chunk in self._chunks if p else ():
            self._subtract(chunk, linear, contributing, lower[chunk.points], sums, blocks)

    def _subtract(
        self,
        chunk: Chunk,
        linear: Linearisation,
        weight: np.ndarray,
        lower: np.ndarray,
        sums: Normals,
        blocks: np.ndarray,
    ) -> None:
        """Subtract W V^-1 W' and W V^-1 m of a chunk from the sums; ``lower (k, 3, 3)`` are the L^-1 of its points."""
        p = sums.right.shape[1]
        count, length = chunk.rows.shape
        weighted = linear.by_ground[chunk.rows] * weight[chunk.rows][..., None, None]
        cross = _compose_derivatives(linear)[chunk.rows].swapaxes(-1, -2) @ weighted  # W (m, k, p, 3)
        cross = lower @ cross.reshape(count, -1, 3).transpose(0, 2, 1)  # (m, 3, k p)
        reduction = np.einsum("mxq,mxy,my->mq", cross, lower, sums.point_right[chunk.points], optimize=True)
        np.subtract.at(sums.right, chunk.camera.ravel(), reduction.reshape(-1, p))
        bounds = [*chunk.group_start.tolist(), count]
        small = np.diff(bounds) < SMALL_GROUP
        for first, last in zip(
            chunk.group_start[~small].tolist(), chunk.group_start[~small] + np.diff(bounds)[~small], strict=True
        ):
            product = cross[first:last].reshape(-1, length * p).T @ cross[first:last].reshape(-1, length * p)
            self._scatter(product[None], chunk.camera[first : first + 1], blocks)
        in_small_group = np.repeat(small, np.diff(bounds))
        if in_small_group.any():
            self._scatter(
                cross[in_small_group].transpose(0, 2, 1) @ cross[in_small_group], chunk.camera[in_small_group], blocks
            )

    def _scatter(self, products: np.ndarray, camera: np.ndarray, blocks: np.ndarray) -> None:
        """Subtract ``products (m, k p, k p)`` from the upper ``blocks (blocks, p, p)`` of their cameras ``(m, k)``."""
        count, length = camera.shape
        p = blocks.shape[1]
        parts = products.reshape(count, length, p, length, p).transpose(0, 1, 3, 2, 4)
        upper = camera[:, :, None] <= camera[:, None, :]
        row = np.broadcast_to(camera[:, :, None], upper.shape)[upper]
        column = np.broadcast_to(camera[:, None, :], upper.shape)[upper]
        block_index, parts = self.pattern.find_blocks(row, column), parts[upper].reshape(-1, p * p)
        if count == 1 and len(np.unique(block_index)) == len(block_index):
            blocks.reshape(-1, p * p)[block_index] -= parts
            return
        summing = sparse.csr_matrix(
            (np.ones(len(block_index)), (block_index, np.arange(len(block_index)))),
            (self.pattern.blocks, len(block_index)),
        )
        blocks -= (summing @ parts).reshape(blocks.shape)

    def solve_points(
        self, part: Portion, linear: Linearisation, weight: np.ndarray, ground: np.ndarray, priors: PointPriors
    ) -> np.ndarray:
        """Return the points' steps V^-1 m ``(k, 3)`` in metres with fixed cameras.

        weight : (n,) of all image points; ground : (m, 3) of all points
        """
        rows, _ = self.observations.find_rows(part.points)
        matrix, right = _point_normals(part, linear, weight[rows], ground, priors)
        return np.einsum("mij,mj->mi", np.linalg.inv(matrix), right)

    def substitute_back(
        self,
        part: Portion,
        linear: Linearisation,
        weight: np.ndarray,
        normals: Normals,
        step: np.ndarray,
        steps: np.ndarray,
    ) -> None:
        """Write the steps in metres to ``steps (m, 3)`` for the ``step (cameras, q t)`` of the coefficients."""
        weighted_change = (
            np.einsum("ncp,np->nc", _compose_derivatives(linear), step[self.observations.camera]) * weight[:, None]
        )
        pulled = (linear.by_ground * weighted_change[:, :, None]).sum(axis=1)
        right = normals.point_right - np.add.reduceat(pulled, self.observations.first[:-1], axis=0)
        steps[:] = np.einsum("mij,mj->mi", normals.inverse, right)

    def compute_cofactors(
        self,
        part: Portion,
        linear: Linearisation,
        weight: np.ndarray,
        normals: Normals,
        cameras: np.ndarray,
        cofactors: Cofactors,
    ) -> None:
        """Write the part's cofactors from those of the coefficients, ``cameras (blocks, t t, q q)``."""
        cofactors.points[:] = normals.inverse
        by_values = _compose_derivatives(linear)
        size = by_values.shape[2]
        cameras = cameras.reshape(len(cameras), size, size)
        for chunk in self._chunks:
            # The cofactor blocks between the cameras of each point, (m, k, k, p, p)
            row, column = chunk.camera[:, :, None], chunk.camera[:, None, :]
            blocks = cameras[self.pattern.find_blocks(np.minimum(row, column).ravel(), np.maximum(row, column).ravel())]
            blocks = blocks.reshape(*chunk.camera.shape, chunk.camera.shape[1], *cameras.shape[1:])
            between = np.where((row > column)[..., None, None], blocks.swapaxes(-1, -2), blocks)
            a, b = by_values[chunk.rows], linear.by_ground[chunk.rows]
            pull = b @ normals.inverse[chunk.points][:, None]  # B V^-1 (m, k, 2, 3)
            left = a[:, :, None] @ between  # A Q (m, k, k, 2, p)
            between_images = (left @ a[:, None].swapaxes(-1, -2)).swapaxes(2, 3)  # A Q A' (m, k, 2, k, 2)
            weighted = pull * weight[chunk.rows][..., None, None]
            half = np.einsum("makbl,mblx->makx", between_images, weighted, optimize=True)
            cofactors.points[chunk.points] += np.einsum("makx,maky->mxy", weighted, half, optimize=True)
            mixed = half @ b.transpose(0, 1, 3, 2)
            computed = np.einsum("makal->makl", between_images) - mixed - mixed.transpose(0, 1, 3, 2)
            computed += b @ cofactors.points[chunk.points][:, None] @ b.transpose(0, 1, 3, 2)
            cofactors.computed[chunk.rows] = computed


def _compose_derivatives(linear: Linearisation) -> np.ndarray:
    """Return the derivatives by the parameters, ``(r, 2, p)``, as cameras that are evaluated by image have them."""
    if linear.by_quantity is None:
        raise ValueError("cameras that are evaluated by image give derivatives by their parameters: there are none")
    return linear.by_quantity


def _point_normals(
    part: Portion, linear: Linearisation, weight: np.ndarray, ground: np.ndarray, priors: PointPriors
) -> tuple[np.ndarray, np.ndarray]:
    """Return V ``(k, 3, 3)`` and m ``(k, 3)`` of the k points of a part, priors included.

    weight : (r,) of the part's image points, 1/px²; ground : (m, 3) of all points
    """
    first = part.place[:-1]
    matrix, right = np.empty((len(first), 3, 3)), np.empty((len(first), 3))
    weighted = linear.by_ground * weight[:, None, None]
    for i in range(3):
        right[:, i] = np.add.reduceat((weighted[:, :, i] * linear.residual).sum(axis=1), first)
        for j in range(i, 3):
            sums = np.add.reduceat((weighted[:, :, i] * linear.by_ground[:, :, j]).sum(axis=1), first)
            matrix[:, i, j] = matrix[:, j, i] = sums
    prior_weight = priors.build_weight_matrices(part.points)
    miss = priors.compute_misclosures_m(ground[part.points], part.points)
    matrix += prior_weight
    right += np.einsum("mij,mj->mi", prior_weight, miss)
    return matrix, right
