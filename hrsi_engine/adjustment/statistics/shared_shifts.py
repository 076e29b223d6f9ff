"""How far the error of a coordinate operation, which all GCPs that it converted share, moves an adjusted block.

The unknown shifts d of the operations, with the covariance D of their stated accuracies, are no unknowns of the
adjustment: most often nothing but the GCPs tells where the block lies, and then they cannot be estimated. They are
*considered* (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter 8): the estimate stays
what it is, and its covariance becomes

    C + G D G'        G = dx / dd

Check points that the same operation converted are shifted by d too, so their errors have C + (G - E) D (G - E)' with E
the identity at their operation: where the GCPs alone hold the block, G = E, and they cannot test the operation at all.

G follows from the normal equations at the solution: the GCPs' positions are moved by one standard deviation, and the
step that this causes is solved for. Everything else that holds the block (heights of a DEM, priors of the cameras)
keeps its weight.
"""

from dataclasses import replace

import numpy as np

from ...ground.geodesy import move_ground
from ..gauss_newton import GaussNewton, Solution


def propagate_shifts(loop: GaussNewton, solution: Solution, surveyed: np.ndarray, shifts_m: np.ndarray) -> np.ndarray:
    """Return by how much each point moves, ``(m, 3, k)`` east, north, up, where the GCPs are shifted.

    surveyed : (m,) mask of the points that carry a survey
    shifts_m : (m, 3, k) east, north and up of each point's survey, for k shifts
    """
    priors, moved = solution.weighting.points, np.zeros_like(shifts_m)
    given = solution.state, solution.weight, priors, solution.weighting.contributes
    unmoved = loop.equations.form_normals(*given)
    loop.system.factorise(solution.normals.blocks, loop.prior_weight)
    for column in range(shifts_m.shape[2]):
        step = np.where(surveyed[:, None] & priors.observed, shifts_m[:, :, column], 0.0)
        if step.any():
            shifted = replace(priors, target=move_ground(priors.target, step))
            there = loop.equations.form_normals(*given[:2], shifted, given[3])
            cameras = loop.system.solve(there.right - unmoved.right)
            change = replace(unmoved, point_right=there.point_right - unmoved.point_right)
            moved[:, :, column] = loop.equations.compute_point_steps(solution.state, solution.weight, change, cameras)
    return moved
