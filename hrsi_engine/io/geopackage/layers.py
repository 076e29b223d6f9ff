"""Writing of vector layers: one GeoPackage with several layers and their QGIS styles.

OGR creates the tables, so that every reader understands the file. The rows are inserted by Python's ``sqlite3`` and
the spatial index is packed (`fill_rtree`): OGR's Python interface needs a call for each value and adds each row to
the index separately. The file is made under a temporary name and renamed at the end.

Spatial index of a layer, written at once: the R-tree of a GeoPackage with all nodes packed.

Boxes are sorted into vertical slices and each slice from south to north (sort-tile-recursive packing, Leutenegger et
al. 1997). Consecutive boxes become a node, and consecutive nodes a node of the next level, up to the root. The nodes
are rows of the shadow tables of SQLite's R-tree (https://www.sqlite.org/rtree.html, "Shadow tables"): 2 bytes of
depth (in the root only), 2 bytes for the number of cells, then cells of an 8-byte id and four 4-byte floats, all
big-endian. SQLite itself would need a hundred times as long, row by row.
"""

import contextlib
import os
import sqlite3
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from osgeo import gdal, ogr, osr
from shapely.affinity import translate

from ...foundation.errors import OutputError
from ...foundation.large_arrays import finite_rows
from ...foundation.progress import Progress, advance, silent
from ...foundation.version import run_date
from ...ground.geodesy import WGS84, WGS84_3D, are_continuous, continuous_longitudes, metres_per_degree
from ..opening.databases import insert_text, sql_text
from ..opening.datasets import config_option, gdal_messages, quiet
from ..safety.replacing import remove_write_ahead_log, replacing
from .layer_styles import Style, default_style
from .typed_rows import DTYPES, LayerRows, describe_columns

GEOMETRY_COLUMN = "geom"
_CHUNK_ROWS = 10_000
#: For a temporary file, which is flushed and renamed when it is complete.
_WITHOUT_SAFETY = ("PRAGMA synchronous = OFF", "PRAGMA journal_mode = OFF")


@dataclass(frozen=True, eq=False)
class Layer:
    """A vector layer as columns.

    name : of the layer
    geometry : ``Point``, ``PointZ``, ``Polygon`` or ``None`` (a table without geometry)
    crs : EPSG code
    coordinates : (n, 2) or (n, 3) points, or sequence of shapely.geometry.Polygon. NaN, an empty polygon: no geometry.
    fields : LayerRows, or mapping of str to (n,) columns by name: text, integers, floats (NaN is written as NULL) or
    bools. Fields of a class of `declared_layers` are described in the file.
    metadata : metadata items of the layer in addition to its description (in the table gpkg_metadata)
    """

    name: str
    geometry: str
    crs: int
    coordinates: Any
    fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.fields.values()))) if self.fields else len(self.coordinates)

    @property
    def description(self) -> str:
        """First line of the docstring of the class of its rows; empty for columns of no class."""
        text = type(self.fields).__doc__ if isinstance(self.fields, LayerRows) else ""
        return (text or "").partition("\n")[0].rstrip(".")

    @cached_property
    def boxes(self) -> np.ndarray:
        """West, south, east, north of each polygon, ``(n, 4)``; NaN where it is empty."""
        empty = (np.nan,) * 4
        extremes = [empty if polygon.is_empty else polygon.bounds for polygon in self.coordinates]
        return np.array(extremes, dtype=np.float64).reshape(-1, 4)

    @property
    def width_m(self) -> float:
        """The longer side of the bounding box of all geometries, metres on the ground; 0 if there are none."""
        west, south, east, north = _extent(*_corners(self))
        if np.isnan(west):
            return 0.0
        sides = np.array([east - west, north - south])
        if self.crs in (WGS84, WGS84_3D):
            sides = sides * metres_per_degree(np.array([[(west + east) / 2.0, (south + north) / 2.0, 0.0]]))[0, :2]
        return float(sides.max())


def default_styles(layers: Sequence[Layer]) -> dict[str, Style]:
    """Return the styles of those layers for which HRSI has one, by name."""
    styles = {layer.name: default_style(layer.name, layer.fields, layer.width_m) for layer in layers}
    return {name: style for name, style in styles.items() if style is not None}


