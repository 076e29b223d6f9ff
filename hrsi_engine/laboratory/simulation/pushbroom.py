"""The physical model of a pushbroom image: exact rays in geocentric axes, both directions.

The satellite moves on a circle about the Earth's centre, ``S(t) = R (cos(wt) u + sin(wt) v)``. Its attitude law
keeps the line of sight of the middle detector on a circle over the ground,
``G(t) = C + r (sin(gt) f - (1 - cos(gt)) n)``, which touches the ellipsoid at the scene centre ``C`` and runs in the
scan direction ``f``; so any scan direction and any view angle of an agile satellite is possible. At each line the
sensor's axes are

* down ``z``, from S to G;
* left ``a = f(t) x z``, along which samples increase (an image scanned southwards has east on its right);
* forward ``x = z x a``.

Detector ``s`` looks along ``z + tan(angle of one pixel) (s - s0) a``: perspective across, scanning along. Position
and attitude errors are applied on top. Nothing here is shared with the rational polynomials of `rpc`: the model is
their independent truth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...ground.ellipsoid import curvature_radii
from ...ground.geodesy import LocalFrame, intersect_height, to_ecef
from .sensors import OrientationError, Sensor
from .world import constant, constants

GRAVITATION = 3.986004418e14  # m3 / s2, WGS84


@constants
class ORBIT:
    """Convergence of the camera's iterations."""

    line_closure_px: float = constant(1e-9, "px", "change of the line at convergence")
    most_iterations: int = constant(40, "iterations", "largest number of iterations")


