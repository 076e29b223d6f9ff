"""PROJ's coordinate operations between a CRS and WGS84: their accuracies, areas of use and choice by point.

**Stated accuracies.** EPSG's figure is the root sum of squares over the three geocentric coordinates: ED50 to WGS 84
(1) has 10 m, and its publication (DMA TR 8350.2, appendix B) gives standard deviations of X, Y and Z of 3, 8 and 5 m;
PSAD56 to WGS 84 (1) has 42 m from 17, 27 and 27 m; NAD27 to WGS 84 (4) has 10 m from 5, 5 and 6 m. The standard
deviation of each coordinate is therefore the figure over sqrt(3), and for an operation on heights alone the figure
itself. The error of an operation is common to all points of a scene.

**The ITRS.** Between WGS84 and most realisations of the International Terrestrial Reference System (ITRF2014, IGS14)
PROJ has only a ballpark operation. WGS84 is such a realisation itself: the difference between them is stated as
`REALISATIONS_M`.

**PROJ's choice.** ``cs2cs`` and GDAL choose point by point (``proj_create_crs_to_crs``,
``pj_get_suggested_operation``): of the operations whose area of use, as a rectangle in the source CRS, contains the
point, they use the one with the best accuracy; of two equal ones that with the smaller area; and an operation for land
before one for the sea. This module does it for all points of an array at once.

Motion of tectonic plates: transformations between plate-fixed datums and WGS84 in a given year.

ETRS89, GDA2020 and NAD83 move with their plate, WGS84 does not: they diverge by up to 7 cm per year. PROJ has
time-dependent operations to ITRF2014, with which the realisations of WGS84 since 2012 agree to 2 cm (NGA.STND.0036,
version 1.0.0, table 2.1).
"""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pyproj
from pyproj.enums import TransformDirection
from pyproj.transformer import TransformerGroup

from ..foundation.errors import InputError
from .geodesy import WGS84, WGS84_3D
from .operation_uses import COORDINATES_OF_ACCURACY, WORLD, CrsOperation

#: Pipeline steps that change longitudes and latitudes from datum to datum.
_DATUM_STEP = re.compile(
    r"proj=(helmert|molobadekas|molodensky|[a-z]*gridshift|defmodel|deformation|affine|horner|tinshift)|\bpm="
)
_GEOID_MODEL = re.compile(r"EGM ?\d+", re.IGNORECASE)  # heights defined by the model have no conversion error
_AUTHORITY = re.compile(r"(?:INVERSE|DERIVED_FROM)\((\w+)\)")


class Candidate(NamedTuple):
    """An available operation: its pipeline, and its area of use as rectangles in the source CRS."""

    operation: CrsOperation
    pipeline: pyproj.Transformer
    rectangles: tuple[Rectangle, ...]


def list_operations(crs: pyproj.CRS, flat: Sequence[CrsOperation]) -> tuple[list[Candidate], tuple[CrsOperation, ...]]:
    """Return the operations of a CRS in PROJ's order: the available ones, and those whose grid is missing.

    ``flat`` are the operations of the horizontal part of a compound CRS.
    """
    target = WGS84_3D if has_heights(crs) else WGS84
    missing: list[Any] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # missing grids are reported later
        try:
            group = TransformerGroup(crs, target, always_xy=True)
            transformers, missing = group.transformers, group.unavailable_operations
        except pyproj.exceptions.ProjError:  # PROJ cannot create one of the operations that it lists
            transformers = _look_up_only_one(crs, target)
    stated = [_describe(one, crs, flat) for one in transformers]
    pipelines = [pyproj.Transformer.from_pipeline(one.definition) for one in transformers]
    areas = find_rectangles(without_heights(crs), [one.bounds for one in stated])
    candidates = [Candidate(*one) for one in zip(stated, pipelines, areas, strict=True)]
    return candidates, tuple(_describe(one, crs, flat) for one in missing)


def _look_up_only_one(crs: pyproj.CRS, target: int) -> list[pyproj.Transformer]:
    """Return PROJ's own choice of operation in a list; an empty list if it depends on the point."""
    try:
        transformer = pyproj.Transformer.from_crs(crs, target, always_xy=True)
    except pyproj.exceptions.ProjError:
        return []
    return [transformer] if transformer.definition.startswith("proj=") else []


