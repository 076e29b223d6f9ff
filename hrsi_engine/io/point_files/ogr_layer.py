"""Vector layers of all formats of OGR: GeoPackage, Shapefile, GeoJSON, KML …; point geometry or fields.

Numbers, texts and points of column formats are read at once through OGR's Arrow stream, twenty times as fast as by
features. All other layers, and all layers with GDAL before 3.6, are read by features.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from osgeo import gdal, ogr

from ...block.points import POINT_OPERATIONS
from ...foundation.errors import InputError
from ..opening.budgets import FILE_BUDGETS, require_small_archive, require_texts
from ..opening.databases import is_database, require_sound, widths
from ..opening.datasets import gdal_messages, quiet
from .positions import MOST_LON_DEG
from .table import (
    MAY_BE_INFINITE,
    NUMBER_FIELDS,
    TEXT_FIELDS,
    PointReader,
    PointTable,
    match_fields,
    parse_numbers,
    strip_texts,
)

_MEASUREMENTS = "image_points"  #: the layer of measurements in files of HRSI


def open_vector(path: str) -> gdal.Dataset | None:
    """Return the opened vector dataset, None if OGR cannot read the file.

    Raises `InputError` for an inconsistent database, or a spreadsheet that is too large when decompressed.
    """
    require_sound(path)
    require_small_archive(path)
    dataset = None
    with gdal_messages():
        dataset = gdal.OpenEx(path, gdal.OF_VECTOR)
    return dataset


def read(path: str, layer_wanted: str = "", chosen: Mapping[str, str] | None = None) -> PointTable:
    """Return the known fields of a layer, or the ``chosen`` ones (`match_fields`), and its geometry.

    Raises `InputError` if the layer cannot be read.
    """
    dataset = open_vector(path)
    if dataset is None:
        raise InputError(f"{path}: cannot be opened as a vector layer: check the file")
    layer = _choose_layer(path, dataset, layer_wanted)
    source = path if dataset.GetLayerCount() == 1 else f"{path}, layer {layer.GetName()!r}"
    table = None
    with gdal_messages() as messages:
        table = _read_layer(path, source, layer, dataset.GetDriver().ShortName, chosen or {})
    if table is None or messages:
        raise InputError(f"{source}: cannot be read to the end ({messages.reason}): obtain it again")
    return replace(table, operations=layer.GetMetadataItem(POINT_OPERATIONS) or "")


def _choose_layer(path: str, dataset: gdal.Dataset, layer_name: str) -> ogr.Layer:
    layers = [dataset.GetLayer(index) for index in range(dataset.GetLayerCount())]
    if layer_name.startswith("#"):
        candidates = [layer for index, layer in enumerate(layers) if f"#{index}" == layer_name]
    else:
        # Not of QGIS, and not the matches that gcps-from-reference rejected
        omitted = ("layer_styles", "qgis_projects", *(("rejected",) if len(layers) > 1 and not layer_name else ()))
        layers = [layer for layer in layers if layer.GetName() not in omitted]
        candidates = [layer for layer in layers if layer_name in ("", layer.GetName())]
        if not layer_name and len(candidates) > 1:  # a GPX file has five layers, most of them empty
            candidates = [layer for layer in candidates if layer.GetFeatureCount()] or candidates
            layers = candidates
    if len(candidates) == 1:
        return candidates[0]
    names = ", ".join(layer.GetName() for layer in layers) or "none"
    if layer_name:
        raise InputError(f"{path}: has no layer {layer_name!r} (layers: {names}): correct the name after |layername=")
    raise InputError(f"{path}: has {len(layers)} layers ({names}): name one: {os.path.basename(path)}|layername=LAYER")


def _read_layer(path: str, source: str, layer: ogr.Layer, driver: str, fields_given: Mapping[str, str]) -> PointTable:
    definition = layer.GetLayerDefn()
    names = [definition.GetFieldDefn(index).GetName() for index in range(definition.GetFieldCount())]
    types = [definition.GetFieldDefn(index).GetType() for index in range(definition.GetFieldCount())]
    if layer.GetFIDColumn() in fields_given.values():  # no field for OGR, but one in QGIS
        names, types = [*names, layer.GetFIDColumn()], [*types, ogr.OFTString]
    result = match_fields(names, fields_given, source)
    has_geometry = definition.GetGeomFieldCount() > 0 and definition.GetGeomType() != ogr.wkbNone
    layer.ResetReading()
    ogr_names = {field: names[index] for field, index in result.items()}
    by_columns = driver in BY_COLUMNS and _is_narrow(path, source, layer, ogr_names)
    if quick := _read_columns(layer, ogr_names, has_geometry) if by_columns else None:
        fields, ids, geometry = quick
        columns = {f: _read_column(source, f, names[result[f]], fields[f], ids) for f in result}
        crs = _crs(layer, driver, geometry)
        return PointTable(source, columns, tuple(names), lambda row: f"feature {ids[row]}", geometry, crs)
    values: dict[str, list] = {field: [] for field in result}
    positions: list[tuple[float, float, float]] = []
    feature_ids: list[int] = []
    numeric = (ogr.OFTInteger, ogr.OFTInteger64, ogr.OFTReal)
    plan = [
        (values[field].append, index, field in NUMBER_FIELDS and types[index] in numeric)
        for field, index in result.items()
    ]
    layer.ResetReading()
    for feature in layer:
        feature_ids.append(feature.GetFID())
        for append, index, is_number in plan:
            if index == definition.GetFieldCount():
                append(str(feature.GetFID()))
            elif feature.IsFieldSetAndNotNull(index):
                append(feature.GetFieldAsDouble(index) if is_number else feature.GetFieldAsString(index))
            else:
                append(np.nan if is_number else "")
        if has_geometry:
            positions.append(_read_position(source, feature))
    columns = {f: _read_column(source, f, names[result[f]], values[f], feature_ids) for f in result}
    geometry = np.array(positions, dtype=np.float64).reshape(-1, 3) if has_geometry else None
    crs = _crs(layer, driver, geometry)
    return PointTable(source, columns, tuple(names), lambda row: f"feature {feature_ids[row]}", geometry, crs)


def _is_narrow(path: str, source: str, layer: ogr.Layer, ogr_names: Mapping[str, str]) -> bool:
    """Return whether all geometries of a layer have the size of a point; raise `InputError` for impossible texts.

    In OGR's columns each row has the width of the longest: with a polygon, a million points would take a petabyte.
    """
    if not is_database(path):
        return True
    texts = {name: field for field, name in ogr_names.items() if field in TEXT_FIELDS}
    geometry = layer.GetGeometryColumn()
    rows, longest = widths(path, layer.GetName(), [*texts, *([geometry] if geometry else [])])
    for name in texts:
        require_texts(source, name, rows, longest[name])
    return not geometry or longest[geometry] <= FILE_BUDGETS.point_bytes


def _read_column(
    source: str, field: str, name: str, values: Sequence | np.ndarray, feature_ids: Sequence[int] | np.ndarray
) -> np.ndarray:
    if field not in NUMBER_FIELDS:
        return np.char.strip(values) if isinstance(values, np.ndarray) else strip_texts(values, source, name)

    def place_of(row: int) -> str:
        return f"{source}, feature {feature_ids[row]}, field {name!r}"

    if len(values) and isinstance(values[0], str):
        return parse_numbers(list(values), place_of, infinite=field in MAY_BE_INFINITE)
    column = np.array(values, dtype=np.float64)
    if np.isinf(column).any() and field not in MAY_BE_INFINITE:
        raise InputError(f"{place_of(int(np.isinf(column).argmax()))}: is infinite: give a number")
    return column


def _read_position(source: str, feature: ogr.Feature) -> tuple[float, float, float]:
    """Return x, y, z of a point or of a multi-point of one part; NaN if missing."""
    geometry = feature.GetGeometryRef()
    if geometry is None or geometry.IsEmpty():
        return np.nan, np.nan, np.nan
    if ogr.GT_Flatten(geometry.GetGeometryType()) == ogr.wkbMultiPoint and geometry.GetGeometryCount() == 1:
        geometry = geometry.GetGeometryRef(0)
    if ogr.GT_Flatten(geometry.GetGeometryType()) != ogr.wkbPoint:
        name = geometry.GetGeometryName().capitalize()
        raise InputError(f"{source}, feature {feature.GetFID()}: is a {name}: give a layer of points")
    return geometry.GetX(), geometry.GetY(), geometry.GetZ() if geometry.Is3D() else np.nan


def _crs(layer: ogr.Layer, driver: str, geometry: np.ndarray | None) -> str:
    """Return the layer's CRS as WKT 2, which includes a vertical part; empty if it has none, or a GeoJSON in metres.

    GDAL reads a GeoJSON without CRS as WGS 84, as the format is defined.
    """
    reference = layer.GetSpatialRef()
    is_assumed = driver == "GeoJSON" and reference is not None and reference.IsGeographic()
    if is_assumed and geometry is not None and np.nanmax(np.abs(geometry[:, :2]), initial=0.0) > MOST_LON_DEG:
        return ""
    wkt = reference.ExportToWkt(["FORMAT=WKT2_2019"]) if reference is not None else ""
    return "" if "Undefined" in wkt[:40] else wkt


def _recognises(path: str, _name: str, _head: bytes) -> bool:
    dataset = open_vector(path)
    return dataset is not None and dataset.GetLayerCount() > 0


READER = PointReader("vector layer", _recognises, read, chooses_fields=True)


def measurements_of(spec: str) -> str:
    """Return a point file's name, with the layer ``image_points`` if it has several layers and none is named."""
    if "|" in spec or not (spec.startswith("/vsi") or os.path.isfile(spec)):
        return spec
    dataset = open_vector(spec)
    names = [dataset.GetLayer(index).GetName() for index in range(dataset.GetLayerCount())] if dataset else []
    return f"{spec}|layername={_MEASUREMENTS}" if len(names) > 1 and _MEASUREMENTS in names else spec