@dataclass(frozen=True, eq=False)
class PushbroomCamera:
    """An image's exact geometry; make one with `aim_camera`. Vectors are geocentric unit vectors.

    Parameters
    ----------
    size : tuple of int
        Samples and lines.
    middle : tuple of float
        Sample and line at which the undisturbed sensor observes the scene centre.
    drift_lines : float
        After which the drifts of ``error`` are complete.
    pixel_rad : float
        Angle of one pixel.
    frame : LocalFrame
        Topocentric frame of the scene centre.
    centre : (3,) ndarray
        The scene centre, geocentric metres.
    scan_direction : (3,) ndarray
        In which the footprint moves.
    normal : (3,) ndarray
        Upwards at the scene centre.
    ground_radius_m : float
        Of the circle on which the footprint moves.
    scan_rad : float
        Angle from line to line on that circle.
    orbit_radius_m : float
        Of the circular orbit.
    zenith, flight_direction : (3,) ndarray
        Of the satellite at the middle line.
    orbit_rad : float
        Angle from line to line on the orbit.
    error : OrientationError
        What is added to position and attitude.
    """

    size: tuple[int, int]
    middle: tuple[float, float]
    drift_lines: float
    pixel_rad: float
    frame: LocalFrame
    centre: np.ndarray
    scan_direction: np.ndarray
    normal: np.ndarray
    ground_radius_m: float
    scan_rad: float
    orbit_radius_m: float
    zenith: np.ndarray
    flight_direction: np.ndarray
    orbit_rad: float
    error: OrientationError = OrientationError()

    def disturb(self, error: OrientationError) -> PushbroomCamera:
        """Return the same camera with other position and attitude errors.

        Parameters
        ----------
        error : OrientationError
            The errors.

        Returns
        -------
        PushbroomCamera
            The disturbed camera.
        """
        return replace(self, error=error)

    def coarsen(self, ratio: int) -> PushbroomCamera:
        """Return the camera of larger pixels, with the same upper left outer corner.

        Parameters
        ----------
        ratio : int
            Pixels of this camera along each side of a larger one.

        Returns
        -------
        PushbroomCamera
            The coarser camera.
        """
        centre_shift = (ratio - 1) / 2.0
        return replace(
            self,
            size=(self.size[0] // ratio, self.size[1] // ratio),
            middle=((self.middle[0] - centre_shift) / ratio, (self.middle[1] - centre_shift) / ratio),
            drift_lines=self.drift_lines / ratio,
            pixel_rad=self.pixel_rad * ratio,
            scan_rad=self.scan_rad * ratio,
            orbit_rad=self.orbit_rad * ratio,
            error=replace(
                self.error,
                vibration=replace(self.error.vibration, lines_per_line=self.error.vibration.lines_per_line * ratio),
            ),
        )

    # ---- exterior orientation ----------------------------------------------------------------------------------

    def exterior(self, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where the sensor is at a line, and how it is turned.

        Parameters
        ----------
        line : (n,) ndarray
            Lines in pixels.

        Returns
        -------
        tuple of (n, 3) ndarray and (n, 3, 3) ndarray
            Positions in metres and rotations with columns forward, right and down, in ECEF.
        """
        step = np.asarray(line, dtype=np.float64) - self.middle[1]
        position, forward, right, down = self._nominal(step)
        share = step / self.drift_lines
        position = position + self.error.position(share) @ self.frame.axes
        axes = np.stack([forward, right, down], axis=2)
        return position, axes @ make_rotation_matrices(self.error.attitude(share, step))

    def _nominal(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return position and axes forward, right and down ``(n, 3)`` without errors, ``step`` lines off the middle."""
        orbit, scan = (self.orbit_rad * step)[:, None], (self.scan_rad * step)[:, None]
        position = self.orbit_radius_m * (np.cos(orbit) * self.zenith + np.sin(orbit) * self.flight_direction)
        target = self.centre + self.ground_radius_m * (
            np.sin(scan) * self.scan_direction - 2.0 * np.sin(scan / 2.0) ** 2 * self.normal
        )
        tangent = np.cos(scan) * self.scan_direction - np.sin(scan) * self.normal
        down = _normalise(target - position)
        left = _normalise(np.cross(tangent, down))
        return position, np.cross(down, left), -left, down

    # ---- image to ground ---------------------------------------------------------------------------------------

    def rays(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays of image points in ECEF.

        Parameters
        ----------
        image : (n, 2) ndarray
            Sample, line in pixels.

        Returns
        -------
        tuple of (n, 3) ndarray
            Origins in metres and unit directions.
        """
        position, axes = self.exterior(image[:, 1])
        across = -(image[:, 0] - self.middle[0]) * self.pixel_rad
        look = axes[:, :, 2] + across[:, None] * axes[:, :, 1]
        return position, _normalise(look)

    def image_to_ground(self, image: np.ndarray, height_m: np.ndarray | float) -> np.ndarray:
        """Return the ground points where the rays of image points reach given heights.

        Parameters
        ----------
        image : (n, 2) ndarray
            Sample, line in pixels.
        height_m : (n,) ndarray or float
            Ellipsoidal heights.

        Returns
        -------
        (n, 3) ndarray
            Lon, lat in degrees, height in metres; NaN where a ray misses the Earth.
        """
        image = np.asarray(image, dtype=np.float64)
        return intersect_height(*self.rays(image), np.broadcast_to(np.asarray(height_m, np.float64), (len(image),)))

    # ---- ground to image ---------------------------------------------------------------------------------------

    def ground_to_image(self, ground: np.ndarray) -> np.ndarray:
        """Return sample, line ``(n, 2)`` of ground points ``(n, 3)``.

        Solved for the line on which a point lies in the plane of the detectors, by a secant iteration per point
        whose slope is kept near one pixel a line; so it converges from anywhere the sensor can be turned to, also
        tens of thousands of lines outside the image. NaN where it does not.

        Parameters
        ----------
        ground : (n, 3) ndarray
            Lon, lat in degrees, ellipsoidal height in metres.

        Returns
        -------
        (n, 2) ndarray
            Sample, line in pixels; NaN where the iteration does not converge.
        """
        target = to_ecef(np.asarray(ground, dtype=np.float64))
        line = np.full(len(target), self.middle[1])
        slope = np.full(len(target), -1.0)
        miss, sample = self._detector_position(target, line)
        for _ in range(ORBIT.most_iterations):
            active = np.flatnonzero(np.abs(miss) > ORBIT.line_closure_px)
            if not active.size:
                break
            step = -miss[active] / slope[active]
            line[active] += step
            previous = miss[active]
            miss[active], sample[active] = self._detector_position(target[active], line[active])
            change = (miss[active] - previous) / np.where(step == 0.0, 1.0, step)
            trusted = (np.abs(step) > 1e-3) & (change < -0.1) & (change > -10.0)
            slope[active] = np.where(trusted, change, slope[active])
        image = np.column_stack([sample, line])
        image[~(np.abs(miss) < 1e3 * ORBIT.line_closure_px)] = np.nan
        return image

    def _detector_position(self, target: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how many lines ahead of the detectors of ``line`` a point lies, and its sample there."""
        position, axes = self.exterior(line)
        forward, right, down = np.einsum("nij,ni->jn", axes, target - position)
        with np.errstate(divide="ignore", invalid="ignore"):
            return forward / down / self.pixel_rad, self.middle[0] - right / down / self.pixel_rad

    # ---- resolution --------------------------------------------------------------------------------------------

    def gsd_m(self) -> tuple[float, float]:
        """Return the ground distance in metres of neighbouring samples and lines at the image's middle.

        Returns
        -------
        tuple of float
            Metres across and along.
        """
        s, c = self.middle
        image = np.array([[s, c], [s + 1.0, c], [s, c + 1.0]])
        xyz = to_ecef(self.image_to_ground(image, self.frame.height_m))
        return float(np.linalg.norm(xyz[1] - xyz[0])), float(np.linalg.norm(xyz[2] - xyz[0]))


def aim_camera(
    sensor: Sensor,
    size: tuple[int, int],
    target: np.ndarray,
    along_deg: float = 0.0,
    across_deg: float = 0.0,
    heading_deg: float = 190.0,
    scan_deg: float | None = None,
) -> PushbroomCamera:
    """Return the undisturbed camera whose middle looks at a target.

    Parameters
    ----------
    sensor : Sensor
        The scanner.
    size : tuple of int
        Samples and lines.
    target : (3,) ndarray
        Lon, lat in degrees, ellipsoidal height in metres.
    along_deg, across_deg : float
        Off-nadir angles of the middle line of sight at the satellite, ahead of it and to its right.
    heading_deg : float
        Azimuth of the flight over the ground.
    scan_deg : float, optional
        Azimuth in which lines increase; by default the heading.

    Returns
    -------
    PushbroomCamera
        The camera.
    """
    frame = LocalFrame(*(float(value) for value in target))
    east, north, up = frame.axes
    centre = to_ecef(np.asarray(target, dtype=np.float64).reshape(1, 3))[0]
    position = _compute_position(sensor, frame, along_deg, across_deg, heading_deg)
    zenith = position / np.linalg.norm(position)
    heading = np.radians(heading_deg)
    flight = _normalise(_compute_across(np.sin(heading) * east + np.cos(heading) * north, zenith))
    scan = np.radians(heading_deg if scan_deg is None else scan_deg)
    # Euler's radius of curvature (m) of the ellipsoid in an azimuth, at the frame's height
    meridian, prime_vertical = curvature_radii(np.array([frame.lat_deg]))
    curvature = np.cos(scan) ** 2 / meridian[0] + np.sin(scan) ** 2 / prime_vertical[0]
    radius = float(1.0 / curvature + frame.height_m)
    pixel_rad = sensor.detector_angle_rad
    orbit_radius = float(np.linalg.norm(position))
    return PushbroomCamera(
        size=size,
        middle=((size[0] - 1) / 2.0, (size[1] - 1) / 2.0),
        drift_lines=float(size[1]),
        pixel_rad=pixel_rad,
        frame=frame,
        centre=centre,
        scan_direction=np.sin(scan) * east + np.cos(scan) * north,
        normal=up,
        ground_radius_m=radius,
        scan_rad=pixel_rad * float(np.linalg.norm(position - centre)) / radius,
        orbit_radius_m=orbit_radius,
        zenith=zenith,
        flight_direction=flight,
        orbit_rad=np.sqrt(GRAVITATION / orbit_radius**3) / sensor.line_rate_hz,
    )


def _compute_position(
    sensor: Sensor, frame: LocalFrame, along_deg: float, across_deg: float, heading_deg: float
) -> np.ndarray:
    """Return the satellite's ECEF position at its altitude that observes the frame's origin at the two angles."""
    target = to_ecef(np.array([[frame.lon_deg, frame.lat_deg, frame.height_m]]))
    target_tangents = np.tan(np.radians([along_deg, across_deg]))
    tangents = target_tangents.copy()
    heading = np.radians(heading_deg)
    forward = np.array([np.sin(heading), np.cos(heading), 0.0])
    right = np.array([np.cos(heading), -np.sin(heading), 0.0])
    for _ in range(30):
        upward = np.array([0.0, 0.0, 1.0]) - tangents[0] * forward - tangents[1] * right
        direction = _normalise(upward @ frame.axes)
        position = intersect_height(target, direction[None], np.array([sensor.altitude_m]), outward=True)
        current = _compute_look_tangents(position, target, forward @ frame.axes)
        tangents = tangents + (target_tangents - current)
    return to_ecef(position)[0]


def _compute_look_tangents(position: np.ndarray, target: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return the tangents of the off-nadir angles ahead and to the right at a satellite (lon, lat, height).

    The flight's direction at the ground, carried up there: azimuths of two places differ, and near a pole by anything.
    """
    look = target[0] - to_ecef(position)[0]
    up = LocalFrame(*position[0]).axes[2]
    forward = _normalise(_compute_across(heading, up))
    return np.array([look @ forward, look @ np.cross(forward, up)]) / -(look @ up)


def _compute_across(vector: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the part of a vector at right angles to a unit vector."""
    return np.asarray(vector - (vector @ normal) * normal)


def make_rotation_matrices(angles_rad: np.ndarray) -> np.ndarray:
    """Return ``Rx(roll) Ry(pitch) Rz(yaw)``, ``(n, 3, 3)``, of ``(n, 3)`` angles; SciPy's rotations refuse n = 0."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles_rad).T, np.cos(angles_rad).T
    return np.stack(
        [
            np.stack([cp * cy, -cp * sy, sp], axis=1),
            np.stack([cr * sy + sr * sp * cy, cr * cy - sr * sp * sy, -sr * cp], axis=1),
            np.stack([sr * sy - cr * sp * cy, sr * cy + cr * sp * sy, cr * cp], axis=1),
        ],
        axis=1,
    )


def _normalise(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
