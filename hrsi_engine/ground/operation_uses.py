"""What PROJ's database states of a coordinate operation, and which points of which source went through it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .geoids import GEOID, Geoid


class CrsOperation(NamedTuple):
    """A coordinate operation to WGS84.

    Parameters
    ----------
    name : str
        Of its steps from datum to datum.
    code : str
        Of the same steps, ``EPSG:1133``; empty where the database has none.
    accuracy_m : float or None
        As stated; None where it is not known.
    sigma_m : tuple of float
        Standard deviations that all of its points share: of each horizontal coordinate, and of the height.
    grids : tuple of str
        Files that it needs.
    area : str
        Its area of use.
    bounds : tuple of float
        West, south, east, north of that in degrees.
    is_ballpark : bool
        Whether it takes one datum for the other for want of anything better.
    is_null : bool
        Whether it leaves longitudes and latitudes as they are.
    """

    name: str
    code: str
    accuracy_m: float | None
    sigma_m: tuple[float, float]
    grids: tuple[str, ...]
    area: str
    bounds: tuple[float, float, float, float]
    is_ballpark: bool
    is_null: bool

    def covers(self, lonlat: np.ndarray) -> np.ndarray:
        """Return which positions lie in the area of use.

        Parameters
        ----------
        lonlat : (n, 2) or (n, 3) ndarray
            Degrees.

        Returns
        -------
        (n,) ndarray
            Bool.
        """
        west, south, east, north = self.bounds
        width = 360.0 if east - west >= 360.0 else (east - west) % 360.0
        inside = ((lonlat[:, 0] - west) % 360.0 <= width) & (lonlat[:, 1] >= south) & (lonlat[:, 1] <= north)
        return np.asarray(inside)


class OperationUse(NamedTuple):
    """Points of a source that went to WGS84 by one operation.

    Parameters
    ----------
    source : str
        The file and layer.
    crs : str
        Name of its CRS.
    number : int
        Of the operation among those of the CRS.
    operation : CrsOperation
        What converted them.
    points : int
        Their number; of a raster, nodes over it.
    better : CrsOperation or None
        The best operation there whose grid is missing, None where the best one was taken.
    loss_m : float
        Accuracy lost by that; NaN where it is not known.
    geoid : Geoid or None
        The model that converted the heights where the CRS does not: one that was named, or a substitute.
    geoid_grids : tuple of str
        Files of the geoid that is meant, where they are missing.
    takes_plate_for_wgs84 : bool
        Whether a datum that moves with its plate was taken for WGS84.
    """

    source: str
    crs: str
    number: int
    operation: CrsOperation
    points: int
    better: CrsOperation | None = None
    loss_m: float = 0.0
    geoid: Geoid | None = None
    geoid_grids: tuple[str, ...] = ()
    takes_plate_for_wgs84: bool = False

    @property
    def is_substituted(self) -> bool:
        """Whether another geoid stands in for the one that is meant."""
        return self.geoid is not None and bool(self.geoid.stands_for)

    def entry(self) -> dict[str, Any]:
        """Return it as a row of the report's ``crs_operations``.

        Returns
        -------
        dict
            Ready for JSON.
        """
        made, better = self.operation, self.better
        return {
            "source": self.source, "crs": self.crs, "name": made.name, "code": made.code or None,
            "accuracy_m": made.accuracy_m, "sigma_plan_m": round(made.sigma_m[0], 4),
            "sigma_height_m": round(made.sigma_m[1], 4), "grid": ", ".join(made.grids) or None, "points": self.points,
            "area": made.area or None, "ballpark": made.is_ballpark, "plate_fixed_as_wgs84": self.takes_plate_for_wgs84,
            "missing_operation": None if better is None else better.name,
            "missing_grid": None if better is None else ", ".join(better.grids),
            "loss_m": None if np.isnan(self.loss_m) else round(self.loss_m, 4),
            "geoid": None if self.geoid is None else self.geoid.name,
            "geoid_stands_for": self.geoid.stands_for if self.geoid is not None and self.geoid.stands_for else None,
        }  # fmt: skip


def with_geoid(flat: CrsOperation, geoid: Geoid) -> CrsOperation:
    """Return an operation of positions with a geoid model for the heights, that of the CRS or a substitute."""
    name, accuracy_m, height_m = f"{flat.name} + {geoid.name} heights", flat.accuracy_m, 0.0
    if geoid.stands_for:
        name, height_m = f"{flat.name} + {geoid.name} for {geoid.stands_for}", GEOID.substitute_sigma_m
        accuracy_m = None if flat.accuracy_m is None else flat.accuracy_m + height_m
    return flat._replace(
        name=name, accuracy_m=accuracy_m, sigma_m=(flat.sigma_m[0], height_m), grids=(*flat.grids, geoid.file)
    )
