"""The map projection of a place: its UTM zone, or polar stereographic (UPS) beyond the UTM latitudes.

The UTM grid is used with its exceptions: 32V extends to 3 degrees east off south-west Norway, and Svalbard has only the
zones 31X, 33X, 35X and 37X. UPS is used north of 84 and south of 80 degrees, where the UTM grid ends. Source: DMA TM
8358.2, The Universal Grids, sections 2-2 and 3-2.
"""

from collections.abc import Sequence

import numpy as np
import pyproj
from pyproj.aoi import AreaOfInterest
from pyproj.enums import PJType

from ..foundation.errors import InputError
from ..foundation.thresholds import threshold, thresholds
from .crs_operations import operations_of
from .geodesy import continuous_longitudes, wrap_degrees


@thresholds
class LOCAL_CRS:
    """Limit for the CRS of coordinates that state none."""

    margin_m: float = threshold(50e3, "m", "largest distance of coordinates from the place where they must lie")


UTM_LATITUDES = (-80.0, 84.0)  # limits of the UTM grid
#: UPS south and north with easting first: EPSG codes.
UPS_SOUTH, UPS_NORTH = 5042, 5041
#: South, north, west, east of the areas whose zone differs from that of the meridian, and their zone.
ZONE_EXCEPTIONS = (
    (56.0, 64.0, 3.0, 12.0, 32),
    (72.0, 84.0, 0.0, 9.0, 31),
    (72.0, 84.0, 9.0, 21.0, 33),
    (72.0, 84.0, 21.0, 33.0, 35),
    (72.0, 84.0, 33.0, 42.0, 37),
)


def utm_zone(lon_deg: float, lat_deg: float) -> int:
    """Return the number of the UTM zone of a position, 1 to 60; outside the UTM grid by its longitude."""
    lon = float(wrap_degrees(np.array(lon_deg)))
    for south, north, west, east, zone in ZONE_EXCEPTIONS:
        if south <= lat_deg < north and west <= lon < east:
            return zone
    return int((lon + 180.0) // 6.0) + 1


def map_epsg(lon_deg: float, lat_deg: float) -> int:
    """Return the EPSG code of the projected CRS for maps of a place.

    lon_deg, lat_deg : the position
    Result: WGS84 / UTM: 32601 to 32660 in the north, 32701 to 32760 in the south; at 84 degrees north and beyond, and
    south of 80, WGS84 / UPS with easting first: 5041 and 5042.
    """
    south, north = UTM_LATITUDES
    if lat_deg >= north:
        return UPS_NORTH
    if lat_deg < south:
        return UPS_SOUTH
    return (32600 if lat_deg >= 0.0 else 32700) + utm_zone(lon_deg, lat_deg)


def map_epsg_of(ground: np.ndarray) -> int:
    """Return the EPSG code (`map_epsg`) for the middle of ground points ``(n, 2)`` or ``(n, 3)``; NaN is ignored."""
    return map_epsg(*middle_position(ground)[:2])


def middle_position(ground: np.ndarray) -> tuple[float, ...]:
    """Return the median of each coordinate of ground points ``(n, 2)`` or ``(n, 3)``, also across 180 degrees."""
    lat_and_height: Sequence[float] = np.nanmedian(ground[:, 1:], axis=0).tolist()
    return float(np.nanmedian(continuous_longitudes(ground[:, 0]))), *lat_and_height


def project_to_map(ground: np.ndarray, epsg: int) -> np.ndarray:
    """Return ``(n, 2)`` easting, northing of lon, lat, height points in a projected WGS84 CRS.

    ground : (n, 3) lon, lat in degrees; the height is not used; epsg : code of the projected CRS
    Result: (n, 2) easting, northing in the unit of the CRS.
    """
    return operations_of(f"EPSG:{epsg}").from_wgs84(ground)


def list_local_crs(lonlat: np.ndarray, xy: np.ndarray) -> list[str]:
    """Return the CRSs in use at a place that have coordinates like these there, the likeliest first.

    lonlat, xy : (2,) the place in degrees, and coordinates near it in an unknown CRS
    Result: ``EPSG:4326`` for longitude and latitude; else the projected CRSs of EPSG whose area of use contains the
    place, WGS84 / UTM first, then by the distance of the coordinates.
    """
    place = np.array([[*lonlat, 0.0]])
    if np.abs(xy - lonlat).max() < LOCAL_CRS.margin_m / 111e3:
        return ["EPSG:4326"]
    area = AreaOfInterest(*lonlat, *lonlat)
    infos = pyproj.database.query_crs_info("EPSG", PJType.PROJECTED_CRS, area, contains=True)
    utm, found = map_epsg(*lonlat), list[tuple[bool, float, int]]()
    for code in {utm, *(int(one.code) for one in infos)}:
        try:
            there = project_to_map(place, code)[0]
        except (InputError, pyproj.exceptions.ProjError, IndexError):  # no operation to WGS84
            continue
        distance = float(np.hypot(*(there - xy)))
        if distance < LOCAL_CRS.margin_m:
            found.append((code != utm, round(distance, -2), code))  # realisations of one datum agree to metres
    return [f"EPSG:{code}" for _, _, code in sorted(found)]
