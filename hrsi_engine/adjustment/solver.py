"""`adjust`: prepare a block, leave out blunders, estimate sigmas, solve, and compute the precision of the result.

The final model is the simplest that predicts the GCPs as well as the best one does, in the adjusted block. A shift, a
shift with a drift along the lines and an affine correction are nested, and if the drifts' sizes are estimated with the
block (`drift_prior`) all three have the same estimate: they differ in the part of the drift that the final cameras
contain (`final_cameras`). So one adjustment tests them all, each with its priors. Leave-one-out: with u and S of the
GCPs (`blunders.discrepancies`), and M the weighted derivatives of the observations by the cameras, a GCP whose image
points E are left out (its position is the surveyed one) is predicted with errors d by cameras x_E::

    d = S_EE^-1 u_E        x_E = x - Q M_E' S_EE^-1 u_E

plus, for a model that contains only a part of the drift, the other part at the image point.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy import special

from ..block.block import Block, Role
from ..foundation.errors import SolveError, list_ids
from ..foundation.large_arrays import any_of_rows, square_lengths
from ..foundation.progress import Progress, advance, silent, stage
from ..foundation.thresholds import EQUALITY, ITERATIONS, SAMPLES, SIGNIFICANCE
from ..foundation.workers.threads import one_thread_calls
from ..ground.geodesy import ground_difference_m
from ..refinement.image_space import IMAGE_SPACE, ImagePolynomial, add_drift_parameters
from ..refinement.selection import DRIFTING, NESTED_MODELS, select_simplest
from .blunders.discrepancies import Discrepancies, compute_derivatives
from .blunders.snooping import Snooping
from .equations import CameraSystem, NormalEquations
from .equations.nested_dissection import SingularSystemError
from .gauss_newton import GaussNewton, Solution
from .options import AdjustOptions
from .outcome.assembly import assemble_adjustment
from .outcome.final_cameras import compute_final_cameras, compute_gain, sum_squares
from .preparation.preparation import prepare_problem
from .preparation.problem import Problem
from .result import Adjustment, CrossValidation
from .sigma_estimation import ROUNDS, SigmaEstimation
from .statistics.precision import Precision, compute_precision


def adjust(
    block: Block, options: AdjustOptions | None = None, progress: Progress = silent, start: np.ndarray | None = None
) -> Adjustment:
    """Adjust a block; return corrected cameras, points and their precision.

    Parameters
    ----------
    block : Block
        The block.
    options : AdjustOptions, optional
        Options; a rule instead of a model (`refinement.RULES`) chooses the model first.
    progress : Progress
        Callback; False cancels.
    start : (images, p) ndarray, optional
        Initial values, for example of an earlier adjustment with the same model; not with a rule.

    Returns
    -------
    Adjustment
        Corrected cameras and points with their precision; its status shows if it did not converge.

    Raises
    ------
    InputError
        An unknown model, weight function or image id.
    SolveError
        Nothing to adjust, or fewer observations than unknowns (the message lists the images).
    Cancelled
        When ``progress`` asks to stop.
    """
    options = options or AdjustOptions()
    if options.jitter == "none":
        return run_adjuster(block, options, progress, start)[0]
    from .jitter.correction import adjust_without_jitter  # needs more of SciPy, which takes time to load

    with one_thread_calls():  # bands are narrow
        return adjust_without_jitter(
            block, options, lambda given, how, part: run_adjuster(given, how, part, start), progress
        )


def run_adjuster(
    block: Block, options: AdjustOptions | None = None, progress: Progress = silent, start: np.ndarray | None = None
) -> tuple[Adjustment, Adjuster]:
    """Adjust as `adjust`, without jitter; return the result and the `Adjuster`, from which a caller can continue."""
    try:
        with one_thread_calls():  # fronts are small: threads would mostly wait for each other
            problem = prepare_problem(block, options or AdjustOptions(), start)
            adjuster = Adjuster(problem)
            try:
                return adjuster.run(progress), adjuster
            except SingularSystemError as error:
                is_concerned = np.isin(problem.observations.camera_of_image, error.cameras)
                names = list_ids(image.id for image, one in zip(block.images, is_concerned, strict=True) if one)
                raise SolveError(f"{error}; {names} or its connection is not determined by the observations") from error
    except np.linalg.LinAlgError as error:  # points too far from their images
        raise SolveError(
            f"the equations are singular ({error}): points and images do not belong together, or the points are "
            "outside the validity range of the RPCs: check coordinates, ids and RPCs"
        ) from error


class Adjuster(Snooping):
    """The rounds of one adjustment: data snooping (`Snooping`), and the estimation of sigmas.

    ``solution`` is the last one; there is none before `run`. Earlier ones are released early: they are large.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.sigmas = SigmaEstimation(problem)
        self.solution: Solution

    def run(self, progress: Progress) -> Adjustment:
        """Run all rounds and return the result."""
        options = self.problem.options
        rejecting = options.reject_sigma > 0.0
        if rejecting:
            self.solution = self.leave_out_wrong_ties(stage(progress, 0.0, 0.6))
            self.solution = self.leave_out_wrong_control(self.solution, stage(progress, 0.6, 0.7))
        else:
            self.solution = self.solve(None, progress)
        # Test the sigmas by the residuals; if they fail, adjust again with estimated sigmas
        sigmas = self.sigmas
        if sigmas.start_estimation(self.loop, self.solution) and sigmas.drifts:
            self.solution = self.loop.continue_from(self.solution)
            sigmas.test_few_surveys(self.loop, self.solution)
        precise = self.iterate_sigmas(stage(progress, 0.7, 0.8))
        if self.sigmas.tried and rejecting:  # test again with the new drifts and sigmas
            solves = self.loop.solves
            self.solution = self.judge_ties_again(self.solution, silent)
            if self.loop.solves > solves:
                precise = self.iterate_sigmas(stage(progress, 0.8, 0.9))
            solves = self.loop.solves
            self.solution = self.leave_out_wrong_control(self.solution, stage(progress, 0.9, 1.0))
            if self.loop.solves > solves:
                precise = compute_precision(self.loop, self.solution)
        if self.sigmas.tried and self.ties.any():  # weights have changed since the last test
            self.estimate_tie_variance_by_rays(self.solution, self.weigh_rays_alone(self.solution))
        if self.problem.choice is not None:
            precise = self.choose_delivered_model(precise)
        self.found.findings += self._undecided  # undecided contradictions of GCPs
        self.found.warnings += [one.message for one in self.found.findings]
        if not (self.problem.block.points.role == Role.CHECK).any():
            self.found.left_out_surveys = self.leave_out_each_survey(self.solution)
        if options.cross_validate:
            # separate iterations: the adjustment keeps its history and its factors
            loop = self.problem.loop()
            loop.set_prior_weight(self.loop.prior_weight, self.loop.common)
            validated = cross_validate(self.problem, loop, self.solution, self.survey_weight, progress)
            self.found.cross_validation = validated
        self.sigmas.report_to(self.found)
        return assemble_adjustment(self.problem, self.loop, self.found, self.solution, precise)

    def choose_delivered_model(self, precise: Precision) -> Precision:
        """Test the model of a rule by leave-one-out of the GCPs; replace it by a simpler one that predicts as well.

        It is replaced only by a nested model, and only if the drift was estimated, from which all of these follow.
        """
        problem, choice = self.problem, self.problem.choice
        gcps = find_judging_gcps(problem, self.solution, self.survey_weight)
        if choice is None or len(gcps) < SAMPLES.plane:
            return precise
        control = self.compute_control(self.solution, gcps)
        self.loop.system.factorise(self.solution.normals.blocks, self.loop.prior_weight)
        squared, too_simple = predict_left_out(problem, self.loop, self.solution, control)
        name, reason = choice.model, choice.reason
        if self.sigmas.drifts and choice.model in NESTED_MODELS:
            judged = {name: errors for name, errors in squared.items() if name not in too_simple}
            name, reason = select_simplest(judged, standard_errors=1.0)
            reason = (
                "the standard deviation of the attitude drift was estimated from the block (variance component); "
                f"{reason}"
            )
        delivered = {name: float(np.sqrt(np.mean(errors))) for name, errors in squared.items()}
        choice = replace(choice, model=name, reason=reason, delivered=delivered)
        if name != problem.model.name:
            now = express_as_model(name, problem, self.loop, self.solution, precise)
            problem, self.loop, self.solution, precise = now
        self.problem = replace(problem, choice=choice)
        return precise

    # ---- sigmas ----------------------------------------------------------------------------------------------------

    def iterate_sigmas(self, progress: Progress) -> Precision:
        """Estimate sigmas and adjust with them in turn until they converge; return the last solution's precision."""
        sigmas = self.sigmas
        for number in range(ROUNDS):
            if not sigmas.tried:
                break
            advance(progress, number / ROUNDS, "sigmas from the residuals")
            change = sigmas.correct_sigmas(self.loop, self.solution, self.compute_control)
            if change < ITERATIONS.settled:
                if not sigmas.test_sigmas(self.loop, self.solution):
                    break
            elif sigmas.sigmas.free.any():
                self.image_weight = sigmas.image_weight()
                self.survey_weight = np.where(
                    self.survey_weight > 0.0, sigmas.sigmas.survey_weight(self.problem.observations), 0.0
                )
                self.solution = self.solve(self.solution, silent)
            else:
                self.solution = self.loop.continue_from(self.solution)
        return sigmas.precision_at(self.loop, self.solution)


