"""Horizontal datums in use at a place, and the error of coordinates of each that are taken for WGS84."""

import contextlib
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pyproj
from pyproj.aoi import AreaOfInterest
from pyproj.enums import PJType

from ..foundation.errors import InputError
from ..foundation.thresholds import threshold, thresholds
from ..ground.crs_operations import operations_of
from ..ground.geodesy import metres_per_degree, wrap_degrees
from ..ground.map_crs import map_epsg


@thresholds
class DATUM:
    """Which horizontal datums are told apart from WGS84."""

    least_shift_m: float = threshold(3.0, "m", "datums nearer to WGS84 are not told apart from it")
    largest_shift_m: float = threshold(5e3, "m", "datums farther off are none of the area")


class DatumShift(NamedTuple):
    """Metres east and north from the coordinates taken for WGS84 to the true position."""

    name: str
    east_m: float
    north_m: float


@lru_cache(maxsize=16)
def find_datum_shifts(lon_deg: float, lat_deg: float) -> tuple[DatumShift, ...]:
    """Return the datums in use at a place that PROJ can transform and that differ from WGS84 (`DATUM`)."""
    area = AreaOfInterest(lon_deg - 0.01, lat_deg - 0.01, lon_deg + 0.01, lat_deg + 0.01)
    known = pyproj.database.query_crs_info(
        auth_name="EPSG", pj_types=PJType.GEOGRAPHIC_2D_CRS, area_of_interest=area, contains=True
    )
    factors = metres_per_degree(np.array([[lon_deg, lat_deg, 0.0]]))[0]
    found: list[DatumShift] = []
    for info in known:
        with contextlib.suppress(InputError):
            lon, lat, _ = operations_of(f"EPSG:{info.code}").to_wgs84(np.array([[lon_deg, lat_deg, 0.0]]))[0]
            shift = DatumShift(
                info.name,
                float(wrap_degrees(np.array(lon - lon_deg)) * factors[0]),
                float((lat - lat_deg) * factors[1]),
            )
            if DATUM.least_shift_m < np.hypot(shift.east_m, shift.north_m) < DATUM.largest_shift_m:
                found.append(shift)
    return tuple(found)


@lru_cache(maxsize=16)
def find_projected_shifts(lon_deg: float, lat_deg: float) -> tuple[DatumShift, ...]:
    """Return the UTM systems of other datums in use at a place, and how far their numbers, read as WGS84's, are off."""
    area = AreaOfInterest(lon_deg - 0.01, lat_deg - 0.01, lon_deg + 0.01, lat_deg + 0.01)
    known = pyproj.database.query_crs_info(
        auth_name="EPSG", pj_types=PJType.PROJECTED_CRS, area_of_interest=area, contains=True
    )
    place = np.array([[lon_deg, lat_deg, 0.0]])
    factors, found = metres_per_degree(place)[0], []
    for info in known:
        if "UTM zone" in info.name and not info.name.startswith("WGS 84 /"):
            with contextlib.suppress(InputError):
                numbers = operations_of(f"EPSG:{map_epsg(lon_deg, lat_deg)}").from_wgs84(place)
                there = operations_of(f"EPSG:{info.code}").to_wgs84(np.column_stack([numbers[:, :2], [0.0]]))[0]
                east, north = wrap_degrees(there[:1] - lon_deg) * factors[0], (there[1:2] - lat_deg) * factors[1]
                shift = DatumShift(info.name, float(east[0]), float(north[0]))
                if DATUM.least_shift_m < np.hypot(shift.east_m, shift.north_m) < DATUM.largest_shift_m:
                    found.append(shift)
    return tuple(found)
