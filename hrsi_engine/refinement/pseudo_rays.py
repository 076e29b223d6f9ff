"""Pseudo light rays of image points, as the generic method needs them (thesis section 4.3, step 1; eqs. 4.10-4.11).

The ray of an image point goes through its ground positions at the two ends of the RPC's height range, in a topocentric
frame about the middle of the image. X runs along the samples and Y to its left (against the lines), so that psi_x is
roll and psi_y is pitch; z is up. The pseudo sensor is where the ray reaches the height H at which the rays of its line
meet::

    X(z) = Xs + (H - z) tan(psi_x)        Y(z) = Ys + (H - z) tan(psi_y)

The thesis fixes H ("e.g. 600 km"); any value describes small corrections well. Corrections of 0.1 rad must turn the
rays where they really meet: 100 m of height there, as an orbit curves over an image, are 10 m on the ground.

RPCs are not made of straight rays exactly; what the middle of the height range misses (the *sag*, usually far below a
millimetre) is kept as a parabola, so that a pseudo sensor without corrections is the RPC itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..block.block import Image
from ..camera.rpc import RPC
from ..foundation.errors import SolveError
from ..ground.geodesy import LocalFrame

#: Height of the pseudo sensor (m) where the rays of a line do not meet at any believable one: nearly parallel rays.
USUAL_SENSOR_HEIGHT_M = 600e3
BELIEVABLE_HEIGHTS_M = (1e3, 2e6)  # from aircraft to the highest mapping satellites
MOST_CLIMB = 0.02  # of the sensor's height over half an image; more is noise of nearly parallel rays
SMALLEST_RANGE_M = 100.0  # apart of the two heights of a ray, where an RPC states less


@dataclass(frozen=True)
class SensorFrame:
    """The frame of an image's pseudo sensor: `LocalFrame` turned about its up axis by ``azimuth_rad``.

    ``heights_m`` are z of the pseudo sensor at the first, middle and last line, ``lines`` the middle line and half
    their number.
    """

    local: LocalFrame
    azimuth_rad: float
    lines: tuple[float, float]
    heights_m: tuple[float, float, float] = (USUAL_SENSOR_HEIGHT_M,) * 3

    @cached_property
    def _turn(self) -> np.ndarray:
        """Rows: the X, Y and z axes in east, north, up."""
        cos, sin = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])

    @property
    def height_m(self) -> float:
        """Height of the pseudo sensor in the middle of the image."""
        return self.heights_m[1]

    def heights_at(self, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return z of the pseudo sensor at lines ``(n,)`` and its change from line to line: a parabola."""
        first, middle, last = self.heights_m
        v = (line - self.lines[0]) / self.lines[1]
        slope, bend = (last - first) / 2.0, (first + last) / 2.0 - middle
        return middle + slope * v + bend * v**2, (slope + 2.0 * bend * v) / self.lines[1]

    @cached_property
    def axes(self) -> np.ndarray:
        """Rows: the X, Y and z axes in geocentric coordinates."""
        return np.asarray(self._turn @ self.local.axes)

    @property
    def origin(self) -> np.ndarray:
        """Geocentric position of the origin."""
        return self.local.origin

    def from_ground(self, ground: np.ndarray) -> np.ndarray:
        """Return X, Y, z in metres, ``(n, 3)``, of lon, lat, height points."""
        return self.local.from_ground(ground) @ self._turn.T

    def to_ground(self, position: np.ndarray) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` of X, Y, z points."""
        return self.local.to_ground(position @ self._turn)

    def rotation_to(self, ground: np.ndarray) -> np.ndarray:
        """Return ``(n, 3, 3)``: derivatives of X, Y, z by a metre east, north and up at each point."""
        return np.asarray(self._turn @ self.local.rotation_to(ground))


@dataclass(frozen=True, eq=False)
class PseudoRays:
    """Rays of n image points in a local frame.

    station : (n, 2) Xs, Ys at the pseudo sensor's height; tangent : (n, 2) tan psi_x, tan psi_y
    station_by_image, tangent_by_image : (n, 2, 2) their derivatives by sample and line
    sag : (n, 2) metres east and north by which the RPC lies beside the straight ray at half its height
    top, span : (n,) frame height of the upper end, and how far below it the lower end lies
    height, height_by_line : (n,) z of the pseudo sensor, and its change from line to line
    """

    station: np.ndarray
    tangent: np.ndarray
    station_by_image: np.ndarray
    tangent_by_image: np.ndarray
    sag: np.ndarray
    top: np.ndarray
    span: np.ndarray
    height: np.ndarray
    height_by_line: np.ndarray

    def table(self) -> np.ndarray:
        """Return the rays as ``(n, 18)``, in the order in which the fields are named above."""
        n = len(self.station)
        return np.column_stack(
            [
                self.station, self.tangent, self.station_by_image.reshape(n, 4), self.tangent_by_image.reshape(n, 4),
                self.sag, self.top, self.span, self.height, self.height_by_line,
            ]
        )  # fmt: skip


def sensor_frame(image: Image) -> SensorFrame:
    """Return the frame of an image: its origin below the middle of the image, on the ellipsoid."""
    middle = image.rpc.localize(image.centre_px[None], image.rpc.height_off).ground[0]
    if not np.isfinite(middle).all():
        raise SolveError(f"{image.id}: the RPC has no ground position for the middle of the image: check that both fit")
    lines = float(image.centre_px[1]), float(image.half_size_px[1])
    level = SensorFrame(LocalFrame(float(middle[0]), float(middle[1])), 0.0, lines)
    ends = np.array([[u, v] for v in (-1.0, 0.0, 1.0) for u in (-1.0, 1.0)])
    rays = pseudo_rays(image.rpc, level, image.centre_px + image.half_size_px * ends)
    east, north = np.diff((rays.station + rays.height[:, None] * rays.tangent)[2:4], axis=0)[0]
    return replace(level, azimuth_rad=float(np.arctan2(north, east)), heights_m=_meeting_heights(rays))


def _meeting_heights(rays: PseudoRays) -> tuple[float, float, float]:
    """Return z where the rays of both ends of three lines are nearest to each other: where the sensor was."""
    apart = rays.station[1::2] - rays.station[::2]
    opening = rays.tangent[1::2] - rays.tangent[::2]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, middle, last = rays.height[::2] + np.sum(apart * opening, axis=1) / np.sum(opening**2, axis=1)
    low, high = BELIEVABLE_HEIGHTS_M
    if not low <= middle <= high:
        return (USUAL_SENSOR_HEIGHT_M,) * 3
    if not max(abs(first - middle), abs(last - middle)) <= MOST_CLIMB * middle:
        return (float(middle),) * 3
    return float(first), float(middle), float(last)


def ray_heights(rpc: RPC) -> tuple[float, float]:
    """Return the two ellipsoidal heights (m) that rays go through."""
    reach = max(abs(rpc.height_scale), SMALLEST_RANGE_M / 2.0)
    return rpc.height_off - reach, rpc.height_off + reach


def pseudo_rays(rpc: RPC, frame: SensorFrame, image_px: np.ndarray) -> PseudoRays:
    """Return the rays of image points ``(n, 2)``; NaN where the RPC has no ground position for a point."""
    low, high = ray_heights(rpc)
    lower, lower_by_image = _ground_and_slope(rpc, frame, image_px, low)
    upper, upper_by_image = _ground_and_slope(rpc, frame, image_px, high)
    span = upper[:, 2] - lower[:, 2]
    tangent = (lower - upper)[:, :2] / span[:, None]
    widening = upper_by_image[:, 2] - lower_by_image[:, 2]
    tangent_by_image = (lower_by_image - upper_by_image)[:, :2] - tangent[:, :, None] * widening[:, None, :]
    tangent_by_image /= span[:, None, None]
    height, height_by_line = frame.heights_at(image_px[:, 1])
    rise = upper[:, 2] - height
    station = upper[:, :2] + rise[:, None] * tangent
    station_by_image = (
        upper_by_image[:, :2]
        + rise[:, None, None] * tangent_by_image
        + tangent[:, :, None] * upper_by_image[:, 2][:, None, :]
    )
    station_by_image[:, :, 1] -= tangent * height_by_line[:, None]
    middle = frame.from_ground(rpc.localize(image_px, (low + high) / 2.0).ground)
    straight = upper[:, :2] + (upper[:, 2] - middle[:, 2])[:, None] * tangent
    return PseudoRays(
        station, tangent, station_by_image, tangent_by_image, middle[:, :2] - straight, upper[:, 2], span,
        height, height_by_line,
    )  # fmt: skip


def _ground_and_slope(
    rpc: RPC, frame: SensorFrame, image_px: np.ndarray, height_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return frame positions ``(n, 3)`` of image points at one height and their derivatives ``(n, 3, 2)`` by them."""
    ground = rpc.localize(image_px, height_m).ground
    _, by_ground = rpc.project_with_metric_jacobian(ground)
    determinant = np.linalg.det(by_ground[:, :, :2])
    by_ground[~(np.abs(determinant) > 0.0)] = np.nan
    return frame.from_ground(ground), frame.rotation_to(ground)[:, :, :2] @ _inverse(by_ground[:, :, :2])


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Return the inverses of 2 x 2 matrices ``(n, 2, 2)``; NaN stays NaN."""
    (a, b), (c, d) = matrices[:, 0].T, matrices[:, 1].T
    return np.stack([np.stack([d, -b], axis=1), np.stack([-c, a], axis=1)], axis=1) / (a * d - b * c)[:, None, None]