def find_judging_gcps(problem: Problem, solution: Solution, survey_weight: np.ndarray) -> np.ndarray:
    """Return the GCPs ``(g,)`` that leave-one-out tests need: used, measured, and with complete surveys.

    survey_weight : (m, 3) 1/m², 0 for coordinates that were not surveyed or are left out
    """
    is_complete = (survey_weight > 0.0).all(axis=1) & solution.weighting.contributes
    measured = np.add.reduceat(solution.weight > 0.0, problem.observations.first[:-1], dtype=np.int64) > 0
    return np.flatnonzero(is_complete & measured & any_of_rows(survey_weight > 0.0))


def predict_left_out(
    problem: Problem, loop: GaussNewton, solution: Solution, control: Discrepancies
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Predict each GCP of ``control`` from the others, by the model and by those nested in it.

    The loop's system has the factors of this solution.
    Result: by model, the squared errors ``(g,)`` in px², mean over the images of each GCP; and the models that are too
        simple: tie points show the drift that they omit, beyond chance and `EQUALITY.negligible`.
    """
    gcps, values = len(control.points), solution.state.values
    errors, change = [], np.zeros((values.size, gcps))
    for gcp in range(gcps):
        excluded = control.find_measurements([gcp])
        normal = control.invert_subset(excluded) @ control.u[excluded]
        errors.append((control.sigma[excluded] * normal).reshape(-1, 2))
        change[:, gcp] = control.by_unknown[excluded].T @ normal
    camera, model_name = problem.camera, problem.model.name
    if not isinstance(camera, ImagePolynomial):
        return {model_name: np.array([np.mean(np.sum(error**2, axis=1)) for error in errors])}, ()
    values_without = values[:, :, None] - loop.system.solve(change.reshape(*values.shape, gcps))
    squares = sum_squares(problem, camera, solution)
    derivatives = compute_derivatives(problem, solution, control.points)
    # the drift that a model omits also appears in the residuals of tie points
    tie = ~problem.observations.located[problem.observations.point]
    tie_squares = squares - sum_squares(problem, camera, replace(solution, factor=solution.factor * ~tie))
    tie_weight = solution.weight * tie * solution.weighting.contributes[problem.observations.point]
    most_left = EQUALITY.negligible * float(tie_weight @ square_lengths(solution.normals.residual))
    unit_variance = max(loop.sum_of_squares(solution) / loop.count_redundancy(solution.weighting), 1.0)
    squared, too_simple = {}, []
    has = {name.removeprefix("drift_") for name in camera.parameters}  # without drifts a shift has no nested models
    nested = [name for name in NESTED_MODELS if has >= set(IMAGE_SPACE[name].parameters)]
    for name in nested if model_name in NESTED_MODELS else (model_name,):
        contained = locate_parameters(IMAGE_SPACE[name].parameters, camera.parameters)
        omitted = np.setdiff1d(np.arange(len(camera.parameters)), contained)
        left = np.zeros((*values.shape, len(omitted)))  # omitted drift, in the camera's parameters
        left[:, contained] = -compute_gain(squares, loop.prior_weight, contained, omitted)
        left[:, omitted] = np.eye(len(omitted))
        drift = np.einsum("cpr,cr->cp", left, values[:, omitted])
        chance = unit_variance * special.chdtri(max(len(omitted), 1) * len(values), SIGNIFICANCE.level)
        if np.einsum("cp,cpq,cq->", drift, tie_squares, drift) > max(most_left, chance):
            too_simple.append(name)
        of_model = []
        for gcp, point in enumerate(control.points.tolist()):
            cameras = problem.observations.camera[np.unique(control.row[control.find_measurements([gcp])])]
            drift = np.einsum("kpr,kr->kp", left[cameras], values_without[cameras][:, omitted, gcp])
            error = errors[gcp] + np.einsum("kcp,kp->kc", derivatives[point][0], drift)
            of_model.append(np.mean(np.sum(error**2, axis=1)))
        squared[name] = np.array(of_model)
    return squared, tuple(too_simple)


def locate_parameters(names: Sequence[str], of_camera: Sequence[str]) -> np.ndarray:
    """Return the indices ``(len(names),)`` of parameters among those of a camera; the prefix of drifts is ignored."""
    place = [name.removeprefix("drift_") for name in of_camera]
    return np.array([place.index(name.removeprefix("drift_")) for name in names], dtype=np.int64)


def express_as_model(
    name: str, problem: Problem, loop: GaussNewton, solution: Solution, precise: Precision
) -> tuple[Problem, GaussNewton, Solution, Precision]:
    """Return the same estimate with another of the nested models as the model of the final cameras."""
    model = IMAGE_SPACE[name]
    camera = add_drift_parameters(model) if name != DRIFTING else model
    order = locate_parameters(camera.parameters, problem.camera.parameters)
    now = replace(
        problem,
        model=model,
        camera=camera,
        equations=NormalEquations(problem.observations, camera, problem.pattern, problem.options.threads),
        prior_weight=problem.prior_weight[:, order],
        guessed=problem.guessed[order],
        usual_drift=problem.usual_drift[:, order],
        start=problem.start._replace(values=problem.start.values[:, order]),
        common=tuple(one.reorder(order) for one in problem.common),
    )
    new_loop = copy(loop)
    new_loop.equations, new_loop.system = now.equations, CameraSystem(now.pattern)
    new_loop.set_prior_weight(loop.prior_weight[:, order], [one.reorder(order) for one in loop.common])
    blocks, right = solution.normals.blocks[:, order[:, None], order], solution.normals.right[:, order]
    normals = replace(solution.normals, blocks=blocks, right=right)
    state = solution.state._replace(values=solution.state.values[:, order])
    cameras = precise.cameras[:, order[:, None], order]
    return (
        now,
        new_loop,
        replace(solution, state=state, normals=normals),
        replace(precise, parameters=precise.parameters[:, order], cameras=cameras),
    )


def cross_validate(
    problem: Problem, loop: GaussNewton, solution: Solution, survey_weight: np.ndarray, progress: Progress
) -> CrossValidation:
    """Return survey - prediction of every GCP used in the ``solution``; ``survey_weight (m, 3)`` are their weights.

    Each GCP in turn is a check point, predicted by the adjustment of all others: a few GCPs are too few to use some of
    them as check points. The adjustments start from the full one and take two or three passes each. Neither survey nor
    measurements of a left-out GCP are used. One on a single image is predicted on its ray at the surveyed height,
    without height error.
    """
    observations = problem.observations
    gcps = np.flatnonzero(solution.weighting.contributes & any_of_rows(survey_weight > 0.0))
    error = np.full((len(gcps), 3), np.nan)
    rays = observations.count_rays(solution.weighting.image > 0.0)
    for number, point in enumerate(gcps.tolist()):
        advance(progress, number / len(gcps), "cross-validation")
        left = survey_weight.copy()
        left[point, :2] = 0.0
        if rays[point] >= 2:
            left[point, 2] = 0.0
        weighting = problem.survey_weighting(solution.weighting.image, left, solution.weighting.points)
        contributes = weighting.contributes.copy()
        contributes[point] = False
        reduced_block = loop.iterate(solution.state, replace(weighting, contributes=contributes))
        survey = observations.survey[point : point + 1]
        predicted = compute_final_cameras(problem, loop, reduced_block).ground[point : point + 1]
        error[number] = ground_difference_m(survey, predicted)[0]
        if rays[point] < 2:
            error[number, 2] = np.nan
    return CrossValidation(tuple(str(name) for name in problem.block.points.ids[observations.points[gcps]]), error)
