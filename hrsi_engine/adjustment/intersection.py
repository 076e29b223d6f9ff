"""Ground points from measurements on images whose cameras stay as they are (space intersection).

The same equations as in the block, with the image parameters fixed: each point is its own 3 x 3 system. The start is
the first measurement's ray at a height near the known points, or in the middle of the RPC's height range.
"""

from __future__ import annotations

import numpy as np

from ..geodesy import moved_ground
from ..refinement import RefinementModel
from .normals import linearise, point_blocks
from .observations import Observations

ITERATIONS = 12
CLOSURE_M = 1e-4  # a tenth of a millimetre on the ground: far below any measurement
STEP_LIMIT_M = 5e3  # weak geometry takes short steps; the equations are nearly linear


def start_positions(observations: Observations, height_m: float | None = None) -> np.ndarray:
    """Return ``(m, 3)`` positions on the ray of each point's first measurement; surveyed points at their survey."""
    if height_m is None:
        known = observations.survey[:, 2]
        height_m = float(np.nanmedian(known)) if np.isfinite(known).any() else None
    ground = np.full((len(observations.points), 3), np.nan)
    first = observations.first[:-1]
    image_of_first = observations.image[first]
    for index in np.unique(image_of_first):
        rpc = observations.images[index].rpc
        here = image_of_first == index
        level = rpc.height_off if height_m is None else height_m
        ground[here] = rpc.localize(observations.xy[first[here]], level).ground
    ground[observations.surveyed] = observations.survey[observations.surveyed]
    return ground


def intersect(observations: Observations, model: RefinementModel, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return the least-squares positions ``(m, 3)`` of all points for fixed ``values (images, p)``.

    ``ground`` is the start. Points that cannot be computed come out as NaN.
    """
    linearisers = observations.linearisers(model)
    weight = 1.0 / observations.sigma_px**2
    start = ground
    for _ in range(ITERATIONS):
        linear = linearise(observations, linearisers, values, ground)
        blocks = point_blocks(observations, linear, weight, ground, start)
        step = np.einsum("mij,mj->mi", blocks.inverse, blocks.right)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, STEP_LIMIT_M / np.maximum(length, STEP_LIMIT_M))
        ground = moved_ground(ground, step)
        if not np.nanmax(length, initial=0.0) > CLOSURE_M:
            break
    return ground
