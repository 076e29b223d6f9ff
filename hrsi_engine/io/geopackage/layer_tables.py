"""Layers of a result as columns: what HRSI wrote into a GeoPackage, read through SQLite in one go."""

import contextlib
import sqlite3
import struct
from typing import Any

import numpy as np
from shapely import wkb

from ...foundation.errors import InputError
from ...ground.geodesy import WGS84, WGS84_3D
from ..opening.sql import sql_text

_ENVELOPE_BYTES = (0, 32, 48, 48, 64)  #: by the code in a geometry's flags: GeoPackage standard, 2.1.3
_HEADER_BYTES = 8
#: Names of the coordinates of points by whether their CRS is geographic.
_AXES = {True: ("lon", "lat", "height"), False: ("x", "y", "height")}


def geopackage_layers(path: str) -> list[str]:
    """Return the names of a GeoPackage's layers of features and attributes."""
    with _open(path) as database:
        rows = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type IN ('features', 'attributes')")
        return [str(row[0]) for row in rows if row[0] != "layer_styles"]


def read_layer_table(path: str, layer: str) -> dict[str, np.ndarray]:
    """Return the columns of a layer of a GeoPackage: its fields; empty numbers are NaN.

    Points give their coordinates, ``lon, lat`` or ``x, y``, and ``height`` where no field has that name; other
    geometries give ``geometry``, as objects of shapely. Raises `InputError` where there is no such file or layer.
    """
    with _open(path) as database:
        found = database.execute(
            "SELECT column_name, srs_id FROM gpkg_geometry_columns WHERE table_name = ?", (layer,)
        ).fetchone()
        place, crs = found if found is not None else ("", 0)
        try:
            cursor = database.execute(sql_text("SELECT * FROM {table}", table=layer))
        except sqlite3.Error:
            listed = ", ".join(geopackage_layers(path)) or "none"
            raise InputError(f"{path}: has no layer {layer!r} (layers: {listed}): name one of these") from None
        names = [str(column[0]) for column in cursor.description]
        rows = cursor.fetchall()
    columns = dict(zip(names, zip(*rows, strict=True) if rows else [()] * len(names), strict=True))
    columns.pop("fid", None)
    geometry = columns.pop(place, None)
    fields = {name: _column(values) for name, values in columns.items()}
    return fields if geometry is None else {**fields, **_geometry(geometry, crs in (WGS84, WGS84_3D), fields)}


@contextlib.contextmanager
def _open(path: str) -> Any:
    try:
        with contextlib.closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
            yield database
    except sqlite3.Error as error:
        raise InputError(f"{path}: cannot be read as a GeoPackage ({error}): check the path") from None


def _column(values: tuple[Any, ...]) -> np.ndarray:
    """Return a column as numbers where it has any, NaN for NULL; else as texts."""
    kinds = {type(value) for value in values}
    if kinds <= {int}:
        return np.array(values, dtype=np.int64)
    if kinds <= {int, float, type(None)}:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    return np.array(["" if value is None else value for value in values], dtype=object)


def _geometry(blobs: tuple[bytes | None, ...], geographic: bool, fields: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the coordinates of points, or geometries."""
    bodies = [None if blob is None else blob[_HEADER_BYTES + _ENVELOPE_BYTES[(blob[3] >> 1) & 7] :] for blob in blobs]
    shapes = [None if body is None else _point(body) for body in bodies]
    if any(shape is None and body is not None for shape, body in zip(shapes, bodies, strict=True)):
        whole = np.empty(len(bodies), dtype=object)
        whole[:] = [None if body is None else wkb.loads(body) for body in bodies]
        return {"geometry": whole}
    nothing = (np.nan, np.nan, np.nan)
    xyz = np.array([nothing if shape is None else shape for shape in shapes], dtype=np.float64).reshape(-1, 3)
    return {name: column for name, column in zip(_AXES[geographic], xyz.T, strict=True) if name not in fields}


def _point(body: bytes) -> tuple[float, ...] | None:
    """Return the coordinates of a point in WKB of little endian, as HRSI and OGR write it; None for all else."""
    if body[0] != 1 or len(body) not in (21, 29):
        return None
    coordinates = struct.unpack(f"<{(len(body) - 5) // 8}d", body[5:])
    return (*coordinates, np.nan)[:3]
