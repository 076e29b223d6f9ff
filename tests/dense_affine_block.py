"""A block with an affine correction of each image, adjusted by one dense matrix over all unknowns: NumPy and PROJ.

Unknowns: of each image a0, as, al (sample) and b0, bs, bl (line), counted from its middle at the projected position;
of each point east, north, up. Observations: image points, surveys of GCPs, and the a priori values 0 of corrections.
"""

from types import SimpleNamespace

import numpy as np
from independent_formulas import intersect, jacobian, metres, moved

SHIFT_PRIOR_PX, DRIFT_PRIOR = 100.0, 1e-3  # docs/adjustment.md: a part of the block with GCPs
IMAGE_PX, SURVEY_M = 0.1, np.array([0.05, 0.1, 0.2])  # stated sigmas: a third of the true one, and none like another


def solve(scene: SimpleNamespace) -> SimpleNamespace:
    """Return parameters, positions and the covariance of both, scaled by sigma0 where that is above 1."""
    names = list(scene.cameras)
    middle = {name: (np.array(camera.size) - 1.0) / 2.0 for name, camera in scene.cameras.items()}
    ids = [name for name in scene.measured if not name.startswith("C")]  # check points take no part
    rows = [(point, name, xy) for point in ids for name, xy in scene.measured[point].items()]
    parameters = {name: np.zeros(6) for name in names}
    start = {
        point: scene.places[point] if point in scene.places
        else intersect([(scene.cameras[name], xy) for name, xy in scene.measured[point].items()],
                       next(iter(scene.places.values())))
        for point in ids
    }  # fmt: skip
    position = dict(start)
    of_image = {name: 6 * index for index, name in enumerate(names)}
    of_point = {point: 6 * len(names) + 3 * index for index, point in enumerate(ids)}
    total = 6 * len(names) + 3 * len(ids)
    prior = np.tile([SHIFT_PRIOR_PX, DRIFT_PRIOR, DRIFT_PRIOR], 2 * len(names))
    for _ in range(6):
        design, miss, sigma = [], [], []
        for point, name, xy in rows:
            computed, by_values, by_ground = corrected(
                scene.cameras[name], middle[name], parameters[name], position[point]
            )
            row = np.zeros((2, total))
            row[:, of_image[name] : of_image[name] + 6] = by_values
            row[:, of_point[point] : of_point[point] + 3] = by_ground
            design.append(row)
            miss.append(xy - computed)
            sigma.append(np.full(2, IMAGE_PX))
        for point in ids:
            if point in scene.places:
                row = np.zeros((3, total))
                row[:, of_point[point] : of_point[point] + 3] = np.eye(3)
                design.append(row)
                miss.append(metres(scene.places[point], position[point])[0])
                sigma.append(SURVEY_M)
        observations = sum(map(len, miss))
        row = np.zeros((6 * len(names), total))
        row[:, : 6 * len(names)] = np.eye(6 * len(names))
        design.append(row)
        miss.append(-np.concatenate([parameters[name] for name in names]))
        sigma.append(prior)
        A, v, s = np.vstack(design), np.concatenate(miss), np.concatenate(sigma)
        normal = A.T @ (A / s[:, None] ** 2)
        step = np.linalg.solve(normal, A.T @ (v / s**2))
        for name in names:
            parameters[name] = parameters[name] + step[of_image[name] : of_image[name] + 6]
        for point in ids:
            position[point] = moved(position[point], step[of_point[point] : of_point[point] + 3])[0]
    v = v - A @ step  # the last step is small; residuals to second order
    cofactor = np.linalg.inv(normal)
    # Redundancy of the observations proper: what the priors determine is not taken from them
    by_priors = float(np.sum(cofactor.diagonal()[: 6 * len(names)] / prior**2))
    redundancy = observations - total + by_priors
    cost = float(np.sum((v[:observations] / s[:observations]) ** 2))
    sigma0 = float(np.sqrt(cost / redundancy))
    return SimpleNamespace(
        names=names, ids=ids, middle=middle, parameters=parameters, position=position, of_image=of_image,
        of_point=of_point, covariance=max(sigma0, 1.0) ** 2 * cofactor, sigma0=sigma0, redundancy=redundancy,
        by_priors=by_priors, observations=observations, unknowns=total, factor=max(sigma0, 1.0),
    )  # fmt: skip


def corrected(camera, middle, values, ground):
    """Return the corrected image point ``(2,)``, its derivatives by the values ``(2, 6)`` and by metres ``(2, 3)``."""
    at = camera.project(ground)[0]
    terms = np.r_[1.0, at - middle]
    slope = np.array([values[1:3], values[4:6]])
    by_values = np.zeros((2, 6))
    by_values[0, :3] = by_values[1, 3:] = terms
    return at + by_values @ values, by_values, (np.eye(2) + slope) @ jacobian(camera, ground)[0]


def covariance_of_rays(solution: SimpleNamespace, scene: SimpleNamespace, point: str, position: np.ndarray):
    """Return the covariance (3, 3) of a point that took no part: of its own rays, and of the images' corrections."""
    by_ground, by_values = [], []
    for name in scene.measured[point]:
        _, values, ground = corrected(scene.cameras[name], solution.middle[name], solution.parameters[name], position)
        row = np.zeros((2, 6 * len(solution.names)))
        row[:, solution.of_image[name] : solution.of_image[name] + 6] = values
        by_ground.append(ground)
        by_values.append(row)
    B, A = np.vstack(by_ground), np.vstack(by_values)
    inverse = np.linalg.pinv(B)
    count = 6 * len(solution.names)
    of_cameras = inverse @ A @ solution.covariance[:count, :count] @ A.T @ inverse.T
    return solution.factor**2 * IMAGE_PX**2 * np.linalg.inv(B.T @ B) + of_cameras
