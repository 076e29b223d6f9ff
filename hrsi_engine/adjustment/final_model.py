"""Choice of the final model: the simplest that predicts the GCPs as well as the best one does, in the adjusted block.

A shift, a shift with a drift along the lines and an affine correction are nested, and if the drifts' sizes are
estimated with the block (`drift_prior`) all three have the same estimate: they differ in the part of the drift that the
final cameras contain (`delivery`). So one adjustment tests them all, each with its priors. Leave-one-out: with u and S
of the GCPs (`blunders.discrepancies`), and M the weighted derivatives of the observations by the cameras, a GCP whose
image points E are left out (its position is the surveyed one) is predicted with errors d by cameras x_E::

    d = S_EE^-1 u_E        x_E = x - Q M_E' S_EE^-1 u_E

plus, for a model that contains only a part of the drift, the other part at the image point.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy import special

from ..foundation.large_arrays import any_of_rows, square_lengths
from ..foundation.thresholds import EQUALITY, SIGNIFICANCE
from ..refinement.image_space import IMAGE_SPACE, ImagePolynomial, add_drift_parameters
from ..refinement.selection import DRIFTING, NESTED_MODELS
from .blunders.discrepancies import Discrepancies, compute_derivatives
from .equations import CameraSystem, NormalEquations
from .gauss_newton import GaussNewton, Solution
from .outcome.final_cameras import compute_gain, sum_squares
from .preparation.problem import Problem
from .statistics.precision import Precision


def find_judging_gcps(problem: Problem, solution: Solution, survey_weight: np.ndarray) -> np.ndarray:
    """Return the GCPs that are used in a solution and have complete surveys ``(m, 3)``, as leave-one-out tests need."""
    is_complete = (survey_weight > 0.0).all(axis=1) & solution.weighting.contributes
    measured = np.add.reduceat(solution.weight > 0.0, problem.observations.first[:-1], dtype=np.int64) > 0
    return np.flatnonzero(is_complete & measured & any_of_rows(survey_weight > 0.0))


def predict_left_out(
    problem: Problem, loop: GaussNewton, solution: Solution, control: Discrepancies
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Predict each GCP of ``control`` from the others, by the model and by those nested in it.

    The loop's system has the factors of this solution. Returned are, by model, the squared errors ``(g,)`` in px², mean
    over the images of each GCP; and the models that are too simple: tie points show the drift that they omit.
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
    """Return the indices of parameters among those of a camera, by name; the prefix of appended drifts is ignored."""
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
