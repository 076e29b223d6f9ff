"""`Equations` for image-space polynomials by compiled code (`kernels`): threads over ranges of points."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from ...block.block import Image
from ...refinement.image_space import ImagePolynomial
from ..observations import Observations
from . import kernels
from .pattern import Pattern
from .states import Cofactors, Normals, PointJacobians, PointPriors, State

RANGES_PER_THREAD = 4  # parts of unequal work even out


class CompiledEquations:
    """See `Equations`; the cameras' tables are made once."""

    def __init__(self, observations: Observations, model: ImagePolynomial, pattern: Pattern, threads: int = 0) -> None:
        self.observations, self.pattern = observations, pattern
        self.threads = threads or os.cpu_count() or 1
        self._most = max(int(np.diff(observations.first).max(initial=0)), 1)
        self._cubics = np.stack([_cubics(image) for image in observations.images])
        self._constants = np.stack([_constants(image) for image in observations.images])
        self._powers = np.ascontiguousarray(model.powers, dtype=np.int64)
        count = len(model.powers)
        self._mixing = np.ascontiguousarray(
            model.mixing.reshape(2 * count, len(model.parameters))
        )  # coefficients by parameters

    # ---- what the solver asks --------------------------------------------------------------------------------------

    def residuals(self, state: State) -> np.ndarray:
        """See `Equations`."""
        out = np.empty((self.observations.count, 2))
        weight = np.zeros(self.observations.count)
        self._run(kernels.residuals, *self._inputs(state, weight), state.ground, self._empty_priors(), out)
        return out

    def normals(self, state: State, weight: np.ndarray, priors: PointPriors, contributes: np.ndarray) -> Normals:
        """See `Equations`."""
        size, pattern = 2 * len(self._powers), self.pattern
        points = len(self.observations.points)
        out = (np.empty((self.observations.count, 2)), np.empty((points, 3, 3)), np.empty((points, 3)))
        observed, cameras = self._inputs(state, weight)
        sums = [
            (np.zeros((pattern.blocks, size, size)), np.zeros((pattern.cameras, size))) for _ in range(self.threads)
        ]
        free = list(sums)

        def part(begin: int, end: int) -> None:
            blocks, right = free.pop()
            kernels.eliminate(
                begin, end, self._most, observed, cameras, state.ground,
                _prior_arrays(priors), contributes, pattern.start, pattern.columns, blocks, right, out,
            )  # fmt: skip
            free.append((blocks, right))

        self._in_threads(part, points)
        blocks, right = sums[0]
        for more_blocks, more_right in sums[1:]:
            blocks += more_blocks
            right += more_right
        return Normals(out[0], self._to_parameters(blocks), right @ self._mixing, out[1], out[2])

    def point_steps(self, state: State, weight: np.ndarray, normals: Normals, step: np.ndarray) -> np.ndarray:
        """See `Equations`."""
        out = np.empty_like(state.ground)
        by_coefficient = np.ascontiguousarray((step @ self._mixing.T).reshape(len(step), 2, len(self._powers)))
        self._run(
            kernels.substitute, *self._inputs(state, weight), state.ground, self._empty_priors(),
            normals.inverse, normals.point_right, by_coefficient, out,
        )  # fmt: skip
        return out

    def point_jacobians(self, state: State, points: np.ndarray) -> PointJacobians:
        """See `Equations`."""
        rows, place = self.observations.rows_of(points)
        residual, by_ground = np.empty((len(rows), 2)), np.empty((len(rows), 2, 3))
        observed, cameras = self._inputs(state, np.zeros(self.observations.count))
        kernels.jacobians(
            0, len(points), self._most, points.astype(np.int64), place, observed, cameras, state.ground,
            self._empty_priors(), residual, by_ground,
        )  # fmt: skip
        return PointJacobians(rows, residual, by_ground)

    def cofactors(
        self, state: State, weight: np.ndarray, normals: Normals, cameras: np.ndarray, contributes: np.ndarray
    ) -> Cofactors:
        """See `Equations`."""
        out = Cofactors(np.empty_like(normals.inverse), np.empty((self.observations.count, 2, 2)))
        by_coefficient = np.ascontiguousarray(self._mixing @ cameras @ self._mixing.T)
        self._run(
            kernels.spread, *self._inputs(state, weight), state.ground, self._empty_priors(), normals.inverse,
            self.pattern.start, self.pattern.columns,
            by_coefficient, tuple(out),
        )  # fmt: skip
        return out

    def intersect(self, state: State, weight: np.ndarray, priors: PointPriors) -> np.ndarray:
        """See `Equations`."""
        ground = state.ground.copy()
        self._run(kernels.intersect, *self._inputs(state, weight), ground, _prior_arrays(priors))
        return ground

    # ---- calls -----------------------------------------------------------------------------------------------------

    def _inputs(self, state: State, weight: np.ndarray) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Return the arguments that all kernels share."""
        observations = self.observations
        by_camera = (state.values @ self._mixing.T).reshape(len(state.values), 2, len(self._powers))
        return (
            (observations.first, observations.image, observations.xy, weight),
            (
                self._cubics,
                self._constants,
                np.ascontiguousarray(by_camera[observations.camera_of_image]),
                self._powers,
                observations.camera_of_image,
            ),
        )

    def _empty_priors(self) -> tuple[np.ndarray, ...]:
        """Return point priors that say nothing, of the right length and without its memory."""
        nothing = np.broadcast_to(np.zeros(3), (len(self.observations.points), 3))
        return nothing, nothing, np.zeros((1, 3))

    def _to_parameters(self, blocks: np.ndarray) -> np.ndarray:
        identity = self._mixing.shape[0] == self._mixing.shape[1] and np.array_equal(
            self._mixing, np.eye(len(self._mixing))
        )
        return blocks if identity else self._mixing.T @ blocks @ self._mixing

    def _run(self, kernel: Callable[..., None], *arguments: Any) -> None:
        self._in_threads(lambda begin, end: kernel(begin, end, self._most, *arguments), len(self.observations.points))

    def _in_threads(self, part: Callable[[int, int], None], count: int) -> None:
        """Call ``part(begin, end)`` for ranges that cover all points."""
        if self.threads == 1 or count < 1000:
            part(0, count)
            return
        bounds = np.linspace(0, count, self.threads * RANGES_PER_THREAD + 1).astype(int).tolist()
        with ThreadPoolExecutor(self.threads) as pool:
            for done in [pool.submit(part, begin, end) for begin, end in pairwise(bounds)]:
                done.result()


def _prior_arrays(priors: PointPriors) -> tuple[np.ndarray, ...]:
    return priors.target, priors.weight, priors.mixed


def _cubics(image: Image) -> np.ndarray:
    """Return the ``(20, 4)`` coefficients of sample and line numerator, sample and line denominator."""
    rpc = image.rpc
    return np.column_stack([rpc.samp_num, rpc.line_num, rpc.samp_den, rpc.line_den])


def _constants(image: Image) -> np.ndarray:
    rpc = image.rpc
    ground = [rpc.long_off, rpc.lat_off, rpc.height_off]
    scale = [1.0 / rpc.long_scale, 1.0 / rpc.lat_scale, 1.0 / rpc.height_scale]
    return np.array([*ground, *scale, rpc.samp_off, rpc.line_off, rpc.samp_scale, rpc.line_scale, *image.centre_px])
