"""Discrepancies of the GCPs from the rest of the block, and how they change if observations are left out.

For the observations of the GCPs (surveyed coordinates and image points) with residuals v, weights P and cofactors Qv of
the residuals in the whole adjustment, let u = P v and S = P Qv P. Leaving the observations E out::

    T = u_E' S_EE^-1 u_E        decrease of the weighted sum of squares
    d = S_EE^-1 u_E             their errors, predicted by the rest of the block
    u - S_E S_EE^-1 u_E,  S - S_E S_EE^-1 S_E'        u and S of all others without them

so that each group of observations is tested, with all consequences, without another adjustment (Baarda 1968; Cook and
Weisberg 1982 for groups). Qv, with all tie points, follows from the factors of the adjustment: a GCP's position depends
on the cameras by dx = V^-1 (m - W' da), so that an observation with derivatives A by the cameras and B by the position
depends on them by R = A - B V^-1 W', and

    S = P - P (R Qa R' + B V^-1 B') P        the second term only within a point

All quantities are in units of the observations' own standard deviations here (sqrt(P) on the diagonal is one).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse

from ...foundation.statistical_limits import REDUNDANCY
from ...foundation.thresholds import threshold, thresholds
from ..gauss_newton import GaussNewton, Solution
from ..preparation.problem import Problem


@thresholds
class DISCREPANCY:
    """Limits below which errors of GCPs do not appear in the residuals and cannot be tested."""

    least_inverse_share: float = threshold(1e-9, "", "smallest eigenvalue over the largest one", "rounding of float64")


PLAN, HEIGHT, IMAGE = range(3)  # kinds of observations, each with its own variance factor


@dataclass(frozen=True, eq=False)
class Discrepancies:
    """The observations of some GCPs, in units of their standard deviations.

    points : (g,) indices of the GCPs
    point : (k,) index into ``points`` of each observation
    kind : (k,) `PLAN`, `HEIGHT` or `IMAGE`
    row : (k,) its measurement, -1 for a survey; axis : (k,) its coordinate
    u, s : (k,) and (k, k), see the module's docstring
    sigma : (k,) standard deviations, m or px
    by_unknown : (k, unknowns) weighted derivatives by the cameras' parameters, points eliminated; empty for parts
    """

    points: np.ndarray
    point: np.ndarray
    kind: np.ndarray
    row: np.ndarray
    axis: np.ndarray
    u: np.ndarray
    s: np.ndarray
    sigma: np.ndarray
    by_unknown: sparse.csr_matrix = field(default_factory=lambda: sparse.csr_matrix((0, 0)))

    def test_subset(self, chosen: np.ndarray) -> tuple[float, int]:
        """Return the decrease of the sum of squares without some observations (indices), and its dimensions."""
        values, vectors = np.linalg.eigh(self.s[chosen[:, None], chosen])
        seen = values > REDUNDANCY.tested
        along = vectors[:, seen].T @ self.u[chosen]
        return float(np.sum(along**2 / values[seen])), int(seen.sum())

    def test_parts(self, out: np.ndarray, parts: Sequence[np.ndarray], inverse: np.ndarray) -> list[float]:
        """Return the decrease of the squares by each of the ``parts`` of ``out`` (indices), beyond the other parts.

        One ``inverse`` of ``S_EE`` is enough: its block of a part is the inverse of that part's S without the rest.
        """
        errors = inverse @ self.u[out]
        tests = []
        for part in parts:
            values, vectors = np.linalg.eigh(inverse[part[:, None], part])
            seen = np.abs(values) > DISCREPANCY.least_inverse_share * np.abs(values).max(initial=0.0)
            tests.append(float(np.sum((vectors[:, seen].T @ errors[part]) ** 2 / values[seen])))
        return tests

    def invert_subset(self, chosen: np.ndarray) -> np.ndarray:
        """Return S_EE^-1 of some observations, without directions that do not appear in the residuals."""
        block = self.s[chosen[:, None], chosen]
        try:  # if norms prove a regular matrix: eight times as fast as eigenvalues
            inverse = np.linalg.inv(block)
            if np.linalg.norm(block) * np.linalg.norm(inverse) * REDUNDANCY.tested < 1.0:
                return np.asarray(inverse)
        except np.linalg.LinAlgError:
            pass
        return np.asarray(np.linalg.pinv(block, rcond=REDUNDANCY.tested, hermitian=True))

    def estimate_errors(self, chosen: np.ndarray) -> np.ndarray:
        """Return the errors (m, px) of some observations, observed - true, as predicted by all other observations."""
        return np.asarray(self.sigma[chosen] * (self.invert_subset(chosen) @ self.u[chosen]))

    def exclude(self, out: np.ndarray, inverse: np.ndarray | None = None) -> Discrepancies:
        """Return the discrepancies of all others when some observations (indices) are left out."""
        return self.reduce_to(np.delete(np.arange(len(self.u)), out), out, inverse)

    def reduce_to(self, chosen: np.ndarray, out: np.ndarray, inverse: np.ndarray | None = None) -> Discrepancies:
        """Return the discrepancies of ``chosen`` observations if those of ``out`` are left out; all others are kept.

        ``inverse`` is `invert_subset` of ``out``, if it was computed before.
        """
        gain = self.s[np.ix_(chosen, out)] @ (self.invert_subset(out) if inverse is None else inverse)
        return Discrepancies(
            self.points, self.point[chosen], self.kind[chosen], self.row[chosen], self.axis[chosen],
            self.u[chosen] - gain @ self.u[out], self.s[np.ix_(chosen, chosen)] - gain @ self.s[np.ix_(out, chosen)],
            self.sigma[chosen],
        )  # fmt: skip

    def select_gcps(self, gcps: np.ndarray, out: np.ndarray, inverse: np.ndarray) -> Discrepancies:
        """Return the discrepancies of some GCPs (indices into ``points``, ascending), which are renumbered from 0.

        Observations ``out`` (with their ``inverse``) are left out and not contained; all others are kept.
        """
        chosen = np.setdiff1d(self.find_observations(gcps.tolist()), out)
        some = self.reduce_to(chosen, out, inverse)
        return replace(some, points=self.points[gcps], point=np.searchsorted(gcps, some.point))

    def find_observations(self, gcps: Sequence[int]) -> np.ndarray:
        """Return the indices of all observations of some GCPs (indices into ``points``)."""
        return np.flatnonzero(self._belongs_to(gcps))

    def find_measurements(self, gcps: Sequence[int]) -> np.ndarray:
        """Return the indices of some GCPs' image observations; without them a GCP has no influence."""
        return np.flatnonzero(self._belongs_to(gcps) & (self.kind == IMAGE))

    def _belongs_to(self, gcps: Sequence[int]) -> np.ndarray:
        wanted = np.zeros(len(self.points), dtype=bool)
        wanted[list(gcps)] = True
        return wanted[self.point]


