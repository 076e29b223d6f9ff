"""Data snooping: which measurements and GCPs are blunders (Baarda 1968; Pope 1976).

The test value of an observation is by how much the weighted sum of squares falls when it is left out, divided by the
variance factor. Tie points are judged one by one with the cameras as they are (`tie_decisions`): thousands of them
determine the cameras, so one more or less does not matter, and each point is a small adjustment of its own in which
the worst measurement goes until the rest agree. Where several measurements could be the wrong one the point cannot
tell; all of those are *doubtful* and left out, none is called a blunder.

GCPs are few and hold the cameras, so they are judged with the cofactors of the whole adjustment
(`control_suspects`): the ground position as one candidate, each measurement as another. The one whose removal helps
most is named, unless another explains the misfit as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from .equations import NormalEquations, PointPriors
from .gauss_newton import Solution, Weighting
from .observations import Observations
from .precision import Precision, deletion_tests, survey_tests
from .result import Decision

EQUALLY_LIKELY = 0.98  # a second candidate that explains this share of the worst one's misfit cannot be told apart
MOST_LOG = 5e3  # of a probability; caps what cannot be represented
FEWEST_GCPS = 3  # two that disagree do not say which is wrong


def critical_value(sigmas: float, dimensions: int, candidates: int = 1) -> float:
    """Return the limit of a chi² test with the error probability of ``sigmas`` for an image point (two dimensions).

    Several ``candidates`` share the probability (Bonferroni), so that points with many rays raise no more false alarms.
    """
    return float(special.chdtri(dimensions, np.exp(-0.5 * sigmas**2) / candidates))


def tie_variance(observations: Observations, squares: np.ndarray, rays: np.ndarray, ties: np.ndarray) -> float:
    """Return the variance factor of the tie points, from the median of their sums of squares; 1 without any."""
    chosen = ties & (rays >= 2)
    if not chosen.any():
        return 1.0
    freedom = 2 * rays[chosen] - 3
    expected = special.chdtri(np.arange(1, freedom.max() + 1), 0.5)[freedom - 1]
    return float(np.median(squares[chosen] / expected))


def point_squares(
    equations: NormalEquations, solution: Solution, weighting: Weighting, observations: Observations
) -> np.ndarray:
    """Return each point's smallest weighted sum of squares for the cameras as they are, ``(m,)``."""
    nobody = np.zeros(len(observations.points), dtype=bool)
    normals = equations.normals(solution.state, weighting.image, weighting.points, nobody)
    lengths = np.einsum("nc,nc->n", normals.residual, normals.residual) * weighting.image
    gain = np.einsum("mi,mij,mj->m", normals.point_right, normals.inverse, normals.point_right)
    return np.add.reduceat(lengths, observations.first[:-1]) - gain


