"""The global model test of an adjustment, and the sigmas that make it hold.

A sigma is wrong where the squares of its observations' residuals are not what it lets expect (chi², two-sided). What
then explains them is estimated with everything else at once, by variance components: the sigmas of image points by
kind and sensor, those of the surveys, and how much the images drift. So a drift is not taken for a poor survey, nor
poor GCPs for a drift. Drifts are estimated unless an image has very many measurements: their size is the least known
of all sigmas, and where nothing drifts the estimate costs nothing.

Sigmas of surveys need a dozen rounds: each feeds back on how well the block knows the GCPs. Where no drift is estimated
beside them, or GCPs are many, these rounds need no solution: with u and S of the surveys (`blunders.discrepancies`), in
units of their sigmas, variances that are r times as large make of them

    (I + S (R - I))^-1 u    and    (I + S (R - I))^-1 S        R = diag(r)

With them a step of Fisher's scoring leads to the restricted maximum likelihood (Harville 1977), where the squares of a
group are what its redundancy lets expect::

    r_i + sum_j F_ij^-1 (u_j' u_j - tr S_jj)        F_ij = sum of the squares of S_ij

What was tested, found and done is in `SigmaEstimation.tests`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, special

from ..refinement.model import estimate_priors
from ..refinement.selection import can_estimate_drift
from .blunders.discrepancies import IMAGE, Discrepancies
from .drift_prior import DriftPrior
from .equations.camera_system import Factored
from .gauss_newton import GaussNewton, Solution
from .outcome import Found, redundancy_of
from .problem import Problem
from .result import ModelTest
from .statistics.precision import Precision, camera_cofactors, precision
from .statistics.variance_components import (
    LEAST_GROUP_FREEDOM,
    SURVEY_GROUPS,
    SURVEYS,
    UNINFORMED,
    Groups,
    Sigmas,
    components,
    summary,
    survey_groups,
    wrong_sigmas,
)

ROUNDS = 25
SETTLED_SHARE = 0.01  # relative change of a sigma
SIGNIFICANCE_OF_SIGMA = 0.01  # where it fails by chance, what is estimated is nearly what was given
MATERIAL = 1.25  # a sigma that is wrong by less does no harm
HIDDEN_BY_DRIFT = 25  # GCPs, whose errors the drift of a few images can follow
STATED = 4.0  # observations that the sigmas as given count for, where all are tested at once
LEAST_SHARE = 0.04  # of a survey's variance, that a step leaves of it
MOST_PLAUSIBLE = 2.0  # image points that fit worse have other faults than their sigma, which sigma0 must go on telling


@dataclass(eq=False)
class SigmaEstimation:
    """The sigmas of one adjustment: as given, as found, and what was tested."""

    problem: Problem
    tests: list[ModelTest] = field(default_factory=list)
    tried: bool = False

    def __post_init__(self) -> None:
        problem, options = self.problem, self.problem.options
        self.groups = Groups.of(problem.block, problem.observations, options.variance_groups, options.sensor_images)
        count = len(self.groups.names)
        self.sigmas = Sigmas.of(self.groups, problem.observations)
        drifts = [estimate_priors(image).drift for image in problem.observations.images]
        per_px = float(np.sqrt(np.mean(np.square(drifts))))
        self.drift = DriftPrior(problem.camera, problem.prior_weight, problem.believed_drift, per_px)
        self.sums = np.zeros((count, 3))
        self.drifts = False
        self._last: tuple[Solution, np.ndarray, Precision] | None = None

    def begin(self, loop: GaussNewton, solution: Solution) -> bool:
        """Return whether anything is to be estimated at a solution: drifts, or what `test` finds wrong."""
        options, observations = self.problem.options, self.problem.observations
        if not (options.test_sigmas or options.variance_components) or not isinstance(loop.system, Factored):
            return False
        asked = options.variance_components or can_estimate_drift(observations.count, len(observations.images))
        self.drifts = bool(options.sigma_drift is None and self.drift.free.any() and asked)
        if options.variance_components:
            self.sigmas.free[:] = True
        if self.drifts:
            self.drift.start(loop)
        self.tried = self.drifts or options.variance_components or self.test(loop, solution)
        return self.tried

    def precision_at(self, loop: GaussNewton, solution: Solution) -> Precision:
        """Return all cofactors at a solution; those that were computed last are kept."""
        if self._last is None or self._last[0] is not solution or self._last[1] is not loop.prior_weight:
            self._last = None  # one is large enough
            self._last = solution, loop.prior_weight, precision(loop, solution)
        return self._last[2]

    def test_few_surveys(self, loop: GaussNewton, solution: Solution) -> None:
        """Test the surveys' sigmas before the drift is estimated, which would follow a few GCPs' errors and hide them.

        What is found then, poor surveys or a large drift, tells the estimate of both.
        """
        gcps = int((solution.weighting.contributes & self.problem.observations.surveyed).sum())
        if gcps <= HIDDEN_BY_DRIFT:
            self.test(loop, solution, SURVEY_GROUPS)

    def test(self, loop: GaussNewton, solution: Solution, groups: Sequence[str] = ()) -> bool:
        """Test the sigmas of some groups, or all; return whether sigmas are to be estimated from now on."""
        if self.sigmas.free.any():
            return False
        precise = self.precision_at(loop, solution)
        self.sums = components(self.groups, self.problem.observations, solution, precise)
        self.tests = [
            self._test(name, float(squares), float(freedom))
            for name, (squares, freedom, _) in zip(self.groups.names, self.sums, strict=True)
            if freedom >= LEAST_GROUP_FREEDOM
        ]
        images = len(self.groups.names) - SURVEYS
        spoilt = any(test.ratio > MOST_PLAUSIBLE for test in self.tests if test.group in self.groups.names[:images])
        failed = any(test.failed for test in self.tests if not groups or test.group in groups) and not spoilt
        self.sigmas.free[:] = failed
        return failed

    def _test(self, name: str, squares: float, freedom: float) -> ModelTest:
        larger, smaller = special.chdtrc(freedom, squares), special.chdtr(freedom, squares)
        ratio = float(np.sqrt(squares / freedom))
        failed = 2.0 * min(larger, smaller) < SIGNIFICANCE_OF_SIGMA and not 1.0 / MATERIAL < ratio < MATERIAL
        return ModelTest(name, ratio, freedom, bool(failed))

    def update(
        self, loop: GaussNewton, solution: Solution, control: Callable[[Solution, np.ndarray], Discrepancies]
    ) -> float:
        """Correct the sigmas; return the largest relative change.

        One below `SETTLED_SHARE` is not worth another solution: all stays as it is. ``control`` returns the
        discrepancies of some GCPs at a solution.
        """
        change, unit_variance = 0.0, 1.0
        if self.sigmas.free.any():
            precise = self.precision_at(loop, solution)
            own = precise.own_cameras(loop)
            self.sums = components(self.groups, self.problem.observations, solution, precise)
            before = self.sigmas.factor
            self.sigmas.update(self.sums)
            self._settle_surveys(solution, before, control)
            change = float(np.abs(self.sigmas.factor / before - 1.0).max())
            if change < SETTLED_SHARE:
                self.sigmas.factor = before
        else:
            own, cofactors = camera_cofactors(loop, solution)
            variances = own.diagonal(axis1=1, axis2=2)
            freedom = max(redundancy_of(self.problem, loop, solution, variances, cofactors), 0.0)
            unit_variance = max((STATED + loop.sum_of_squares(solution)) / (STATED + freedom), 1.0)
        if self.drifts:
            change = max(change, self.drift.update(loop, solution, own, unit_variance))
        if change >= SETTLED_SHARE:  # another solution follows
            self._last = None
        return change

    def _settle_surveys(
        self, solution: Solution, before: np.ndarray, control_at: Callable[[Solution, np.ndarray], Discrepancies]
    ) -> None:
        """Repeat the update of the surveys' sigmas until it settles; ``before`` are the factors of the solution."""
        observations, weighting = self.problem.observations, solution.weighting
        points = np.flatnonzero(weighting.contributes & weighting.points.held & observations.surveyed)
        if len(points) < (HIDDEN_BY_DRIFT if self.drifts else 2) or observations.correlated[points].any():
            return
        control = control_at(solution, points)
        surveys = np.flatnonzero(control.kind != IMAGE)
        group = survey_groups(observations)[points][control.point[surveys], control.axis[surveys]]
        u, s = control.u[surveys], control.s[np.ix_(surveys, surveys)]
        sums = self.sums.copy()
        sums[:-SURVEYS, 0] = sums[:-SURVEYS, 1]  # those of the image points wait for the next solution
        for _ in range(ROUNDS):
            variance = np.append((self.sigmas.factor / before)[-SURVEYS:] ** 2, 1.0)[group]
            factors = linalg.lu_factor(np.eye(len(u)) + s * (variance - 1.0), check_finite=False)
            left = linalg.lu_solve(factors, np.column_stack([u, s]), check_finite=False)
            own = left[:, 1:].diagonal()
            kind = np.where(variance * own < 1.0 - UNINFORMED, group, SURVEYS)[:, None] == np.arange(SURVEYS)
            squares, freedom = left[:, 0] ** 2 @ kind, own @ kind
            curvature = kind.T @ left[:, 1:] ** 2 @ kind
            ratio = (self.sigmas.factor / before)[-SURVEYS:] ** 2
            step = np.linalg.pinv(curvature, hermitian=True) @ (squares - freedom)
            sums[-SURVEYS:, 1] = ratio * freedom
            sums[-SURVEYS:, 0] = np.maximum(ratio + step, LEAST_SHARE * ratio) * freedom
            if self.sigmas.update(sums) < SETTLED_SHARE * SETTLED_SHARE:
                break

    def image_weight(self) -> np.ndarray:
        """Return the weights of the image points ``(n,)``, none left out."""
        return self.sigmas.image_weight(self.groups, self.problem.weighting.image)

    def survey_weight(self) -> np.ndarray:
        """Return the weights of the surveys ``(m, 3)``, none left out."""
        observations = self.problem.observations
        return self.sigmas.survey_weight(observations, observations.survey_weight)

    def report(self, found: Found) -> None:
        """Add what was tested and estimated to what the adjustment found."""
        found.tests = tuple(self.tests)
        horizontal, height, correlated = self.sigmas.predictive_survey_factors(self.sums).tolist()
        found.survey_factors = horizontal, height, correlated
        found.sigma_px = self.problem.observations.sigma_px * self.sigmas.factor[self.groups.of_image_point]
        if not self.tried:
            return
        if self.sigmas.free.any():
            found.components = summary(self.groups, self.problem.observations, self.sigmas, self.sums)
            found.warnings += wrong_sigmas(found.components, self.groups.cautious)
        if self.drifts:
            found.components += self.drift.summary()
