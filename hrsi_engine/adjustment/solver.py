"""`adjust`: prepare, leave out blunders, estimate sigmas, solve, and say how good the result is."""

from __future__ import annotations

import numpy as np

from ..block.block import Block
from ..foundation.errors import SolveError
from ..foundation.progress import Progress, silent, stage
from .blunders.snooping import Snooping
from .cross_validation import cross_validate
from .drift_prior import DriftPrior
from .gauss_newton import Solution
from .options import AdjustOptions
from .outcome import outcome
from .precision import precision
from .problem import prepare
from .result import Adjustment
from .variance_components import ROUNDS, SETTLED, Groups, Sigmas, components, summary, wrong_sigmas


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
    try:
        return Adjuster(prepare(block, options or AdjustOptions(), start)).run(progress)
    except np.linalg.LinAlgError as error:  # points so far from their images that no camera tells where they are
        raise SolveError(
            f"the equations are singular ({error}): points and images do not belong together, or the points are so far "
            "from the images that their RPCs say nothing of them: check coordinates, ids and RPCs"
        ) from error


class Adjuster(Snooping):
    """The rounds of one adjustment: those that find blunders (`Snooping`), and those that find sigmas."""

    def run(self, progress: Progress) -> Adjustment:
        """Return the result of all rounds."""
        options = self.problem.options
        rejecting = options.reject_sigma > 0.0
        if rejecting:
            solution = self.without_wrong_ties(stage(progress, 0.0, 0.6))
            solution = self.without_wrong_control(solution, stage(progress, 0.6, 0.7))
        else:
            solution = self.solve(None, progress)
        if options.variance_components:
            solution = self.with_estimated_sigmas(solution, stage(progress, 0.7, 0.9))
            if rejecting:  # once more: by sigmas as they are
                solution = self.without_wrong_control(solution, stage(progress, 0.9, 1.0))
        self.say()
        precise = precision(self.problem.equations, self.loop, solution)
        if options.cross_validate:
            # a loop of its own: the history and the factors of the adjustment stay as they are
            loop = self.problem.loop()
            loop.hold(self.loop.prior_weight)
            self.found.cross_validation = cross_validate(self.problem, loop, solution, self.survey_weight, progress)
        return outcome(self.problem, self.loop, self.found, solution, precise)

    # ---- sigmas ----------------------------------------------------------------------------------------------------

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
