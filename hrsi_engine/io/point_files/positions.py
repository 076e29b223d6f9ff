"""Positions of a table's rows as longitude, latitude and ellipsoidal height, from any CRS and height datum.

A height datum is never assumed without a message: ``layer`` uses that of the CRS, and warns if there is none.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pyproj

from ...foundation.errors import InputError
from ...foundation.large_arrays import finite_rows
from ...ground.crs_operations import operations_of
from ...ground.geodesy import wrap_degrees
from ...ground.operation_uses import OperationUse, with_geoid, with_surface_heights
from ...ground.proj_operations import has_heights, parse_crs, without_heights
from ..rasters.dems import open_geoid, read_geoid_heights
from .table import PointTable

#: Ellipsoidal heights (n,) of a ground surface at longitudes and latitudes (n, 2); NaN outside of it.
Surface = Callable[[np.ndarray], np.ndarray]

#: Surveyed positions (lon, lat, ellipsoidal height) in HRSI's own layers, whose geometry is the adjusted position.
SURVEYED = ("survey_lon", "survey_lat", "survey_height")
MOST_LON_DEG = 540.0  # 180 and a turn: larger values are no degrees
_ADD_HEIGHTS = "add a field 'height' or points with z, or name a DEM with `dem`"


@dataclass(frozen=True)
class Reference:
    """Reference of the coordinates of a file where the file does not state it.

    ground_crs : CRS of a file that states none; height_datum : ``layer``, ``ellipsoidal``, ``egm96``, ``egm2008`` or
    a geoid grid; surface : heights for points without one; adjusted : whether positions of HRSI's own layers are the
    adjusted ones, not the surveyed ones; epoch : year at which coordinates in a plate-fixed CRS are transformed to
    WGS84; surface_operations : operations that transformed the surface to WGS84
    """

    ground_crs: str = ""
    height_datum: str = "layer"
    surface: Surface | None = None
    adjusted: bool = False
    epoch: float | None = None
    surface_operations: tuple[OperationUse, ...] = ()


def has_positions(table: PointTable) -> bool:
    """Return whether a table has ground positions, in its geometry or in fields."""
    fields = table.columns
    return table.geometry is not None or {"lon", "lat"} <= fields.keys() or {"x", "y"} <= fields.keys()


@dataclass(frozen=True)
class Positions:
    """Positions of a table's rows in WGS84, and the operations that transformed them.

    ground : (n, 3) lon, lat, ellipsoidal height, NaN for a row without position
    warnings : remarks for the user
    operation : (n,) number of the operation, in ``operations``, that transformed each row; -1 for none
    """

    ground: np.ndarray
    warnings: list[str]
    operation: np.ndarray
    operations: tuple[OperationUse, ...] = ()


def ground_positions(table: PointTable, reference: Reference) -> Positions:
    """Return the positions of a table's rows in WGS84.

    Raises `InputError` for a missing CRS, missing heights, swapped or impossible coordinates.
    """
    operation = np.full(len(table), -1)
    if is_own := table.columns.keys() >= set(SURVEYED):
        # Heights of HRSI's own layers are ellipsoidal, also where the user's points, of the same run, are not
        reference = replace(reference, height_datum="ellipsoidal")
    if is_own and not reference.adjusted:
        lon, lat, height = (table.columns[name] for name in SURVEYED)
        return Positions(np.column_stack([wrap_degrees(lon), lat, height]), [], operation)
    xyz, crs, warnings = _read_positions(table, reference)
    present = finite_rows(xyz[:, :2])
    half = np.isfinite(xyz[:, 0]) != np.isfinite(xyz[:, 1])
    missing = half if "sample" in table.columns else ~present
    table.refuse(missing, "has no position: give both coordinates")
    ground, uses = np.full_like(xyz, np.nan), list[OperationUse]()
    if not present.any():
        return Positions(ground, warnings, operation)
    parsed = parse_crs(crs, f"{table.source}: ")
    rows = np.flatnonzero(present)
    _require_plausible(table, xyz, present, parsed)
    remaining = np.isnan(xyz[rows, 2])
    # Rows without a height get that of the surface; their CRS is used without its heights
    for part, on_surface in ((rows[~remaining], False), (rows[remaining], True)):
        if not len(part):
            continue
        is_flat = on_surface or reference.height_datum != "layer" or not has_heights(parsed)
        try:
            operations = operations_of((without_heights(parsed) if is_flat else parsed).to_wkt(), reference.epoch)
        except InputError as error:
            raise InputError(f"{table.source}: {error}") from None
        ground[part], number = operations.convert(np.nan_to_num(xyz[part]))
        operations_used = operations.uses(table.source, ground[part], number)
        if on_surface:
            if reference.surface is None:
                raise InputError(f"{table.name_row(part[0])}: has no height: {_ADD_HEIGHTS}")
            ground[part, 2] = reference.surface(ground[part, :2])
            outside = np.isin(np.arange(len(table)), part) & np.isnan(ground[:, 2])
            table.refuse(outside, f"has no height, and the DEM has none there: {_ADD_HEIGHTS}")
            warnings.append(f"{table.source}: {len(part)} points have no height; the height of the DEM is used")
            of_dem = reference.surface_operations
            operations_used = tuple(
                use._replace(operation=with_surface_heights(use.operation, of_dem)) for use in operations_used
            )
        elif reference.height_datum not in ("layer", "ellipsoidal"):
            geoid = open_geoid(reference.height_datum)
            ground[part, 2] += read_geoid_heights(ground[part], geoid)
            operations_used = tuple(
                use._replace(operation=with_geoid(use.operation, geoid), geoid=geoid) for use in operations_used
            )
        elif is_flat and reference.height_datum == "layer":
            warnings.append(
                f"{table.source}: the height datum is not known; the heights are used as ellipsoidal (set "
                "`height_datum` to ellipsoidal, egm96, egm2008 or FILE)"
            )
        place = {use.number: len(uses) + index for index, use in enumerate(operations_used)}
        operation[part] = [place.get(one, -1) for one in number.tolist()]
        uses += operations_used
    table.refuse(present & ~finite_rows(ground), "lies outside the area of its CRS: correct the CRS or the point")
    ground[:, 0] = wrap_degrees(ground[:, 0])
    return Positions(ground, warnings, operation, tuple(uses))


def _read_positions(table: PointTable, reference: Reference) -> tuple[np.ndarray, str, list[str]]:
    """Return x, y, z as in the file, and their CRS."""
    fields, warnings = table.columns, []
    prefer_xy = bool(reference.ground_crs) and {"x", "y"} <= fields.keys()
    prefer_xy = prefer_xy and not parse_crs(reference.ground_crs, "`ground_crs`: ").is_geographic
    if table.geometry is not None:
        x, y, z, crs = *table.geometry.T, table.crs or reference.ground_crs
        if table.crs and reference.ground_crs:
            warnings.append(f"{table.source}: has a CRS of its own, `ground_crs` is not used for it")
    else:
        x, y = (fields["x"], fields["y"]) if prefer_xy or "lon" not in fields else (fields["lon"], fields["lat"])
        z = np.full(len(table), np.nan)
        crs = reference.ground_crs or ("" if x is fields.get("x") else "EPSG:4326")
    if not crs:
        raise InputError(f"{table.source}: names no CRS: assign one to the layer, or give `ground_crs` EPSG:…")
    if "height" in fields:
        # Heights of the field; where it is empty, of the geometry
        height = table.columns["height"]
        separate = np.abs(z - height)
        if np.any(separate > 0.001) and np.any(z[np.isfinite(z)] != 0.0):
            warnings.append(
                f"{table.source}: heights of the points and of the field differ by up to {np.nanmax(separate):.3f} m; "
                f"the field is used"
            )
        z = np.where(np.isnan(height), z, height)
    if reference.surface is not None and np.isfinite(z).sum() > 1 and not np.nan_to_num(z).any():
        z = np.full(len(table), np.nan)  # programs write 0 for points without a height
    return np.column_stack([x, y, z]), crs, warnings


def _require_plausible(table: PointTable, xyz: np.ndarray, present: np.ndarray, crs: pyproj.CRS) -> None:
    """Raise `InputError` for impossible degrees: swapped latitude and longitude, or metres in a geographic CRS.

    ``present`` is a mask ``(n,)`` of the rows with a position.
    """
    x, y = np.abs(xyz[:, :2].T)
    is_impossible = present & ((y > 90.0) | (x > MOST_LON_DEG))
    if crs.is_projected and not is_impossible.any():
        raise InputError(
            f"{table.source}: its coordinates look like degrees, but its CRS {crs.name!r} is projected: correct the CRS"
        )
    if crs.is_geographic:
        swapped, advice = "latitude and longitude look swapped", "correct fields or CRS"
        cause = np.where(np.maximum(x, y) <= MOST_LON_DEG, swapped, "no degrees")
        table.refuse(is_impossible, lambda row: f"lon {xyz[row, 0]:g}, lat {xyz[row, 1]:g}: {cause[row]}: {advice}")
