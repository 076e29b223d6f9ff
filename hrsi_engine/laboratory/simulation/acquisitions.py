"""Dates: on which day an image is taken, the position of the sun, and what the air and the sensor do.

The sun's direction follows from its declination and hour angle (Cooper, 1969, Solar Energy 12, 333-346).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...ground.sun import SunAngles, sun_at_hour_angle
from .sensors import Radiometry
from .world import constant, constants

YEAR_DAYS = 365.0


@constants
class DATES:
    """Time of day, snow and air of the dates of a year."""

    overpass_hour: float = constant(10.5, "h", "mean local solar time of the overpass", "sun-synchronous orbits")
    overpass_spread_h: float = constant(0.3, "h", "standard deviation of the time of overpass")
    winter_days: float = constant(75.0, "d", "days before and after the turn of the year on which snow may lie")
    snow_chance: float = constant(0.4, "", "chance of snow on a winter date")
    most_haze: float = constant(0.35, "", "largest share of haze in the light")
    haze_grey: float = constant(420.0, "DN", "grey value of haze")
    full_sun_deg: float = constant(
        60.0, "°", "elevation of the sun at which the grey values of the land covers are defined"
    )
    ambient: float = constant(0.3, "", "share of the light on flat ground that comes from the sky")


AXIS_DEG = 23.44


@dataclass(frozen=True)
class Acquisition:
    """What is different on the day when an image is taken.

    Parameters
    ----------
    number : int
        Of the date, from 1.
    day : float
        Of the year, from 0.
    sun_azimuth_deg, sun_elevation_deg : float
        Clockwise from north, and above the horizon.
    snow : float
        Share of the open land under snow.
    haze : float
        Share of the light that is the air's own.
    gain : float
        Of the sensor's setting that day.
    """

    number: int
    day: float
    sun_azimuth_deg: float
    sun_elevation_deg: float
    snow: float = 0.0
    haze: float = 0.0
    gain: float = 1.0

    @property
    def sun(self) -> np.ndarray:
        """Unit vector ``(3,)`` east, north, up towards the sun."""
        return SunAngles(self.sun_azimuth_deg, self.sun_elevation_deg).direction

    def radiometry(self, usual: Radiometry) -> Radiometry:
        """Return how grey values become digital numbers under this sun and air.

        Parameters
        ----------
        usual : Radiometry
            Under a high sun in clear air.

        Returns
        -------
        Radiometry
            With the gain and the offset of the date.
        """
        light = DATES.ambient + (1.0 - DATES.ambient) * np.sin(np.radians(self.sun_elevation_deg)) / np.sin(
            np.radians(DATES.full_sun_deg)
        )
        gain = usual.gain * self.gain
        return replace(
            usual,
            gain=float(gain * (1.0 - self.haze) * light),
            offset=usual.offset + gain * self.haze * DATES.haze_grey,
        )


def compute_sun_position(day: float, solar_hour: float, lat_deg: float) -> SunAngles:
    """Return azimuth (clockwise from north) and elevation of the sun in degrees.

    Parameters
    ----------
    day : float
        Of the year, from 0.
    solar_hour : float
        Local solar time, 12 at noon.
    lat_deg : float
        Latitude.

    Returns
    -------
    SunAngles
        Azimuth and elevation.
    """
    declination = np.radians(AXIS_DEG) * np.sin(2.0 * np.pi * (285.0 + day) / YEAR_DAYS)
    return sun_at_hour_angle(float(declination), float(np.radians(15.0 * (solar_hour - 12.0))), lat_deg)


def draw_acquisitions(count: int, lat_deg: float, seed: int) -> tuple[Acquisition, ...]:
    """Return dates spread over a year, one in each of ``count`` equal parts of it, with their sun, snow and air.

    Parameters
    ----------
    count : int
        Number of dates.
    lat_deg : float
        Latitude of the scene.
    seed : int
        Of the draws.

    Returns
    -------
    tuple of Acquisition
        In the order of time.
    """
    rng = np.random.default_rng([seed, 60])
    acquisitions = []
    for number in range(count):
        day = float(YEAR_DAYS * (number + rng.random()) / count)
        azimuth, elevation = compute_sun_position(
            day, DATES.overpass_hour + DATES.overpass_spread_h * rng.standard_normal(), lat_deg
        )
        winter = (
            min(compute_day_of_season(day, lat_deg), YEAR_DAYS - compute_day_of_season(day, lat_deg))
            < DATES.winter_days
        )
        snow = float(rng.uniform(0.4, 1.0)) if rng.random() < DATES.snow_chance and winter else 0.0
        haze, gain = float(DATES.most_haze * rng.random() ** 2), float(rng.uniform(0.8, 1.2))
        acquisitions.append(
            Acquisition(
                number + 1, day, azimuth, sun_elevation_deg=max(elevation, 5.0), snow=snow, haze=haze, gain=gain
            )
        )
    return tuple(acquisitions)


def compute_day_of_season(day: float, lat_deg: float) -> float:
    """Return the day of the northern year with the same season."""
    return float((day + (YEAR_DAYS / 2.0 if lat_deg < 0.0 else 0.0)) % YEAR_DAYS)
