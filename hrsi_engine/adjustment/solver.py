"""`adjust`: prepare, leave out blunders, estimate sigmas, solve, and say how good the result is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..block.block import Block
from ..foundation.errors import list_ids
from ..foundation.progress import Progress, silent, stage
from .cross_validation import cross_validate
from .drift_prior import DriftPrior
from .equations import PointPriors
from .gauss_newton import LOOSE_TOLERANCE, GaussNewton, Solution, Weighting
from .options import AdjustOptions
from .outcome import Found, outcome
from .precision import Precision, precision
from .problem import Problem, prepare
from .result import Adjustment, Decision, Finding
from .snooping import Suspect, control_suspect, point_squares, tie_decisions, tie_variance
from .variance_components import ROUNDS, SETTLED, Groups, Sigmas, components, summary, wrong_sigmas

SNOOPING_ROUNDS = 6
RARE = 2e-4  # share of the measurements whose change of decision is not worth another round


def adjust(
    block: Block, options: AdjustOptions | None = None, progress: Progress = silent, start: np.ndarray | None = None
) -> Adjustment:
    """Adjust a block; return corrected cameras, points and their precision.

    Parameters
    ----------
    block : Block
        The block.
    options : AdjustOptions, optional
        How to adjust.
    progress : Progress
        Callback; False cancels.
    start : (images, p) ndarray, optional
        Values to begin with, those of an earlier adjustment with the same model, say.

    Returns
    -------
    Adjustment
        Corrected cameras and points, and how sure they are; not to converge is a status in it.

    Raises
    ------
    InputError
        An unknown model, weight function or image id.
    SolveError
        Nothing to adjust, or fewer observations than unknowns (the images are named).
    Cancelled
        When ``progress`` asks to stop.
    """
    return Adjuster(prepare(block, options or AdjustOptions(), start)).run(progress)


class Adjuster:
    """The rounds of one adjustment: each is a run of the loop from where the last one ended."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.loop: GaussNewton = problem.loop()
        observations = problem.observations
        self.image_weight = problem.weighting.image
        self.survey_weight = observations.survey_weight.copy()
        self.ties = observations.contributing_points & ~observations.surveyed
        self.found = Found(np.full(observations.count, int(Decision.KEPT), dtype=np.int8))

    def run(self, progress: Progress) -> Adjustment:
        """Return the result of all rounds."""
        options = self.problem.options
        solution = self.solve(None, progress)
        if options.reject_sigma > 0.0:
            solution = self.without_blunders(solution, stage(progress, 0.3, 0.7))
        if options.variance_components:
            solution = self.with_estimated_sigmas(solution, stage(progress, 0.7, 0.9))
        precise = precision(self.problem.equations, self.loop, solution)
        if options.reject_sigma > 0.0:
            solution, precise = self.without_bad_control(solution, precise, stage(progress, 0.9, 1.0))
        if options.cross_validate:
            # a loop of its own: the history and the factors of the adjustment stay as they are
            loop = self.problem.loop()
            loop.hold(self.loop.prior_weight)
            self.found.cross_validation = cross_validate(self.problem, loop, solution, self.survey_weight, progress)
        return outcome(self.problem, self.loop, self.found, solution, precise)

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def weighting(self) -> Weighting:
        """Return the weights without what was left out."""
        image = np.where(self.found.decision == int(Decision.KEPT), self.image_weight, 0.0)
        return self.problem.survey_weighting(image, self.survey_weight)

    def solve(self, last: Solution | None, progress: Progress, loosely: bool = False) -> Solution:
        """Run the loop from the last solution, or from the start."""
        options = self.problem.options
        state = self.problem.start if last is None else last.state
        first_of_many = last is None and options.reject_sigma > 0.0
        robust = "huber" if first_of_many and options.robust == "none" else options.robust
        tolerance = LOOSE_TOLERANCE if loosely or first_of_many else options.tolerance
        return self.loop.run(state, self.weighting(), robust, tolerance, progress)

    def without_blunders(self, solution: Solution, progress: Progress) -> Solution:
        """Leave out the measurements that do not fit their points; the rounds end when the decisions settle."""
        if not self.ties.any():
            return self.solve(solution, progress)
        for number in range(SNOOPING_ROUNDS):
            decision, self.found.failed = self._judge(solution)
            changed = int((decision != self.found.decision).sum())
            self.found.decision = decision
            settled = changed <= RARE * len(decision)
            solution = self.solve(solution, progress, loosely=not settled and number < SNOOPING_ROUNDS - 1)
            if settled:
                break
        return solution

    def _judge(self, solution: Solution) -> tuple[np.ndarray, np.ndarray]:
        """Return the decisions for the cameras of a solution, and the values of the tests that failed."""
        observations, equations = self.problem.observations, self.problem.equations
        present = self.weighting()
        if self.problem.dem_heights is not None:  # rays are judged by rays, not by a DEM that may be wrong here
            free = PointPriors.of(observations, solution.state.ground, self.survey_weight)
            present = replace(present, points=free)
        squares = point_squares(equations, solution, present, observations)
        rays = np.add.reduceat(present.image > 0.0, observations.first[:-1], dtype=np.int64)
        self.found.tie_variance = tie_variance(observations, squares, rays, self.ties)
        everything = replace(present, image=self.image_weight)
        return tie_decisions(
            equations, observations, solution, everything, self.ties, self.problem.options.reject_sigma,
            self.found.tie_variance,
        )  # fmt: skip

    def without_bad_control(
        self, solution: Solution, precise: Precision, progress: Progress
    ) -> tuple[Solution, Precision]:
        """Test the GCPs with the whole adjustment's cofactors; take out one at a time."""
        sigmas = self.problem.options.reject_sigma
        most = int(self.problem.observations.surveyed.sum()) // 2
        for _ in range(most):
            suspect = control_suspect(self.problem.observations, solution, precise, sigmas)
            if suspect is None or not self._accuse(suspect):
                break
            if self.ties.any():
                decision, self.found.failed = self._judge(solution)
                self.found.decision = np.where(self._control_rows(), self.found.decision, decision)
            solution = self.solve(solution, progress)
            precise = precision(self.problem.equations, self.loop, solution)
        return solution, precise

    def _control_rows(self) -> np.ndarray:
        return self.problem.observations.surveyed[self.problem.observations.point]

    def _accuse(self, suspect: Suspect) -> bool:
        """Record a finding; take its observation out unless another GCP is as likely. Return whether it was."""
        observations, points = self.problem.observations, self.problem.block.points
        name = str(points.ids[observations.points[suspect.point]])
        image = None if suspect.row is None else observations.images[observations.image[suspect.row]].id
        what = "its ground position" if image is None else f"its measurement on image {image}"
        if suspect.same_point:
            what = "its ground position or its measurements (they cannot be told apart)"
        clear = not suspect.rivals
        if clear and suspect.row is None:
            self.survey_weight[suspect.point] = 0.0
        elif clear:
            self.found.decision[suspect.row] = int(Decision.BLUNDER)
        rivals = list_ids(points.ids[observations.points[list(suspect.rivals)]])
        consequence = "it is left out" if clear else f"but {rivals} may be the wrong one instead: all are kept"
        message = f"GCP {name}: {what} disagrees with the rest by {suspect.statistic:.1f} sigma; {consequence}"
        self.found.findings.append(Finding(name, image or "ground", suspect.statistic, clear, message))
        self.found.warnings.append(message)
        return clear

    def with_estimated_sigmas(self, solution: Solution, progress: Progress) -> Solution:
        """Repeat the adjustment with the sigmas that its residuals show."""
        problem, observations = self.problem, self.problem.observations
        groups = Groups.of(problem.block, observations, problem.options.variance_groups, problem.options.sensor_images)
        sigmas = Sigmas(np.ones(len(groups.names)))
        given_image, given_survey = self.image_weight, self.survey_weight.copy()
        drift = DriftPrior(problem.camera, problem.prior_weight)
        for _ in range(ROUNDS):
            precise = precision(problem.equations, self.loop, solution)
            sums = components(groups, observations, solution, precise)
            change = sigmas.update(sums)
            if problem.options.sigma_drift is None:
                change = max(change, drift.update(self.loop, solution, precise))
            self.image_weight = sigmas.image_weight(groups, given_image)
            self.survey_weight = np.where(
                self.survey_weight > 0.0, sigmas.survey_weight(observations, given_survey), 0.0
            )
            solution = self.solve(solution, progress)
            if change < SETTLED:
                break
        self.found.components = summary(groups, observations, sigmas, sums)
        self.found.warnings += wrong_sigmas(self.found.components)
        self.found.components += drift.summary()
        return solution
