"""Every conversion to and from WGS84: PROJ's best operation at each point, its accuracy, and what a better one lacks.

Two CRS are joined by many coordinate operations, each for an area of use and with a stated accuracy. PROJ chooses among
them point by point, and so do ``cs2cs`` and GDAL (``proj_create_crs_to_crs``, ``pj_get_suggested_operation``): of the
operations whose area of use, as a rectangle in the source CRS, holds the point it takes the one of best accuracy, where
two are equal that of the smaller area, and an operation for land before one for the sea. A point that its grid does not
cover goes to the next operation. `CrsOperations` follows that rule for all points of an array at once: each group of
points goes through one plain pipeline, and the operation of each point is known. Two things differ. A ballpark
operation, which takes one datum for the other, serves only where PROJ knows no real one; and the way from WGS84 is the
inverse of the way to it at every point.

**Stated accuracies.** EPSG's figure is the root sum of squares over the three geocentric coordinates: ED50 to WGS 84
(1) has 10 m, and its publication (DMA TR 8350.2, appendix B) gives X, Y and Z standard deviations of 3, 8 and 5 m;
PSAD56 to WGS 84 (1) has 42 m of 17, 27 and 27 m; NAD27 to WGS 84 (4) has 10 m of 5, 5 and 6 m. So the standard
deviation of each coordinate is the figure over sqrt(3). Of an operation on heights alone it is the figure itself. The
error of an operation is the same at all points of a scene.

**Epochs.** An operation between a plate-fixed datum and WGS84 that changes nothing states 1 to 4 m for the motion of
the plate. With an epoch, that motion is removed (`plate_motion`).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pyproj
from pyproj.enums import TransformDirection
from pyproj.transformer import TransformerGroup

from ..foundation.errors import InputError
from .ellipsoid import wrap_once
from .geodesy import WGS84, WGS84_3D
from .geoids import find_substitute, how_to_get_grids
from .operation_uses import COORDINATES_OF_ACCURACY, WORLD, CrsOperation, OperationUse, with_geoid
from .plate_motion import PlateMotion, find_plate_motion

EDGE_NODES = 21  # along each side of an area of use, to find its rectangle in the source CRS, as PROJ does
#: What a step of a pipeline is called that changes longitudes and latitudes from datum to datum.
_DATUM_STEP = re.compile(
    r"proj=(helmert|molobadekas|molodensky|[a-z]*gridshift|defmodel|deformation|affine|horner|tinshift)|\bpm="
)
_GEOID_MODEL = re.compile(r"EGM ?\d+", re.IGNORECASE)  # heights are defined by the model, so it has no error
_AUTHORITY = re.compile(r"(?:INVERSE|DERIVED_FROM)\((\w+)\)")
_OFFSHORE = "- offshore"
_KEPT = 128  # CRS whose operations stay in memory
Rectangle = tuple[float, float, float, float]


class _Candidate(NamedTuple):
    """An operation that can be used here: its pipeline, and its area of use as rectangles in the source CRS."""

    operation: CrsOperation
    pipeline: pyproj.Transformer
    rectangles: tuple[Rectangle, ...]  # low x, low y, high x, high y


class CrsOperations:
    """The operations between one CRS and WGS84; `operations_of` keeps those that were used last.

    Parameters
    ----------
    crs : pyproj.CRS
        Horizontal, three-dimensional, geocentric or compound.
    epoch : float, optional
        Year in which positions on a plate-fixed datum are wanted on WGS84.

    Raises
    ------
    InputError
        PROJ knows no way to WGS84, or there is no geoid grid for the heights.
    """

    def __init__(self, crs: pyproj.CRS, epoch: float | None = None) -> None:
        self.crs, self.epoch = crs, epoch
        self.has_heights = has_heights(crs)
        flat = without_heights(crs)
        self.horizontal = self if flat is crs else CrsOperations(flat, epoch)
        available, self.unavailable = self._look_up()
        real = [one for one in available if not one.operation.is_ballpark]
        self._candidates = tuple(real or ([] if self.vertical_name else available))
        self.substitute = find_substitute(self.vertical_name) if self.vertical_name else None
        if self._candidates or self.substitute is not None:
            return
        if self.vertical_name:
            raise InputError(f"no PROJ grid to convert the heights of {crs.name!r}: {how_to_get_grids()}")
        raise InputError(f"PROJ knows no way from {crs.name!r} to WGS84: convert the layer first")

    @property
    def vertical_name(self) -> str:
        """Name of the vertical CRS of a compound one; empty for others."""
        return str(self.crs.sub_crs_list[1].name) if len(self.crs.sub_crs_list) > 1 else ""

    @cached_property
    def operations(self) -> tuple[CrsOperation, ...]:
        """The operations that can be used here, in PROJ's order; behind them those with a substitute for the geoid."""
        own = tuple(self._at_epoch(number, one.operation) for number, one in enumerate(self._candidates))
        if self.substitute is None:
            return own
        return own + tuple(with_geoid(flat, self.substitute) for flat in self.horizontal.operations)

    # ---- conversion ----------------------------------------------------------------------------------------------

    def to_wgs84(self, xyz: np.ndarray) -> np.ndarray:
        """Return lon, lat, ellipsoidal height of points; heights of a CRS without its own stay as they are.

        Parameters
        ----------
        xyz : (n, 3) ndarray
            In the CRS, x (east) first.

        Returns
        -------
        (n, 3) ndarray
            Degrees and metres; not finite where no operation covers a point.
        """
        return self.convert(xyz)[0]

    def convert(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `to_wgs84` of points, and which of the `operations` converted each.

        Parameters
        ----------
        xyz : (n, 3) ndarray
            In the CRS, x (east) first.

        Returns
        -------
        tuple of (n, 3) ndarray and (n,) ndarray of int
            Lon, lat, height; and numbers of `operations`, -1 where none covers a point.
        """
        ground, number = self._convert_static(np.asarray(xyz, dtype=np.float64))
        for one in np.unique(number[number >= 0]).tolist() if self._motion is not None else ():
            if self._motion is not None and self.is_plate_fixed(one):
                rows = number == one
                ground[rows] = self._motion.move(ground[rows])
        return ground, number

    def height_offsets(self, xy: np.ndarray) -> np.ndarray:
        """Return the ellipsoidal heights of the CRS's height 0.

        Parameters
        ----------
        xy : (n, 2) ndarray
            In the CRS, x (east) first.

        Returns
        -------
        (n,) ndarray
            Metres; not finite where no grid covers a point, 0 for a CRS without heights.
        """
        return self.to_wgs84(np.column_stack([xy, np.zeros(len(xy))]))[:, 2]

    def from_wgs84(self, lonlat: np.ndarray) -> np.ndarray:
        """Return x, y in the horizontal CRS of positions: the inverse of `to_wgs84`.

        Parameters
        ----------
        lonlat : (n, 2) or (n, 3) ndarray
            Degrees; a height is not used.

        Returns
        -------
        (n, 2) ndarray
            In the CRS, x (east) first; not finite where a position is nowhere in it.
        """
        if self.horizontal is not self:
            return self.horizontal.from_wgs84(lonlat)
        lonlat = np.asarray(lonlat, dtype=np.float64)[:, :2]
        still = lonlat if self._motion is None else self._motion.move_back(lonlat)
        if len(self._candidates) == 1:
            return self._pass_back(0, still if self.is_plate_fixed(0) else lonlat)
        # Begin with the operation that the areas of use in degrees suggest; the one that leads back decides
        xy, number = np.full((len(lonlat), 2), np.inf), np.full(len(lonlat), -1)
        areas = [split_at_180(one.operation.bounds) for one in self._candidates]
        chosen = self._choose(lonlat, areas)
        for _ in self._candidates:
            for one in np.unique(chosen[chosen != number]).tolist():
                rows = np.flatnonzero((chosen == one) & (number != one))
                xy[rows] = self._pass_back(one, (still if self.is_plate_fixed(one) else lonlat)[rows])
            number, known = chosen, np.isfinite(xy[:, 0])
            chosen = number.copy()
            chosen[known] = self._choose(xy[known], [one.rectangles for one in self._candidates])
            if np.array_equal(chosen, number):
                break
        return xy

    def _convert_static(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `convert` without the motion of plates."""
        areas, tried = [one.rectangles for one in self._candidates], dict[int, np.ndarray]()
        chosen = self._choose(xyz, areas) if self._candidates else np.full(len(xyz), -1)
        if len(xyz) and not chosen.strides[0] and chosen[0] >= 0:  # one for all
            first = int(chosen[0])
            ground, number = self._pass(first, xyz), np.full(len(xyz), first, dtype=np.int16)
            tried[first] = np.broadcast_to(True, len(xyz))
        else:
            ground, number = np.full((len(xyz), 3), np.inf), np.full(len(xyz), -1, dtype=np.int16)
            for one in np.unique(chosen[chosen >= 0]).tolist():
                rows = np.flatnonzero(chosen == one)
                ground[rows], number[rows] = self._pass(one, xyz[rows]), one
                tried[one] = chosen == one
        # What a grid does not cover goes to the next operation
        waiting = np.zeros(0, dtype=np.int64)
        if len(self._candidates) > 1 and not np.isfinite(ground).all():
            waiting = np.flatnonzero(~np.isfinite(ground).all(axis=1))
        while len(waiting):
            chosen = self._choose(xyz[waiting], areas, {one: rows[waiting] for one, rows in tried.items()})
            for one in np.unique(chosen[chosen >= 0]).tolist():
                rows = waiting[chosen == one]
                ground[rows], number[rows] = self._pass(one, xyz[rows]), one
                tried[one] = tried.get(one, np.zeros(len(xyz), dtype=bool)) | np.isin(np.arange(len(xyz)), rows)
            waiting = waiting[(chosen >= 0) & ~np.isfinite(ground[waiting]).all(axis=1)]
        if self.substitute is None:
            return ground, number
        lost = np.flatnonzero(~np.isfinite(ground).all(axis=1))
        if len(lost):
            flat, which = self.horizontal._convert_static(xyz[lost])
            axis = self.crs.sub_crs_list[1].axis_info[0]
            up = -axis.unit_conversion_factor if axis.direction == "down" else axis.unit_conversion_factor
            known = np.isfinite(flat[:, :2]).all(axis=1)
            flat[known, 2] = flat[known, 2] * up + self.substitute.heights(flat[known])
            ground[lost], number[lost] = flat, np.where(which >= 0, which + len(self._candidates), -1)
        return ground, number

    def _pass(self, one: int, xyz: np.ndarray) -> np.ndarray:
        """Return lon, lat, height of points ``(n, 3)`` by one of the candidates."""
        pipeline = self._candidates[one].pipeline
        if self.vertical_name:  # positions as of the CRS without heights: so rasters and points lie alike
            heights = pipeline.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2])[2]
            ground = self.horizontal._convert_static(xyz)[0]
            ground[:, 2] = heights
            return ground
        if self.has_heights:
            return np.column_stack(pipeline.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2]))
        return np.column_stack([*pipeline.transform(xyz[:, 0], xyz[:, 1]), xyz[:, 2]])

    def _pass_back(self, one: int, lonlat: np.ndarray) -> np.ndarray:
        """Return x, y ``(n, 2)`` of positions ``(n, 2)`` by one of the candidates, backwards.

        PROJ's way back begins at height 0 on the other ellipsoid, and misses by up to a centimetre: what the way there
        makes of that corrects it.
        """
        operation, pipeline, _ = self._candidates[one]
        zero, back = np.zeros(len(lonlat)), TransformDirection.INVERSE
        x, y, _ = pipeline.transform(lonlat[:, 0], lonlat[:, 1], zero, direction=back)
        if not operation.is_null:
            lon, lat, _ = pipeline.transform(x, y, zero)
            with np.errstate(invalid="ignore"):
                lon, lat = lonlat[:, 0] - wrap_once(lon - lonlat[:, 0]), 2.0 * lonlat[:, 1] - lat
            x, y, _ = pipeline.transform(lon, lat, zero, direction=back)
        return np.column_stack([x, y])

    # ---- choice of the operation ---------------------------------------------------------------------------------

    def _choose(
        self,
        xy: np.ndarray,
        areas: Sequence[Sequence[Rectangle]],
        without: Mapping[int, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Return the number of the candidate for each point by PROJ's rule, -1 where none is left.

        xy : (n, 2 or 3); areas : rectangles of each candidate; without : (n,) where a candidate is out
        """
        without = without or {}
        if len(areas) == 1 and not without:
            return np.broadcast_to(0, len(xy))
        if not len(xy):
            return np.zeros(0, dtype=np.int64)
        x, y = xy[:, 0], xy[:, 1]
        if self.crs.is_geographic and (np.abs(x) > 180.0).any():
            x = (x + 180.0) % 360.0 - 180.0
        # Where each area holds all points or none, what is chosen for one holds for all
        low_x, low_y, high_x, high_y = np.fmin.reduce(x), np.fmin.reduce(y), np.fmax.reduce(x), np.fmax.reduce(y)
        met = [
            (one, r)
            for one, rectangles in enumerate(areas)
            for r in rectangles
            if not (high_x < r[0] or low_x > r[2] or high_y < r[1] or low_y > r[3])
        ]
        whole = all(r[0] <= low_x and r[1] <= low_y and r[2] >= high_x and r[3] >= high_y for _, r in met)
        if whole and not without:
            x, y = np.array([low_x]), np.array([low_y])
        best, accuracy = np.full(len(x), -1), np.full(len(x), np.inf)
        within = np.tile([-np.inf, -np.inf, np.inf, np.inf], (len(x), 1))
        for one, r in met:
            operation = self._candidates[one].operation
            inside = (x >= r[0]) & (y >= r[1]) & (x <= r[2]) & (y <= r[3])
            if one in without:
                inside &= ~without[one]
            better = best < 0
            if operation.accuracy_m is not None and _OFFSHORE not in operation.area:
                smaller = (within[:, :2] <= r[:2]).all(axis=1) & (within[:, 2:] >= r[2:]).all(axis=1)
                smaller &= (within != r).any(axis=1)
                same = accuracy == operation.accuracy_m
                better |= (operation.accuracy_m < accuracy) | (same & smaller)
            here = inside & better
            best[here], within[here] = one, r
            accuracy[here] = -1.0 if operation.accuracy_m is None else operation.accuracy_m
        for one, candidate in enumerate(self._candidates):  # outside all areas: the first that needs no grid
            if not candidate.operation.grids:
                best[(best < 0) & ~without.get(one, np.zeros(len(x), dtype=bool))] = one
        return best if len(best) == len(xy) else np.broadcast_to(best, len(xy))

    def _look_up(self) -> tuple[list[_Candidate], tuple[CrsOperation, ...]]:
        """Return the operations in PROJ's order: those that can be used here, and those that lack a grid."""
        target = WGS84_3D if self.has_heights else WGS84
        missing: list[Any] = []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of grids that are missing: told where it matters
            try:
                group = TransformerGroup(self.crs, target, always_xy=True)
                found, missing = group.transformers, group.unavailable_operations
            except pyproj.exceptions.ProjError:  # PROJ cannot make one of the operations that it lists
                found = self._look_up_only_one(target)
        stated = [self._describe(one) for one in found]
        pipelines = [pyproj.Transformer.from_pipeline(one.definition) for one in found]
        areas = _rectangles(self.horizontal.crs, [one.bounds for one in stated])
        candidates = [_Candidate(*one) for one in zip(stated, pipelines, areas, strict=True)]
        return candidates, tuple(self._describe(one) for one in missing)

    def _look_up_only_one(self, target: int) -> list[pyproj.Transformer]:
        """Return the operation that PROJ itself takes, in a list; none where that depends on the point."""
        try:
            found = pyproj.Transformer.from_crs(self.crs, target, always_xy=True)
        except pyproj.exceptions.ProjError:
            return []
        return [found] if found.definition.startswith("proj=") else []

    def _describe(self, operation: Any) -> CrsOperation:
        """Return what PROJ states of a transformer or of a coordinate operation."""
        steps = operation.operations or ()
        moving = [step for step in steps if step.type_name != "Conversion"]
        ids = [known for step in moving if (known := step.to_json_dict().get("id"))]
        codes = [_AUTHORITY.sub(r"\1", known["authority"]) + f":{known['code']}" for known in ids]
        title = getattr(operation, "description", None) or operation.name
        stated = None if operation.accuracy is None or operation.accuracy < 0.0 else float(operation.accuracy)
        is_null = hasattr(operation, "definition") and not _DATUM_STEP.search(operation.definition)
        area = operation.area_of_use
        return CrsOperation(
            " + ".join(step.name for step in moving) or title,
            ", ".join(codes), stated, self._sigmas(stated, is_null, title),
            tuple(grid.short_name for step in steps for grid in step.grids),
            area.name if area else "", area.bounds if area else WORLD,
            "ballpark" in title.lower(), is_null,
        )  # fmt: skip

    def _sigmas(self, stated: float | None, is_null: bool, title: str) -> tuple[float, float]:
        """Return the standard deviations of a horizontal coordinate and of the height that an operation states.

        Of a compound CRS the positions have the largest accuracy of an operation of its horizontal part that the sum
        holds, the heights the rest. A null operation is off in plan, by the motion of a plate.
        """
        each = (stated or 0.0) / COORDINATES_OF_ACCURACY**0.5
        if not self.vertical_name:
            return each, each if self.has_heights and not is_null else 0.0
        flat = (*self.horizontal.operations, *self.horizontal.unavailable)
        known = [one.accuracy_m for one in flat if one.accuracy_m is not None and one.accuracy_m <= (stated or 0.0)]
        plan = max(known, default=0.0)
        return plan / COORDINATES_OF_ACCURACY**0.5, 0.0 if _GEOID_MODEL.search(title) else (stated or 0.0) - plan

    # ---- the motion of plates ------------------------------------------------------------------------------------

    def motion_in(self, epoch: float) -> PlateMotion | None:
        """Return the motion of the CRS's plate up to a year; None where the CRS is fixed to none that PROJ knows.

        Parameters
        ----------
        epoch : float
            Year.

        Returns
        -------
        PlateMotion or None
            To WGS84.
        """
        geodetic = self.crs.geodetic_crs
        if geodetic is None or geodetic.is_geocentric:
            return None
        return find_plate_motion(geodetic.to_wkt(), epoch, self.has_heights)

    def is_plate_fixed(self, number: int) -> bool:
        """Tell whether one of `operations` takes a datum that moves with its plate for WGS84.

        Parameters
        ----------
        number : int
            Which of them.

        Returns
        -------
        bool
            True where it states an accuracy, and changes nothing.
        """
        if number >= len(self._candidates):
            return self.horizontal.is_plate_fixed(number - len(self._candidates))
        made = self._candidates[number].operation
        return made.is_null and not made.is_ballpark and bool(made.accuracy_m)

    @cached_property
    def _motion(self) -> PlateMotion | None:
        """What moves the CRS's plate to the epoch that is wanted."""
        return None if self.epoch is None else self.motion_in(self.epoch)

    def _at_epoch(self, number: int, operation: CrsOperation) -> CrsOperation:
        """Return an operation followed by the motion of the plate, where that takes place."""
        motion = self._motion
        if motion is None or not self.is_plate_fixed(number):
            return operation
        each = motion.accuracy_m / COORDINATES_OF_ACCURACY**0.5
        return operation._replace(
            name=f"{operation.name} + {motion.name} in {motion.epoch:g}", accuracy_m=motion.accuracy_m, is_null=False,
            sigma_m=(each, float(np.hypot(operation.sigma_m[1], each if motion.is_3d else 0.0))),
        )  # fmt: skip

    # ---- what was done -------------------------------------------------------------------------------------------

    def uses(self, source: str, ground: np.ndarray, number: np.ndarray) -> tuple[OperationUse, ...]:
        """Return what converted points of a source, and what a better operation lacks there.

        Parameters
        ----------
        source : str
            The file and layer.
        ground : (n, 2) or (n, 3) ndarray
            As converted: lon, lat.
        number : (n,) ndarray of int
            As `convert` returns it.

        Returns
        -------
        tuple of OperationUse
            One an operation, the most used first.
        """
        found = []
        for one in np.unique(number[number >= 0]).tolist():
            here, made = ground[number == one], self.operations[one]
            better, loss_m = self._better_than(one, here)
            substitute = self.substitute if one >= len(self._candidates) else None
            meant = self._missing_at(here) if substitute is not None else None
            grids = () if meant is None else meant.grids
            plate = self.is_plate_fixed(one) and made.is_null
            found.append(
                OperationUse(source, self.crs.name, one, made, len(here), better, loss_m, substitute, grids, plate)
            )
        return tuple(sorted(found, key=lambda use: -use.points))

    def uses_at(self, source: str, lonlat: np.ndarray) -> tuple[OperationUse, ...]:
        """Return `uses` at positions on WGS84: nodes over a raster, or the place of an image.

        Parameters
        ----------
        source : str
            What lies there.
        lonlat : (n, 2) or (n, 3) ndarray
            Degrees.

        Returns
        -------
        tuple of OperationUse
            As `uses`.
        """
        lonlat, xy = np.asarray(lonlat, dtype=np.float64), self.from_wgs84(lonlat)
        known = np.isfinite(xy).all(axis=1)
        number = self.convert(np.column_stack([xy[known], np.zeros(known.sum())]))[1]
        return self.uses(source, lonlat[known], number)

    def _missing_at(self, ground: np.ndarray) -> CrsOperation | None:
        """Return the most accurate operation that lacks its grid and covers some of the points."""
        here = [one for one in self.unavailable if not one.is_ballpark and one.covers(ground).any()]
        return min(here, key=lambda one: np.inf if one.accuracy_m is None else one.accuracy_m, default=None)

    def _better_than(self, number: int, ground: np.ndarray) -> tuple[CrsOperation | None, float]:
        """Return the best operation whose grid is missing at some of the points, and the accuracy (m) lost by that.

        NaN where the accuracy of what is used is not known. What a substitute for the geoid costs is told apart.
        """
        if number >= len(self._candidates):
            return self.horizontal._better_than(number - len(self._candidates), ground)
        made, best = self._candidates[number].operation, self._missing_at(ground)
        if best is None or made.accuracy_m is None:
            return best, 0.0 if best is None else float("nan")
        loss_m = 0.0 if best.accuracy_m is None else made.accuracy_m - best.accuracy_m
        return (best, loss_m) if loss_m > 0.0 else (None, 0.0)


@lru_cache(maxsize=_KEPT)
def operations_of(crs: str, epoch: float | None = None) -> CrsOperations:
    """Return the operations between a CRS and WGS84.

    Parameters
    ----------
    crs : str
        Anything PROJ reads: ``EPSG:28355``, WKT, ``EPSG:25832+5783``.
    epoch : float, optional
        Year in which positions on a plate-fixed datum are wanted on WGS84.

    Returns
    -------
    CrsOperations
        They serve all threads.

    Raises
    ------
    InputError
        The CRS is not known, there is no way to WGS84, or no geoid grid for the heights.
    """
    return CrsOperations(parse_crs(crs), epoch)


def to_wgs84(xyz: np.ndarray, crs: str) -> np.ndarray:
    """Return lon, lat, ellipsoidal height of points in any CRS that PROJ knows.

    A vertical part of the CRS is converted; a CRS without one leaves the heights as they are.

    Parameters
    ----------
    xyz : (n, 3) ndarray
        Positions in the CRS, x (east) first.
    crs : str
        Anything PROJ reads: ``EPSG:28355``, WKT, ``EPSG:25832+5783``.

    Returns
    -------
    (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres; not finite where no operation covers a point.

    Raises
    ------
    InputError
        The CRS is not known, or there is no way to WGS84.
    """
    return operations_of(crs).to_wgs84(xyz)


def parse_crs(crs: str) -> pyproj.CRS:
    """Return the CRS of a text; raises `InputError` for one that PROJ does not know."""
    try:
        return pyproj.CRS.from_user_input(crs)
    except (pyproj.exceptions.CRSError, UnicodeError) as error:
        raise InputError(f"unknown coordinate reference system {crs!r}: give an EPSG code or WKT") from error


def has_heights(crs: pyproj.CRS) -> bool:
    """Tell whether a CRS says what its heights refer to (compound or three-dimensional)."""
    return len(crs.sub_crs_list) > 1 or len(crs.axis_info) == 3


def without_heights(crs: pyproj.CRS) -> pyproj.CRS:
    """Return a CRS without its heights, so that they pass unchanged; itself where it has none, or is geocentric."""
    if crs.sub_crs_list:
        return without_heights(crs.sub_crs_list[0])
    if len(crs.axis_info) == 2 or crs.is_geocentric:
        return crs
    flat = crs.to_json_dict()
    for part in (flat, flat.get("base_crs", {}), flat.get("source_crs", {})):
        part.pop("id", None)
        if "coordinate_system" in part:
            part["coordinate_system"]["axis"] = part["coordinate_system"]["axis"][:2]
    return pyproj.CRS.from_json_dict(flat)


def split_at_180(bounds: Rectangle) -> tuple[Rectangle, ...]:
    """Return an area (west, south, east, north) as one rectangle in degrees, two where it lies across 180 degrees."""
    west, south, east, north = bounds
    return (bounds,) if west <= east else ((west, south, 180.0, north), (-180.0, south, east, north))


def _rectangles(flat: pyproj.CRS, areas: Sequence[Rectangle]) -> list[tuple[Rectangle, ...]]:
    """Return areas of use (west, south, east, north) as rectangles in a CRS; none where it cannot show an area.

    As PROJ does it: by `EDGE_NODES` nodes along each side, on the CRS's ellipsoid, without a datum.
    """
    everywhere = (-np.inf, -np.inf, np.inf, np.inf)
    if flat.is_geocentric or flat.ellipsoid is None:
        return [(everywhere,)] * len(areas)
    axis, inverse = flat.ellipsoid.semi_major_metre, flat.ellipsoid.inverse_flattening
    shape = f"+rf={inverse!r}" if inverse else f"+b={axis!r}"
    degrees = pyproj.CRS.from_user_input(f"+proj=longlat +a={axis!r} {shape} +no_defs +type=crs")
    to_flat = pyproj.Transformer.from_crs(degrees, flat, always_xy=True)
    found = []
    for area in areas:
        rectangles = []
        for west, south, east, north in split_at_180(area):
            if (west, south, east, north) == WORLD:
                rectangles.append(everywhere)
                continue
            lon, lat = np.linspace(west, east, EDGE_NODES), np.linspace(south, north, EDGE_NODES)
            x, y = to_flat.transform(
                np.concatenate([lon, lon, np.full(EDGE_NODES, west), np.full(EDGE_NODES, east)]),
                np.concatenate([np.full(EDGE_NODES, south), np.full(EDGE_NODES, north), lat, lat]),
            )
            known = np.isfinite(x) & np.isfinite(y)
            if known.any():
                x, y = x[known], y[known]
                rectangles.append((float(x.min()), float(y.min()), float(x.max()), float(y.max())))
        found.append(tuple(rectangles))
    return found