def _describe(operation: Any, crs: pyproj.CRS, flat: Sequence[CrsOperation]) -> CrsOperation:
    """Return the description of a transformer or a coordinate operation of PROJ."""
    steps = operation.operations or ((operation,) if hasattr(operation, "type_name") else ())  # one step: no list
    moving = [step for step in steps if step.type_name != "Conversion"]
    ids = [identifier for step in moving if (identifier := step.to_json_dict().get("id"))]
    codes = [_AUTHORITY.sub(r"\1", identifier["authority"]) + f":{identifier['code']}" for identifier in ids]
    title, name = getattr(operation, "description", None) or operation.name, " + ".join(step.name for step in moving)
    stated = None if operation.accuracy is None or operation.accuracy < 0.0 else float(operation.accuracy)
    is_null = hasattr(operation, "definition") and not _DATUM_STEP.search(operation.definition)
    is_ballpark, only_flat = "ballpark" in title.lower(), title.replace("Ballpark geographic offset", "")
    if is_ballpark and "ballpark" not in only_flat.lower() and is_realisation_of_itrs(crs):
        is_ballpark, stated = False, REALISATIONS_M
        name = re.sub("Ballpark geographic offset from (.+) to WGS 84", r"\1 taken for WGS 84", name)
    area = operation.area_of_use
    return CrsOperation(
        name or title,
        ", ".join(codes),
        stated,
        sigma_m=_estimate_sigmas(stated, is_null, title, crs, flat),
        grids=tuple(grid.short_name for step in steps for grid in step.grids),
        area=area.name if area else "",
        bounds=area.bounds if area else WORLD,
        is_ballpark=is_ballpark,
        is_null=is_null,
    )


def _estimate_sigmas(
    stated: float | None, is_null: bool, title: str, crs: pyproj.CRS, flat: Sequence[CrsOperation]
) -> tuple[float, float]:
    """Return the standard deviations of a horizontal coordinate and of the height from an operation's stated accuracy.

    For a compound CRS, the positions get the largest accuracy figure of an operation of its horizontal part that does
    not exceed the total, the heights the remainder. A null operation has an error in plan only, the plate motion.
    """
    axis_sigma_m = (stated or 0.0) / COORDINATES_OF_ACCURACY**0.5
    if not name_vertical_crs(crs):
        return axis_sigma_m, axis_sigma_m if has_heights(crs) and not is_null else 0.0
    accuracies = [one.accuracy_m for one in flat if one.accuracy_m is not None and one.accuracy_m <= (stated or 0.0)]
    plan = max(accuracies, default=0.0)
    return plan / COORDINATES_OF_ACCURACY**0.5, 0.0 if _GEOID_MODEL.search(title) else (stated or 0.0) - plan


# ---- parts of a CRS ----------------------------------------------------------------------------------------------


def parse_crs(crs: str, where: str = "") -> pyproj.CRS:
    """Return the CRS of a text; raises `InputError`, which begins with ``where``, if PROJ does not know it."""
    try:
        return pyproj.CRS.from_user_input(crs)
    except (pyproj.exceptions.CRSError, UnicodeError) as error:
        text = f"{where}unknown coordinate reference system {crs[:60]!r}: give an EPSG code or WKT"
        raise InputError(text) from error


def has_heights(crs: pyproj.CRS) -> bool:
    """Return whether a CRS defines the reference of its heights (compound or three-dimensional)."""
    return len(crs.sub_crs_list) > 1 or len(crs.axis_info) == 3


def name_vertical_crs(crs: pyproj.CRS) -> str:
    """Return the name of the vertical CRS of a compound CRS; empty for others."""
    return str(crs.sub_crs_list[1].name) if len(crs.sub_crs_list) > 1 else ""


def without_heights(crs: pyproj.CRS) -> pyproj.CRS:
    """Return a CRS without heights, so that they are not converted; itself if it has none or is geocentric."""
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


EDGE_NODES = 21  # nodes along each side of an area of use, for its rectangle in the source CRS, as in PROJ
OFFSHORE = "- offshore"
Rectangle = tuple[float, float, float, float]  # low x, low y, high x, high y


