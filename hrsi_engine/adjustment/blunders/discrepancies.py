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

from ...foundation.thresholds import EQUALITY, REDUNDANCY
from ..gauss_newton import GaussNewton, Solution
from ..preparation.problem import Problem

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

    def test_subset(self, subset: np.ndarray) -> tuple[float, int]:
        """Return T of some observations, the decrease of the sum of squares without them, and its degrees of freedom.

        subset : (e,) indices of the observations; directions that hardly appear in the residuals are not counted
        """
        values, vectors = np.linalg.eigh(self.s[subset[:, None], subset])
        is_tested = values > REDUNDANCY.tested
        along = vectors[:, is_tested].T @ self.u[subset]
        return float(np.sum(along**2 / values[is_tested])), int(is_tested.sum())

    def test_parts(self, excluded: np.ndarray, parts: Sequence[np.ndarray], inverse: np.ndarray) -> list[float]:
        """Return the decrease of the squares by each of the ``parts`` of ``excluded`` (indices), beyond the others.

        One ``inverse`` of ``S_EE`` is enough: its block of a part is the inverse of that part's S without the rest.
        """
        errors = inverse @ self.u[excluded]
        tests = []
        for part in parts:
            values, vectors = np.linalg.eigh(inverse[part[:, None], part])
            is_tested = np.abs(values) > EQUALITY.rounding * np.abs(values).max(initial=0.0)
            tests.append(float(np.sum((vectors[:, is_tested].T @ errors[part]) ** 2 / values[is_tested])))
        return tests

    def invert_subset(self, subset: np.ndarray) -> np.ndarray:
        """Return S_EE^-1 ``(e, e)`` of observations ``subset (e,)``, without directions that residuals do not show."""
        block = self.s[subset[:, None], subset]
        try:  # if norms prove a regular matrix: eight times as fast as eigenvalues
            inverse = np.linalg.inv(block)
            if np.linalg.norm(block) * np.linalg.norm(inverse) * REDUNDANCY.tested < 1.0:
                return np.asarray(inverse)
        except np.linalg.LinAlgError:
            pass
        return np.asarray(np.linalg.pinv(block, rcond=REDUNDANCY.tested, hermitian=True))

    def estimate_errors(self, subset: np.ndarray) -> np.ndarray:
        """Return d of observations ``subset (e,)``: observed minus predicted by all others, ``(e,)`` in m or px."""
        return np.asarray(self.sigma[subset] * (self.invert_subset(subset) @ self.u[subset]))

    def exclude(self, excluded: np.ndarray, inverse: np.ndarray | None = None) -> Discrepancies:
        """Return the discrepancies of all other observations when those of ``excluded (e,)`` are left out.

        inverse : (e, e) `invert_subset` of these, if it was computed before
        """
        return self.reduce_to(np.delete(np.arange(len(self.u)), excluded), excluded, inverse)

    def reduce_to(self, subset: np.ndarray, excluded: np.ndarray, inverse: np.ndarray | None = None) -> Discrepancies:
        """Return the discrepancies of ``subset`` observations without those of ``excluded``; all others are kept.

        ``inverse`` is `invert_subset` of ``excluded``, if it was computed before.
        """
        gain = self.s[np.ix_(subset, excluded)] @ (self.invert_subset(excluded) if inverse is None else inverse)
        return Discrepancies(
            points=self.points,
            point=self.point[subset],
            kind=self.kind[subset],
            row=self.row[subset],
            axis=self.axis[subset],
            u=self.u[subset] - gain @ self.u[excluded],
            s=self.s[np.ix_(subset, subset)] - gain @ self.s[np.ix_(excluded, subset)],
            sigma=self.sigma[subset],
        )

    def select_gcps(self, gcps: np.ndarray, excluded: np.ndarray, inverse: np.ndarray) -> Discrepancies:
        """Return the discrepancies of some GCPs (indices into ``points``, ascending), which are renumbered from 0.

        Observations ``excluded`` (with their ``inverse``) are left out and not contained; all others are kept.
        """
        subset = np.setdiff1d(self.find_observations(gcps.tolist()), excluded)
        reduced = self.reduce_to(subset, excluded, inverse)
        return replace(reduced, points=self.points[gcps], point=np.searchsorted(gcps, reduced.point))

    def find_observations(self, gcps: Sequence[int]) -> np.ndarray:
        """Return the indices of all observations of some GCPs (indices into ``points``)."""
        return np.flatnonzero(self._belongs_to(gcps))

    def find_measurements(self, gcps: Sequence[int]) -> np.ndarray:
        """Return the indices of some GCPs' image observations; without them a GCP has no influence."""
        return np.flatnonzero(self._belongs_to(gcps) & (self.kind == IMAGE))

    def _belongs_to(self, gcps: Sequence[int]) -> np.ndarray:
        is_member = np.zeros(len(self.points), dtype=bool)
        is_member[list(gcps)] = True
        return is_member[self.point]


