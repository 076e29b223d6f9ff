"""Data snooping of tie points: detection of blunders among their measurements (Baarda 1968; Pope 1976).

Tie points are tested one by one with fixed cameras: thousands of them determine the cameras, so that a single one has
no influence, and each point is a small adjustment of its own. The test value of a measurement is the decrease of the
weighted sum of squares without it, divided by the variance factor. The worst measurement is left out until the others
agree; if a single one does not explain the misfit, and there are four rays or more, two blunders may mask each other:
then the test starts with the largest set of rays that agree with the intersection of two of them. If several
measurements of a point could be the wrong one, all of them are *doubtful* and left out, and none is called a blunder.

Two remaining rays of k have one condition y (sigmas), which wrong ones meet by chance. With a share e of wrong
measurements and errors of size a (sigmas), the odds that of k rays k - 1 or all are wrong and two of them agree by
chance, against that the other k - 2 are wrong, are

    odds = (k e (1 - e) + e²) / (1 - e)² · chance / phi(y)        chance = 1 / (2 a), phi: the normal density

(Bayes; the number of pairs that could agree is the same in both). Pairs with odds above `RAYS.credit` are doubtful too.

**Error probabilities** are shared by all tests. ``reject_sigma`` states an error probability: that an image point (two
dimensions) deviates by this many standard deviations. A block has thousands of tests, so that this probability alone
would reject points in every correct block. The limit of the tie points is therefore that of Benjamini and Hochberg
(1995): of all N points tested those R are wrong whose probability is below p R / N with p = `RAYS.false_share`, so
that a correct block has a rejection in p of cases, and a bad one is tested as strictly as the user asks. GCPs share the
probability equally (Bonferroni).
"""

import numpy as np
from scipy import special

from ...foundation.thresholds import EQUALITY, ITERATIONS, REDUNDANCY, SAMPLES, threshold, thresholds
from ..equations import PointPriors
from ..gauss_newton import Solution, Weighting
from ..observations import Observations
from ..preparation.problem import Problem
from ..result import Decision
from ..starting_values.consensus import list_ray_pairs
from ..statistics.precision import compute_deletion_tests
from ..weights import huber

MEDIAN_EFFICIENCY = 0.4  # efficiency of a variance from the median of squares


@thresholds
class RAYS:
    """Limits for blunders among the measurements of a tie point."""

    credit: float = threshold(0.05, "", "odds of a chance agreement up to which two rays are accepted (see the module)")
    least_sigma_px: float = threshold(
        0.025,
        "px",
        "smallest sigma of a measurement in its test: an error of 0.1 px has no effect",
        "rendered strip of 20 frames: 2 % of its tie points fail at 4 sigma of 0.01 px, with errors from 0.04 px",
    )
    false_share: float = threshold(
        0.002,
        "",
        "probability of a rejection in an error-free block, and false discovery rate of the rejected tie points",
    )


@thresholds
class TREND:
    """Limits for image residuals that neighbours share: they are attributed to the cameras, not to blunders."""

    sample: int = threshold(600, "measurements", "largest number of an image for its trend: coefficients to 0.1 sigma")


def estimate_tie_variance(
    observations: Observations, squares: np.ndarray, rays: np.ndarray, ties: np.ndarray
) -> tuple[float, float]:
    """Return the variance factor of the tie points, and its degrees of freedom; 1 and 0 without tie points.

    It is the median of the sums of squares over that of chi² with 2 k - 3 degrees of freedom for k rays, of points on
    two rays or more; not of points reduced to two rays, which were selected because they agree. Sums of squares that
    are differences of nearly equal numbers may be negative by rounding: the factor is at least `EQUALITY.rounding`.

    squares, rays : (m,) weighted sum of squares and number of used rays of each point; ties : (m,) mask of the tie
        points
    """
    testable = ties & (rays >= np.minimum(np.diff(observations.first), 3)) & (rays >= 2)
    if not testable.any():
        return 1.0, 0.0
    freedom = 2 * rays[testable] - 3
    expected = special.chdtri(np.arange(1, freedom.max() + 1), 0.5)[freedom - 1]
    variance = max(float(np.median(squares[testable] / expected)), EQUALITY.rounding)
    return variance, float(MEDIAN_EFFICIENCY * freedom.sum())


def tie_test_limit(sigmas: float, rays: int) -> float:
    """Return the test value beyond which one of a point's measurements is wrong; two rays have one condition."""
    return critical_value(sigmas, 1) if rays == 2 else critical_value(sigmas, 2, max(rays, 1))


