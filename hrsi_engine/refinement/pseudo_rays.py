"""Pseudo light rays of image points for the generic method (thesis section 4.3, step 1; eqs. 4.10-4.11).

The ray of an image point passes through its ground positions at the two ends of the RPC's height range, in a
topocentric frame about the middle of the image. X is along the samples and Y to its left (against the lines), so that
psi_x is roll and psi_y is pitch; z is up. The pseudo sensor is the point of the ray at the height H at which the rays
of its line intersect::

    X(z) = Xs + (H - z) tan(psi_x)        Y(z) = Ys + (H - z) tan(psi_y)

The thesis fixes H ("e.g. 600 km"); any value suits small corrections. Corrections of 0.1 rad must rotate the rays at
their true intersection: 100 m of its height, as an orbit curves over an image, are 10 m on the ground.

The rays of an RPC are not exactly straight; the deviation at the middle of the height range (*sag*, usually far below a
millimetre) is kept as a parabola, so that a pseudo sensor without corrections reproduces the RPC.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..block.block import Image
from ..block.imaging_geometry import GEOMETRY
from ..camera.rpc import RPC
from ..foundation.errors import SolveError
from ..foundation.thresholds import EQUALITY, threshold, thresholds
from ..ground import ellipsoid
from ..ground.ellipsoid import Number, Triple
from ..ground.geodesy import LocalFrame
from .model import ALL_ROWS, RowIndex


@thresholds
class SENSOR:
    """Limits for plausible pseudo sensors, and for the convergence of their rays."""

    usual_height_m: float = threshold(600e3, "m", "height of the sensor, if not computed", "thesis, section 4.3")
    least_height_m: float = threshold(1e3, "m", "smallest plausible height: an aircraft")
    largest_height_m: float = threshold(2e6, "m", "largest plausible height: above all mapping satellites")
    height_closure_m: float = threshold(1e-6, "m", "height error of a grid of corrected rays at convergence")


@dataclass(frozen=True)
class SensorFrame:
    """The frame of an image's pseudo sensor: `LocalFrame` rotated about its up axis by ``azimuth_rad``.

    ``heights_m`` are z of the pseudo sensor at the first, middle and last line; ``centre_px`` and ``half_size_px``
    those of the image.
    """

    local: LocalFrame
    azimuth_rad: float
    centre_px: np.ndarray
    half_size_px: np.ndarray
    heights_m: tuple[float, float, float] = (SENSOR.usual_height_m,) * 3

    @cached_property
    def constants(self) -> np.ndarray:
        """Constants for the formulas ``(19,)``: axes (9), origin (3), centre (2), half size (2), heights (3)."""
        return np.concatenate([self.axes.ravel(), self.local.origin, self.centre_px, self.half_size_px, self.heights_m])

    @cached_property
    def _turn(self) -> np.ndarray:
        """Rows: the X, Y and z axes in east, north, up."""
        cos, sin = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def axes(self) -> np.ndarray:
        """Rows: the X, Y and z axes in geocentric coordinates."""
        return np.asarray(self._turn @ self.local.axes)

    def from_ground(self, ground: np.ndarray) -> np.ndarray:
        """Return X, Y, z in metres, ``(n, 3)``, of lon, lat, height points."""
        return self.local.from_ground(ground) @ self._turn.T

    def to_ground(self, position: np.ndarray) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` of X, Y, z points."""
        return self.local.to_ground(position @ self._turn)


#: Columns of a table of rays ``(n, 18)``. Xs, Ys at the pseudo sensor's height, and tan psi_x, tan psi_y; the
#: derivatives of both by sample and line (those of X first); deviation of the RPC from the straight ray in X and Y at
#: half its height (sag, m); z of the upper end, and the height difference to the lower end; z of the pseudo sensor, and
#: its change from line to line.
STATION, TANGENT, SENSOR_HEIGHT = slice(0, 2), slice(2, 4), 16
COLUMNS = 18


@lru_cache(maxsize=1024)
def compute_sensor_frame(image: Image) -> SensorFrame:
    """Return the frame of an image: its origin is below the centre of the image, on the ellipsoid."""
    nadir = image.rpc.localize(image.camera_centre_px[None], image.rpc.height_off).ground[0]
    if not np.isfinite(nadir).all():
        raise SolveError(f"{image.id}: the RPC has no ground position for the middle of the image: check that both fit")
    centre, half_size = image.camera_centre_px, image.camera_half_size_px
    level = SensorFrame(LocalFrame(float(nadir[0]), float(nadir[1])), 0.0, centre, half_size)
    ends = np.array([[u, v] for v in (-1.0, 0.0, 1.0) for u in (-1.0, 1.0)])
    rays = compute_pseudo_rays(image.rpc, level, centre + half_size * ends)
    on_datum = rays[:, STATION] + rays[:, SENSOR_HEIGHT, None] * rays[:, TANGENT]
    east, north = on_datum[3] - on_datum[2]
    # The sensor heights z of the three lines: where the rays of both ends of a line are closest to each other
    difference = rays[1::2, STATION] - rays[::2, STATION]
    opening = rays[1::2, TANGENT] - rays[::2, TANGENT]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = rays[::2, SENSOR_HEIGHT] + np.sum(difference * opening, axis=1) / np.sum(opening**2, axis=1)
    first, middle, last = z.tolist()
    heights = first, middle, last
    if not SENSOR.least_height_m <= middle <= SENSOR.largest_height_m:
        heights = (SENSOR.usual_height_m,) * 3
    elif not max(abs(first - middle), abs(last - middle)) <= EQUALITY.alike * middle:
        heights = (middle,) * 3
    return replace(level, azimuth_rad=float(np.arctan2(north, east)), heights_m=heights)


