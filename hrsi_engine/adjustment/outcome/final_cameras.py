"""The final cameras: those of the requested model, without the additional drift of the estimation.

The estimate has the model's own values v and the drift d that the model does not contain
(`refinement.image_space.add_drift_parameters`). The final camera is the correction by the model alone that is nearest
to both together at the measured image points: with the weighted squares N of the correction's derivatives there and the
priors P of the values::

    (N_vv + P) step = N_vd d        delivered = v + step

so that residuals have no common part left. The points are then intersected with these cameras.
"""

from typing import NamedTuple

import numpy as np

from ...refinement.image_space import ImagePolynomial
from ..equations import State
from ..gauss_newton import GaussNewton, Solution
from ..preparation.problem import Problem
from ..starting_values.intersection import form_point_equations


class FinalCameras(NamedTuple):
    """Final values (cameras, p), positions (m, 3) and residuals (n, 2) by these cameras, and N (cameras, q, q)."""

    values: np.ndarray
    ground: np.ndarray
    residual: np.ndarray
    squares: np.ndarray


def compute_final_cameras(problem: Problem, loop: GaussNewton, solution: Solution) -> FinalCameras:
    """Return the final cameras of the model, and the points intersected with them."""
    squares = compute_drift_squares(problem, solution)
    gain = compute_drift_gain(problem, loop, squares)
    if gain is None:
        return FinalCameras(solution.state.values, solution.state.ground, solution.normals.residual, squares)
    values = absorb_drift(solution.state.values, gain)
    equations = form_point_equations(problem.observations, problem.model, problem.options.threads)
    ground = equations.intersect(State(values, solution.state.ground), solution.weight, solution.weighting.points)
    return FinalCameras(values, ground, equations.compute_residuals(State(values, ground)), squares)


def compute_drift_gain(problem: Problem, loop: GaussNewton, squares: np.ndarray) -> np.ndarray | None:
    """Return the factors G of the drift in the final values, v + G d: ``(cameras, p, q - p)``; None without a drift.

    squares : (cameras, q, q) N, of `compute_drift_squares`
    """
    p, q = len(problem.model.parameters), squares.shape[1]
    return None if p == q else compute_gain(squares, loop.prior_weight, np.arange(p), np.arange(p, q))


def compute_gain(
    squares: np.ndarray, prior_weight: np.ndarray, contained: np.ndarray, omitted: np.ndarray
) -> np.ndarray:
    """Return the factors by which a model's parameters absorb others of the camera: (N_vv + P)^-1 N_vd, 0 if fixed.

    squares, prior_weight : (cameras, q, q) N and (cameras, q) P, infinite where fixed
    contained, omitted : (p,) and (r,) indices of v and d among the camera's parameters
    Result: ``(cameras, p, r)``
    """
    prior = prior_weight[:, contained]
    fixed = np.isinf(prior)
    normal = squares[:, contained[:, None], contained] + np.where(fixed, 1.0, prior)[:, :, None] * np.eye(
        len(contained)
    )
    return np.where(fixed[:, :, None], 0.0, np.linalg.solve(normal, squares[:, contained[:, None], omitted]))


def compute_drift_squares(problem: Problem, solution: Solution) -> np.ndarray:
    """Return N ``(cameras, q, q)``, with that of an earlier adjustment added; zeros if there is no drift to absorb."""
    camera = problem.camera
    if camera is problem.model or not isinstance(camera, ImagePolynomial):
        return np.zeros((len(solution.state.values), len(camera.parameters), len(camera.parameters)))
    squares = sum_squares(problem, camera, solution)
    if problem.earlier is not None:
        np.add.at(squares, problem.earlier.camera, problem.earlier.known.squares)
    return squares


def absorb_drift(estimated: np.ndarray, gain: np.ndarray | None) -> np.ndarray:
    """Return the final values ``(cameras, p)``, from the estimated ones ``(cameras, q)`` with the drift."""
    if gain is None:
        return estimated
    p = gain.shape[1]
    return estimated[:, :p] + np.einsum("cij,cj->ci", gain, estimated[:, p:])


def sum_squares(problem: Problem, camera: ImagePolynomial, solution: Solution) -> np.ndarray:
    """Return the weighted squares ``(cameras, q, q)`` of the derivatives by all parameters, at the measurements."""
    observations, size = problem.observations, len(camera.parameters)
    weight = solution.weight * solution.weighting.contributes[observations.point]
    squares = np.zeros((observations.cameras, size, size))
    for index, rows_of_image in enumerate(observations.by_image):
        rows = rows_of_image[weight[rows_of_image] > 0.0]
        image, number = observations.images[index], observations.camera_of_image[index]
        computed = observations.xy[rows] - solution.normals.residual[rows]
        projected = computed - camera.correction(image, solution.state.values[number], computed)
        squares[number] += camera.compute_normal(image, projected, weight[rows])
    return squares