def compute_point_squares(problem: Problem, solution: Solution, weighting: Weighting) -> np.ndarray:
    """Return each point's smallest weighted sum of squares with fixed cameras, ``(m,)``: v' P v - m' V^-1 m.

    weighting : of the image points and of the points' priors; the solution's robust factors are not applied
    """
    normals = solution.normals  # the points' parts do not depend on which points contribute to the cameras
    if weighting is not solution.weighting or not (solution.factor == 1.0).all():
        nobody = np.zeros(len(problem.observations.points), dtype=bool)
        normals = problem.equations.form_normals(solution.state, weighting.image, weighting.points, nobody)
    lengths = np.einsum("nc,nc->n", normals.residual, normals.residual) * weighting.image
    gain = np.einsum("mi,mij,mj->m", normals.point_right, normals.inverse, normals.point_right)
    return np.add.reduceat(lengths, problem.observations.first[:-1]) - gain


def check_ties(
    problem: Problem,
    solution: Solution,
    all_in: Weighting,
    ties: np.ndarray,
    squares: np.ndarray,
    variance: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Decide on the measurements of tie points with the cameras of a solution, by the limit ``reject_sigma``.

    Every point starts with all its measurements again, so that one that was left out with worse cameras can be accepted
    again.

    solution : its measurements with weight determine the common part of the residuals
    all_in : weights of all measurements, and the points' priors
    ties, squares : (m,) mask of the points to test, and their sums of squares with all measurements
    variance : variance factor of the tie points and its degrees of freedom (`estimate_tie_variance`)
    Result: a `Decision` for every measurement ``(n,)``, and the test values (sigmas) of those that failed, else NaN.
    """
    observations, sigmas = problem.observations, problem.options.reject_sigma
    factor, freedom = variance
    decision = np.full(observations.count, int(Decision.KEPT), dtype=np.int8)
    failed = np.full(observations.count, np.nan, dtype=np.float32)
    lengths = np.diff(observations.first)
    limit_by_rays = np.array([tie_test_limit(sigmas, rays) for rays in range(int(lengths.max(initial=0)) + 1)])
    suspicious = np.flatnonzero(ties & (squares > limit_by_rays[lengths] * factor))
    rays = lengths[suspicious]
    groups: list[tuple[np.ndarray, PointRays]] = []
    if not len(suspicious):
        return decision, failed
    trends = _fit_image_trends(observations, solution)
    for length in np.unique(rays):
        points = suspicious[rays == length]
        rows, linear = problem.equations.linearise_points(solution.state, points)
        detrended = linear.residual - np.einsum(
            "nt,ntc->nc", _list_terms(observations, rows), trends[observations.image[rows]]
        )
        rows = rows.reshape(-1, length)
        groups.append(
            (
                rows,
                PointRays(
                    detrended.reshape(-1, length, 2),
                    linear.by_ground.reshape(-1, length, 2, 3),
                    np.minimum(all_in.image[rows] / factor, RAYS.least_sigma_px**-2),
                    all_in.points,
                    points,
                ),
            )
        )
    probability = np.concatenate([group.test_worst_rays(freedom) for _, group in groups])
    # the limit in sigmas that detects the wrong tie points; those that are not suspicious are assumed to be correct
    ordered, tests = np.sort(probability), max(int(ties.sum()), 1)
    allowed = RAYS.false_share * np.arange(1, len(ordered) + 1) / tests
    passed = np.flatnonzero(ordered <= allowed)
    fdr_limit = allowed[passed[-1]] if len(passed) else RAYS.false_share / tests
    limit = max(sigmas, float(np.sqrt(-2.0 * np.log(fdr_limit))))
    touched = probability < error_probability(limit)
    outlier_rate = 1.0 - (1.0 - touched.sum() / ties.sum()) ** (1.0 / lengths[ties].mean())
    worst = np.concatenate([group.worst for _, group in groups])
    size = float(np.sqrt(np.median(worst[touched]))) if touched.any() else 1.0
    for rows, group in groups:
        decision[rows], failed[rows] = group.judge(sigmas, limit, outlier_rate, size)
    return decision, failed


def _fit_image_trends(observations: Observations, solution: Solution) -> np.ndarray:
    """Return the common part of each image's residuals: coefficients ``(images, 6, 2)`` of `_list_terms`, px.

    Fitted robustly (Huber) to an even choice of the measurements with weight; 0 for images with too few.
    """
    trends = np.zeros((len(observations.images), 6, 2))
    is_used, residual = solution.weight > 0.0, solution.normals.residual
    for index, rows in enumerate(observations.by_image):
        rows = rows[is_used[rows]]
        rows = rows[:: 1 + len(rows) // TREND.sample]
        if len(rows) < SAMPLES.quadratic:
            continue
        terms, weight = _list_terms(observations, rows), np.ones(len(rows))
        for _ in range(ITERATIONS.repeated):
            weighted = terms * weight[:, None]
            normal = terms.T @ weighted + REDUNDANCY.regularised * len(rows) * np.eye(6)
            trends[index] = np.linalg.solve(normal, weighted.T @ residual[rows])
            distance = np.linalg.norm(residual[rows] - terms @ trends[index], axis=1)
            weight = huber(distance / max(float(np.median(distance)), 1e-9))
    return trends


def _list_terms(observations: Observations, rows: np.ndarray) -> np.ndarray:
    """Return 1, u, v, u², u v, v² ``(k, 6)`` of the positions of image points ``rows (k,)``, scaled to -1 … 1."""
    u, v = observations.places[rows].T
    return np.column_stack([np.ones(len(rows)), u, v, u * u, u * v, v * v])


class PointRays:
    """Points with k measurements each, adjusted independently with fixed cameras.

    residual, by_ground : (m, k, 2) and (m, k, 2, 3) residuals and derivatives, px and px per metre
    weight : (m, k) of the measurements, variance factor included, 1/px²
    priors, points : priors of all points, and the indices of these points
    """

    def __init__(
        self, residual: np.ndarray, by_ground: np.ndarray, weight: np.ndarray, priors: PointPriors, points: np.ndarray
    ) -> None:
        self.residual, self.by_ground, self.weight = residual, by_ground, weight.copy()
        self.own = priors.weight[points]
        self.decision = np.full(weight.shape, int(Decision.KEPT), dtype=np.int8)
        self.failed = np.full(weight.shape, np.nan)
        self.worst = np.zeros(len(weight))
        self.probability = np.ones(len(weight))

    def test_worst_rays(self, freedom: float) -> np.ndarray:
        """Return the p-value of each point's worst measurement, ``(m,)``; the rays of a point share the tests.

        It is that of Fisher's F distribution, because the variance factor has only ``freedom`` degrees of freedom. Two
        rays have one condition, and one common test.
        """
        tests, _ = self._compute_tests(np.arange(len(self.weight)))
        worst, rays = tests.max(axis=1), (self.weight > 0.0).sum(axis=1)
        freedom = max(freedom, 1.0)
        of_two = special.fdtrc(1.0, freedom, worst)
        self.worst = worst
        self.probability = np.minimum(np.where(rays == 2, of_two, rays * special.fdtrc(2.0, freedom, 0.5 * worst)), 1.0)
        return self.probability

    def judge(self, sigmas: float, limit: float, wrong_share: float, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Leave out the worst measurement of each point until the others agree; return decisions and tests ``(m, k)``.

        A point whose worst measurement is below ``limit`` (sigmas) has no wrong one; for the others ``sigmas`` is the
        limit. ``wrong_share`` is the share of wrong measurements, ``size`` the usual size of their errors, in sigmas.
        """
        limits = np.array([tie_test_limit(sigmas, rays) for rays in range(self.weight.shape[1] + 1)])
        pending = np.flatnonzero(self.probability < error_probability(limit))
        if not len(pending):
            return self.decision, self.failed
        touched = pending[self.worst[pending] > critical_value(sigmas, 2)]
        if self.weight.shape[1] >= 4:
            tests, squares = self._compute_tests(pending)
            freedom = 2 * (self.weight[pending] > 0.0).sum(axis=1) - 5
            several = squares - tests.max(axis=1) > special.chdtri(np.maximum(freedom, 1), error_probability(sigmas))
            self._begin_with_consensus(pending[several], sigmas)
        while len(pending):
            tests, squares = self._compute_tests(pending)
            rays = (self.weight[pending] > 0.0).sum(axis=1)
            failed_points = (tests.max(axis=1) > limits[rays]) & (rays >= 2)
            pending = pending[failed_points]
            tests = tests[failed_points]
            squares = squares[failed_points]
            rays = rays[failed_points]
            self._leave_out(pending, tests, squares, rays, sigmas)
        # Two remaining rays that agree too probably by chance
        two_ray_points = touched[(self.weight[touched] > 0.0).sum(axis=1) == 2]
        if not len(two_ray_points):
            return self.decision, self.failed
        _, squares = self._compute_tests(two_ray_points)
        agreeing = np.exp(-0.5 * squares) / np.sqrt(2.0 * np.pi)
        rays = self.weight.shape[1]
        odds = (
            (rays * wrong_share * (1.0 - wrong_share) + wrong_share**2)
            / (1.0 - wrong_share) ** 2
            * (0.5 / size)
            / agreeing
        )
        two_ray_points = two_ray_points[odds > RAYS.credit]
        self._mark_doubtful(two_ray_points, self.weight[two_ray_points] > 0.0, np.full(len(two_ray_points), np.nan))
        return self.decision, self.failed

    def _mark_doubtful(self, points: np.ndarray, excluded: np.ndarray, failed: np.ndarray) -> None:
        """Leave out measurements ``excluded (l, k)`` of points as doubtful, and blunders found with their help.

        points : (l,) indices; failed : (l,) test value (sigmas) that is reported for the measurements
        """
        guessed = excluded | (self.decision[points] == int(Decision.BLUNDER))
        self.decision[points] = np.where(guessed, int(Decision.DOUBTFUL), self.decision[points])
        self.failed[points] = np.where(excluded, failed[:, None], self.failed[points])
        self.weight[points] = np.where(excluded, 0.0, self.weight[points])

    def _begin_with_consensus(self, points: np.ndarray, sigmas: float) -> None:
        """Leave out the rays outside the largest set of rays that agree with the intersection of two of them.

        If there are several such sets, the rays that they do not have in common are doubtful.

        points : (l,) indices of points in which two blunders may mask each other; sigmas : limit of the tests
        """
        count, length = len(points), self.weight.shape[1]
        residual, by_ground = self.residual[points], self.by_ground[points]
        with np.errstate(divide="ignore"):
            prior = np.where(self.weight[points] > 0.0, 1.0 / self.weight[points], np.inf)
        pair_limit, ray_limit = critical_value(sigmas, 1), critical_value(sigmas, 2)
        best = np.zeros(count, dtype=np.int64)
        in_any_set, common = np.zeros((count, length), dtype=bool), np.ones((count, length), dtype=bool)
        worst = np.zeros((count, length))
        for pair in list_ray_pairs(length):
            both_rows = list(pair)
            design = by_ground[:, both_rows].reshape(count, 4, 3)
            weight = np.repeat(1.0 / prior[:, both_rows], 2, axis=1)
            normal = (design * weight[..., None]).swapaxes(1, 2) @ design
            normal[:, range(3), range(3)] += self.own[points]
            inverse = np.linalg.inv(normal)
            right = (design * weight[..., None]).swapaxes(1, 2) @ residual[:, both_rows].reshape(count, 4, 1)
            left = residual - (by_ground @ (inverse @ right)[:, None])[..., 0]
            pair_squares = (left[:, both_rows] ** 2).sum(axis=2)
            squares = (pair_squares / prior[:, both_rows]).sum(axis=1)
            cofactor = by_ground @ inverse[:, None] @ by_ground.swapaxes(-1, -2)
            cofactor[..., [0, 1], [0, 1]] += np.minimum(prior, 1e12)[..., None]
            tests = (left * np.linalg.solve(cofactor, left[..., None])[..., 0]).sum(axis=2)
            agree = tests <= ray_limit
            agree[:, both_rows] = True
            support = np.where(squares <= pair_limit, agree.sum(axis=1), 0)
            better, equal = support > best, (support == best) & (support > 0)
            in_any_set = np.where(better[:, None], agree, in_any_set | (agree & equal[:, None]))
            common = np.where(better[:, None], agree, common & (agree | ~equal[:, None]))
            worst = np.where(better[:, None], tests, worst)
            best = np.maximum(best, support)
        has_consensus = best >= 2
        unclear = in_any_set & ~common & has_consensus[:, None]
        lonely = common.sum(axis=1) < 2
        statistic = np.sqrt(np.maximum(worst, 0.0))
        outside = has_consensus[:, None] & ~in_any_set
        self.decision[points] = np.where(outside, int(Decision.BLUNDER), self.decision[points])
        self.failed[points] = np.where(outside, statistic, self.failed[points])
        self.weight[points] = np.where(outside, 0.0, self.weight[points])
        doubtful = unclear.any(axis=1)
        excluded = np.where((lonely & doubtful)[:, None], in_any_set, unclear)[doubtful]
        largest = statistic[doubtful].max(axis=1, initial=0.0)
        blunders = self.decision[points[doubtful]].copy()
        self._mark_doubtful(points[doubtful], excluded, largest)
        # rays outside all sets remain blunders if the common rays suffice to show it
        sure = (common[doubtful].sum(axis=1) >= 3)[:, None] & (blunders == int(Decision.BLUNDER))
        self.decision[points[doubtful]] = np.where(sure, int(Decision.BLUNDER), self.decision[points[doubtful]])

    def _leave_out(
        self, points: np.ndarray, tests: np.ndarray, squares: np.ndarray, rays: np.ndarray, sigmas: float
    ) -> None:
        """Leave out the worst measurement of each point, or all those that could be the wrong one, as doubtful.

        A measurement could be the wrong one if the others agree without it by a chi² test. Doubtful are also both of
        two rays.

        points, squares, rays : (l,) indices of points that failed, their sums of squares, and their numbers of used
            rays
        tests : (l, k) test values of their measurements; sigmas : limit of the tests
        """
        freedom = np.maximum(2 * rays - 5, 1)
        limits = np.array([critical_value(sigmas, d) for d in range(1, int(freedom.max(initial=1)) + 1)])[freedom - 1]
        alive = self.weight[points] > 0.0
        could_be = alive & (squares[:, None] - tests <= limits[:, None])
        unclear = (could_be.sum(axis=1) > 1) | (rays == 2)
        could_be[rays == 2] = alive[rays == 2]
        worst = np.zeros_like(could_be)
        worst[np.arange(len(points)), tests.argmax(axis=1)] = True
        excluded = np.where(unclear[:, None], could_be, worst)
        # Fewer than two rays left: these cannot be checked.
        lonely = unclear & ((alive & ~excluded).sum(axis=1) < 2)
        excluded[lonely] = alive[lonely]
        kind = np.where(unclear, int(Decision.DOUBTFUL), int(Decision.BLUNDER)).astype(np.int8)
        self.decision[points] = np.where(excluded, kind[:, None], self.decision[points])
        self.failed[points] = np.where(excluded, np.sqrt(tests.max(axis=1))[:, None], self.failed[points])
        self.weight[points] = np.where(excluded, 0.0, self.weight[points])
        # Earlier blunders of these points were found with measurements that agree with none.
        collapsed = points[lonely]
        guessed = self.decision[collapsed] == int(Decision.BLUNDER)
        self.decision[collapsed] = np.where(guessed, int(Decision.DOUBTFUL), self.decision[collapsed])

    def _compute_tests(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the test values ``(m, k)`` and sums of squares ``(m,)`` of points by least squares."""
        jacobian, weight, residual = self.by_ground[points], self.weight[points], self.residual[points]
        count, length = weight.shape
        weighted = jacobian * weight[:, :, None, None]
        flat, flat_weighted = jacobian.reshape(count, -1, 3), weighted.reshape(count, -1, 3)
        normal = flat_weighted.swapaxes(1, 2) @ flat
        normal[:, range(3), range(3)] += self.own[points]
        inverse = np.linalg.inv(normal)
        step = inverse @ (flat_weighted.swapaxes(1, 2) @ residual.reshape(count, -1, 1))
        left = residual - (flat @ step).reshape(count, length, 2)
        projected = jacobian @ inverse[:, None] @ jacobian.swapaxes(-1, -2)
        with np.errstate(divide="ignore"):
            prior = np.where(weight > 0.0, 1.0 / weight, 0.0)
        cofactor = prior[:, :, None, None] * np.eye(2) - projected
        tests = compute_deletion_tests(left.reshape(-1, 2), cofactor.reshape(-1, 2, 2), weight.ravel())
        return tests.reshape(count, length), np.einsum("akc,akc,ak->a", left, left, weight)


# ---- error probabilities ---------------------------------------------------------------------------------------------


def error_probability(sigmas: float) -> float:
    """Return the probability that an image point deviates by more than ``sigmas`` standard deviations by chance."""
    return float(np.exp(-0.5 * sigmas**2))


def critical_value(sigmas: float, dimensions: int, candidates: int = 1) -> float:
    """Return the limit of a chi² test with the error probability of ``sigmas``, shared by several ``candidates``."""
    return float(special.chdtri(dimensions, error_probability(sigmas) / candidates))
