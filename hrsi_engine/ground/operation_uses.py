"""Coordinate operations with their stated accuracy, the points that they converted, and warnings about them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..foundation.errors import InputError
from ..foundation.thresholds import EQUALITY
from .geoids import GEOID, Geoid, how_to_get_grids

WORLD = (-180.0, -90.0, 180.0, 90.0)  # west, south, east, north
COORDINATES_OF_ACCURACY = 3  # number of coordinates whose root sum of squares is the stated accuracy


class CrsOperation(NamedTuple):
    """A coordinate operation to WGS84.

    name : its steps from datum to datum
    code : EPSG codes of the same steps, ``EPSG:1133``; empty if the database has none
    accuracy_m : stated accuracy; None if it is unknown
    sigma_m : standard deviations of the errors common to all its points: of each horizontal coordinate, of the height
    grids : files that it needs; area : its area of use; bounds : west, south, east, north of the area in degrees
    is_ballpark : whether it treats two datums as equal because PROJ has no transformation
    is_null : whether it does not change longitudes and latitudes
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
        """Return which positions are in the area of use.

        lonlat : (n, 2) or (n, 3) degrees
        Result: (n,) bool.
        """
        west, south, east, north = self.bounds
        width = 360.0 if east - west >= 360.0 else (east - west) % 360.0
        inside = ((lonlat[:, 0] - west) % 360.0 <= width) & (lonlat[:, 1] >= south) & (lonlat[:, 1] <= north)
        return np.asarray(inside)


