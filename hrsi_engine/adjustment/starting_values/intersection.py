"""Ground points from measurements on images with fixed cameras (space intersection).

The same equations as in the block, with the image parameters fixed: each point is its own 3 x 3 system. The start is
the first measurement, extrapolated from its image's centre by the camera's derivatives, at the median height of known
points or in the middle of the RPC's height range: the cameras are nearly linear, a few steps suffice.
"""

import numpy as np

from ...block.block import stack_rpcs
from ...ground.geodesy import move_ground
from ...refinement.model import RefinementModel
from ..equations import NormalEquations, PointPriors, State, make_diagonal_pattern
from ..observations import Observations


def estimate_start_positions(observations: Observations) -> np.ndarray:
    """Return approximate positions ``(m, 3)``; surveyed coordinates are taken from the survey."""
    first = observations.first[:-1]
    if not len(first):
        return np.empty((0, 3))
    image_index, image = np.unique(observations.image[first], return_inverse=True)
    images = [observations.images[index] for index in image_index.tolist()]
    stack = stack_rpcs(images)
    centre_px = np.array([one.centre_px for one in images])
    surveyed = observations.survey[observations.survey_weight[:, 2] > 0.0, 2]
    heights = np.full(len(images), np.median(surveyed)) if len(surveyed) else [one.rpc.height_off for one in images]
    numbers = np.arange(len(images))
    centre = stack.localize(numbers, centre_px, np.asarray(heights))
    outwards = np.linalg.pinv(stack.project_with_metric_jacobian(numbers, centre)[1][:, :, :2])  # metres per pixel
    step = np.zeros((len(first), 3))
    step[:, :2] = (outwards[image] @ (observations.xy[first] - centre_px[image])[:, :, None])[:, :, 0]
    return np.where(observations.survey_weight > 0.0, observations.survey, move_ground(centre[image], step))


def intersect_points(
    observations: Observations, model: RefinementModel, values: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return the least-squares positions ``(m, 3)`` of all points for fixed ``values (images, p)``.

    ``ground`` is the start. Points that cannot be computed are NaN.
    """
    return form_point_equations(observations, model).intersect(
        State(values, ground), 1.0 / observations.sigma_px**2, PointPriors.from_surveys(observations, ground)
    )


def compute_intersection_cofactors(
    observations: Observations, model: RefinementModel, values: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return the cofactors ``(m, 3, 3)`` m² of positions intersected with fixed cameras, by the image sigmas."""
    priors, nobody = PointPriors.from_surveys(observations, ground), np.zeros(len(ground), dtype=bool)
    weight, state = 1.0 / observations.sigma_px**2, State(values, ground)
    return form_point_equations(observations, model).form_normals(state, weight, priors, nobody).inverse


def compute_intersection_residuals(
    observations: Observations, model: RefinementModel, values: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return observed - computed ``(n, 2)`` of all measurements at the positions of `intersect_points`."""
    equations, priors = form_point_equations(observations, model), PointPriors.from_surveys(observations, ground)
    intersected = equations.intersect(State(values, ground), 1.0 / observations.sigma_px**2, priors)
    return equations.compute_residuals(State(values, intersected))


def form_point_equations(observations: Observations, model: RefinementModel, threads: int = 0) -> NormalEquations:
    """Return the equations of the points alone, with fixed cameras."""
    return NormalEquations(
        observations, model, make_diagonal_pattern(observations.cameras, len(model.parameters)), threads
    )
