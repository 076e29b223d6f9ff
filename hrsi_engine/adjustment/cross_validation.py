"""Leave-out validation: each GCP in turn is a check point, predicted by the adjustment of all the others.

With a handful of GCPs there are none to spare for checking; this uses each for both. The adjustments start from the
full one and take two or three passes each. A left-out GCP has no say at all: neither survey nor measurements.
"""

from dataclasses import replace

import numpy as np

from ..foundation.large_arrays import any_of_rows
from ..foundation.progress import Progress, advance, silent
from ..ground.geodesy import ground_difference_m
from .delivery import deliver_cameras
from .gauss_newton import GaussNewton, Solution
from .problem import Problem
from .result import CrossValidation


def cross_validate(
    problem: Problem, loop: GaussNewton, solution: Solution, survey_weight: np.ndarray, progress: Progress = silent
) -> CrossValidation:
    """Return survey - prediction of every GCP that holds the ``solution``; ``survey_weight (m, 3)`` are its surveys.

    A GCP on one image is predicted on its ray at the surveyed height; its height error does not exist.
    """
    observations = problem.observations
    chosen = np.flatnonzero(solution.weighting.contributes & any_of_rows(survey_weight > 0.0))
    error = np.full((len(chosen), 3), np.nan)
    rays = observations.count_rays(solution.weighting.image > 0.0)
    for number, point in enumerate(chosen.tolist()):
        advance(progress, number / len(chosen), "cross-validation")
        left = survey_weight.copy()
        left[point, :2] = 0.0
        if rays[point] >= 2:
            left[point, 2] = 0.0
        weighting = problem.survey_weighting(solution.weighting.image, left, solution.weighting.points)
        contributes = weighting.contributes.copy()
        contributes[point] = False
        without = loop.iterate(
            solution.state, replace(weighting, contributes=contributes), problem.options.robust,
            problem.options.tolerance, silent,
        )  # fmt: skip
        survey = observations.survey[point : point + 1]
        predicted = deliver_cameras(problem, loop, without).ground[point : point + 1]
        error[number] = ground_difference_m(survey, predicted)[0]
        if rays[point] < 2:
            error[number, 2] = np.nan
    ids = problem.block.points.ids[observations.points[chosen]]
    return CrossValidation(tuple(str(name) for name in ids), error)