class OperationUse(NamedTuple):
    """Points of a source that were converted to WGS84 by one operation.

    source : the file and layer; crs : name of its CRS; number : index of the operation in `CrsOperations.operations`
    operation : the operation used; points : number of points, for a raster of nodes
    better : the best operation at these points, if its grid is missing; None if the best one was used
    loss_m : accuracy lost by the missing grid; NaN if it is unknown
    geoid : the geoid model for heights, if it does not follow from the CRS: one that was named, or a substitute
    geoid_grids : files of the geoid that was replaced by a substitute
    treats_plate_as_wgs84 : whether a plate-fixed datum was treated as equal to WGS84
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
    treats_plate_as_wgs84: bool = False

    @property
    def error_names(self) -> tuple[str, str]:
        """Names that identify the common errors of positions and of heights, equal for points with equal errors."""
        return self.operation.code or self.operation.name, self.operation.name

    @property
    def is_substituted(self) -> bool:
        """Whether another geoid model replaces the one that is missing."""
        return self.geoid is not None and bool(self.geoid.stands_for)

    def entry(self) -> dict[str, Any]:
        """Return the row of the report's ``crs_operations``.

        Result: a dict for JSON.
        """
        operation, better = self.operation, self.better
        return {
            "source": self.source,
            "crs": self.crs,
            "name": operation.name,
            "code": operation.code or None,
            "accuracy_m": operation.accuracy_m,
            "sigma_plan_m": round(operation.sigma_m[0], 4),
            "sigma_height_m": round(operation.sigma_m[1], 4),
            "grid": ", ".join(operation.grids) or None,
            "points": self.points,
            "area": operation.area or None,
            "ballpark": operation.is_ballpark,
            "plate_fixed_as_wgs84": self.treats_plate_as_wgs84,
            "missing_operation": None if better is None else better.name,
            "missing_grid": None if better is None else ", ".join(better.grids),
            "loss_m": None if np.isnan(self.loss_m) else round(self.loss_m, 4),
            "geoid": None if self.geoid is None else self.geoid.name,
            "geoid_stands_for": self.geoid.stands_for if self.geoid is not None and self.geoid.stands_for else None,
        }


def read_entry(entry: Mapping[str, Any], points: int) -> OperationUse:
    """Return the use of an operation by ``points`` points from a row written by `OperationUse.entry`.

    Raises `KeyError`, `TypeError` or `ValueError` if it is not such a row.
    """
    sigma_m = float(entry["sigma_plan_m"]), float(entry["sigma_height_m"])
    accuracy_m = None if entry["accuracy_m"] is None else float(entry["accuracy_m"])
    loss_m = float("nan") if entry["loss_m"] is None else float(entry["loss_m"])
    if not np.isfinite([*sigma_m, accuracy_m or 0.0]).all() or min(sigma_m) < 0.0:
        raise ValueError("accuracies")
    grids, missing = (tuple((entry[name] or "").split(", ")) for name in ("grid", "missing_grid"))
    operation = CrsOperation(
        str(entry["name"]),
        str(entry["code"] or ""),
        accuracy_m,
        sigma_m=sigma_m,
        grids=grids,
        area=str(entry["area"] or ""),
        bounds=WORLD,
        is_ballpark=bool(entry["ballpark"]),
        is_null=False,
    )
    best_m = None if accuracy_m is None else accuracy_m - loss_m
    better = operation._replace(name=str(entry["missing_operation"]), accuracy_m=best_m, grids=missing)
    geoid = Geoid(str(entry["geoid"]), "", str(entry["geoid_stands_for"] or ""))
    return OperationUse(
        str(entry["source"]),
        str(entry["crs"]),
        0,
        operation=operation,
        points=points,
        better=better if entry["missing_operation"] else None,
        loss_m=loss_m,
        geoid=geoid if entry["geoid"] else None,
        geoid_grids=(),
        treats_plate_as_wgs84=bool(entry["plate_fixed_as_wgs84"]),
    )


def with_geoid(flat: CrsOperation, geoid: Geoid) -> CrsOperation:
    """Return an operation on positions combined with a geoid model for the heights, that of the CRS or a substitute."""
    name, accuracy_m, height_m = f"{flat.name} + {geoid.name} heights", flat.accuracy_m, 0.0
    if geoid.stands_for:
        name, height_m = f"{flat.name} + {geoid.name} for {geoid.stands_for}", GEOID.substitute_sigma_m
        accuracy_m = None if flat.accuracy_m is None else flat.accuracy_m + height_m
    return flat._replace(
        name=name, accuracy_m=accuracy_m, sigma_m=(flat.sigma_m[0], height_m), grids=(*flat.grids, geoid.file)
    )


def with_surface_heights(flat: CrsOperation, uses: Sequence[OperationUse]) -> CrsOperation:
    """Return an operation on positions, for heights interpolated in a DEM that was converted to WGS84 by ``uses``."""
    height_m = largest_sigma_m(uses)[1]
    if not height_m:
        return flat
    name = next(use.operation.name for use in uses if use.operation.sigma_m[1] == height_m)
    accuracy_m = None if flat.accuracy_m is None else flat.accuracy_m + height_m
    return flat._replace(
        name=f"{flat.name} + heights of a DEM by {name}", accuracy_m=accuracy_m, sigma_m=(flat.sigma_m[0], height_m)
    )


def largest_sigma_m(uses: Iterable[OperationUse]) -> tuple[float, float]:
    """Return the largest standard deviations of a horizontal coordinate and of the height; 0 without operations."""
    plan, height = np.max([(0.0, 0.0), *(use.operation.sigma_m for use in uses)], axis=0).tolist()
    return plan, height


def describe_missing_grid(use: OperationUse) -> str:
    """Return one sentence with the missing grid of a better operation and the loss in metres; empty without a loss."""
    better = use.better
    if better is None or use.loss_m < EQUALITY.position_m:
        return ""
    stated = "not known" if use.operation.accuracy_m is None else f"{use.operation.accuracy_m:g} m"
    best = "not known" if better.accuracy_m is None else f"{better.accuracy_m:g} m"
    loss = "an unknown accuracy" if np.isnan(use.loss_m) else f"{use.loss_m:.2g} m of accuracy"
    return (
        f"{use.source}: {use.crs} is converted to WGS84 by {use.operation.name} (accuracy {stated}); {better.name} ("
        f"{best}) is not available without its grid {', '.join(better.grids)}: {loss} is lost"
    )


def describe_substitute(use: OperationUse) -> str:
    """Return one sentence with the geoid, its substitute and the standard deviation; empty without a substitute."""
    if use.geoid is None or not use.geoid.stands_for:
        return ""
    return (
        f"{use.source}: the geoid of {use.geoid.stands_for} is not installed, {use.geoid.name} is used instead: "
        f"heights have a common error of {GEOID.substitute_sigma_m:g} m"
    )


def advise_grids(use: OperationUse) -> str:
    """Return advice how to obtain the missing grids."""
    if use.is_substituted:
        return how_to_get_grids(", ".join(use.geoid_grids)) if use.geoid_grids else how_to_get_grids()
    return how_to_get_grids("" if use.better is None else ", ".join(use.better.grids), is_geoid=False)


def list_operation_warnings(uses: Sequence[OperationUse]) -> list[str]:
    """Return warnings about missing grids and geoids, plate-fixed datums and ballpark operations."""
    warnings = []
    for use in uses:
        texts = describe_missing_grid(use), describe_substitute(use)
        warnings += [f"{text}: {advise_grids(use)}" for text in texts if text]
        if use.operation.is_ballpark:
            warnings.append(
                f"{use.source}: PROJ has no operation from {use.crs} to WGS84, so the two datums are treated as equal"
            )
        if use.treats_plate_as_wgs84:
            warnings.append(
                f"{use.source}: {use.crs} moves with its plate and is treated as WGS84 ({use.operation.name}): they "
                f"may differ by {use.operation.sigma_m[0] * COORDINATES_OF_ACCURACY**0.5:.3g} m, equal for all its "
                "points"
            )
    return list(dict.fromkeys(warnings))


def require_strict_datums(uses: Iterable[OperationUse], strict_datum: bool) -> None:
    """Raise `InputError` for a missing geoid or grid if ``strict_datum`` forbids replacements."""
    for use in uses if strict_datum else ():
        text = describe_substitute(use) or describe_missing_grid(use)
        if text:
            raise InputError(f"{text}: {advise_grids(use)}; or leave out `strict_datum`")
