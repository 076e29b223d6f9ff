"""The adjustment of a small block by one dense design matrix over all unknowns: an oracle for the sparse one."""

from typing import NamedTuple

import numpy as np
import simulated_blocks as blocks
from scipy import linalg

from hrsi.hrsi_engine.adjustment.equations import FREE_POINT_SIGMA_M
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.block.pointing import POINTING
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.refinement.image_space import ImagePolynomial, add_drift_parameters
from hrsi.hrsi_engine.refinement.model import select_priors


class Dense(NamedTuple):
    """Values of the model (images, p), positions (points, 3), cofactors of both, what lack of drift moves (m)."""

    values: np.ndarray
    ground: np.ndarray
    values_cofactor: np.ndarray
    ground_cofactor: np.ndarray
    moved_m: np.ndarray

    def ground_sigma_m(self, factor):
        """Return the sigmas of the positions, for a factor of the observations' sigmas."""
        return np.sqrt(factor**2 * self.ground_cofactor + self.moved_m**2)


def dense_solution(block, model, controlled=True, drift=POINTING.least_drift):
    """Solve the same problem with one dense design matrix over all unknowns, the cameras' drift among them."""
    camera = add_drift_parameters(model) if drift and isinstance(model, ImagePolynomial) else model
    p, q, count, total = len(model.parameters), len(camera.parameters), len(block.images), len(block.points)
    priors = [select_priors(image, controlled) for image in block.images]  # 7 m without GCPs, once 5 px (issue 37)
    sigma = [
        np.r_[model.prior_sigmas(*of_image), np.full(q - p, drift)]
        for of_image in zip(block.images, priors, strict=True)
    ]
    prior = np.concatenate(sigma)
    values, ground, start = np.zeros((count, q)), *_start(block)
    own = linalg.block_diag(np.diag(prior**2), *_surveys(block))
    weight = np.repeat(1.0 / block.measurements.sigma_px**2, 2)
    for _ in range(8):
        design, miss = _design(block, camera, values, ground)
        normal = design.T @ (design * weight[:, None]) + np.linalg.inv(own)
        offsets = np.concatenate([-values.ravel(), ground_difference_m(start, ground).ravel()])
        step = np.linalg.solve(normal, design.T @ (weight * miss) + np.linalg.solve(own, offsets))
        values = values + step[: count * q].reshape(count, q)
        ground = move_ground(ground, step[count * q :].reshape(-1, 3))
    cofactor = np.diag(np.linalg.inv(normal))
    delivered, without = _without_drift(block, model, values, ground, start, design[:, : count * q], weight, prior)
    return Dense(
        delivered, without, cofactor[: count * q].reshape(count, q)[:, :p], cofactor[count * q :].reshape(total, 3),
        ground_difference_m(without, ground),
    )  # fmt: skip


def _start(block):
    """Return where the points begin, and the positions that surveys and weak priors hold them to."""
    ground = block.points.ground.copy()
    free = ~(block.points.role == Role.GCP)
    ground[free] = blocks.ground(len(ground), 77)[free]
    return ground, ground.copy()


def _surveys(block):
    survey = block.points.survey_covariance_m2()
    survey[~(block.points.role == Role.GCP)] = FREE_POINT_SIGMA_M**2 * np.eye(3)
    return survey


def _design(block, camera, values, ground):
    """Return the design matrix over cameras and points, and observed - computed."""
    rows, count, q = block.measurements, len(block.images), len(camera.parameters)
    design, miss = np.zeros((2 * len(rows), count * q + 3 * len(ground))), np.zeros(2 * len(rows))
    for row in range(len(rows)):
        image, point = rows.image[row], rows.point[row]
        at = camera.equations(block.images[image], rows.xy[row : row + 1])(values[image], ground[point : point + 1])
        here = slice(2 * row, 2 * row + 2)
        design[here, image * q : image * q + q] = at.by_values[0]
        design[here, count * q + 3 * point + np.arange(3)] = at.by_ground[0]
        miss[here] = rows.xy[row] - at.computed[0]
    return design, miss


def _without_drift(block, model, values, ground, start, by_values, weight, prior):
    """Return the values of the model nearest to the whole correction, and the points intersected with them."""
    p, (count, q) = len(model.parameters), values.shape
    delivered = values[:, :p].copy()
    root = np.sqrt(weight)
    for image in range(count) if q > p else ():
        columns = image * q + np.arange(q)
        own, rest = by_values[:, columns[:p]], by_values[:, columns[p:]]
        design = np.vstack([own * root[:, None], np.diag(1.0 / prior[columns[:p]])])
        target = np.r_[root * (rest @ values[image, p:]), np.zeros(p)]
        delivered[image] += np.linalg.lstsq(design, target, rcond=None)[0]
    inverse = np.linalg.inv(linalg.block_diag(*_surveys(block)))
    for _ in range(4):
        design, miss = _design(block, model, delivered, ground)
        by_ground = design[:, count * p :]
        normal = by_ground.T @ (by_ground * weight[:, None]) + inverse
        right = by_ground.T @ (weight * miss) + inverse @ ground_difference_m(start, ground).ravel()
        ground = move_ground(ground, np.linalg.solve(normal, right).reshape(-1, 3))
    return delivered, ground
