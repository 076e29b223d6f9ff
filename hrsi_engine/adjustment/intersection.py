"""Ground points from measurements on images whose cameras stay as they are (space intersection).

The same equations as in the block, with the image parameters fixed: each point is its own 3 x 3 system. The start is
the first measurement carried from its image's centre by the camera's derivatives, at a height near the known points or
in the middle of the RPC's height range: the cameras are nearly linear, a few steps close the rest.
"""

from __future__ import annotations

import numpy as np

from ..block.block import Image
from ..ground.geodesy import moved_ground
from ..refinement.model import RefinementModel
from .equations import NormalEquations, PointPriors, State, trivial_pattern
from .observations import Observations

CENTRE_STEPS = 6
CENTRE_CLOSURE_M = 10.0  # a start needs no more


def start_positions(observations: Observations, height_m: float | None = None) -> np.ndarray:
    """Return approximate positions ``(m, 3)``; surveyed coordinates at their survey."""
    if height_m is None:
        known = observations.survey[observations.survey_weight[:, 2] > 0.0, 2]
        height_m = float(np.median(known)) if len(known) else None
    first = observations.first[:-1]
    image = observations.image[first]
    seen = np.bincount(image, minlength=len(observations.images)) > 0
    centre, outwards = np.full((len(seen), 3), np.nan), np.zeros((len(seen), 2, 2))
    for index in np.flatnonzero(seen):
        centre[index], outwards[index] = _at_centre(observations.images[index], height_m)
    offset = observations.xy[first] - np.array([i.centre_px for i in observations.images])[image]
    step = np.zeros((len(first), 3))
    step[:, :2] = (outwards[image] @ offset[:, :, None])[:, :, 0]
    ground = moved_ground(centre[image], step)
    return np.where(observations.survey_weight > 0.0, observations.survey, ground)


def _at_centre(image: Image, height_m: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the ground position (3,) of an image's centre and the metres east, north per pixel (2, 2) there."""
    rpc = image.rpc
    ground = np.array([[rpc.long_off, rpc.lat_off, rpc.height_off if height_m is None else height_m]])
    for _ in range(CENTRE_STEPS):
        at, by_ground = rpc.project_with_metric_jacobian(ground)
        outwards = np.linalg.pinv(by_ground[0, :, :2])
        step = np.zeros((1, 3))
        step[0, :2] = outwards @ (image.centre_px - at[0])
        ground = moved_ground(ground, step)
        if np.abs(step).max() < CENTRE_CLOSURE_M:
            return ground[0], outwards
    found = rpc.localize(image.centre_px[None], ground[0, 2]).ground  # slower, and safer with odd RPCs
    return found[0], outwards


def intersect(observations: Observations, model: RefinementModel, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return the least-squares positions ``(m, 3)`` of all points for fixed ``values (images, p)``.

    ``ground`` is the start. Points that cannot be computed come out as NaN.
    """
    return fixed_cameras(observations, model).intersect(
        State(values, ground), 1.0 / observations.sigma_px**2, PointPriors.of(observations, ground)
    )


def image_residuals(
    observations: Observations, model: RefinementModel, values: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return observed - computed ``(n, 2)`` of all measurements."""
    return fixed_cameras(observations, model).residuals(State(values, ground))


def fixed_cameras(observations: Observations, model: RefinementModel, threads: int = 0) -> NormalEquations:
    """Return the equations of points alone."""
    return NormalEquations(observations, model, trivial_pattern(observations.cameras, len(model.parameters)), threads)
