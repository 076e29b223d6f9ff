"""Direction to the sun: at a place and time, or from its declination and hour angle.

Declination and right ascension follow the low-precision formulas of the Astronomical Almanac (page C5: 0.01 degree from
1950 to 2050). Refraction, below 0.1 degree at an elevation of 10 degrees or more, is neglected.
"""

from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

_EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)


class SunAngles(NamedTuple):
    """Direction to the sun in degrees: azimuth clockwise from north, elevation above the horizon."""

    azimuth_deg: float
    elevation_deg: float

    @property
    def direction(self) -> np.ndarray:
        """Unit vector ``(3,)`` east, north, up to the sun."""
        azimuth, elevation = np.radians(self)
        plan = np.cos(elevation)
        return np.array([plan * np.sin(azimuth), plan * np.cos(azimuth), np.sin(elevation)])


def sun_at_hour_angle(declination_rad: float, hour_angle_rad: float, lat_deg: float) -> SunAngles:
    """Return the direction to the sun at a latitude; the hour angle is counted westwards from the meridian."""
    lat, hour, declination = np.radians(lat_deg), hour_angle_rad, declination_rad
    up = np.sin(lat) * np.sin(declination) + np.cos(lat) * np.cos(declination) * np.cos(hour)
    east = -np.cos(declination) * np.sin(hour)
    north = np.cos(lat) * np.sin(declination) - np.sin(lat) * np.cos(declination) * np.cos(hour)
    return SunAngles(float(np.degrees(np.arctan2(east, north)) % 360.0), float(np.degrees(np.arcsin(up))))


def sun_at_time(time: datetime, lon_deg: float, lat_deg: float) -> SunAngles:
    """Return the direction to the sun at a place and time (with its zone), accurate to a few hundredths of a degree."""
    days = (time - _EPOCH).total_seconds() / 86400.0
    mean_longitude = np.radians(280.460 + 0.9856474 * days)
    anomaly = np.radians(357.528 + 0.9856003 * days)
    longitude = mean_longitude + np.radians(1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly))
    obliquity = np.radians(23.439 - 4e-7 * days)
    right_ascension = np.arctan2(np.cos(obliquity) * np.sin(longitude), np.cos(longitude))
    declination = float(np.arcsin(np.sin(obliquity) * np.sin(longitude)))
    sidereal = np.radians((280.46061837 + 360.98564736629 * days + lon_deg) % 360.0)
    return sun_at_hour_angle(declination, float(sidereal - right_ascension), lat_deg)
