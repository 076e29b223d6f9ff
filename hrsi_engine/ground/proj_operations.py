"""What PROJ knows of a CRS: its parts, and the operations between it and WGS84 with their accuracy.

**Stated accuracies.** EPSG's figure is the root sum of squares over the three geocentric coordinates: ED50 to WGS 84
(1) has 10 m, and its publication (DMA TR 8350.2, appendix B) gives X, Y and Z standard deviations of 3, 8 and 5 m;
PSAD56 to WGS 84 (1) has 42 m of 17, 27 and 27 m; NAD27 to WGS 84 (4) has 10 m of 5, 5 and 6 m. So the standard
deviation of each coordinate is the figure over sqrt(3). Of an operation on heights alone it is the figure itself. The
error of an operation is the same at all points of a scene.

**The ITRS.** PROJ has no operation between WGS84 and most realisations of the International Terrestrial Reference
System (ITRF2014, IGS14), and lists a ballpark one. WGS84 is such a realisation itself: what they differ by is stated as
`REALISATIONS_M`.
"""

import re
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import pyproj
from pyproj.transformer import TransformerGroup

from ..foundation.errors import InputError
from .geodesy import WGS84, WGS84_3D
from .operation_choice import Rectangle, find_rectangles
from .operation_uses import COORDINATES_OF_ACCURACY, WORLD, CrsOperation
from .plate_motion import REALISATIONS_M, is_realisation_of_itrs

#: What a step of a pipeline is called that changes longitudes and latitudes from datum to datum.
_DATUM_STEP = re.compile(
    r"proj=(helmert|molobadekas|molodensky|[a-z]*gridshift|defmodel|deformation|affine|horner|tinshift)|\bpm="
)
_GEOID_MODEL = re.compile(r"EGM ?\d+", re.IGNORECASE)  # heights are defined by the model, so it has no error
_AUTHORITY = re.compile(r"(?:INVERSE|DERIVED_FROM)\((\w+)\)")


class Candidate(NamedTuple):
    """An operation that can be used here: its pipeline, and its area of use as rectangles in the source CRS."""

    operation: CrsOperation
    pipeline: pyproj.Transformer
    rectangles: tuple[Rectangle, ...]


def list_operations(crs: pyproj.CRS, flat: Sequence[CrsOperation]) -> tuple[list[Candidate], tuple[CrsOperation, ...]]:
    """Return the operations of a CRS in PROJ's order: those that can be used here, and those that lack a grid.

    ``flat`` are the operations of the horizontal part of a compound CRS.
    """
    target = WGS84_3D if has_heights(crs) else WGS84
    missing: list[Any] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of grids that are missing: told where it matters
        try:
            group = TransformerGroup(crs, target, always_xy=True)
            found, missing = group.transformers, group.unavailable_operations
        except pyproj.exceptions.ProjError:  # PROJ cannot make one of the operations that it lists
            found = _look_up_only_one(crs, target)
    stated = [_describe(one, crs, flat) for one in found]
    pipelines = [pyproj.Transformer.from_pipeline(one.definition) for one in found]
    areas = find_rectangles(without_heights(crs), [one.bounds for one in stated])
    candidates = [Candidate(*one) for one in zip(stated, pipelines, areas, strict=True)]
    return candidates, tuple(_describe(one, crs, flat) for one in missing)


def _look_up_only_one(crs: pyproj.CRS, target: int) -> list[pyproj.Transformer]:
    """Return the operation that PROJ itself takes, in a list; none where that depends on the point."""
    try:
        found = pyproj.Transformer.from_crs(crs, target, always_xy=True)
    except pyproj.exceptions.ProjError:
        return []
    return [found] if found.definition.startswith("proj=") else []


def _describe(operation: Any, crs: pyproj.CRS, flat: Sequence[CrsOperation]) -> CrsOperation:
    """Return what PROJ states of a transformer or of a coordinate operation."""
    steps = operation.operations or ((operation,) if hasattr(operation, "type_name") else ())  # of one step: itself
    moving = [step for step in steps if step.type_name != "Conversion"]
    ids = [known for step in moving if (known := step.to_json_dict().get("id"))]
    codes = [_AUTHORITY.sub(r"\1", known["authority"]) + f":{known['code']}" for known in ids]
    title, name = getattr(operation, "description", None) or operation.name, " + ".join(step.name for step in moving)
    stated = None if operation.accuracy is None or operation.accuracy < 0.0 else float(operation.accuracy)
    is_null = hasattr(operation, "definition") and not _DATUM_STEP.search(operation.definition)
    is_ballpark, only_flat = "ballpark" in title.lower(), title.replace("Ballpark geographic offset", "")
    if is_ballpark and "ballpark" not in only_flat.lower() and is_realisation_of_itrs(crs):
        is_ballpark, stated = False, REALISATIONS_M
        name = re.sub("Ballpark geographic offset from (.+) to WGS 84", r"\1 taken for WGS 84", name)
    area = operation.area_of_use
    return CrsOperation(
        name or title, ", ".join(codes), stated, _estimate_sigmas(stated, is_null, title, crs, flat),
        tuple(grid.short_name for step in steps for grid in step.grids),
        area.name if area else "", area.bounds if area else WORLD, is_ballpark, is_null,
    )  # fmt: skip


def _estimate_sigmas(
    stated: float | None, is_null: bool, title: str, crs: pyproj.CRS, flat: Sequence[CrsOperation]
) -> tuple[float, float]:
    """Return the standard deviations of a horizontal coordinate and of the height that an operation states.

    Of a compound CRS the positions have the largest accuracy of an operation of its horizontal part that the sum holds,
    the heights the rest. A null operation is off in plan, by the motion of a plate.
    """
    each = (stated or 0.0) / COORDINATES_OF_ACCURACY**0.5
    if not name_vertical_crs(crs):
        return each, each if has_heights(crs) and not is_null else 0.0
    known = [one.accuracy_m for one in flat if one.accuracy_m is not None and one.accuracy_m <= (stated or 0.0)]
    plan = max(known, default=0.0)
    return plan / COORDINATES_OF_ACCURACY**0.5, 0.0 if _GEOID_MODEL.search(title) else (stated or 0.0) - plan


# ---- parts of a CRS ----------------------------------------------------------------------------------------------


def parse_crs(crs: str) -> pyproj.CRS:
    """Return the CRS of a text; raises `InputError` for one that PROJ does not know."""
    try:
        return pyproj.CRS.from_user_input(crs)
    except (pyproj.exceptions.CRSError, UnicodeError) as error:
        raise InputError(f"unknown coordinate reference system {crs!r}: give an EPSG code or WKT") from error


def has_heights(crs: pyproj.CRS) -> bool:
    """Tell whether a CRS says what its heights refer to (compound or three-dimensional)."""
    return len(crs.sub_crs_list) > 1 or len(crs.axis_info) == 3


def name_vertical_crs(crs: pyproj.CRS) -> str:
    """Return the name of the vertical CRS of a compound one; empty for others."""
    return str(crs.sub_crs_list[1].name) if len(crs.sub_crs_list) > 1 else ""


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
