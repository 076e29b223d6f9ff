"""Rows of layers replaced inside an existing GeoPackage, in one transaction, while QGIS may have the file open.

`layers.write_geopackage` makes a new file and renames it; here the file stays the same one, so that open layers see
the new rows and the file's other layers are left alone.
"""

import contextlib
import os
import sqlite3
from collections.abc import Sequence

from osgeo import gdal

from ...foundation.errors import InputError, OutputError
from ..opening.datasets import gdal_messages
from ..opening.sql import sql_text
from ..point_files.ogr_layer import open_vector
from .layers import (
    Layer,
    create_layer,
    create_style_table,
    default_styles,
    in_one_place,
    insert_rows,
    insert_styles,
    write_geopackage,
)
from .sqlite_rows import PythonRows

_WAIT_S = 5.0  # for another program that is writing
_SQL_TYPES = {"f": "REAL", "i": "INTEGER", "u": "INTEGER", "b": "BOOLEAN"}


def replace_layers(path: str, layers: Sequence[Layer]) -> None:
    """Give layers of a GeoPackage these rows and their styles; file, layers and fields are made where missing.

    Raises `OutputError` where the file cannot be written; then it is as it was.
    """
    if not os.path.exists(path):
        write_geopackage(path, layers)
        return
    layers = in_one_place(layers)
    styles = default_styles(layers)
    _make_missing_layers(path, layers)
    try:
        with contextlib.closing(sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)) as database:
            database.execute("BEGIN IMMEDIATE")
            for layer in layers:
                _replace(database, layer)
            # Replace the default styles of the layers; those that the user stored under names of their own stay
            for name in styles:
                database.execute("DELETE FROM layer_styles WHERE f_table_name = ? AND styleName = ?", (name, name))
            insert_styles(database, layers, styles)
            database.execute("COMMIT")
    except sqlite3.Error as error:
        raise OutputError(f"{path}: cannot be written ({error}): close other programs that write into it") from None


def _make_missing_layers(path: str, layers: Sequence[Layer]) -> None:
    dataset = None
    with gdal_messages() as messages:
        dataset = gdal.OpenEx(path, gdal.OF_VECTOR | gdal.OF_UPDATE, allowed_drivers=["GPKG"])
        if dataset is not None:
            for layer in layers:
                table = dataset.GetLayerByName(layer.name)
                if table is None:
                    create_layer(dataset, layer)
                elif layer.metadata:
                    table.SetMetadata({**table.GetMetadata(), **layer.metadata})
            if dataset.GetLayerByName("layer_styles") is None:
                create_style_table(dataset)
    if dataset is None or messages:
        reason = messages[-1] if messages else "no GeoPackage"
        raise OutputError(f"{path}: cannot be written ({reason}): check the file, or save to another one")
    del dataset


def _replace(database: sqlite3.Connection, layer: Layer) -> None:
    """Empty a layer and its spatial index, add fields that it lacks, insert the rows."""
    present = {str(row[1]).lower() for row in database.execute("SELECT * FROM pragma_table_info(?)", (layer.name,))}
    for name, column in layer.fields.items():
        if name.lower() not in present:
            sql_type = _SQL_TYPES.get(column.dtype.kind, "TEXT")
            added = sql_text("ALTER TABLE {table} ADD COLUMN {column}", table=layer.name, column=name)
            database.execute(f"{added} {sql_type}")
    for _ in insert_rows(database, layer, PythonRows(database), empty_first=True):
        pass


def layer_names(path: str) -> dict[str, int]:
    """Return the layers of a vector file with their numbers of rows; raise `InputError` where it cannot be opened."""
    dataset = _open_layer(path)
    layers = [dataset.GetLayer(index) for index in range(dataset.GetLayerCount())]
    return {layer.GetName(): layer.GetFeatureCount() for layer in layers}


def text_columns(path: str, layer: str, fields: Sequence[str]) -> dict[str, list[str]]:
    """Return columns of a layer as text; raise `InputError` for a layer or field that is not there."""
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
