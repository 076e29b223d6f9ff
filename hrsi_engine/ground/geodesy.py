"""Coordinates on and above the WGS84 ellipsoid.

Ground coordinates are arrays ``(n, 3)`` of ``(lon, lat, height)``: degrees, degrees, ellipsoidal metres.
They are converted to three metric systems:

* ECEF, the geocentric axes (EPSG:4978);
* a `LocalFrame`: topocentric east, north, up about one origin, for rays and pseudo sensors;
* local metric steps: one metre east, north or up *at each point* in degrees and metres (`metres_per_degree`). The
  unknowns of the adjustment are such steps, so that standard deviations of surveys apply directly.

Other CRS and height datums are converted by `crs_operations` and `geoids`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import ellipsoid

#: EPSG codes of WGS84: geographic 2D, geographic 3D.
WGS84, WGS84_3D = 4326, 4979

ONE_PLACE_DEG = 90.0  # longitudes closer together than this across the 180 degree meridian belong to one place


def metres_per_degree(ground: np.ndarray) -> np.ndarray:
    """Return ``(n, 3)``: metres per degree of lon and lat, and 1 for the height, at each ground point.

    Small differences of ground coordinates times these factors are east, north, up in metres.
    """
    factors = np.ones_like(ground)
    factors[:, 0], factors[:, 1] = ellipsoid.metres_of_a_degree(ground[:, 1], ground[:, 2])
    return factors


def wrap_degrees(difference_deg: np.ndarray) -> np.ndarray:
    """Return longitude differences in [-180, 180): 359.9 becomes -0.1."""
    return ellipsoid.wrap_once(difference_deg)


def continuous_longitudes(lon_deg: np.ndarray) -> np.ndarray:
    """Return the longitudes ``(n,)`` of one place without the jump at 180 degrees; NaN is kept.

    They are in [-180, 180). If a place of less than `ONE_PLACE_DEG` crosses 180 degrees, its longitudes in the western
    hemisphere are increased by 360.
    """
    wrapped = wrap_degrees(np.asarray(lon_deg, dtype=np.float64))
    finite = wrapped[np.isfinite(wrapped)]
    if not finite.size or np.ptp(finite) <= 360.0 - ONE_PLACE_DEG:
        return wrapped
    eastwards = np.where(wrapped < 0.0, wrapped + 360.0, wrapped)
    return eastwards if np.ptp(eastwards[np.isfinite(eastwards)]) < ONE_PLACE_DEG else wrapped


def are_continuous(lon_deg: np.ndarray) -> bool:
    """Return whether longitudes ``(n,)``, or their extremes, need no change by `continuous_longitudes`; NaN is ignored.

    True if all are in [-180, 180) and their range is at most three quarters of a turn.
    """
    west, east = np.fmin.reduce(lon_deg), np.fmax.reduce(lon_deg)
    return bool(west >= -180.0 and east < 180.0 and east - west <= 360.0 - ONE_PLACE_DEG)


def longitudes_near(lon_deg: np.ndarray, middle_deg: float, half_width_deg: float) -> np.ndarray:
    """Return longitudes ``(n,)`` within half a turn of an area's middle, NaN for those on the other side of the Earth.

    At the cut opposite the middle, a line across it would seem to be a full turn long. Longitudes closer to the cut
    than to the end of the area are therefore NaN.
    """
    difference_deg = wrap_degrees(lon_deg - middle_deg)
    return np.where(np.abs(difference_deg) <= 0.5 * (180.0 + half_width_deg), middle_deg + difference_deg, np.nan)


def ground_difference_m(ground: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return ``ground - reference`` in metres east, north, up, ``(n, 3)``.

    ground, reference : (n, 3) lon, lat in degrees, height in metres
    Result: (n, 3) east, north, up in metres.
    """
    difference = ground - reference
    difference[:, 0] = wrap_degrees(difference[:, 0])
    return difference * metres_per_degree(reference)