def write_geopackage(
    path: str,
    layers: Sequence[Layer],
    styles: Mapping[str, Style] | None = None,
    progress: Progress = silent,
    lineage: Mapping[str, str] | None = None,
) -> None:
    """Write layers with styles by layer name (default: those of `layer_styles`), replacing the file in one step.

    path : the file; layers : its layers; styles : by layer name; by default those of `layer_styles`
    progress : callback; False cancels
    lineage : metadata items on the origin of the layers, by name, written for each layer (in the table gpkg_metadata)
    Raises `OutputError`: the file cannot be written; `Cancelled`: ``progress`` returned False.
    """
    for layer in layers:
        lengths = {name: len(column) for name, column in layer.fields.items()} | {"id of rows": len(layer)}
        if layer.geometry != "None":
            lengths["coordinates"] = len(layer.coordinates)
        if len(set(lengths.values())) > 1:
            raise OutputError(f"{path}, layer {layer.name}: columns differ in length: {lengths}")
    layers = join_longitudes(layers)
    total = max(1, sum(map(len, layers)))
    if styles is None:
        styles = default_styles(layers)
    length = len(os.fsencode(os.path.abspath(path)))
    if length > 400:  # names of temporary files and journals are longer: they identify the process
        raise OutputError(
            f"{path}: a path of {length} bytes is too long for SQLite, which opens 512: choose a shorter `output_dir`"
        )
    with replacing(path) as temporary, quiet():  # GDAL and SQLite print more messages if the disk is full
        with config_option("OGR_CURRENT_DATE", run_date()):
            # OGR makes an empty GeoPackage with all layers
            dataset = None
            with gdal_messages() as messages:
                dataset = ogr.GetDriverByName("GPKG").CreateDataSource(temporary, options=["VERSION=1.2"])
                if dataset is not None:
                    for layer in layers:
                        create_layer(dataset, layer, lineage or {})
                    if styles:
                        create_style_table(dataset)
            if dataset is None or messages:
                dataset = None  # closed here, where GDAL's messages are suppressed
                raise OutputError(f"{path}: cannot be written ({messages.reason}): check the folder")
            del dataset
        try:
            with contextlib.closing(sqlite3.connect(temporary, isolation_level=None)) as database:
                for pragma in _WITHOUT_SAFETY:
                    database.execute(pragma)
                database.execute("BEGIN")
                rows_written = 0
                for layer in layers:
                    for _ in insert_rows(database, layer):
                        rows_written += _CHUNK_ROWS
                        advance(progress, min(1.0, rows_written / total), f"writing layer {layer.name}")
                insert_styles(database, layers, styles)
                describe_fields(database, layers)
                database.execute("COMMIT")
        except sqlite3.Error as error:
            raise OutputError(f"{path}: cannot be written ({error}): check free space and permissions") from None
        remove_write_ahead_log(path)
    advance(progress, 1.0, f"wrote {os.path.basename(path)}")


def join_longitudes(layers: Sequence[Layer]) -> list[Layer]:
    """Return layers whose longitudes do not jump at 180 degrees, so that the extent of a block across it is correct."""
    places = {
        number: _corners(layer)[0][:, 0]
        for number, layer in enumerate(layers)
        if layer.crs in (WGS84, WGS84_3D) and layer.geometry != "None"
    }
    ends = [(np.fmin.reduce(part), np.fmax.reduce(part)) for part in places.values() if len(part)]
    if not ends or are_continuous(np.concatenate(ends)):  # without arrays of the length of the layers
        return list(layers)
    west = np.concatenate(list(places.values()))
    turns = np.round((continuous_longitudes(west) - west) / 360.0)
    shifted, parts = list(layers), np.split(turns, np.cumsum([len(part) for part in places.values()])[:-1])
    for number, part in zip(places, parts, strict=True):
        if np.any(np.abs(part) > 0.0):
            coordinates: Any = layers[number].coordinates
            if isinstance(coordinates, Sequence):
                turned = zip(coordinates, np.nan_to_num(part).tolist(), strict=True)
                coordinates = [translate(polygon, 360.0 * count) if count else polygon for polygon, count in turned]
            else:
                place = np.asarray(coordinates)
                coordinates = np.column_stack([place[:, 0] + 360.0 * part, place[:, 1:]])
            shifted[number] = replace(layers[number], coordinates=coordinates)
    return shifted