def compute_discrepancies(problem: Problem, loop: GaussNewton, solution: Solution, points: np.ndarray) -> Discrepancies:
    """Return the discrepancies of some GCPs ``(g,)`` at a solution; observations without weight are not contained."""
    observations, priors = problem.observations, solution.weighting.points
    system, parameters = loop.system, loop.prior_weight.shape[1]
    system.factorise(solution.normals.blocks, loop.prior_weight)
    given = solution.weight  # a property, computed at each access
    derivatives = compute_derivatives(problem, solution, points)
    surveys, miss = (
        priors.build_weight_matrices(points, observed=True),
        priors.compute_misclosures_m(solution.state.ground[points], points),
    )
    columns: list[list[np.ndarray]] = [[] for _ in range(6)]
    own, by_cameras, unknowns = [], [], []
    for number, point in enumerate(points.tolist()):
        rows = np.arange(observations.first[point], observations.first[point + 1])
        rows = rows[given[rows] > 0.0]
        by_values, by_ground = derivatives[point]
        k = len(rows)
        weight = np.zeros((3 + 2 * k, 3 + 2 * k))
        weight[:3, :3] = surveys[number]
        weight[range(3, 3 + 2 * k), range(3, 3 + 2 * k)] = np.repeat(given[rows], 2)
        position = np.concatenate([np.eye(3), by_ground.reshape(-1, 3)])  # B
        inverse = solution.normals.inverse[point]
        # A, and the derivatives of the position by the cameras that observe it: -V^-1 W'
        seeing, place = np.unique(observations.camera[rows], return_inverse=True)
        cameras = np.zeros((3 + 2 * k, len(seeing), parameters))
        answer = np.zeros((3, len(seeing), parameters))
        for measured, (row, camera) in enumerate(zip(rows.tolist(), place.tolist(), strict=True)):
            cameras[3 + 2 * measured : 5 + 2 * measured, camera] = by_values[measured]
            answer[:, camera] -= given[row] * (inverse @ by_ground[measured].T @ by_values[measured])
        depending = cameras + np.tensordot(position, answer, axes=1)  # R
        used = np.flatnonzero(weight.diagonal() > 0.0)
        unit = 1.0 / np.sqrt(weight.diagonal()[used])
        weight = weight[np.ix_(used, used)]
        weighted = unit[:, None] * weight
        residual = np.concatenate([miss[number], solution.normals.residual[rows].ravel()])[used]
        position = position[used]
        alone = (weight - weight @ position @ inverse @ position.T @ weight) * unit * unit[:, None]
        own.append(0.5 * (alone + alone.T))
        by_cameras.append(weighted @ depending[used].reshape(len(used), -1))
        unknowns.append((seeing[:, None] * parameters + np.arange(parameters)).ravel())
        for column, values in zip(
            columns,
            (
                np.full(len(used), number), np.r_[[PLAN, PLAN, HEIGHT], np.full(2 * k, IMAGE)][used],
                np.r_[[-1, -1, -1], np.repeat(rows, 2)][used], np.r_[[0, 1, 2], np.tile([0, 1], k)][used],
                weighted @ residual, unit,
            ),
            strict=True,
        ):  # fmt: skip
            column.append(values)
    point, kind, row, axis, u, sigma = (np.concatenate(column) for column in columns)
    by_unknown = _stack_by_unknown(by_cameras, unknowns, loop.prior_weight.size)
    s = system.project_cofactors(by_unknown)
    np.negative(s, out=s)
    begin = 0
    for block in own:
        s[begin : begin + len(block), begin : begin + len(block)] += block
        begin += len(block)
    return Discrepancies(points, point, kind, row, axis, u, s, sigma, by_unknown)