def choose_operations(
    xy: np.ndarray,
    operations: Sequence[CrsOperation],
    areas: Sequence[Sequence[Rectangle]],
    excluded: Mapping[int, np.ndarray],
) -> np.ndarray:
    """Return the index of the operation for each point ``(n,)`` by PROJ's rule, -1 if none is available.

    ``xy (n, 2 or 3)`` and the ``areas`` of use of the ``operations`` have the same coordinates; ``excluded`` are masks
    ``(n,)`` of points for which an operation is excluded. If all points have the same operation, the stride of the
    result is 0.
    """
    if len(areas) == 1 and not excluded:
        return np.broadcast_to(0, len(xy))
    if not len(xy):
        return np.zeros(0, dtype=np.int64)
    x, y = xy[:, 0], xy[:, 1]
    # If each area contains all points or none, the choice for one point is valid for all
    low_x, low_y, high_x, high_y = np.fmin.reduce(x), np.fmin.reduce(y), np.fmax.reduce(x), np.fmax.reduce(y)
    overlaps = [
        (one, r)
        for one, rectangles in enumerate(areas)
        for r in rectangles
        if not (high_x < r[0] or low_x > r[2] or high_y < r[1] or low_y > r[3])
    ]
    covers_all = all(r[0] <= low_x and r[1] <= low_y and r[2] >= high_x and r[3] >= high_y for _, r in overlaps)
    if covers_all and not excluded:
        x, y = np.array([low_x]), np.array([low_y])
    best, accuracy = np.full(len(x), -1), np.full(len(x), np.inf)
    limits = np.tile([-np.inf, -np.inf, np.inf, np.inf], (len(x), 1))
    for one, r in overlaps:
        operation = operations[one]
        inside = (x >= r[0]) & (y >= r[1]) & (x <= r[2]) & (y <= r[3])
        if one in excluded:
            inside &= ~excluded[one]
        better = best < 0
        if operation.accuracy_m is not None and OFFSHORE not in operation.area:
            smaller = (limits[:, :2] <= r[:2]).all(axis=1) & (limits[:, 2:] >= r[2:]).all(axis=1)
            smaller &= (limits != r).any(axis=1)
            is_equal = accuracy == operation.accuracy_m
            better |= (operation.accuracy_m < accuracy) | (is_equal & smaller)
        assigned = inside & better
        best[assigned], limits[assigned] = one, r
        accuracy[assigned] = -1.0 if operation.accuracy_m is None else operation.accuracy_m
    for one, operation in enumerate(operations):  # outside all areas: the first that needs no grid
        if not operation.grids:
            best[(best < 0) & ~excluded.get(one, np.zeros(len(x), dtype=bool))] = one
    return best if len(best) == len(xy) else np.broadcast_to(best, len(xy))


def split_at_180(bounds: Rectangle) -> tuple[Rectangle, ...]:
    """Return an area (west, south, east, north) as one rectangle in degrees, or two if it crosses 180 degrees."""
    west, south, east, north = bounds
    return (bounds,) if west <= east else ((west, south, 180.0, north), (-180.0, south, east, north))


def find_rectangles(flat: pyproj.CRS, areas: Sequence[Rectangle]) -> list[tuple[Rectangle, ...]]:
    """Return areas of use (west, south, east, north) as rectangles in a CRS; empty if the CRS cannot represent an area.

    As in PROJ: from `EDGE_NODES` nodes along each side, on the CRS's ellipsoid, without a datum transformation.
    """
    everywhere = (-np.inf, -np.inf, np.inf, np.inf)
    if flat.is_geocentric or flat.ellipsoid is None:
        return [(everywhere,)] * len(areas)
    axis, inverse = flat.ellipsoid.semi_major_metre, flat.ellipsoid.inverse_flattening
    shape = f"+rf={inverse!r}" if inverse else f"+b={axis!r}"
    degrees = pyproj.CRS.from_user_input(f"+proj=longlat +a={axis!r} {shape} +no_defs +type=crs")
    to_flat = pyproj.Transformer.from_crs(degrees, flat, always_xy=True)
    areas_of_use = []
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
            is_finite = np.isfinite(x) & np.isfinite(y)
            if is_finite.any():
                x, y = x[is_finite], y[is_finite]
                rectangles.append((float(x.min()), float(y.min()), float(x.max()), float(y.max())))
        areas_of_use.append(tuple(rectangles))
    return areas_of_use


#: EPSG codes of ITRF2014 and of ETRS89 as geographic 2D CRS.
ITRF2014, ETRS89 = 9000, 4258
#: Datums (geographic 2D CRS) that PROJ converts to ITRF2014 only through another one: ETRS89 through ETRF2000, the
#: basis of the national networks; GDA94 through GDA2020; NAD83(CSRS) through its version 7. A national realisation of
#: ETRS89, which PROJ treats as equal to it (SWEREF99, RGF93, ETRF2000-PL), is converted through ETRS89.
BY_WAY_OF = {ETRS89: 9067, 4283: 7844, 4617: 8255}
REALISED_M = 0.5  # limit of the stated accuracy for a realisation of ETRS89; a path through WGS84 states 2 m
WGS84_IN_ITRF_M = 0.02  # standard deviation of WGS84's realisations in ITRF2014 (see above)
REALISATIONS_M = 0.1  # assumed accuracy of treating realisations of a datum as equal (EPSG: ETRS89)