#: Formats whose columns have one type. For damaged text formats, GDAL 3.6 can crash.
BY_COLUMNS = ("GPKG", "Arrow", "Parquet")
#: By the size of a point in WKB (bytes): its type codes (ISO, and old WKB with z), and number of coordinates.
_WKB_POINTS: dict[float, tuple[tuple[int, ...], int]] = {21: ((1,), 2), 29: ((1001, 0x80000001), 3)}


def _read_columns(
    layer: ogr.Layer, names: Mapping[str, str], with_geometry: bool
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray | None] | None:
    """Return fields of a layer from OGR's Arrow stream (``names``: HRSI's -> the layer's), or None if not possible.

    Numbers (n,) float64, NaN for NULL, or texts (n,) str; feature ids (n,); positions (n, 3).
    """
    try:
        stream = layer.GetArrowStreamAsNumPy(["USE_MASKED_ARRAYS=YES"])
    except (AttributeError, ImportError, RuntimeError):  # GDAL before 3.6, or without NumPy
        return None
    fid = layer.GetFIDColumn() or "OGC_FID"
    batches: list[tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]] = []
    for batch in stream:
        if fid not in batch or any(name not in batch for name in names.values()):
            return None
        fields = {field: _read_arrow_field(field, batch[name]) for field, name in names.items()}
        place = _read_arrow_positions(layer, batch) if with_geometry else np.empty((len(batch[fid]), 3))
        if place is None or any(column is None for column in fields.values()):
            return None
        batches.append((fields, batch[fid], place))  # type: ignore[arg-type]
    if not batches:
        return None
    return (
        {field: np.concatenate([fields[field] for fields, _, _ in batches]) for field in names},
        np.concatenate([ids for _, ids, _ in batches]),
        np.concatenate([place for _, _, place in batches]) if with_geometry else None,
    )