def distances_m(ground: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the straight (chord) distances between points in metres, valid at the poles and across 180 degrees.

    ground, reference : (n, 3) lon, lat in degrees, height in metres
    """
    return np.linalg.norm(to_ecef(ground) - to_ecef(reference), axis=1)


def move_ground(ground: np.ndarray, step_m: np.ndarray) -> np.ndarray:
    """Return ground points moved by small steps in metres east, north, up."""
    return ground + step_m / metres_per_degree(ground)


def to_ecef(ground: np.ndarray) -> np.ndarray:
    """Return geocentric x, y, z in metres, ``(n, 3)``.

    ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres
    Result: (n, 3) geocentric x, y, z in metres.
    """
    return np.column_stack(ellipsoid.geocentric(ground[:, 0], ground[:, 1], ground[:, 2]))


def from_ecef(xyz: np.ndarray) -> np.ndarray:
    """Return lon, lat, height of geocentric points; Bowring's formula, iterated to less than a micrometre.

    xyz : (n, 3) geocentric x, y, z in metres
    Result: (n, 3) lon, lat in degrees, ellipsoidal height in metres.
    """
    return np.column_stack(ellipsoid.geodetic(xyz[:, 0], xyz[:, 1], xyz[:, 2]))


def east_north_up(lon_deg: np.ndarray, lat_deg: np.ndarray) -> np.ndarray:
    """Return the east, north and up unit vectors at points, rows of ``(n, 3, 3)`` in geocentric x, y, z."""
    return np.moveaxis(np.array(ellipsoid.axes(lon_deg, lat_deg)), -1, 0)


def intersect_height(
    origin: np.ndarray, direction: np.ndarray, height_m: np.ndarray | float, outward: bool = False
) -> np.ndarray:
    """Return lon, lat, height ``(n, 3)`` where geocentric rays reach ellipsoidal heights; NaN where they miss.

    Starts on the ellipsoid with axes enlarged by the height (sub-metre off) and ends by two Newton steps along the
    ray: the first leaves micrometres, the second less than rounding.

    origin, direction : (n, 3) m and unit vectors; height_m : (n,), or one for all
    outward : True for the far of the two intersections: a ray from the ground up to a satellite
    """
    axes = np.array([ellipsoid.SEMI_MAJOR_M, ellipsoid.SEMI_MAJOR_M, ellipsoid.SEMI_MINOR_M]) + np.reshape(
        height_m, (-1, 1)
    )
    p, d = origin / axes, direction / axes
    a, b, c = (d * d).sum(1), (p * d).sum(1), (p * p).sum(1) - 1.0
    with np.errstate(invalid="ignore"):
        distance = (-b + (1.0 if outward else -1.0) * np.sqrt(b * b - a * c)) / a
    for _ in range(2):
        ground = from_ecef(origin + distance[:, None] * direction)
        up = east_north_up(ground[:, 0], ground[:, 1])[:, 2]
        distance = distance + (height_m - ground[:, 2]) / (direction * up).sum(1)
    return from_ecef(origin + distance[:, None] * direction)


@dataclass(frozen=True)
class LocalFrame:
    """Topocentric frame: east, north and up in metres from an origin.

    lon_deg, lat_deg : position of the origin; height_m : its ellipsoidal height
    """

    lon_deg: float
    lat_deg: float
    height_m: float = 0.0

    @cached_property
    def origin(self) -> np.ndarray:
        return to_ecef(np.array([[self.lon_deg, self.lat_deg, self.height_m]]))[0]

    @cached_property
    def axes(self) -> np.ndarray:
        return east_north_up(np.array([self.lon_deg]), np.array([self.lat_deg]))[0]

    def from_ground(self, ground: np.ndarray) -> np.ndarray:
        """Return ``(n, 3)`` east, north, up metres of lon, lat, height points.

        ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres
        Result: (n, 3) east, north, up in metres.
        """
        return (to_ecef(ground) - self.origin) @ self.axes.T

    def to_ground(self, local: np.ndarray) -> np.ndarray:
        """Return ``(n, 3)`` lon, lat, height of east, north, up points.

        local : (n, 3) east, north, up in metres
        Result: (n, 3) lon, lat in degrees, ellipsoidal height in metres.
        """
        return from_ecef(local @ self.axes + self.origin)