def localize_ray_ends(rpc: RPC, image_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ground positions ``(n, 3)`` of image points at the lower, middle and upper height of their rays."""
    reach = max(abs(rpc.height_scale), GEOMETRY.ray_reach_m / 2.0)
    low, high = rpc.height_off - reach, rpc.height_off + reach
    lower, middle, upper = (rpc.localize(image_px, height).ground for height in (low, (low + high) / 2.0, high))
    return lower, middle, upper


def compute_pseudo_rays(rpc: RPC, frame: SensorFrame, image_px: np.ndarray) -> np.ndarray:
    """Return the rays of image points ``(n, 2)`` as a table ``(n, 18)`` with the columns described above.

    Rows are NaN where the RPC has no ground position for a point.
    """
    constants, rays = frame.constants[None], np.empty((len(image_px), COLUMNS))
    places = []
    with np.errstate(divide="ignore", invalid="ignore"):
        for ground in localize_ray_ends(rpc, image_px):
            _, by_ground = rpc.project_with_metric_jacobian(ground)
            lon, lat, height = ground.T
            position, axes = ellipsoid.geocentric(lon, lat, height), ellipsoid.axes(lon, lat)
            places.append(place_in_frame(constants, 0, position, axes, by_ground, ALL_ROWS))
        lower, middle, upper = places
        draw_ray(constants, 0, image_px[:, 1], lower=lower, middle=middle[0], upper=upper, rays=rays, a=ALL_ROWS)
    return rays


# ---- formulas shared by compiled loops (one image point) and NumPy (all of an image) ---------------------------------


def place_in_frame(
    constants: np.ndarray, i: int, position: Triple[Number], axes: Any, by_ground: np.ndarray, a: RowIndex
) -> tuple[Triple[Number], Triple[Number], Triple[Number]]:
    """Return X, Y, z of an image point's ground position, and their derivatives by sample and line at its height.

    constants : `SensorFrame.constants` of many images; i : the image
    position, axes : geocentric position, and unit vectors east, north, up there
    by_ground : (n, 2, 3) derivatives of sample and line by metres east, north, up; a : row, or all rows
    """
    c = constants
    x, y, z = position[0] - c[i, 9], position[1] - c[i, 10], position[2] - c[i, 11]
    place = (
        c[i, 0] * x + c[i, 1] * y + c[i, 2] * z,
        c[i, 3] * x + c[i, 4] * y + c[i, 5] * z,
        c[i, 6] * x + c[i, 7] * y + c[i, 8] * z,
    )
    determinant = by_ground[a, 0, 0] * by_ground[a, 1, 1] - by_ground[a, 0, 1] * by_ground[a, 1, 0]
    by_sample = _in_frame(c, i, axes, by_ground[a, 1, 1] / determinant, -by_ground[a, 1, 0] / determinant)
    by_line = _in_frame(c, i, axes, -by_ground[a, 0, 1] / determinant, by_ground[a, 0, 0] / determinant)
    return place, by_sample, by_line


def _in_frame(constants: np.ndarray, i: int, axes: Any, east: Number, north: Number) -> Triple[Number]:
    """Return a vector, given in metres east and north at a point, in the frame's X, Y, z."""
    c = constants
    x = east * axes[0][0] + north * axes[1][0]
    y = east * axes[0][1] + north * axes[1][1]
    z = east * axes[0][2] + north * axes[1][2]
    return (
        c[i, 0] * x + c[i, 1] * y + c[i, 2] * z,
        c[i, 3] * x + c[i, 4] * y + c[i, 5] * z,
        c[i, 6] * x + c[i, 7] * y + c[i, 8] * z,
    )


def draw_ray(
    constants: np.ndarray, i: int, line: Number, lower: Any, middle: Triple[Number], upper: Any, rays: np.ndarray,
    a: RowIndex,
) -> None:  # fmt: skip
    """Write the ray of an image point to row ``a`` (or all rows) of ``rays (n, 18)``.

    ``lower`` and ``upper`` are the results of `place_in_frame` at the ends, ``middle`` is the position halfway.
    """
    low, low_by_sample, low_by_line = lower
    high, high_by_sample, high_by_line = upper
    # z of the pseudo sensor: a parabola through those of the first, middle and last line
    v = (line - constants[i, 13]) / constants[i, 15]
    slope = (constants[i, 18] - constants[i, 16]) / 2.0
    bend = (constants[i, 16] + constants[i, 18]) / 2.0 - constants[i, 17]
    height, height_by_line = constants[i, 17] + slope * v + bend * v * v, (slope + 2.0 * bend * v) / constants[i, 15]
    span, rise = high[2] - low[2], high[2] - height
    for k in range(2):
        tangent = (low[k] - high[k]) / span
        by_sample = (low_by_sample[k] - high_by_sample[k] - tangent * (high_by_sample[2] - low_by_sample[2])) / span
        by_line = (low_by_line[k] - high_by_line[k] - tangent * (high_by_line[2] - low_by_line[2])) / span
        rays[a, k] = high[k] + rise * tangent
        rays[a, 2 + k] = tangent
        rays[a, 4 + 2 * k] = high_by_sample[k] + rise * by_sample + tangent * high_by_sample[2]
        rays[a, 5 + 2 * k] = high_by_line[k] + rise * by_line + tangent * high_by_line[2] - tangent * height_by_line
        rays[a, 8 + 2 * k] = by_sample
        rays[a, 9 + 2 * k] = by_line
        rays[a, 12 + k] = middle[k] - high[k] - (high[2] - middle[2]) * tangent
    rays[a, 14] = high[2]
    rays[a, 15] = span
    rays[a, 16] = height
    rays[a, 17] = height_by_line


#: Functions that compiled loops call.
RAY_FORMULAS = (place_in_frame, _in_frame, draw_ray)