def _stack_by_unknown(blocks: list[np.ndarray], unknowns: list[np.ndarray], count: int) -> sparse.csr_matrix:
    """Return the sparse matrix of ``blocks`` of rows below each other, each with the ``unknowns`` of its columns."""
    starts = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    columns = np.concatenate([np.tile(own, len(block)) for block, own in zip(blocks, unknowns, strict=True)])
    values = np.concatenate([block.ravel() for block in blocks])
    return sparse.csr_matrix((values, columns, np.r_[0, np.cumsum(starts)]), shape=(len(starts), count))


def compute_derivatives(
    problem: Problem, solution: Solution, points: np.ndarray
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return the derivatives by the camera's values (k, 2, p) and by the position (k, 2, 3) of each point's rows."""
    observations = problem.observations
    rows, _ = observations.find_rows(points)
    rows = rows[solution.weight[rows] > 0.0]
    by_values = np.empty((len(rows), 2, problem.prior_weight.shape[1]))
    by_ground = np.empty((len(rows), 2, 3))
    for index in np.unique(observations.image[rows]).tolist():
        here = np.flatnonzero(observations.image[rows] == index)
        linearise = problem.camera.equations(observations.images[index], observations.xy[rows[here]])
        values = solution.state.values[observations.camera_of_image[index]]
        at = linearise(values, solution.state.ground[observations.point[rows[here]]])
        by_values[here], by_ground[here] = at.by_values, at.by_ground
    last = np.searchsorted(observations.point[rows], points, side="right")
    groups = zip(np.split(by_values, last[:-1]), np.split(by_ground, last[:-1]), strict=True)
    return dict(zip(points.tolist(), groups, strict=True))
