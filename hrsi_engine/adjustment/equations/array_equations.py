"""`Equations` with NumPy for every refinement model: all derivatives at once, then products of small matrices.

Points that were measured by the same cameras stand together. The sum over such a *group* of k cameras,
``sum W V^-1 W'``, is one matrix product of (k p, 3 m) with its counterpart, which is what processors are quick at;
small groups are multiplied point by point instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ...ground.geodesy import moved_ground
from ...refinement import RefinementModel
from ..observations import Observations
from .pattern import Pattern
from .states import Cofactors, Normals, PointJacobians, PointPriors, State

ROWS_PER_CHUNK = 60_000  # image points whose products are in memory at once
SMALL_GROUP = 6  # points; fewer are not worth a matrix product of their own
INTERSECT_STEPS = 15
CLOSURE_M = 1e-4  # a tenth of a millimetre on the ground: far below any measurement
STEP_LIMIT_M = 5e3  # weak geometry takes short steps; the equations are nearly linear


class Linearisation(NamedTuple):
    """Residuals (n, 2) and derivatives (n, 2, p), (n, 2, 3) of all image points at a state."""

    state: State
    residual: np.ndarray
    by_values: np.ndarray
    by_ground: np.ndarray


class Chunk(NamedTuple):
    """Points with k image points each: ``rows (m, k)``, their cameras, and where groups of equal cameras begin."""

    points: np.ndarray
    rows: np.ndarray
    camera: np.ndarray
    group_start: np.ndarray


class ArrayEquations:
    """See `Equations`."""

    def __init__(self, observations: Observations, model: RefinementModel, pattern: Pattern) -> None:
        self.observations, self.pattern = observations, pattern
        self._linearisers = observations.linearisers(model)
        self._chunks = list(_chunks(observations))
        self._last: Linearisation | None = None

    def linearise(self, state: State) -> Linearisation:
        """Return residuals and derivatives; those of the last state are kept."""
        last = self._last
        if last is not None and last.state.values is state.values and last.state.ground is state.ground:
            return last
        self._last = None  # before the new one, so that only one is in memory
        observations = self.observations
        n, p = observations.count, self.pattern.parameters
        new = Linearisation(state, np.empty((n, 2)), np.empty((n, 2, p)), np.empty((n, 2, 3)))
        for index, (rows, equations) in enumerate(zip(observations.by_image, self._linearisers, strict=True)):
            if len(rows):
                values = state.values[observations.camera_of_image[index]]
                at = equations(values, state.ground[observations.point[rows]])
                new.residual[rows] = observations.xy[rows] - at.computed
                new.by_values[rows], new.by_ground[rows] = at.by_values, at.by_ground
        self._last = new
        return new

    def residuals(self, state: State) -> np.ndarray:
        """See `Equations`."""
        return self.linearise(state).residual

    def normals(self, state: State, weight: np.ndarray, priors: PointPriors, contributes: np.ndarray) -> Normals:
        """See `Equations`."""
        linear, observations, pattern = self.linearise(state), self.observations, self.pattern
        p = pattern.parameters
        inverse, point_right = self._point_normals(linear, weight, priors)
        blocks, right = np.zeros((pattern.blocks, p, p)), np.zeros((pattern.cameras, p))
        used = weight * contributes[observations.point]
        for index, rows in enumerate(observations.by_image):
            camera = observations.camera_of_image[index]
            a = linear.by_values[rows].reshape(2 * len(rows), p)
            weighted = a * np.repeat(used[rows], 2)[:, None]
            blocks[pattern.diagonal[camera]] += weighted.T @ a
            right[camera] += weighted.T @ linear.residual[rows].ravel()
        for chunk in self._chunks if p else ():
            self._subtract(chunk, linear, used, inverse, point_right, blocks, right)
        return Normals(linear.residual, blocks, right, inverse, point_right)

    def _point_normals(
        self, linear: Linearisation, weight: np.ndarray, priors: PointPriors
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return V^-1 and the right-hand sides of all points."""
        first = self.observations.first[:-1]
        matrix, right = np.empty((len(first), 3, 3)), np.empty((len(first), 3))
        weighted = linear.by_ground * weight[:, None, None]
        for i in range(3):
            right[:, i] = np.add.reduceat((weighted[:, :, i] * linear.residual).sum(axis=1), first)
            for j in range(i, 3):
                sums = np.add.reduceat((weighted[:, :, i] * linear.by_ground[:, :, j]).sum(axis=1), first)
                matrix[:, i, j] = matrix[:, j, i] = sums
        own, miss = priors.matrices(), priors.miss_m(linear.state.ground)
        matrix += own
        right += np.einsum("mij,mj->mi", own, miss)
        return np.linalg.inv(matrix), right

    def _subtract(
        self, chunk: Chunk, linear: Linearisation, weight: np.ndarray, inverse: np.ndarray, point_right: np.ndarray,
        blocks: np.ndarray, right: np.ndarray,
    ) -> None:  # fmt: skip
        """Subtract W V^-1 W' and W V^-1 m of a chunk."""
        p = self.pattern.parameters
        count, length = chunk.rows.shape
        cross = _cross(linear, weight, chunk.rows).transpose(0, 2, 1)  # (m, 3, k p)
        gain = inverse[chunk.points] @ cross
        reduction = np.einsum("mxq,mx->mq", gain, point_right[chunk.points])
        np.subtract.at(right, chunk.camera.ravel(), reduction.reshape(-1, p))
        bounds = [*chunk.group_start.tolist(), count]
        small = np.diff(bounds) < SMALL_GROUP
        for first, last in zip(
            chunk.group_start[~small].tolist(), chunk.group_start[~small] + np.diff(bounds)[~small], strict=True
        ):
            product = cross[first:last].reshape(-1, length * p).T @ gain[first:last].reshape(-1, length * p)
            self._scatter(product[None], chunk.camera[first : first + 1], blocks)
        alone = np.repeat(small, np.diff(bounds))
        if alone.any():
            self._scatter(cross[alone].transpose(0, 2, 1) @ gain[alone], chunk.camera[alone], blocks)

    def _scatter(self, products: np.ndarray, camera: np.ndarray, blocks: np.ndarray) -> None:
        """Subtract ``products (m, k p, k p)`` from the upper blocks of their cameras ``(m, k)``."""
        count, length = camera.shape
        p = self.pattern.parameters
        parts = products.reshape(count, length, p, length, p).transpose(0, 1, 3, 2, 4)
        upper = camera[:, :, None] <= camera[:, None, :]
        row = np.broadcast_to(camera[:, :, None], upper.shape)[upper]
        column = np.broadcast_to(camera[:, None, :], upper.shape)[upper]
        where, parts = self.pattern.find(row, column), parts[upper].reshape(-1, p * p)
        if count == 1 and len(np.unique(where)) == len(where):
            blocks.reshape(-1, p * p)[where] -= parts
            return
        summing = sparse.csr_matrix(
            (np.ones(len(where)), (where, np.arange(len(where)))), (self.pattern.blocks, len(where))
        )
        blocks -= (summing @ parts).reshape(blocks.shape)

    def point_steps(self, state: State, weight: np.ndarray, normals: Normals, step: np.ndarray) -> np.ndarray:
        """See `Equations`."""
        linear = self.linearise(state)
        moved = np.einsum("ncp,np->nc", linear.by_values, step[self.observations.camera]) * weight[:, None]
        pulled = (linear.by_ground * moved[:, :, None]).sum(axis=1)
        right = normals.point_right - np.add.reduceat(pulled, self.observations.first[:-1], axis=0)
        return np.einsum("mij,mj->mi", normals.inverse, right)

    def point_jacobians(self, state: State, points: np.ndarray) -> PointJacobians:
        """See `Equations`."""
        linear = self.linearise(state)
        rows, _ = self.observations.rows_of(points)
        return PointJacobians(rows, linear.residual[rows], linear.by_ground[rows])

    def cofactors(
        self, state: State, weight: np.ndarray, normals: Normals, cameras: np.ndarray, contributes: np.ndarray
    ) -> Cofactors:
        """See `Equations`."""
        linear = self.linearise(state)
        out = Cofactors(normals.inverse.copy(), np.empty((self.observations.count, 2, 2)))
        for chunk in self._chunks:
            between = self._between(chunk, cameras)
            a, b = linear.by_values[chunk.rows], linear.by_ground[chunk.rows]
            pull = b @ normals.inverse[chunk.points][:, None]  # B V^-1 (m, k, 2, 3)
            left = a[:, :, None] @ between  # A Q (m, k, k, 2, p)
            seen = (left @ a[:, None].swapaxes(-1, -2)).swapaxes(2, 3)  # A Q A' (m, k, 2, k, 2)
            weighted = pull * weight[chunk.rows][..., None, None]
            half = np.einsum("makbl,mblx->makx", seen, weighted, optimize=True)
            out.points[chunk.points] += np.einsum("makx,maky->mxy", weighted, half, optimize=True)
            mixed = half @ b.transpose(0, 1, 3, 2)
            own = np.einsum("makal->makl", seen) - mixed - mixed.transpose(0, 1, 3, 2)
            own += b @ out.points[chunk.points][:, None] @ b.transpose(0, 1, 3, 2)
            out.computed[chunk.rows] = own
        return out

    def _between(self, chunk: Chunk, cameras: np.ndarray) -> np.ndarray:
        """Return the cofactor blocks between the cameras of each point, ``(m, k, k, p, p)``."""
        row, column = chunk.camera[:, :, None], chunk.camera[:, None, :]
        blocks = cameras[self.pattern.find(np.minimum(row, column).ravel(), np.maximum(row, column).ravel())]
        blocks = blocks.reshape(*chunk.camera.shape, chunk.camera.shape[1], *cameras.shape[1:])
        return np.where((row > column)[..., None, None], blocks.swapaxes(-1, -2), blocks)

    def intersect(self, state: State, weight: np.ndarray, priors: PointPriors) -> np.ndarray:
        """See `Equations`."""
        ground = state.ground
        for _ in range(INTERSECT_STEPS):
            here = State(state.values, ground)
            inverse, right = self._point_normals(self.linearise(here), weight, priors)
            step = np.einsum("mij,mj->mi", inverse, right)
            length = np.linalg.norm(step, axis=1, keepdims=True)
            ground = moved_ground(ground, step * np.minimum(1.0, STEP_LIMIT_M / np.maximum(length, STEP_LIMIT_M)))
            if not np.nanmax(length, initial=0.0) > CLOSURE_M:
                break
        return ground


def _cross(linear: Linearisation, weight: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the blocks W of points with k image points each, ``(m, k p, 3)``."""
    weighted = linear.by_ground[rows] * weight[rows][..., None, None]
    return (linear.by_values[rows].swapaxes(-1, -2) @ weighted).reshape(len(rows), -1, 3)


def _chunks(observations: Observations) -> Iterator[Chunk]:
    """Yield the points by their number of image points, those of the same cameras together."""
    for length, points in observations.by_length.items():
        camera = observations.camera[observations.first[points][:, None] + np.arange(length)]
        order = np.lexsort(camera.T[::-1])
        step = max(1, ROWS_PER_CHUNK // length)
        for begin in range(0, len(points), step):
            some = order[begin : begin + step]
            cameras = camera[some]
            new = np.r_[True, np.any(cameras[1:] != cameras[:-1], axis=1)]
            rows = observations.first[points[some]][:, None] + np.arange(length)
            yield Chunk(points[some], rows, cameras, np.flatnonzero(new))
