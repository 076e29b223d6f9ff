"""From a file to `LaserPoints`: which reader it takes, and the one place where its rows are checked."""

import os
from dataclasses import replace

import numpy as np

from ...block.laser import LaserPoints
from ...foundation.errors import InputError
from ..opening.budgets import GROUND_HEIGHTS
from ..opening.plain_files import require_plain
from ..point_files.find import point_reader_of, split_spec
from ..point_files.positions import Reference, ground_positions, has_positions
from ..point_files.table import PointTable
from .granules import HDF5_HEAD, read_granule
from .parquet import PARQUET_HEAD, read_parquet

TRACK_FIELDS = ("rgt", "cycle")  #: what tells the passes of ICESat-2 apart; their beams share most errors
NO_GROUND = "a height of no ground"


def read_laser(
    spec: str, height_datum: str = "ellipsoidal", ground_crs: str | None = None, epoch: float | None = None
) -> LaserPoints:
    """Return the laser points of a file.

    spec : a granule (ATL06, ATL08, GEDI L2A), GeoParquet, or ``FILE[|layername=L]`` of points with the fields
    ``height`` or ``h_mean``, and ``sigma_h`` or ``h_sigma``
    height_datum : what heights of a layer refer to: ``ellipsoidal``, ``layer`` (as its CRS says), ``egm96``,
    ``egm2008`` or a geoid grid file. Granules are always ellipsoidal
    ground_crs : CRS of x and y in a file that names none; longitudes and latitudes are WGS84 there
    epoch : year in which a CRS fixed to a plate is brought to WGS84

    All points come back; those with impossible heights have a ``doubt``. `InputError` names file and field, and what to
    do.
    """
    path, layer = split_spec(spec)
    head = _read_head(path)
    if head.startswith(HDF5_HEAD):
        return _mark_impossible_heights(read_granule(path))
    table = read_parquet(path) if head.startswith(PARQUET_HEAD) else point_reader_of(path).read(path, layer)
    return _mark_impossible_heights(_of_table(table, Reference(ground_crs or "", height_datum, epoch=epoch)))


def _read_head(path: str) -> bytes:
    require_plain(path)
    if not os.path.isfile(path):
        return b""  # the readers of point files say what is wrong
    try:
        with open(path, "rb") as file:
            return file.read(len(HDF5_HEAD))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): check its permissions") from None


def _of_table(table: PointTable, reference: Reference) -> LaserPoints:
    """Return the rows of a table that have a position and a height."""
    if not len(table):
        raise InputError(f"{table.source}: holds no points: name another file or layer")
    if not has_positions(table):
        raise InputError(
            f"{table.source}: has no positions (point geometry, or fields lon and lat); its fields are "
            f"{', '.join(table.field_names) or 'none'}: add them"
        )
    heights = table.columns.get("height")
    if heights is None and (table.geometry is None or not np.isfinite(table.geometry[:, 2]).any()):
        raise InputError(
            f"{table.source}: has no heights: laser points need a field height (or h_mean), or points with z"
        )
    table = _with_heights(table)
    if table.geometry is None and not {"x", "y"} <= table.columns.keys():
        reference = replace(reference, ground_crs="")
    placed = ground_positions(table, reference)
    nothing = np.full(len(table), np.nan)
    sigma = table.columns.get("sigma_h", nothing)
    sources = {name: table.columns.get(name, nothing) for name in ("slope", "misfit", "photons", "canopy")}
    ids = table.columns.get("id")
    return LaserPoints.create(
        placed.ground, ids=None if ids is None or (ids == "").any() else ids, track=_name_tracks(table),
        sigma_m=np.where(sigma > 0.0, sigma, np.nan), slope=sources["slope"], misfit_m=sources["misfit"],
        photons=sources["photons"], canopy_m=sources["canopy"], source=table.source, operations=placed.operations,
    )  # fmt: skip


def _with_heights(table: PointTable) -> PointTable:
    """Return the table without positions where it has no height, so that no DEM is asked for one."""
    nothing = np.full(len(table), np.nan)
    z = nothing if table.geometry is None else table.geometry[:, 2]
    lost = np.isnan(table.columns.get("height", nothing)) & np.isnan(z)
    if not lost.any():
        return table
    kept = ~lost
    columns = {name: column[kept] for name, column in table.columns.items()}
    if not kept.any():
        raise InputError(f"{table.source}: none of its points has a height: name another file or layer")
    geometry = None if table.geometry is None else table.geometry[kept]
    return PointTable(table.source, columns, table.field_names, table.row_name, geometry, table.crs)


def _name_tracks(table: PointTable) -> np.ndarray:
    """Return each row's track: as the file says, or by reference ground track and cycle."""
    if "track" in table.columns:
        return table.columns["track"]
    text = np.full(len(table), "", dtype=str)
    for field in TRACK_FIELDS:
        if field in table.columns:
            number = np.char.mod("%g", table.columns[field])
            text = np.char.add(np.char.add(text, np.where(text == "", f"{field} ", f", {field} ")), number)
    return text


def _mark_impossible_heights(points: LaserPoints) -> LaserPoints:
    """Return the points with a doubt where a height can be none; raise `InputError` where all are like that."""
    wrong = (points.ground[:, 2] < GROUND_HEIGHTS.lowest_m) | (points.ground[:, 2] > GROUND_HEIGHTS.highest_m)
    if not len(points) or wrong.all():
        raise InputError(f"{points.source}: none of its points has a height that is on the ground: get it again")
    doubt = np.where(wrong & (points.doubt == ""), NO_GROUND, points.doubt)
    return replace(points, doubt=doubt)
