"""Layers of a result as columns: reads and replaces the layers of HRSI in a GeoPackage directly through SQLite.

`replace_layers` replaces rows of layers inside an existing GeoPackage, in one transaction, while QGIS may have the file
open. `layers.write_geopackage` makes a new file and renames it; here the file remains the same one, so that open
layers show the new rows and the other layers of the file are not changed.
"""

import contextlib
import os
import sqlite3
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from osgeo import gdal
from shapely import wkb

from ...foundation.errors import InputError, OutputError
from ...ground.geodesy import WGS84, WGS84_3D
from ..large_tables import read_large_table
from ..opening.databases import sql_text
from ..opening.datasets import gdal_messages
from ..point_files.kept_columns import COMPLETE_FILES, LAYERS_FILE
from ..point_files.ogr_layer import open_vector
from . import layers as layer_files


def geopackage_layers(path: str) -> list[str]:
    """Return the names of a GeoPackage's layers of features and attributes."""
    with _open(path) as database:
        rows = database.execute("SELECT table_name FROM gpkg_contents WHERE data_type IN ('features', 'attributes')")
        return [str(row[0]) for row in rows if row[0] != "layer_styles"]


def read_layer_table(path: str, layer: str) -> dict[str, np.ndarray]:
    """Return the fields of a layer of a GeoPackage as columns; missing numbers are NaN.

    Points add their coordinates, ``lon, lat`` or ``x, y``, and ``height``, unless a field has that name; others add
    ``geometry``, objects of shapely. Of a large block, whose layers show a selection, all rows are returned. Raises
    `InputError` if there is no such file or layer.
    """
    complete = os.path.join(os.path.dirname(path), COMPLETE_FILES.get(layer, ""))
    if os.path.basename(path) == LAYERS_FILE and os.path.isfile(complete):
        return read_large_table(complete)
    with _open(path) as database:
        result = database.execute(
            "SELECT column_name, srs_id FROM gpkg_geometry_columns WHERE table_name = ?", (layer,)
        ).fetchone()
        place, crs = result if result is not None else ("", 0)
        try:
            cursor = database.execute(sql_text("SELECT * FROM {table}", table=layer))
        except sqlite3.Error:
            entries = ", ".join(geopackage_layers(path)) or "none"
            raise InputError(f"{path}: has no layer {layer!r} (layers: {entries}): name one of these") from None
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
    """Return a column as numbers, with NaN for NULL, if all values are numbers or NULL; otherwise as objects."""
    kinds = {type(value) for value in values}
    if kinds <= {int}:
        return np.array(values, dtype=np.int64)
    if kinds <= {int, float, type(None)}:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    return np.array(["" if value is None else value for value in values], dtype=object)


