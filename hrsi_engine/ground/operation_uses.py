"""What PROJ's database states of a coordinate operation, which points went through it, and what a user should know."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..foundation.errors import InputError
from ..foundation.thresholds import threshold, thresholds
from .geoids import GEOID, Geoid, how_to_get_grids


@thresholds
class OPERATIONS:
    """Which losses of accuracy by a missing grid are told."""

    least_loss_m: float = threshold(
        0.1,
        "m",
        "accuracy lost because of a missing grid from which a warning is given",
        "issue 36: none above is silent",
    )


WORLD = (-180.0, -90.0, 180.0, 90.0)  # west, south, east, north
COORDINATES_OF_ACCURACY = 3  # a stated accuracy is the root sum of squares of so many coordinates


class CrsOperation(NamedTuple):
    """A coordinate operation to WGS84.

    name : of its steps from datum to datum
    code : of the same steps, ``EPSG:1133``; empty where the database has none
    accuracy_m : as stated; None where it is not known
    sigma_m : standard deviations that all of its points share: of each horizontal coordinate, and of the height
    grids : files that it needs; area : its area of use; bounds : west, south, east, north of that in degrees
    is_ballpark : whether it takes one datum for the other for want of anything better
    is_null : whether it leaves longitudes and latitudes as they are
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

        lonlat : (n, 2) or (n, 3) degrees
        Result: (n,) bool.
        """
        west, south, east, north = self.bounds
        width = 360.0 if east - west >= 360.0 else (east - west) % 360.0
        inside = ((lonlat[:, 0] - west) % 360.0 <= width) & (lonlat[:, 1] >= south) & (lonlat[:, 1] <= north)
        return np.asarray(inside)


class OperationUse(NamedTuple):
    """Points of a source that went to WGS84 by one operation.

    source : the file and layer; crs : name of its CRS; number : of the operation among those of the CRS
    operation : what converted them; points : their number; of a raster, nodes over it
    better : the best operation there whose grid is missing, None where the best one was taken
    loss_m : accuracy lost by that; NaN where it is not known
    geoid : the model that converted the heights where the CRS does not: one that was named, or a substitute
    geoid_grids : files of the geoid that is meant, where they are missing
    takes_plate_for_wgs84 : whether a datum that moves with its plate was taken for WGS84
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
    def error_names(self) -> tuple[str, str]:
        """What tells the errors of positions and of heights from those of other operations."""
        return self.operation.code or self.operation.name, self.operation.name

    @property
    def is_substituted(self) -> bool:
        """Whether another geoid stands in for the one that is meant."""
        return self.geoid is not None and bool(self.geoid.stands_for)

    def entry(self) -> dict[str, Any]:
        """Return it as a row of the report's ``crs_operations``.

        Result: ready for JSON.
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


def read_entry(entry: Mapping[str, Any], points: int) -> OperationUse:
    """Return the use of an operation by so many points that `OperationUse.entry` told of.

    Raises `KeyError`, `TypeError` or `ValueError` for what is no such entry.
    """
    sigma_m = float(entry["sigma_plan_m"]), float(entry["sigma_height_m"])
    accuracy_m = None if entry["accuracy_m"] is None else float(entry["accuracy_m"])
    loss_m = float("nan") if entry["loss_m"] is None else float(entry["loss_m"])
    if not np.isfinite([*sigma_m, accuracy_m or 0.0]).all() or min(sigma_m) < 0.0:
        raise ValueError("accuracies")
    grids, missing = (tuple((entry[name] or "").split(", ")) for name in ("grid", "missing_grid"))
    made = CrsOperation(
        str(entry["name"]), str(entry["code"] or ""), accuracy_m, sigma_m, grids, str(entry["area"] or ""), WORLD,
        bool(entry["ballpark"]), is_null=False,
    )  # fmt: skip
    best_m = None if accuracy_m is None else accuracy_m - loss_m
    better = made._replace(name=str(entry["missing_operation"]), accuracy_m=best_m, grids=missing)
    geoid = Geoid(str(entry["geoid"]), "", str(entry["geoid_stands_for"] or ""))
    return OperationUse(
        str(entry["source"]), str(entry["crs"]), 0, made, points, better if entry["missing_operation"] else None,
        loss_m, geoid if entry["geoid"] else None, (), bool(entry["plate_fixed_as_wgs84"]),
    )  # fmt: skip


def with_geoid(flat: CrsOperation, geoid: Geoid) -> CrsOperation:
    """Return an operation of positions with a geoid model for the heights, that of the CRS or a substitute."""
    name, accuracy_m, height_m = f"{flat.name} + {geoid.name} heights", flat.accuracy_m, 0.0
    if geoid.stands_for:
        name, height_m = f"{flat.name} + {geoid.name} for {geoid.stands_for}", GEOID.substitute_sigma_m
        accuracy_m = None if flat.accuracy_m is None else flat.accuracy_m + height_m
    return flat._replace(
        name=name, accuracy_m=accuracy_m, sigma_m=(flat.sigma_m[0], height_m), grids=(*flat.grids, geoid.file)
    )


def with_surface_heights(flat: CrsOperation, uses: Sequence[OperationUse]) -> CrsOperation:
    """Return an operation of positions whose heights come from a DEM, which came to WGS84 by ``uses``."""
    height_m = largest_sigma_m(uses)[1]
    if not height_m:
        return flat
    name = next(use.operation.name for use in uses if use.operation.sigma_m[1] == height_m)
    accuracy_m = None if flat.accuracy_m is None else flat.accuracy_m + height_m
    return flat._replace(
        name=f"{flat.name} + heights of a DEM by {name}", accuracy_m=accuracy_m, sigma_m=(flat.sigma_m[0], height_m)
    )


def largest_sigma_m(uses: Iterable[OperationUse]) -> tuple[float, float]:
    """Return the largest standard deviation of a horizontal coordinate, and of the height; 0 without any use."""
    plan, height = np.max([(0.0, 0.0), *(use.operation.sigma_m for use in uses)], axis=0).tolist()
    return plan, height


def describe_missing_grid(use: OperationUse) -> str:
    """Return what a better operation lacks, and the loss in metres, in one sentence; empty where nothing is lost."""
    better = use.better
    if better is None or use.loss_m < OPERATIONS.least_loss_m:
        return ""
    stated = "not known" if use.operation.accuracy_m is None else f"{use.operation.accuracy_m:g} m"
    best = "not known" if better.accuracy_m is None else f"{better.accuracy_m:g} m"
    loss = "an unknown accuracy" if np.isnan(use.loss_m) else f"{use.loss_m:.2g} m of accuracy"
    return (
        f"{use.source}: {use.crs} is converted to WGS84 by {use.operation.name} (accuracy {stated}); {better.name} ("
        f"{best}) is not available without its grid {', '.join(better.grids)}: {loss} is lost"
    )


def describe_substitute(use: OperationUse) -> str:
    """Return which geoid stands in for which, and its standard deviation, in one sentence; empty where none does."""
    if use.geoid is None or not use.geoid.stands_for:
        return ""
    return (
        f"{use.source}: the geoid of {use.geoid.stands_for} is not installed, {use.geoid.name} is used instead: "
        f"heights have a common error of {GEOID.substitute_sigma_m:g} m"
    )


def advise_grids(use: OperationUse) -> str:
    """Return how to get the grids that are missing."""
    if use.is_substituted:
        return how_to_get_grids(", ".join(use.geoid_grids)) if use.geoid_grids else how_to_get_grids()
    return how_to_get_grids("" if use.better is None else ", ".join(use.better.grids), is_geoid=False)


def list_operation_warnings(uses: Sequence[OperationUse]) -> list[str]:
    """Return what a user should know of operations: grids and geoids that are missing, plates, ballpark operations."""
    told = []
    for use in uses:
        for text in (describe_missing_grid(use), describe_substitute(use)):
            if text:
                told.append(f"{text}: {advise_grids(use)}")
        if use.operation.is_ballpark:
            told.append(
                f"{use.source}: PROJ has no operation from {use.crs} to WGS84, so the two datums are treated as equal"
            )
        if use.takes_plate_for_wgs84:
            told.append(
                f"{use.source}: {use.crs} moves with its plate and is treated as WGS84 ({use.operation.name}): they "
                f"may differ by {use.operation.sigma_m[0] * COORDINATES_OF_ACCURACY**0.5:.3g} m, equal for all its "
                "points"
            )
    return list(dict.fromkeys(told))


def require_strict_datums(uses: Iterable[OperationUse], strict_datum: bool) -> None:
    """Raise `InputError` for a geoid or a grid that is missing, where ``strict_datum`` allows no replacement."""
    for use in uses if strict_datum else ():
        text = describe_substitute(use) or describe_missing_grid(use)
        if text:
            raise InputError(f"{text}: {advise_grids(use)}; or leave out `strict_datum`")