def compute_discrepancies(problem: Problem, loop: GaussNewton, solution: Solution, points: np.ndarray) -> Discrepancies:
    """Return the discrepancies of some GCPs at a solution; observations without weight are not contained.

    loop : its system is factorised here, with the loop's priors; points : (g,) indices of the GCPs
    Result: S is dense, ``(k, k)``, for the k observations of these GCPs.
    """
    observations, priors = problem.observations, solution.weighting.points
    system, parameters = loop.system, loop.prior_weight.shape[1]
    system.factorise(solution.normals.blocks, loop.prior_weight)
    image_weight = solution.weight  # a property, computed at each access
    derivatives = compute_derivatives(problem, solution, points)
    surveys = priors.build_weight_matrices(points, observed=True)
    miss = priors.compute_misclosures_m(solution.state.ground[points], points)
    columns: list[list[np.ndarray]] = [[] for _ in range(6)]
    diagonal_blocks, by_cameras, unknowns = [], [], []
    for number, point in enumerate(points.tolist()):
        rows = np.arange(observations.first[point], observations.first[point + 1])
        rows = rows[image_weight[rows] > 0.0]
        by_values, by_ground = derivatives[point]
        k = len(rows)
        weight = np.zeros((3 + 2 * k, 3 + 2 * k))
        weight[:3, :3] = surveys[number]
        weight[range(3, 3 + 2 * k), range(3, 3 + 2 * k)] = np.repeat(image_weight[rows], 2)
        position = np.concatenate([np.eye(3), by_ground.reshape(-1, 3)])  # B
        inverse = solution.normals.inverse[point]
        # A, and the derivatives of the position by the cameras that observe it: -V^-1 W'
        seeing, place = np.unique(observations.camera[rows], return_inverse=True)
        cameras = np.zeros((3 + 2 * k, len(seeing), parameters))
        answer = np.zeros((3, len(seeing), parameters))
        for measured, (row, camera) in enumerate(zip(rows.tolist(), place.tolist(), strict=True)):
            cameras[3 + 2 * measured : 5 + 2 * measured, camera] = by_values[measured]
            answer[:, camera] -= image_weight[row] * (inverse @ by_ground[measured].T @ by_values[measured])
        depending = cameras + np.tensordot(position, answer, axes=1)  # R
        weighted_rows = np.flatnonzero(weight.diagonal() > 0.0)
        unit = 1.0 / np.sqrt(weight.diagonal()[weighted_rows])
        weight = weight[np.ix_(weighted_rows, weighted_rows)]
        weighted = unit[:, None] * weight
        residual = np.concatenate([miss[number], solution.normals.residual[rows].ravel()])[weighted_rows]
        position = position[weighted_rows]
        cofactor = (weight - weight @ position @ inverse @ position.T @ weight) * unit * unit[:, None]
        diagonal_blocks.append(0.5 * (cofactor + cofactor.T))
        by_cameras.append(weighted @ depending[weighted_rows].reshape(len(weighted_rows), -1))
        unknowns.append((seeing[:, None] * parameters + np.arange(parameters)).ravel())
        for column, values in zip(
            columns,
            (
                np.full(len(weighted_rows), number),
                np.r_[[PLAN, PLAN, HEIGHT], np.full(2 * k, IMAGE)][weighted_rows],
                np.r_[[-1, -1, -1], np.repeat(rows, 2)][weighted_rows],
                np.r_[[0, 1, 2], np.tile([0, 1], k)][weighted_rows],
                weighted @ residual,
                unit,
            ),
            strict=True,
        ):
            column.append(values)
    point, kind, row, axis, u, sigma = (np.concatenate(column) for column in columns)
    by_unknown = _stack_by_unknown(by_cameras, unknowns, loop.prior_weight.size)
    s = system.project_cofactors(by_unknown)
    np.negative(s, out=s)
    begin = 0
    for block in diagonal_blocks:
        s[begin : begin + len(block), begin : begin + len(block)] += block
        begin += len(block)
    return Discrepancies(points, point, kind, row, axis, u, s=s, sigma=sigma, by_unknown=by_unknown)


def _stack_by_unknown(blocks: list[np.ndarray], unknowns: list[np.ndarray], count: int) -> sparse.csr_matrix:
    """Return the sparse matrix of ``blocks`` of rows below each other, each with the ``unknowns`` of its columns."""
    starts = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    columns = np.concatenate([np.tile(indices, len(block)) for block, indices in zip(blocks, unknowns, strict=True)])
    values = np.concatenate([block.ravel() for block in blocks])
    return sparse.csr_matrix((values, columns, np.r_[0, np.cumsum(starts)]), shape=(len(starts), count))


def compute_derivatives(
    problem: Problem, solution: Solution, points: np.ndarray
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return derivatives of the image points of each of the ``points (g,)``, those of its k rows with weight.

    Result: by index of the point, derivatives by the camera's values ``(k, 2, p)``, px per unit, and by the position
        ``(k, 2, 3)``, px/m east, north, up.
    """
    observations = problem.observations
    rows, _ = observations.find_rows(points)
    rows = rows[solution.weight[rows] > 0.0]
    by_values = np.empty((len(rows), 2, problem.prior_weight.shape[1]))
    by_ground = np.empty((len(rows), 2, 3))
    for index in np.unique(observations.image[rows]).tolist():
        places = np.flatnonzero(observations.image[rows] == index)
        linearise = problem.camera.equations(observations.images[index], observations.xy[rows[places]])
        values = solution.state.values[observations.camera_of_image[index]]
        linearised = linearise(values, solution.state.ground[observations.point[rows[places]]])
        by_values[places], by_ground[places] = linearised.by_values, linearised.by_ground
    last = np.searchsorted(observations.point[rows], points, side="right")
    groups = zip(np.split(by_values, last[:-1]), np.split(by_ground, last[:-1]), strict=True)
    return dict(zip(points.tolist(), groups, strict=True))