def _geometry(blobs: tuple[bytes | None, ...], geographic: bool, fields: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the coordinate columns of points, or one column of other geometries."""
    # After the header of 8 bytes follows an envelope, whose kind is in the flags: GeoPackage standard, 2.1.3
    begins = (8 + (0, 32, 48, 48, 64)[(blob[3] >> 1) & 7] if blob is not None else 0 for blob in blobs)
    bodies = [None if blob is None else blob[begin:] for blob, begin in zip(blobs, begins, strict=True)]
    shapes = [None if body is None else _point(body) for body in bodies]
    if any(shape is None and body is not None for shape, body in zip(shapes, bodies, strict=True)):
        geometries = np.empty(len(bodies), dtype=object)
        geometries[:] = [None if body is None else wkb.loads(body) for body in bodies]
        return {"geometry": geometries}
    nothing = (np.nan, np.nan, np.nan)
    xyz = np.array([nothing if shape is None else shape for shape in shapes], dtype=np.float64).reshape(-1, 3)
    names = ("lon", "lat", "height") if geographic else ("x", "y", "height")
    return {name: column for name, column in zip(names, xyz.T, strict=True) if name not in fields}


def _point(body: bytes) -> tuple[float, ...] | None:
    """Return the coordinates of a point in little-endian WKB, as HRSI and OGR write it; None for any other geometry."""
    if body[0] != 1 or len(body) not in (21, 29):
        return None
    coordinates = struct.unpack(f"<{(len(body) - 5) // 8}d", body[5:])
    return (*coordinates, np.nan)[:3]


_WAIT_S = 5.0  # while another program is writing


def replace_layers(path: str, layers: Sequence[layer_files.Layer]) -> None:
    """Replace rows and styles of layers of a GeoPackage; file, layers and fields are created if they are missing.

    Raises `OutputError` if the file cannot be written; its rows are unchanged then.
    """
    if not os.path.exists(path):
        layer_files.write_geopackage(path, layers)
        return
    layers = layer_files.join_longitudes(layers)
    styles = layer_files.default_styles(layers)
    dataset = None
    with gdal_messages() as messages:
        dataset = gdal.OpenEx(path, gdal.OF_VECTOR | gdal.OF_UPDATE, allowed_drivers=["GPKG"])
        if dataset is not None:
            for layer in layers:
                table = dataset.GetLayerByName(layer.name)
                if table is None:
                    layer_files.create_layer(dataset, layer)
                elif layer.metadata:
                    table.SetMetadata({**table.GetMetadata(), **layer.metadata})
            if dataset.GetLayerByName("layer_styles") is None:
                layer_files.create_style_table(dataset)
    if dataset is None or messages:
        reason = messages[-1] if messages else "no GeoPackage"
        raise OutputError(f"{path}: cannot be written ({reason}): check the file, or save to another one")
    del dataset
    try:
        with contextlib.closing(sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)) as database:
            database.execute("BEGIN IMMEDIATE")
            for layer in layers:
                _replace_rows(database, layer)
            # Replace the default styles of the layers; styles that the user stored under other names remain
            for name in styles:
                database.execute("DELETE FROM layer_styles WHERE f_table_name = ? AND styleName = ?", (name, name))
            layer_files.insert_styles(database, layers, styles)
            database.execute("COMMIT")
        for layer in layers:  # now the file itself has all rows
            if os.path.basename(path) == LAYERS_FILE and layer.name in COMPLETE_FILES:
                with contextlib.suppress(FileNotFoundError):
                    os.remove(os.path.join(os.path.dirname(path), COMPLETE_FILES[layer.name]))
    except sqlite3.Error as error:
        raise OutputError(f"{path}: cannot be written ({error}): close other programs that write into it") from None


def _replace_rows(database: sqlite3.Connection, layer: layer_files.Layer) -> None:
    """Delete the rows of a layer and its spatial index, add missing fields, insert the new rows."""
    present = {str(row[1]).lower() for row in database.execute("SELECT * FROM pragma_table_info(?)", (layer.name,))}
    for name, column in layer.fields.items():
        if name.lower() not in present:
            sql_type = {"f": "REAL", "i": "INTEGER", "u": "INTEGER", "b": "BOOLEAN"}.get(column.dtype.kind, "TEXT")
            added = sql_text("ALTER TABLE {table} ADD COLUMN {column}", table=layer.name, column=name)
            database.execute(f"{added} {sql_type}")
    for _ in layer_files.insert_rows(database, layer):
        pass


def layer_names(path: str) -> dict[str, int]:
    """Return the layers of a vector file with their numbers of rows; raise `InputError` if it cannot be opened."""
    dataset = _open_layer(path)
    layers = [dataset.GetLayer(index) for index in range(dataset.GetLayerCount())]
    return {layer.GetName(): layer.GetFeatureCount() for layer in layers}


def text_columns(path: str, layer: str, fields: Sequence[str]) -> dict[str, list[str]]:
    """Return fields of a layer as text; raise `InputError` if the layer or a field is missing."""
    dataset = _open_layer(path)
    table = dataset.GetLayerByName(layer)
    for field in fields:
        if table is None or table.GetLayerDefn().GetFieldIndex(field) < 0:
            raise InputError(f"{path}: layer {layer!r} has no field {field!r}: name another file")
    return {field: [str(feature.GetField(field) or "") for feature in table] for field in fields}


def _open_layer(path: str) -> gdal.Dataset:
    dataset = open_vector(path)
    if dataset is None:
        raise InputError(f"{path}: cannot be opened as a vector file: check the path")
    return dataset
