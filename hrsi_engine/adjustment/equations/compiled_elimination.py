"""Elimination of points by the compiled loops of `elimination_kernels`, in parts of a block (needs numba)."""

from itertools import pairwise

import numpy as np

from ..observations import Observations
from . import elimination_kernels as kernels
from .elimination import NumpyElimination
from .linearisation import Linearisation, Portion
from .pattern import Pattern
from .states import Cofactors, Normals, PointPriors

ROWS_PER_PART = 4096  # image points whose equations fit in a processor's cache


class NumbaElimination(NumpyElimination):
    """Elimination by compiled loops, a few thousand image points at a time."""

    compiled = True

    def __init__(self, observations: Observations, pattern: Pattern) -> None:
        super().__init__(observations, pattern)
        self._most = max(int(np.diff(observations.first).max(initial=0)), 1)

    def list_parts(self) -> list[Portion]:
        first = self.observations.first
        bounds = np.unique(np.append(np.searchsorted(first, np.arange(0, first[-1], ROWS_PER_PART)), len(first) - 1))
        return [
            Portion(np.arange(begin, end), first[begin : end + 1] - first[begin], number)
            for number, (begin, end) in enumerate(pairwise(bounds.tolist()))
        ]

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
        kernels.eliminate_points(
            self._rows(part, weight),
            self._most,
            self.observations.camera,
            _arrays(linear),
            linear.by_quantity,
            ground,
            _arrays_of(priors),
            contributes,
            self.pattern.start,
            self.pattern.columns,
            sums.blocks,
            sums.right,
            (sums.residual, sums.inverse, sums.point_right),
        )

    def solve_points(
        self, part: Portion, linear: Linearisation, weight: np.ndarray, ground: np.ndarray, priors: PointPriors
    ) -> np.ndarray:
        steps = np.empty((len(part.points), 3))
        kernels.solve_points(self._rows(part, weight), _arrays(linear), ground, _arrays_of(priors), steps)
        return steps

    def substitute_back(
        self,
        part: Portion,
        linear: Linearisation,
        weight: np.ndarray,
        normals: Normals,
        step: np.ndarray,
        steps: np.ndarray,
    ) -> None:
        kernels.substitute_back(
            self._rows(part, weight),
            self.observations.camera,
            _arrays(linear),
            linear.by_quantity,
            normals.inverse,
            normals.point_right,
            step,
            steps,
        )

    def compute_cofactors(
        self,
        part: Portion,
        linear: Linearisation,
        weight: np.ndarray,
        normals: Normals,
        cameras: np.ndarray,
        results: Cofactors,
    ) -> None:
        kernels.compute_cofactors(
            self._rows(part, weight),
            self._most,
            self.observations.camera,
            _arrays(linear),
            linear.by_quantity,
            normals.inverse,
            self.pattern.start,
            self.pattern.columns,
            cameras,
            tuple(results),
        )

    def _rows(self, part: Portion, weight: np.ndarray) -> tuple[np.ndarray, ...]:
        return part.points, part.place, self.observations.first, weight


def _arrays(linear: Linearisation) -> tuple[np.ndarray, ...]:
    return linear.residual, linear.by_ground, linear.terms


def _arrays_of(priors: PointPriors) -> tuple[np.ndarray, ...]:
    return priors.target, priors.weight, priors.mixed