def tie_decisions(
    equations: NormalEquations,
    observations: Observations,
    solution: Solution,
    all_in: Weighting,
    ties: np.ndarray,
    sigmas: float,
    variance: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a `Decision` for every measurement ``(n,)``, and the test values (sigmas) of those that failed, else NaN.

    Every point starts with all its measurements again (weighting ``all_in``), so that one that was left out when the
    cameras were worse may come back. ``ties (m,)`` are the points to judge.
    """
    decision = np.full(observations.count, int(Decision.KEPT), dtype=np.int8)
    failed = np.full(observations.count, np.nan, dtype=np.float32)
    squares = point_squares(equations, solution, all_in, observations)
    suspicious = np.flatnonzero(ties & (squares > critical_value(sigmas, 2) * variance))
    rays = np.diff(observations.first)[suspicious]
    for length in np.unique(rays):
        points = suspicious[rays == length]
        local = equations.point_jacobians(solution.state, points)
        rows = local.rows.reshape(-1, length)
        group = _Group(
            local.residual.reshape(-1, length, 2), local.by_ground.reshape(-1, length, 2, 3),
            all_in.image[rows] / variance, all_in.points, points,
        )  # fmt: skip
        decision[rows], failed[rows] = group.judge(sigmas)
    return decision, failed


class _Group:
    """Points with k measurements each, adjusted side by side with fixed cameras."""

    def __init__(
        self, residual: np.ndarray, by_ground: np.ndarray, weight: np.ndarray, priors: PointPriors, points: np.ndarray
    ) -> None:
        self.residual, self.by_ground, self.weight = residual, by_ground, weight.copy()
        self.own = priors.weight[points]
        self.decision = np.full(weight.shape, int(Decision.KEPT), dtype=np.int8)
        self.failed = np.full(weight.shape, np.nan)

    def judge(self, sigmas: float) -> tuple[np.ndarray, np.ndarray]:
        """Leave out the worst measurement of each point until the rest agree; return decisions and tests ``(m, k)``."""
        limits = np.array([critical_value(sigmas, 2, max(k, 1)) for k in range(self.weight.shape[1] + 1)])
        pending = np.arange(len(self.weight))
        while len(pending):
            tests, squares = self._tests(pending)
            rays = (self.weight[pending] > 0.0).sum(axis=1)
            bad = (tests.max(axis=1) > limits[rays]) & (rays >= 2)
            pending, tests, squares, rays = pending[bad], tests[bad], squares[bad], rays[bad]
            self._leave_out(pending, tests, squares, rays, sigmas)
        return self.decision, self.failed

    def _leave_out(
        self, points: np.ndarray, tests: np.ndarray, squares: np.ndarray, rays: np.ndarray, sigmas: float
    ) -> None:
        """Take the worst measurement out, or all of those that could be it."""
        rest = np.maximum(2 * rays - 5, 1)
        acceptable = np.array([critical_value(sigmas, d) for d in range(1, int(rest.max(initial=1)) + 1)])[rest - 1]
        alive = self.weight[points] > 0.0
        could_be = alive & (squares[:, None] - tests <= acceptable[:, None])
        unclear = (could_be.sum(axis=1) > 1) | (rays == 2)
        could_be[rays == 2] = alive[rays == 2]
        worst = np.zeros_like(could_be)
        worst[np.arange(len(points)), tests.argmax(axis=1)] = True
        out = np.where(unclear[:, None], could_be, worst)
        # Fewer than two left: whatever remains cannot be checked.
        lonely = unclear & ((alive & ~out).sum(axis=1) < 2)
        out[lonely] = alive[lonely]
        kind = np.where(unclear, int(Decision.DOUBTFUL), int(Decision.BLUNDER)).astype(np.int8)
        self.decision[points] = np.where(out, kind[:, None], self.decision[points])
        self.failed[points] = np.where(out, np.sqrt(tests.max(axis=1))[:, None], self.failed[points])
        self.weight[points] = np.where(out, 0.0, self.weight[points])
        # Whatever was called a blunder before was judged by measurements that agree with none.
        collapsed = points[lonely]
        guessed = self.decision[collapsed] == int(Decision.BLUNDER)
        self.decision[collapsed] = np.where(guessed, int(Decision.DOUBTFUL), self.decision[collapsed])

    def _tests(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the test values ``(m, k)`` and sums of squares ``(m,)`` of least-squares points."""
        jacobian, weight, residual = self.by_ground[points], self.weight[points], self.residual[points]
        count, length = weight.shape
        weighted = jacobian * weight[:, :, None, None]
        flat, flat_weighted = jacobian.reshape(count, -1, 3), weighted.reshape(count, -1, 3)
        normal = flat_weighted.swapaxes(1, 2) @ flat
        normal[:, range(3), range(3)] += self.own[points]
        inverse = np.linalg.inv(normal)
        step = inverse @ (flat_weighted.swapaxes(1, 2) @ residual.reshape(count, -1, 1))
        left = residual - (flat @ step).reshape(count, length, 2)
        seen = jacobian @ inverse[:, None] @ jacobian.swapaxes(-1, -2)
        with np.errstate(divide="ignore"):
            prior = np.where(weight > 0.0, 1.0 / weight, 0.0)
        cofactor = prior[:, :, None, None] * np.eye(2) - seen
        tests = deletion_tests(left.reshape(-1, 2), cofactor.reshape(-1, 2, 2), weight.ravel())
        return tests.reshape(count, length), np.einsum("akc,akc,ak->a", left, left, weight)


@dataclass(frozen=True)
class Suspect:
    """The worst candidate among the GCPs: its point, its row (None: the ground position), and its test.

    ``statistic`` is in equivalent standard deviations; ``rivals`` are candidates at other points that explain the
    misfit as well; ``same_point`` is true where ground position and measurement of the point cannot be told apart.
    """

    point: int
    row: int | None
    statistic: float
    rivals: tuple[int, ...]
    same_point: bool


def control_suspect(
    observations: Observations, solution: Solution, precise: Precision, sigmas: float
) -> Suspect | None:
    """Return the worst of the GCPs' positions and measurements, if it fails its test, or None.

    The variance factor is that of the GCPs themselves without the candidate (externally studentised), because the
    sigmas of GCPs are the user's guess and the RPC's own errors come on top.
    """
    priors, weight = solution.weighting.points, solution.weight
    surveyed = np.flatnonzero((solution.weighting.contributes & priors.held) & observations.surveyed)
    if len(surveyed) < FEWEST_GCPS or precise.cameras is None:
        return None
    rows, _ = observations.rows_of(surveyed)
    rows = rows[weight[rows] > 0.0]
    survey_weight = priors.matrices(surveyed, observed=True)
    miss = priors.miss_m(solution.state.ground[surveyed], surveyed)
    of_miss = np.linalg.inv(priors.matrices(surveyed)) - precise.points[surveyed]
    of_survey = survey_tests(miss, of_miss, survey_weight)
    of_rows = deletion_tests(solution.normals.residual[rows], precise.residuals[rows], weight[rows])
    squares = float(np.einsum("ki,kij,kj->", miss, survey_weight, miss))
    squares += float(np.sum(weight[rows, None] * solution.normals.residual[rows] ** 2))
    freedom = float(np.sum(weight[rows] * np.trace(precise.residuals[rows], axis1=1, axis2=2)))
    freedom += float(np.sum(survey_weight * of_miss))
    tests = np.concatenate([of_survey, of_rows])
    point = np.concatenate([surveyed, observations.point[rows]])
    dimensions = np.concatenate([priors.observed[surveyed].sum(axis=1), np.full(len(rows), 2)])
    probability = _studentised(tests, dimensions, squares, freedom)
    worst = int(np.lexsort((tests, probability))[-1])
    if probability[worst] < 0.5 * sigmas**2:
        return None
    close = tests >= EQUALLY_LIKELY * tests[worst]
    rivals = tuple(np.unique(point[close & (point != point[worst])]).tolist())
    same = bool((close & (point == point[worst])).sum() > 1)
    row = None if worst < len(surveyed) else int(rows[worst - len(surveyed)])
    return Suspect(int(point[worst]), row, float(np.sqrt(2.0 * probability[worst])), rivals, same)


def _studentised(tests: np.ndarray, dimensions: np.ndarray, squares: float, freedom: float) -> np.ndarray:
    """Return -log of the probability of test values under the F distribution of the rest; 0 where nothing is left."""
    left = freedom - dimensions
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (tests / dimensions) / (np.maximum(squares - tests, 1e-12 * squares) / left)
    usable = left > 0.5
    with np.errstate(divide="ignore"):
        surprise = -np.log(special.fdtrc(dimensions, np.maximum(left, 0.5), np.where(usable, ratio, 0.0)))
    return np.where(usable, np.minimum(surprise, MOST_LOG), 0.0)