def _read_arrow_field(field: str, column: np.ndarray) -> np.ndarray | None:
    """Return a column as numbers or texts, None if it is neither."""
    kind, missing = column.dtype.kind, np.ma.getmaskarray(column)
    plain = np.ma.getdata(column)
    if kind == "S":
        with suppress(UnicodeDecodeError):
            return np.where(missing, "", plain.astype(str))  # ASCII
        with suppress(UnicodeDecodeError):
            return np.where(missing, "", np.char.decode(plain, "utf-8"))
        return None
    if field in NUMBER_FIELDS and kind in "iuf":
        return np.where(missing, np.nan, plain.astype(np.float64))
    if field not in NUMBER_FIELDS and kind in "iu":
        return np.where(missing, "", plain.astype(str))
    return None  # OGR formats real numbers and dates as text in its own way


def _read_arrow_positions(layer: ogr.Layer, batch: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the points of a batch ``(n, 3)``, NaN where missing; None if not all of them are simple points."""
    column = batch.get(layer.GetGeometryColumn() or "wkb_geometry")
    if column is None or column.dtype.kind != "V":
        return None
    present = ~np.ma.getmaskarray(column)
    known = parse_wkb_points(np.ma.getdata(column)[present].tobytes(), int(present.sum()))
    if known is None:
        return None
    place = np.full((len(column), 3), np.nan)
    place[present] = known
    return place


def parse_wkb_points(content: bytes, count: int) -> np.ndarray | None:
    """Return points ``(n, 3)`` of equal size in well-known binary, NaN for heights that it does not contain.

    None if they are no simple points.
    """
    place = np.full((count, 3), np.nan)
    if not count:
        return place
    codes, axes = _WKB_POINTS.get(len(content) / count, ((), 0))
    if not axes:
        return None
    rows = np.frombuffer(content, np.dtype([("order", "u1"), ("code", "<u4"), ("xyz", "<f8", (axes,))]))
    if not (rows["order"] == 1).all() or not np.isin(rows["code"], codes).all():
        return None
    place[:, :axes] = rows["xyz"]
    return place


def is_area(path: str) -> bool:
    """Return whether the first feature of a vector file is a polygon: a footprint or an area of interest."""
    with quiet():
        dataset = gdal.OpenEx(path, gdal.OF_VECTOR)
        layer = dataset.GetLayer(0) if dataset is not None and dataset.GetLayerCount() else None
        feature = layer.GetNextFeature() if layer is not None else None
        shape = feature.GetGeometryRef() if feature is not None else None
    return shape is not None and "POLYGON" in shape.GetGeometryName()