def create_layer(dataset: gdal.Dataset, layer: Layer, lineage: Mapping[str, str] | None = None) -> None:
    """Create an empty layer by OGR, with its ``lineage`` in gpkg_metadata and its description in gpkg_contents."""
    reference = osr.SpatialReference()
    reference.ImportFromEPSG(layer.crs)
    reference.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    options = ["SPATIAL_INDEX=YES", f"GEOMETRY_NAME={GEOMETRY_COLUMN}", "FID=fid"]
    options += [f"DESCRIPTION={layer.description}"] if layer.description else []
    types = {"Point": ogr.wkbPoint, "PointZ": ogr.wkbPoint25D, "Polygon": ogr.wkbPolygon, "None": ogr.wkbNone}
    place = None if layer.geometry == "None" else reference
    table = dataset.CreateLayer(layer.name, place, types[layer.geometry], options)
    declared = layer.fields.declared if isinstance(layer.fields, LayerRows) else {}
    for name, column in layer.fields.items():
        kinds = {"f": ogr.OFTReal, "i": ogr.OFTInteger64, "u": ogr.OFTInteger64, "b": ogr.OFTInteger}
        kind = DTYPES[declared[name].kind][0] if name in declared else column.dtype.kind
        definition = ogr.FieldDefn(name, kinds.get(kind, ogr.OFTString))
        if kind == "b":
            definition.SetSubType(ogr.OFSTBoolean)
        table.CreateField(definition)
    if lineage or layer.metadata:
        description = {"DESCRIPTION": layer.description} if layer.description else {}
        table.SetMetadata({**(lineage or {}), **layer.metadata, **description})


def insert_rows(database: sqlite3.Connection, layer: Layer) -> Iterator[None]:
    """Replace the rows of an existing table by a layer's, pausing after each chunk; then set extent, index and count.

    The caller begins and ends the transaction.
    """
    names = ["fid", *([GEOMETRY_COLUMN] if layer.geometry != "None" else []), *layer.fields]
    low, high = _corners(layer)
    with _without_triggers(database, layer.name):
        database.execute(sql_text("DELETE FROM {table}", table=layer.name))
        for start in range(0, len(layer), _CHUNK_ROWS):
            part = slice(start, min(start + _CHUNK_ROWS, len(layer)))
            columns = [values[part].tolist() for values in layer.fields.values()]
            geometries = [] if layer.geometry == "None" else [_geometries(layer, part)]
            rows = zip(range(part.start + 1, part.stop + 1), *geometries, *columns, strict=True)
            database.executemany(insert_text(layer.name, names), rows)
            yield
        fill_rtree(database, f"rtree_{layer.name}_{GEOMETRY_COLUMN}", low, high)
    database.execute("UPDATE gpkg_ogr_contents SET feature_count = ? WHERE table_name = ?", (len(layer), layer.name))
    west, south, east, north = _extent(low, high)
    if not np.isnan(west):
        database.execute(
            "UPDATE gpkg_contents SET min_x = ?, max_x = ?, min_y = ?, max_y = ? WHERE table_name = ?",
            (west, east, south, north, layer.name),
        )


@contextlib.contextmanager
def _without_triggers(database: sqlite3.Connection, table: str) -> Iterator[None]:
    """Drop OGR's triggers that count and index each row, and create them again at the end."""
    triggers = database.execute(
        "SELECT name, sql FROM sqlite_master WHERE type = 'trigger' AND tbl_name = ?", (table,)
    ).fetchall()
    for name, _ in triggers:
        database.execute(sql_text("DROP TRIGGER {trigger}", trigger=name))
    yield
    for _, sql in triggers:
        database.execute(sql)


def _corners(layer: Layer) -> tuple[np.ndarray, np.ndarray]:
    """Return minimum and maximum x, y of each geometry, ``(n, 2)`` each; NaN if it is empty."""
    if layer.geometry == "None":
        return np.empty((0, 2)), np.empty((0, 2))
    if layer.geometry != "Polygon":
        xy = np.where(finite_rows(layer.coordinates[:, :2])[:, None], layer.coordinates[:, :2], np.nan)
        return xy, xy
    return layer.boxes[:, :2], layer.boxes[:, 2:]


def _extent(low: np.ndarray, high: np.ndarray) -> tuple[float, ...]:
    """Return west, south, east, north of boxes with corners ``(n, 2)``; NaN without any."""
    columns = ((np.fmin, low.T), (np.fmax, high.T))
    return tuple(float(extreme.reduce(column, initial=np.nan)) for extreme, pair in columns for column in pair)


