"""The cameras that are delivered: those of the model asked for, without the drift that was estimated beside it.

The estimate has the model's own values v and the drift d that it does not follow (`refinement.image_space.with_drift`).
What is delivered instead is the correction of the model alone that comes nearest to both together where the image was
measured: with the weighted squares N of the correction's derivatives there and the priors P of the values::

    (N_vv + P) step = N_vd d        delivered = v + step

so that residuals have no common part left. The points are then intersected with these cameras.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..refinement.image_space import ImagePolynomial
from .equations import State
from .gauss_newton import GaussNewton, Solution
from .intersection import fixed_cameras
from .problem import Problem


class Delivered(NamedTuple):
    """Values (cameras, p) of the model, positions (m, 3) and residuals (n, 2) by these cameras."""

    values: np.ndarray
    ground: np.ndarray
    residual: np.ndarray


def deliver(problem: Problem, loop: GaussNewton, solution: Solution) -> Delivered:
    """Return the cameras of the model, and the points by them."""
    camera, p = problem.camera, len(problem.model.parameters)
    if camera is problem.model or not isinstance(camera, ImagePolynomial):
        return Delivered(solution.state.values, solution.state.ground, solution.normals.residual)
    squares = _squares(problem, camera, solution)
    prior = loop.prior_weight[:, :p]
    held = np.isinf(prior)
    own = squares[:, :p, :p] + np.where(held, 1.0, prior)[:, :, None] * np.eye(p)
    right = np.einsum("cij,cj->ci", squares[:, :p, p:], solution.state.values[:, p:])
    values = solution.state.values[:, :p] + np.where(held, 0.0, np.linalg.solve(own, right[:, :, None])[:, :, 0])
    equations = fixed_cameras(problem.observations, problem.model, problem.options.threads)
    ground = equations.intersect(State(values, solution.state.ground), solution.weight, solution.weighting.points)
    return Delivered(values, ground, equations.residuals(State(values, ground)))


def _squares(problem: Problem, camera: ImagePolynomial, solution: Solution) -> np.ndarray:
    """Return the weighted squares ``(cameras, q, q)`` of the derivatives by all parameters, at the measurements."""
    observations, size = problem.observations, len(camera.parameters)
    weight = solution.weight * solution.weighting.contributes[observations.point]
    squares = np.zeros((observations.cameras, size, size))
    for index, rows in enumerate(observations.by_image):
        image, number = observations.images[index], observations.camera_of_image[index]
        computed = observations.xy[rows] - solution.normals.residual[rows]
        projected = computed - camera.by_values(image, computed) @ solution.state.values[number]
        by_values = camera.by_values(image, projected).reshape(-1, size)
        squares[number] += (by_values.T * np.repeat(weight[rows], 2)) @ by_values
    return squares
