"""The position of a part of a block that only its RPCs determine: the mean one of the RPCs before adjustment.

Let the ground of such a part move by t (east, north, up). Corrections of its images absorb that, except for their
drift, and tie points hardly determine the drift common to all images: their information on t consists of errors that
neighbouring matches share, and of contradictions between the RPCs. A free network keeps the mean position of its
approximate coordinates instead (inner constraints; Baarda 1973, S-transformations). Here these are the RPCs: with the
corrections h of the images at their middles, their a priori covariances C, and B = dh / dt, ::

    t(x) = M^-1 sum B' C^-1 h        M = sum B' C^-1 B

is the translation that corresponds to the corrections x, and 0 where their weighted sum of squares is smallest. A
priori its covariance is M^-1, by the adjustment A Q A' (A = dt / dx, Q the cofactors of x). In directions where the
latter is smaller by less than `EQUALITY.negligible` (L the shares, V the directions, in units of M^-1/2), "t = 0"
replaces the estimate from tie points, and all other unknowns follow by their correlations::

    F = V' M^1/2 A        D = Q F' (I - L)^-1        x - D F x        Q + D L D'

The covariance is exact for errors of the RPCs by C: the position is as uncertain as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...foundation.thresholds import EQUALITY
from ...ground.geodesy import move_ground
from ..equations import State
from ..gauss_newton import GaussNewton, Solution
from ..preparation.parts import Part
from ..preparation.problem import Problem
from ..statistics.precision import Precision


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
