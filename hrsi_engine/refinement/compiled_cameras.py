"""Observation equations of many image points, linearised by compiled loops, for all models with a formula for it.

A loop per family of models iterates over points and their image points, with the family's formula (`correct_in_image`
and similar ones), the RPC (`compiled_rpc.project_compiled`) and the ellipsoid inside. A new family needs its formula, a
loop of ten lines here, and an entry in `FAMILIES`; other models are linearised image by image with NumPy. Needs numba.

Arguments that the loops share
    points (k,), place (k + 1,) : indices of points, and the first output row of each
    first (m + 1,), image (n,), xy (n, 2) : as in `adjustment.observations`; rays (n, r): constants of image points
    ground (m, 3) : lon, lat, height of all points
    constants (images, c), coefficients (images, …) : of the formula
    out : residual (rows, 2), by_ground (rows, 2, 3), by_quantity (rows, 2, q) or (0, 2, 0), terms (rows, t)
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..block.block import Image
from ..camera.compiled_rpc import project_point, rpc_tables
from ..foundation.compiled_code import OPTIONS, Arrays, register
from ..ground import ellipsoid
from . import pseudo_rays
from .image_space import ImagePolynomial, correct_in_image
from .object_coordinates import GroundPolynomial, correct_by_ground
from .object_space import GroundCorrection, move_position, rotate_derivatives
from .pseudo_rays import linearise_by_rays, rays_of_image
from .pseudo_sensor import PseudoSensor

register(correct_in_image, correct_by_ground, move_position, rotate_derivatives)
register(*pseudo_rays.CORRECTION_FORMULAS)


@njit(**OPTIONS)
def _linearise_polynomials(
    points: np.ndarray,
    place: np.ndarray,
    observed: Arrays,
    ground: np.ndarray,
    rpcs: Arrays,
    formula: Arrays,
    arrays: Arrays,
) -> None:
    """Write the equations of `image_space.ImagePolynomial`, or of `object_coordinates.GroundPolynomial` (3 powers)."""
    first, image, xy, _ = observed
    constants, coefficients, powers = formula
    residual, by_ground, _, terms = arrays
    scratch = np.empty(20)
    for number in range(len(points)):
        point = points[number]
        lon, lat, height = ground[point, 0], ground[point, 1], ground[point, 2]
        east, north = ellipsoid.metres_of_a_degree(lat, height)
        row = first[point]
        for a in range(place[number], place[number + 1]):
            i = image[row]
            project_point(rpcs, i, lon, lat, height, east, north, scratch, residual, by_ground, a)
            if powers.shape[1] == 2:
                correct_in_image(powers, constants, coefficients, i, residual, by_ground, terms, a)
            else:
                correct_by_ground(
                    powers, constants, coefficients, i, lon, lat, height, east, north, residual, by_ground, terms, a
                )
            residual[a, 0] = xy[row, 0] - residual[a, 0]
            residual[a, 1] = xy[row, 1] - residual[a, 1]
            row += 1


@njit(**OPTIONS)
def _linearise_ground_corrections(
    points: np.ndarray,
    place: np.ndarray,
    observed: Arrays,
    ground: np.ndarray,
    rpcs: Arrays,
    formula: Arrays,
    arrays: Arrays,
) -> None:
    """Write the equations of `object_space.GroundCorrection`."""
    first, image, xy, _ = observed
    constants, coefficients, _ = formula
    residual, by_ground, by_frame, terms = arrays
    scratch = np.empty(20)
    for number in range(len(points)):
        point = points[number]
        position = ellipsoid.geocentric(ground[point, 0], ground[point, 1], ground[point, 2])
        axes = ellipsoid.axes(ground[point, 0], ground[point, 1])
        row = first[point]
        for a in range(place[number], place[number + 1]):
            i = image[row]
            x, y, z = move_position(constants, coefficients, i, position, terms, a)
            lon, lat, height = ellipsoid.geodetic(x, y, z)
            east, north = ellipsoid.metres_of_a_degree(lat, height)
            project_point(rpcs, i, lon, lat, height, east, north, scratch, residual, by_ground, a)
            rotate_derivatives(constants, coefficients, i, ellipsoid.axes(lon, lat), axes, by_ground, by_frame, a)
            residual[a, 0] = xy[row, 0] - residual[a, 0]
            residual[a, 1] = xy[row, 1] - residual[a, 1]
            row += 1


@njit(**OPTIONS)
def _linearise_pseudo_sensors(
    points: np.ndarray,
    place: np.ndarray,
    observed: Arrays,
    ground: np.ndarray,
    rpcs: Arrays,
    formula: Arrays,
    arrays: Arrays,
) -> None:
    """Write the equations of `pseudo_sensor.PseudoSensor`; its rays replace the RPCs."""
    first, image, xy, rays = observed
    constants, coefficients, parameters = formula
    residual, by_ground, by_quantity, terms = arrays
    for number in range(len(points)):
        point = points[number]
        position = ellipsoid.geocentric(ground[point, 0], ground[point, 1], ground[point, 2])
        axes = ellipsoid.axes(ground[point, 0], ground[point, 1])
        row = first[point]
        for a in range(place[number], place[number + 1]):
            linearise_by_rays(
                parameters,
                constants,
                coefficients,
                image[row],
                rays,
                xy,
                row,
                position,
                axes,
                residual,
                by_ground,
                by_quantity,
                terms,
                a,
            )
            residual[a, 0] = xy[row, 0] - residual[a, 0]
            residual[a, 1] = xy[row, 1] - residual[a, 1]
            row += 1


def tabulate_rpcs(images: Sequence[Image]) -> Arrays:
    """Return the RPCs of images as the loops take them."""
    return rpc_tables([image.rpc for image in images])


class Family(NamedTuple):
    """Compiled linearisation of a family of models.

    loop : compiled loop over points; table : returns the array in which the models of the family differ
    rays : returns the constants of image points ``xy (n, 2)`` of an image, their rays
    """

    loop: Callable[..., None]
    table: Callable[[Any], np.ndarray]
    rays: Callable[[Image, np.ndarray], np.ndarray] = lambda image, xy: np.empty((len(xy), 0))


FAMILIES: dict[type, Family] = {
    ImagePolynomial: Family(_linearise_polynomials, lambda m: np.ascontiguousarray(m.powers, dtype=np.int64)),
    GroundPolynomial: Family(_linearise_polynomials, lambda m: np.ascontiguousarray(m.powers, dtype=np.int64)),
    GroundCorrection: Family(_linearise_ground_corrections, lambda model: model.entries),
    PseudoSensor: Family(_linearise_pseudo_sensors, lambda model: model.used, rays_of_image),
}