_ITRS = re.compile(
    "International[ _]Terrestrial[ _]Reference[ _]Frame|IG[Sb]|SIRGAS[ _]Continuously|Australian[ _]Terrestrial|"
    "World[ _]Geodetic[ _]System[ _]1984|WGS[ _]1984"
)


@dataclass(frozen=True)
class PlateMotion:
    """Steps from a plate-fixed geodetic CRS to ITRF2014 in one year; heights are changed only if ``is_3d``.

    epoch : the year; name : name of the operations; accuracy_m : stated accuracy, including that of WGS84
    """

    steps: tuple[pyproj.Transformer, ...]
    epoch: float
    is_3d: bool
    name: str
    accuracy_m: float

    def move(self, ground: np.ndarray, direction: TransformDirection = TransformDirection.FORWARD) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)`` on WGS84 for positions on the plate-fixed datum, or the inverse."""
        lon, lat, height = ground.T
        year = np.full(len(ground), self.epoch)
        for step in self.steps if direction is TransformDirection.FORWARD else self.steps[::-1]:
            lon, lat, moved_height, _ = step.transform(lon, lat, height, year, direction=direction)
            height = moved_height if self.is_3d else height
        return np.column_stack([lon, lat, height])


def is_realisation_of_itrs(crs: pyproj.CRS) -> bool:
    """Return whether the datum of a CRS is a realisation of the ITRS or of WGS84, which are not fixed to a plate."""
    geodetic = crs.geodetic_crs
    return geodetic is not None and geodetic.datum is not None and _ITRS.match(geodetic.datum.name) is not None


@lru_cache(maxsize=64)
def find_plate_motion(geodetic_wkt: str, epoch: float, is_3d: bool) -> PlateMotion | None:
    """Return the transformation of a plate-fixed geodetic CRS to ITRF2014 in a year; heights change only if ``is_3d``.

    None if PROJ has no time-dependent operation.
    """
    geodetic = pyproj.CRS.from_wkt(geodetic_wkt)
    if is_realisation_of_itrs(geodetic):
        return None
    through = BY_WAY_OF.get(_code_of(geodetic))
    for way in [(through,)] if through else [(), (ETRS89, BY_WAY_OF[ETRS89])]:
        route = [geodetic, *(pyproj.CRS.from_epsg(code) for code in (*way, ITRF2014))]
        if is_3d:
            route = [one.to_3d() for one in route]
        steps = [step for pair in itertools.pairwise(route) if (step := _best(*pair)) is not None]
        is_realisation = len(way) < 2 or (
            len(steps) == 3 and "helmert" not in steps[0].definition and 0.0 <= steps[0].accuracy <= REALISED_M
        )
        if len(steps) == len(route) - 1 and is_realisation and any("t_epoch" in step.definition for step in steps):
            break
    else:
        return None
    names = [
        part.name
        for step in steps
        for part in step.operations or ()
        if " to " in part.name and not part.name.startswith(("Conversion", "Ballpark"))
    ]
    # As stated, or that of treating two realisations of a datum as equal
    stated_m = [float(step.accuracy) if step.accuracy >= 0.0 else REALISATIONS_M for step in steps]
    accuracy = float(np.hypot(WGS84_IN_ITRF_M, sum(stated_m)))
    pipelines = tuple(pyproj.Transformer.from_pipeline(step.definition) for step in steps)
    return PlateMotion(pipelines, epoch, is_3d, " + ".join(names), accuracy)


def _best(source: pyproj.CRS, target: pyproj.CRS) -> pyproj.Transformer | None:
    """Return PROJ's first operation that is not ballpark; any operation if none is and ``source`` is in `BY_WAY_OF`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            group = TransformerGroup(source, target, always_xy=True)
    except pyproj.exceptions.ProjError:  # the file of an operation cannot be opened
        return None
    real = [one for one in group.transformers if "ballpark" not in one.description.lower()]
    is_equated = _code_of(source) in BY_WAY_OF
    return next(iter(real or (group.transformers if is_equated else ())), None)


def _code_of(crs: pyproj.CRS) -> int:
    """Return the EPSG code of the geographic 2D CRS of a geodetic CRS, 0 without a code."""
    code = crs.to_epsg() or 0
    return {4937: 4258, 4939: 4283, 4955: 4617}.get(code, code)