def _geometries(layer: Layer, rows: slice) -> list[bytes | None]:
    """Return the geometries of some rows as GeoPackage binary, None for empty ones."""
    if layer.geometry == "Polygon":
        # A header with the envelope, then WKB
        boxed = zip(layer.coordinates[rows], layer.boxes[rows].tolist(), strict=True)
        return [
            None
            if polygon.is_empty
            else struct.pack("<2sBBi4d", b"GP", 0, 3, layer.crs, west, east, south, north) + bytes(polygon.wkb)
            for polygon, (west, south, east, north) in boxed
        ]
    # GeoPackage geometries of points: a header of 8 bytes without envelope, then ISO WKB.
    # Source: OGC 12-128r18, clause 2.1.3.
    xyz = np.asarray(layer.coordinates[rows], dtype=np.float64)
    axes, kind = (3, 1001) if layer.geometry == "PointZ" else (2, 1)
    head = struct.pack("<2sBBiBI", b"GP", 0, 1, layer.crs, 1, kind)
    blobs = np.zeros(len(xyz), dtype=[("head", f"V{len(head)}"), ("coordinates", "<f8", (axes,))])
    blobs["head"], blobs["coordinates"] = np.void(head), xyz[:, :axes]
    values: list[bytes | None] = blobs.view(f"V{blobs.itemsize}").tolist()
    for empty in np.flatnonzero(~finite_rows(xyz[:, :2])).tolist():
        values[empty] = None
    return values


#: Tables of the extension gpkg_schema, which describes columns, and the table of extensions, which is missing in a file
#: without an R-tree. Source: OGC 12-128r18, annexes C.6 and F.9.
_SCHEMA_TABLES = (
    "CREATE TABLE IF NOT EXISTS gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL,"
    " definition TEXT NOT NULL, scope TEXT NOT NULL,"
    " CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))",
    "CREATE TABLE IF NOT EXISTS gpkg_data_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, name TEXT,"
    " title TEXT, description TEXT, mime_type TEXT, constraint_name TEXT,"
    " CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name), CONSTRAINT gdc_tn UNIQUE (table_name, name))",
    "CREATE TABLE IF NOT EXISTS gpkg_data_column_constraints (constraint_name TEXT NOT NULL, constraint_type TEXT NOT"
    " NULL, value TEXT, min NUMERIC, min_is_inclusive BOOLEAN, max NUMERIC, max_is_inclusive BOOLEAN, description TEXT,"
    " CONSTRAINT gdcc_ntv UNIQUE (constraint_name, constraint_type, value))",
)


def describe_fields(database: sqlite3.Connection, layers: Sequence[Layer]) -> None:
    """Write the descriptions of declared fields (`typed_rows`) into the standard's table gpkg_data_columns."""
    rows = [(layer.name, name, said.text) for layer in layers for name, said in describe_columns(layer.fields).items()]
    if not rows:
        return
    for statement in _SCHEMA_TABLES:
        database.execute(statement)
    schema = None, "gpkg_schema", "http://www.geopackage.org/spec121/#extension_schema", "read-write"
    extension = [(table, *schema) for table in ("gpkg_data_columns", "gpkg_data_column_constraints")]
    database.executemany("INSERT INTO gpkg_extensions VALUES (?, ?, ?, ?, ?)", extension)
    database.executemany("INSERT INTO gpkg_data_columns (table_name, column_name, description) VALUES (?, ?, ?)", rows)


def create_style_table(dataset: gdal.Dataset) -> None:
    """Create the table in which QGIS looks for the styles of a file's layers, with the columns that QGIS gives it."""
    table = dataset.CreateLayer("layer_styles", None, ogr.wkbNone, ["FID=id"])
    for name, width in (
        ("f_table_catalog", 256),
        ("f_table_schema", 256),
        ("f_table_name", 256),
        ("f_geometry_column", 256),
        ("styleName", 30),
        ("styleQML", 0),
        ("styleSLD", 0),
    ):
        definition = ogr.FieldDefn(name, ogr.OFTString)
        definition.SetWidth(width)
        table.CreateField(definition)
    default = ogr.FieldDefn("useAsDefault", ogr.OFTInteger)
    default.SetSubType(ogr.OFSTBoolean)
    table.CreateField(default)
    for name in ("description", "owner", "ui"):
        table.CreateField(ogr.FieldDefn(name, ogr.OFTString))
    table.CreateField(ogr.FieldDefn("update_time", ogr.OFTDateTime))


