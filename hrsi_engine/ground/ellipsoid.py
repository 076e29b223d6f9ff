"""The formulas of the WGS84 ellipsoid, each written once for numbers and for arrays.

Every function takes numbers or arrays of one shape and returns the same kind: `geodesy` calls them with columns of many
points, compiled loops point by point (numba compiles the same source). Angles are in degrees, lengths in metres.

With a the semi-major axis, e² the squared eccentricity and w² = 1 - e² sin² lat the radii of curvature are
N = a / w (prime vertical) and M = N (1 - e²) / w² (meridian). Source: Torge and Müller, Geodesy, 4th ed., section 4.1;
the inverse of `geocentric` is Bowring's (Survey Review 23, 1976), iterated.
"""

from typing import TypeVar

import numpy as np

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1.0 - FLATTENING)
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
SECOND_ECCENTRICITY_SQUARED = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED)
BOWRING_STEPS = 4  # error below a micrometre from the sea floor to satellite orbits

Number = TypeVar("Number", float, np.ndarray)
Couple = tuple[Number, Number]
Triple = tuple[Number, Number, Number]


def wrap_once(difference_deg: Number) -> Number:
    """Return longitude differences in [-180, 180): 359.9 becomes -0.1."""
    return difference_deg - 360.0 * np.floor((difference_deg + 180.0) / 360.0)


def curvature_radii(lat_deg: Number) -> tuple[Number, Number]:
    """Return the radii of curvature (m) in the meridian (M) and in the prime vertical (N)."""
    sine = np.sin(np.radians(lat_deg))
    w2 = 1.0 - ECCENTRICITY_SQUARED * sine * sine
    prime_vertical = SEMI_MAJOR_M / np.sqrt(w2)
    return prime_vertical * (1.0 - ECCENTRICITY_SQUARED) / w2, prime_vertical


def metres_of_a_degree(lat_deg: Number, height_m: Number) -> tuple[Number, Number]:
    """Return metres per degree of longitude and of latitude at a latitude and height."""
    meridian, prime_vertical = curvature_radii(lat_deg)
    across = np.radians(prime_vertical + height_m) * np.cos(np.radians(lat_deg))
    return across, np.radians(meridian + height_m)


def geocentric(lon_deg: Number, lat_deg: Number, height_m: Number) -> Triple[Number]:
    """Return geocentric x, y, z (EPSG:4978)."""
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    _, prime_vertical = curvature_radii(lat_deg)
    across = (prime_vertical + height_m) * np.cos(lat)
    z = (prime_vertical * (1.0 - ECCENTRICITY_SQUARED) + height_m) * np.sin(lat)
    return across * np.cos(lon), across * np.sin(lon), z


def geodetic(x: Number, y: Number, z: Number) -> Triple[Number]:
    """Return longitude, latitude and height of geocentric x, y, z."""
    across = np.hypot(x, y)
    reduced = np.arctan2(z, across * (1.0 - FLATTENING))
    lat = reduced
    for _ in range(BOWRING_STEPS):
        up = z + SECOND_ECCENTRICITY_SQUARED * SEMI_MINOR_M * np.sin(reduced) ** 3
        lat = np.arctan2(up, across - ECCENTRICITY_SQUARED * SEMI_MAJOR_M * np.cos(reduced) ** 3)
        reduced = np.arctan2((1.0 - FLATTENING) * np.sin(lat), np.cos(lat))
    sine, cosine = np.sin(lat), np.cos(lat)
    height = across * cosine + z * sine - SEMI_MAJOR_M * np.sqrt(1.0 - ECCENTRICITY_SQUARED * sine * sine)
    return np.degrees(np.arctan2(y, x)), np.degrees(lat), height


def axes(lon_deg: Number, lat_deg: Number) -> tuple[Triple[Number], Triple[Number], Triple[Number]]:
    """Return the east, north and up unit vectors at a position, each as geocentric x, y, z."""
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    sin_lon, cos_lon, sin_lat, cos_lat = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
    east = -sin_lon, cos_lon, 0.0 * cos_lon
    north = -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat
    up = cos_lat * cos_lon, cos_lat * sin_lon, sin_lat
    return east, north, up


#: The functions that compiled loops call.
ELLIPSOID_FORMULAS = (wrap_once, curvature_radii, metres_of_a_degree, geocentric, geodetic, axes)
