"""The final cameras: those of the requested model, without the additional drift of the estimation.

The estimate has the model's own values v and the drift d that the model does not contain
(`refinement.image_space.add_drift_parameters`). The final camera is the correction by the model alone that is nearest
to both together at the measured image points: with the weighted squares N of the correction's derivatives there and the
priors P of the values::

    (N_vv + P) step = N_vd d        delivered = v + step

so that residuals have no common part left. The points are then intersected with these cameras.

The position of a part of a block that only its RPCs determine is the mean one of the RPCs before adjustment. Let the
ground of such a part move by t (east, north, up). Corrections of its images absorb that, except for their drift, and
tie points hardly determine the drift common to all images: their information on t consists of errors that neighbouring
matches share, and of contradictions between the RPCs. A free network keeps the mean position of its approximate
coordinates instead (inner constraints; Baarda 1973, S-transformations). Here these are the RPCs: with the corrections h
of the images at their middles, their a priori covariances C, and B = dh / dt, ::

    t(x) = M^-1 sum B' C^-1 h        M = sum B' C^-1 B

is the translation that corresponds to the corrections x, and 0 where their weighted sum of squares is smallest. A
priori its covariance is M^-1, by the adjustment A Q A' (A = dt / dx, Q the cofactors of x). In directions where the
latter is smaller by less than `EQUALITY.negligible` (L the shares, V the directions, in units of M^-1/2), "t = 0"
replaces the estimate from tie points, and all other unknowns follow by their correlations::

    F = V' M^1/2 A        D = Q F' (I - L)^-1        x - D F x        Q + D L D'

The covariance is exact for errors of the RPCs by C: the position is as uncertain as they are.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...foundation.thresholds import EQUALITY
from ...ground.geodesy import move_ground
from ...refinement.image_space import ImagePolynomial
from ..equations import State
from ..gauss_newton import GaussNewton, Solution
from ..preparation.parts import Part
from ..preparation.problem import Problem
from ..starting_values.intersection import form_point_equations
from ..statistics.precision import Precision


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


def keep_rpc_position(
    problem: Problem, loop: GaussNewton, solution: Solution, precise: Precision
) -> tuple[Solution, Precision]:
    """Return solution and precision with the parts that only RPCs determine moved to the RPCs' mean position."""
    shape, translations = (*solution.state.values.shape, 3), []
    right = np.zeros(shape)  # for all parts at once: they have no common unknowns
    for part in problem.parts:
        translation = _describe_translation(problem, loop, part)
        if translation is not None:
            translations.append(translation)
            right[translation[0]] = translation[1]
    if not translations:
        return solution, precise
    loop.system.factorise(solution.normals.blocks, loop.prior_weight)
    spread = loop.system.solve(right)
    by_values, uncertain = np.zeros(shape[:2]), np.zeros(shape)  # - D F x, and D L^1/2
    for cameras, rows in translations:
        share, vectors = np.linalg.eigh(np.eye(3) - np.einsum("cpi,cpj->ij", rows, spread[cameras]))
        share, vectors = np.maximum(share, 0.0), vectors * (share < EQUALITY.negligible)
        direction = spread[cameras] @ vectors / (1.0 - share)
        by_values[cameras] = -direction @ np.einsum("cpi,cp->i", rows @ vectors, solution.state.values[cameras])
        uncertain[cameras] = direction * np.sqrt(share)
    still = replace(solution.normals, point_right=np.zeros_like(solution.normals.point_right))

    def move(values: np.ndarray) -> np.ndarray:
        return loop.equations.compute_point_steps(solution.state, solution.weight, still, values)

    ahead = State(solution.state.values + by_values, move_ground(solution.state.ground, move(by_values)))
    shift = loop.form_solution(ahead, solution.weighting, solution.factor)
    steps = np.stack([move(uncertain[:, :, k]) for k in range(3)], axis=2)
    pairs = uncertain[loop.pattern.rows], uncertain[loop.pattern.columns]
    return replace(shift, converged=solution.converged, status=solution.status), replace(
        precise,
        cameras=precise.cameras + pairs[0] @ pairs[1].swapaxes(1, 2),
        points=precise.points + steps @ steps.swapaxes(1, 2),
        parameters=precise.parameters + np.sum(uncertain**2, axis=2),
    )


def _describe_translation(problem: Problem, loop: GaussNewton, part: Part) -> tuple[np.ndarray, np.ndarray] | None:
    """Return a part's cameras (k,), and the translation of the part by their parameters, ``M^1/2 A`` ``(k, p, 3)``.

    None if other observations than the RPCs determine the part's position, or parameters are fixed.
    """
    observations, options = problem.observations, problem.options
    has_other_control = options.laser is not None or options.sigma_dem_m is not None or problem.earlier is not None
    if not part.ties or part.gcps or part.places or has_other_control:
        return None
    cameras, first = np.unique(observations.camera_of_image[part.images], return_index=True)
    pointing, weight = ~problem.camera.drifts, loop.prior_weight[cameras]
    if not pointing.any() or np.isinf(weight).any():
        return None
    rows = np.zeros((len(cameras), weight.shape[1], 3))
    normal = np.zeros((3, 3))
    for place, index in enumerate(part.images[first].tolist()):
        image = observations.images[index]
        middle = image.centre_px[None]
        ground = image.rpc.localize(middle, image.rpc.height_off).ground
        height = problem.camera.equations(image, middle)(np.zeros(weight.shape[1]), ground)
        by_values, by_ground = height.by_values[0][:, pointing], height.by_ground[0]
        gain = np.linalg.solve(by_values / weight[place, pointing] @ by_values.T, by_ground)  # C^-1 B
        rows[place, pointing] = by_values.T @ gain
        normal += by_ground.T @ gain
    values, vectors = np.linalg.eigh(normal)
    if not values[0] > 0.0:
        return None
    return cameras, rows @ (vectors / np.sqrt(values)) @ vectors.T
