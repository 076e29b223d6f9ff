"""Pushbroom sensors by name, and the errors with which their position and attitude are known.

Values are the published orbit, nadir ground sample distance, detector length and line rate of each satellite,
rounded; they set the scale of a simulation and do not copy any one product.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
LARGEST_DN = 2047  #: of 11 bits


@dataclass(frozen=True)
class Vibration:
    """Jitter of roll and pitch along the lines of a pass; lines are counted from the middle of the image.

    Roll moves the image in sample, pitch in line: by an angle over that of a pixel, against the angle's sign.

    Parameters
    ----------
    waves : tuple of tuple of float
        Period in lines, amplitude in rad and phase in rad of sines of the roll; that of the pitch is a quarter period
        ahead.
    curve : tuple of tuple of float
        Line, roll and pitch in rad, with lines that increase; a cubic spline between, mirrored at its ends.
    start_line : float
        Line of the curve, and of the sines, at the middle of the image.
    lines_per_line : float
        Lines of the curve in a line of the image, whose pixels may be larger.
    """

    waves: tuple[Vector, ...] = ()
    curve: tuple[Vector, ...] = ()
    start_line: float = 0.0
    lines_per_line: float = 1.0

    def compute_angles(self, line: np.ndarray) -> np.ndarray:
        """Return roll and pitch.

        Parameters
        ----------
        line : (n,) ndarray
            Lines from the middle of the image.

        Returns
        -------
        (n, 2) ndarray
            Radians.
        """
        curve_line = self.start_line + self.lines_per_line * np.asarray(line, dtype=np.float64)
        angles = np.zeros((len(curve_line), 2))
        for period, amplitude, phase in self.waves:
            turn = 2.0 * np.pi * curve_line / period + phase
            angles += amplitude * np.column_stack([np.sin(turn), np.cos(turn)])
        if self._spline is not None:
            first, last = self._spline.x[[0, -1]]
            from_end = np.mod(curve_line - first, 2.0 * (last - first)) - (last - first)
            angles += self._spline(last - np.abs(from_end))
        return angles

    @property
    def curvature_rad(self) -> float:
        """Upper bound of the second derivative of an angle, rad by the square of a line of the image."""
        curvature = sum(amplitude * (2.0 * np.pi / period) ** 2 for period, amplitude, _ in self.waves)
        if self._spline is not None:
            curvature += float(np.abs(self._spline(self._spline.x, 2)).max())
        return float(curvature * self.lines_per_line**2)

    @cached_property
    def _spline(self) -> CubicSpline | None:
        """Roll and pitch by the line of the curve; None without a curve."""
        table = np.array(self.curve)
        return CubicSpline(table[:, 0], table[:, 1:]) if self.curve else None


@dataclass(frozen=True)
class OrientationError:
    """What is added to a camera's exact position and attitude.

    A drift is the change over the whole image, zero at its middle line.

    Parameters
    ----------
    position_m, position_drift_m : tuple of float
        Metres east, north and up in the topocentric frame of the scene centre (dX, dY, dH).
    attitude_rad, attitude_drift_rad : tuple of float
        Roll, pitch and yaw about the sensor's own axes forward, right and down.
    vibration : Vibration
        Jitter within the image.
    """

    position_m: Vector = ZERO
    position_drift_m: Vector = ZERO
    attitude_rad: Vector = ZERO
    attitude_drift_rad: Vector = ZERO
    vibration: Vibration = Vibration()

    def position(self, share: np.ndarray) -> np.ndarray:
        """Return the error of the position.

        Parameters
        ----------
        share : (n,) ndarray
            -0.5 at the first line, 0.5 at the last.

        Returns
        -------
        (n, 3) ndarray
            Metres.
        """
        return np.asarray(self.position_m) + share[:, None] * np.asarray(self.position_drift_m)

    def attitude(self, share: np.ndarray, line: np.ndarray) -> np.ndarray:
        """Return the error of the attitude.

        Parameters
        ----------
        share : (n,) ndarray
            -0.5 at the first line, 0.5 at the last.
        line : (n,) ndarray
            From the middle of the image, for the jitter.

        Returns
        -------
        (n, 3) ndarray
            Roll, pitch and yaw in radians.
        """
        angles = np.asarray(self.attitude_rad) + share[:, None] * np.asarray(self.attitude_drift_rad)
        angles[:, :2] += self.vibration.compute_angles(line)
        return angles


@dataclass(frozen=True)
class Radiometry:
    """How grey values become digital numbers of 11 bits.

    Parameters
    ----------
    gain, offset : float
        ``gain * grey + offset``.
    psf_px : float
        Standard deviation of the point spread function.
    noise_dn, shot_dn : float
        The noise of a digital number D has the variance ``noise_dn ** 2 + shot_dn * D``.
    """

    gain: float = 1.0
    offset: float = 0.0
    psf_px: float = 0.5
    noise_dn: float = 2.0
    shot_dn: float = 0.02


class AccuracyStatement(NamedTuple):
    """Standard deviations of a vendor's orbit and attitude of a satellite.

    Parameters
    ----------
    position_m, position_drift_m : float
        Of each axis.
    attitude_rad, attitude_drift_rad : float
        About each axis.
    """

    position_m: float
    position_drift_m: float
    attitude_rad: float
    attitude_drift_rad: float

    def draw(self, rng: np.random.Generator, scale: float = 1.0) -> OrientationError:
        """Draw one image's error, every component independent and normal.

        Parameters
        ----------
        rng : numpy.random.Generator
            Where the numbers come from.
        scale : float
            Factor of all standard deviations.

        Returns
        -------
        OrientationError
            The error.
        """

        def triple(sigma: float) -> Vector:
            east, north, up = scale * sigma * rng.standard_normal(3)
            return float(east), float(north), float(up)

        return OrientationError(
            position_m=triple(self.position_m),
            position_drift_m=triple(self.position_drift_m),
            attitude_rad=triple(self.attitude_rad),
            attitude_drift_rad=triple(self.attitude_drift_rad),
        )


@dataclass(frozen=True)
class Sensor:
    """A pushbroom scanner on a circular orbit.

    Parameters
    ----------
    name : str
        Its name.
    altitude_m, gsd_m : float
        They fix the angle of one detector.
    samples : int
        Of the full detector line.
    line_rate_hz : float
        It fixes how far the satellite flies from line to line.
    accuracy : AccuracyStatement
        Of its orbit and attitude.
    ms_ratio : int
        Size of a multispectral pixel in panchromatic ones.
    """

    name: str
    altitude_m: float
    gsd_m: float
    samples: int
    line_rate_hz: float
    accuracy: AccuracyStatement
    ms_ratio: int = 4

    @property
    def detector_angle_rad(self) -> float:
        """Angle of one pixel seen from the sensor."""
        return self.gsd_m / self.altitude_m


SENSORS: dict[str, Sensor] = {
    "ikonos": Sensor("IKONOS", 681e3, 0.82, 13816, 6500.0, AccuracyStatement(2.0, 0.2, 10e-6, 0.3e-6)),
    "quickbird": Sensor("QuickBird", 450e3, 0.61, 27552, 6900.0, AccuracyStatement(2.0, 0.5, 30e-6, 4e-6)),
    "worldview-2": Sensor("WorldView-2", 770e3, 0.46, 35420, 20000.0, AccuracyStatement(1.0, 0.1, 4e-6, 0.2e-6)),
    "pleiades": Sensor("Pleiades", 694e3, 0.70, 30000, 13600.0, AccuracyStatement(1.0, 0.1, 6e-6, 0.3e-6)),
    "spot5": Sensor("SPOT 5", 832e3, 2.50, 24000, 2660.0, AccuracyStatement(2.0, 0.3, 40e-6, 2e-6)),
    "wide-field": Sensor("wide field", 645e3, 16.0, 12000, 425.0, AccuracyStatement(20.0, 3.0, 100e-6, 20e-6)),
}
