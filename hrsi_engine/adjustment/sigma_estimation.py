"""The global model test of an adjustment, and the estimation of sigmas that satisfy it.

A sigma is wrong if the squares of its observations' residuals differ from their expectation (chi², two-sided). Then
the sigmas are estimated together, by variance components: those of image points by kind and sensor, those of the
surveys, and those of the drifts of the images. So a drift is not attributed to surveys, nor errors of GCPs to a drift.
Drifts are estimated unless an image has very many measurements: their sigmas are the least known of all, and without
any drift the estimation has no disadvantage.

Sigmas of surveys need a dozen rounds: each one changes the precision with which the block predicts the GCPs. If no
drift is estimated with them, or GCPs are many, these rounds need no solution: with u and S of the surveys
(`blunders.discrepancies`), in units of their sigmas, variances that are r times as large change them to

    (I + S (R - I))^-1 u    and    (I + S (R - I))^-1 S        R = diag(r)

With these a step of Fisher's scoring leads to the restricted maximum likelihood (Harville 1977), where the squares of a
group equal their expectation by its redundancy::

    r_i + sum_j F_ij^-1 (u_j' u_j - tr S_jj)        F_ij = sum of the squares of S_ij

Tests and their results are in `SigmaEstimation.tests`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, special

from ..block.placement import FRAME
from ..foundation.thresholds import EQUALITY, ITERATIONS, REDUNDANCY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..refinement.model import estimate_priors
from ..refinement.selection import can_estimate_drift
from .blunders.discrepancies import IMAGE, Discrepancies
from .drift_prior import DriftPrior
from .gauss_newton import GaussNewton, Solution
from .outcome.assembly import RoundFindings, compute_redundancy
from .preparation.problem import Problem
from .result import ModelTest
from .statistics import variance_components as components
from .statistics.precision import Precision, compute_precision

ROUNDS = 25


@thresholds
class SIGMA:
    """Limits for the test of a priori sigmas, for their estimation and its convergence."""

    beside_held: float = threshold(
        2.0,
        "",
        "estimated over given sigma beyond which image points, external heights or positions are wrong: without tie "
        "points, or with such heights or positions (else `SIGNIFICANCE.extreme`)",
    )
    hidden_by_drift: int = threshold(25, "GCPs", "number of GCPs up to which drifts of a few images can absorb errors")


@dataclass(eq=False)
class SigmaEstimation:
    """The sigmas of one adjustment: given ones, estimated ones, and their tests."""

    problem: Problem
    tests: list[ModelTest] = field(default_factory=list)
    tried: bool = False

    def __post_init__(self) -> None:
        problem, options = self.problem, self.problem.options
        self.groups = components.Groups.assign_groups(
            problem.block, problem.observations, options.variance_groups, options.sensor_images
        )
        count = len(self.groups.names)
        self.sigmas = components.Sigmas.start_groups(
            self.groups, problem.observations, corrected=options.jitter_estimate is not None
        )
        drifts = [estimate_priors(image).drift for image in problem.observations.images]
        per_px = float(np.sqrt(np.mean(np.square(drifts))))
        self.drift = DriftPrior(problem.camera, problem.prior_weight, problem.usual_drift, per_px, problem.common)
        self.sums = np.zeros((count, 3))
        self.drifts = False
        self._last: tuple[Solution, np.ndarray, Precision] | None = None

    def start_estimation(self, loop: GaussNewton, solution: Solution) -> bool:
        """Return True if sigmas are to be estimated at a solution: drifts, or those that fail `test_sigmas`."""
        options, observations = self.problem.options, self.problem.observations
        if not (options.test_sigmas or options.variance_components):
            return False
        is_asked_for = options.variance_components or can_estimate_drift(observations.count, len(observations.images))
        self.drifts = bool(options.sigma_drift is None and self.drift.free.any() and is_asked_for)
        if options.variance_components:
            self.sigmas.free[:] = True
        if self.drifts:
            self.drift.set_initial_drift_prior(loop)
        self.tried = self.drifts or options.variance_components or self.test_sigmas(loop, solution)
        return self.tried

    def precision_at(self, loop: GaussNewton, solution: Solution) -> Precision:
        """Return all cofactors at a solution; the last ones computed are cached."""
        if self._last is None or self._last[0] is not solution or self._last[1] is not loop.prior_weight:
            self._last = None  # frees memory before the next
            self._last = solution, loop.prior_weight, compute_precision(loop, solution)
        return self._last[2]

    def test_few_surveys(self, loop: GaussNewton, solution: Solution) -> None:
        """Test the surveys' sigmas before the drift is estimated, which could absorb the errors of a few GCPs.

        Whether surveys are poor or the drift is large is decided by their common estimation.
        """
        gcps = int((solution.weighting.contributes & self.problem.observations.surveyed).sum())
        if gcps <= SIGMA.hidden_by_drift:
            self.test_sigmas(loop, solution, components.SURVEY_GROUPS)

    def test_sigmas(self, loop: GaussNewton, solution: Solution, groups: Sequence[str] = ()) -> bool:
        """Test the sigmas of some groups, or all; return True if sigmas are to be estimated from now on."""
        if self.sigmas.free.any():
            return False
        precise = self.precision_at(loop, solution)
        self.sums = components.compute_group_sums(self.groups, self.problem.observations, solution, precise)
        self.tests = []
        for name, (squares, freedom, _) in zip(self.groups.names, self.sums.tolist(), strict=True):
            if freedom >= REDUNDANCY.estimated:
                chance = 2.0 * min(special.chdtrc(freedom, squares), special.chdtr(freedom, squares))
                ratio = float(np.sqrt(squares / freedom))
                failed = chance < SIGNIFICANCE.level and not 1.0 / EQUALITY.size < ratio < EQUALITY.size
                self.tests.append(ModelTest(name, ratio, freedom, bool(failed)))
        # Wrong points also cause residuals, and so do wrong external heights or places: larger sigmas would accept
        # them. With hardly any tie points sigma0 is the factor of all.
        redundancy = self.sums[: -components.SURVEYS : 2, 1].sum()
        is_free = not self.problem.position_observations and redundancy >= REDUNDANCY.common
        largest = SIGNIFICANCE.extreme if is_free else SIGMA.beside_held
        least_px = FRAME.gross_px if is_free else 0.0
        # RMS of the stated sigmas of the image points of each group that has any
        of_point, names = self.groups.of_image_point, self.groups.names[: -components.SURVEYS]
        count = np.bincount(of_point, minlength=len(names))
        squared = np.bincount(of_point, self.problem.observations.sigma_px**2, len(names))
        stated_px = {name: float(np.sqrt(s / n)) for name, s, n in zip(names, squared, count, strict=True) if n}
        spoilt = any(
            test.ratio > max(largest, least_px / stated_px[test.group])
            for test in self.tests
            if test.group in stated_px
        )
        failed = any(test.failed for test in self.tests if not groups or test.group in groups) and not spoilt
        self.sigmas.free[:] = failed
        return failed

    def correct_sigmas(
        self, loop: GaussNewton, solution: Solution, control: Callable[[Solution, np.ndarray], Discrepancies]
    ) -> float:
        """Correct the sigmas; return the largest relative change.

        A change below `ITERATIONS.settled` needs no further solution: all stays unchanged. ``control`` is the function
        that
        returns the discrepancies of some GCPs at a solution.
        """
        change, unit_variance = 0.0, 1.0
        if self.sigmas.free.any():
            precise = self.precision_at(loop, solution)
            cofactors = precise.cameras
            self.sums = components.compute_group_sums(self.groups, self.problem.observations, solution, precise)
            previous, of_image = self.sigmas.factor, self.sigmas.of_image
            self.sigmas.correct_factors(self.sums)
            self._iterate_control(solution, previous, control)
            # the squares by the groups' new sigmas determine the differences between images
            growth = (self.sigmas.factor / previous)[self.groups.of_image_point]
            of_images = components.compute_image_sums(self.problem.observations, solution, precise, growth)
            self.sigmas.correct_images(of_images, self.groups.sensor)
            changes = self.sigmas.factor / previous - 1.0, self.sigmas.of_image / of_image - 1.0
            change = float(max(np.abs(one).max() for one in changes))
            if change < ITERATIONS.settled:
                self.sigmas.factor, self.sigmas.of_image = previous, of_image
        else:
            cofactors = loop.compute_camera_cofactors(solution)
            variances = cofactors[loop.pattern.diagonal].diagonal(axis1=1, axis2=2)
            freedom = max(compute_redundancy(self.problem, loop, solution, variances, cofactors), 0.0)
            stated = REDUNDANCY.stated
            unit_variance = max((stated + loop.sum_of_squares(solution)) / (stated + freedom), 1.0)
        if self.drifts:
            change = max(change, self.drift.correct_sigmas(loop, solution, cofactors, unit_variance))
        if change >= ITERATIONS.settled:  # another solution follows
            self._last = None
        return change

    def _iterate_control(
        self, solution: Solution, previous: np.ndarray, control_at: Callable[[Solution, np.ndarray], Discrepancies]
    ) -> None:
        """Repeat the update of the sigmas of surveys and of image points of GCPs until they converge.

        Both explain the same discrepancies and are estimated together; ``previous`` are the factors of the solution.
        """
        observations, weighting, groups = self.problem.observations, solution.weighting, len(self.sigmas.factor)
        rays = np.add.reduceat(solution.weight > 0.0, observations.first[:-1], dtype=np.int64)
        # survey and measurement of a GCP on one image cannot be distinguished
        points = np.flatnonzero(weighting.contributes & weighting.points.held & observations.surveyed & (rays > 1))
        if len(points) < (SIGMA.hidden_by_drift if self.drifts else 2) or observations.correlated[points].any():
            return
        points = points[:: -(-len(points) // SAMPLES.dense)]
        control = control_at(solution, points)
        images, kinds = groups - components.SURVEYS, components.number_survey_groups(observations)[points]
        of_survey = images + kinds[control.point, control.axis]  # the last index, `groups`, means no group
        group = np.where(control.kind == IMAGE, self.groups.of_image_point[control.row], of_survey)
        is_tested = np.isin(np.arange(groups), group)
        is_tested[:images:2] = False  # those of tie points
        is_tested[images:] = True
        rows = np.flatnonzero(np.append(is_tested, True)[group])
        group, u, s = group[rows], control.u[rows], control.s[np.ix_(rows, rows)]
        sums, free = self.sums.copy(), self.sigmas.free
        self.sigmas.factor, self.sigmas.free = np.where(is_tested, previous, self.sigmas.factor), free & is_tested
        for _ in range(ROUNDS):
            variance = np.append(np.where(is_tested, self.sigmas.factor / previous, 1.0) ** 2, 1.0)[group]
            factors = linalg.lu_factor(np.eye(len(u)) + s * (variance - 1.0), check_finite=False)
            left = linalg.lu_solve(factors, np.column_stack([u, s]), check_finite=False)
            shares = left[:, 1:].diagonal()
            telling = variance * shares < 1.0 - REDUNDANCY.tested
            kind = np.where(telling, group, groups)[:, None] == np.arange(groups)
            freedom = shares @ kind
            step = np.linalg.pinv(kind.T @ left[:, 1:] ** 2 @ kind, hermitian=True) @ (left[:, 0] ** 2 @ kind - freedom)
            ratio = (self.sigmas.factor / previous) ** 2
            sums[is_tested, 1] = (ratio * freedom)[is_tested]
            sums[is_tested, 0] = (np.maximum(ratio + step, EQUALITY.negligible * ratio) * freedom)[is_tested]
            if self.sigmas.correct_factors(sums) < ITERATIONS.settled * ITERATIONS.settled:
                break
        self.sigmas.free = free

    def image_weight(self) -> np.ndarray:
        """Return the weights of all image points ``(n,)``, also of rejected ones."""
        return self.problem.weighting.image / self._factor_image_points() ** 2

    def _factor_image_points(self) -> np.ndarray:
        """Return the factors of the image points' sigmas ``(n,)``, of their groups and of single images."""
        of_image = self.sigmas.of_image[self.problem.observations.image]
        return np.asarray(self.sigmas.factor[self.groups.of_image_point] * of_image)

    def report_to(self, result: RoundFindings) -> None:
        """Add the tests and the estimated sigmas to the findings of the adjustment."""
        result.tests = tuple(self.tests)
        horizontal, height, correlated = self.sigmas.predict_survey_factors(self.sums).tolist()
        result.survey_factors = horizontal, height, correlated
        result.sigma_px = self.problem.observations.sigma_px * self._factor_image_points()
        if not self.tried:
            return
        if self.sigmas.free.any():
            groups, observations = self.groups, self.problem.observations
            result.components = components.list_components(groups, observations, self.sigmas, self.sums)
            result.warnings += components.describe_wrong_sigmas(result.components, self.groups.cautious)
        if self.drifts:
            result.components += self.drift.list_components()