def insert_styles(database: sqlite3.Connection, layers: Sequence[Layer], styles: Mapping[str, Style]) -> None:
    for name in [layer.name for layer in layers if layer.name in styles]:
        database.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName,"
            " styleQML, styleSLD, useAsDefault, description, owner, ui, update_time)"
            " VALUES ('', '', ?, ?, ?, ?, '', 1, ?, '', '', ?)",
            (name, GEOMETRY_COLUMN, name, styles[name].qml, styles[name].description, run_date()),
        )
    if styles:
        database.execute(
            "UPDATE gpkg_ogr_contents SET feature_count = (SELECT count(*) FROM layer_styles)"
            " WHERE table_name = 'layer_styles'"
        )


_CELL = np.dtype([("id", ">i8"), ("box", ">f4", (4,))])
_HEAD_BYTES, _ROOT = 4, 1


def fill_rtree(database: sqlite3.Connection, rtree: str, low: np.ndarray, high: np.ndarray) -> None:
    """Replace the contents of an R-tree, if it exists, by the boxes of the rows 1 to n.

    low, high : (n, 2) minimum and maximum x, y, equal for points; NaN for a row without geometry
    """
    if not database.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (f"{rtree}_node",)).fetchone():
        return
    size = database.execute(sql_text("SELECT length(data) FROM {node} WHERE nodeno = 1", node=f"{rtree}_node"))
    capacity = (int(size.fetchone()[0]) - _HEAD_BYTES) // _CELL.itemsize
    node_type = np.dtype([("depth", ">u2"), ("cells", ">u2"), ("cell", _CELL, (capacity,))])
    for shadow in ("node", "rowid", "parent"):
        database.execute(sql_text("DELETE FROM {table}", table=f"{rtree}_{shadow}"))
    ids = np.flatnonzero(np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)) + 1
    boxes = _round_outwards(low[ids - 1], high[ids - 1])
    order = _order_in_tiles(boxes, capacity)
    ids, boxes, depth, first = ids[order], boxes[order], 0, _ROOT + 1
    while True:
        count = max(1, -(-len(ids) // capacity))
        bounds = np.arange(count + 1) * len(ids) // count  # all nodes are about equally full
        numbers = first + np.arange(count) if count > 1 else np.array([_ROOT])
        node, cells = np.repeat(np.arange(count), np.diff(bounds)), np.diff(bounds)
        place = np.arange(len(ids)) - bounds[node]
        content = np.zeros(count, dtype=node_type)
        content["cells"], content["depth"] = cells, depth if count == 1 else 0
        content["cell"]["id"][node, place], content["cell"]["box"][node, place] = ids, boxes
        _insert(database, f"{rtree}_node", ("nodeno", "data"), zip(numbers.tolist(), map(bytes, content), strict=True))
        table, key = ("parent", "nodeno") if depth else ("rowid", "rowid")
        by_id = np.argsort(ids)
        parents = zip(ids[by_id].tolist(), numbers[node[by_id]].tolist(), strict=True)
        _insert(database, f"{rtree}_{table}", (key, "parentnode" if depth else "nodeno"), parents)
        if count == 1:
            return
        smallest, largest = (extreme.reduceat(boxes, bounds[:-1]) for extreme in (np.minimum, np.maximum))
        boxes = np.column_stack([smallest[:, 0], largest[:, 1], smallest[:, 2], largest[:, 3]])
        ids, depth, first = numbers, depth + 1, first + count


def _insert(database: sqlite3.Connection, table: str, columns: tuple[str, str], rows: Iterable[tuple]) -> None:
    database.executemany(insert_text(table, columns), rows)


def _round_outwards(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return min x, max x, min y, max y as float32 ``(n, 4)``, rounded so that they contain the float64 boxes."""
    boxes = np.empty((len(low), 4), dtype=np.float32)
    for column, exact, exceeds, limit in ((0, low, np.greater, -np.inf), (1, high, np.less, np.inf)):
        for axis in (0, 1):
            single = exact[:, axis].astype(np.float32)
            inside = exceeds(single, exact[:, axis])
            boxes[:, 2 * axis + column] = np.where(inside, np.nextafter(single, np.float32(limit)), single)
    return boxes


def _order_in_tiles(boxes: np.ndarray, capacity: int) -> np.ndarray:
    """Return an order in which neighbours follow each other: vertical slices, each from south to north."""
    count = len(boxes)
    slices = int(np.ceil(np.sqrt(count / capacity)))
    strip = np.empty(count, dtype=np.int64)
    strip[np.argsort(boxes[:, 0] + boxes[:, 1], kind="stable")] = np.arange(count) * slices // max(count, 1)
    return np.lexsort((boxes[:, 2] + boxes[:, 3], strip))
