"""The adjustment of a small block by one dense design matrix over all unknowns: an oracle for the sparse one."""

from __future__ import annotations

import numpy as np
import simulated_blocks as blocks
from scipy import linalg

from hrsi.hrsi_engine.adjustment.equations import FREE_POINT_SIGMA_M
from hrsi.hrsi_engine.block import Role
from hrsi.hrsi_engine.geodesy import ground_difference_m, moved_ground
from hrsi.hrsi_engine.refinement.model import CONTROLLED, UNCONTROLLED


def dense_solution(block, model, controlled=True):
    """Solve the same problem with one dense design matrix over all unknowns: values, points, cofactors, redundancy."""
    priors = CONTROLLED if controlled else UNCONTROLLED
    p, count, total = len(model.parameters), len(block.images), len(block.points)
    rows = block.measurements
    values, ground = np.zeros((count, p)), block.points.ground.copy()
    free = ~(block.points.role == Role.GCP)
    ground[free] = blocks.ground(total, 77)[free]
    start = ground.copy()
    prior = np.concatenate([model.prior_sigmas(image, priors) for image in block.images])
    for _ in range(8):
        design = np.zeros((2 * len(rows), count * p + 3 * total))
        miss = np.zeros(2 * len(rows))
        for row in range(len(rows)):
            image, point = rows.image[row], rows.point[row]
            at = model.equations(block.images[image], rows.xy[row : row + 1])(values[image], ground[point : point + 1])
            design[2 * row : 2 * row + 2, image * p : image * p + p] = at.by_values[0]
            columns = count * p + 3 * point + np.arange(3)
            design[2 * row : 2 * row + 2, columns] = at.by_ground[0]
            miss[2 * row : 2 * row + 2] = rows.xy[row] - at.computed[0]
        weight = np.repeat(1.0 / rows.sigma_px**2, 2)
        survey = block.points.survey_covariance_m2()
        survey[free] = FREE_POINT_SIGMA_M**2 * np.eye(3)
        known = np.where(free[:, None], start, block.points.ground)
        normal = design.T @ (design * weight[:, None])
        own = linalg.block_diag(np.diag(prior**2), *survey)
        normal += np.linalg.inv(own)
        offsets = np.concatenate([-values.ravel(), ground_difference_m(known, ground).ravel()])
        step = np.linalg.solve(normal, design.T @ (weight * miss) + np.linalg.solve(own, offsets))
        values = values + step[: count * p].reshape(count, p)
        ground = moved_ground(ground, step[count * p :].reshape(-1, 3))
    return values, ground, np.linalg.inv(normal)
