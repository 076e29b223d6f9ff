"""Any vector layer that OGR reads: GeoPackage, Shapefile, GeoJSON, KML …; point geometry or coordinates in fields."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from osgeo import gdal, ogr

from ...block.points import POINT_OPERATIONS
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.budgets import require_small_archive, require_texts
from ..opening.datasets import gdal_messages
from ..opening.sound_databases import is_database, require_sound, widths
from .columns import MAY_BE_INFINITE, NUMBER_FIELDS, TEXT_FIELDS, match_fields, numbers, strip_texts
from .ogr_arrow import BY_COLUMNS, arrow_columns
from .table import PointReader, PointTable

_NOT_DATA = ("layer_styles", "qgis_projects")  # what QGIS keeps in a GeoPackage beside the layers
_MEASUREMENTS = "image_points"  #: the layer of measurements in what HRSI writes


@thresholds
class OGR_POINTS:
    """Which geometries of a database are points."""

    point_bytes: int = threshold(128, "byte", "longest geometry", "a point with the longest header of a GeoPackage")


_NUMERIC = (ogr.OFTInteger, ogr.OFTInteger64, ogr.OFTReal)


def open_vector(path: str) -> gdal.Dataset | None:
    """Return the opened vector dataset, None where OGR cannot read the file.

    Raises `InputError` where it is a database that contradicts itself, or a spreadsheet that unfolds without end.
    """
    require_sound(path)
    require_small_archive(path)
    dataset = None
    with gdal_messages():
        dataset = gdal.OpenEx(path, gdal.OF_VECTOR)
    return dataset


def read(path: str, layer_wanted: str = "") -> PointTable:
    """Return the known fields and the geometry of a layer; raise `InputError` where there are none."""
    dataset = open_vector(path)
    if dataset is None:
        raise InputError(f"{path}: cannot be opened as a vector layer: check the file")
    layer = _choose_layer(path, dataset, layer_wanted)
    source = path if dataset.GetLayerCount() == 1 else f"{path}, layer {layer.GetName()!r}"
    table = None
    with gdal_messages() as messages:
        table = _read_layer(path, source, layer, dataset.GetDriver().ShortName)
    if table is None or messages:
        reason = messages[-1] if messages else "unknown reason"
        raise InputError(f"{source}: cannot be read to the end ({reason}): get it again")
    return replace(table, operations=layer.GetMetadataItem(POINT_OPERATIONS) or "")


def _choose_layer(path: str, dataset: gdal.Dataset, wanted: str) -> ogr.Layer:
    layers = [dataset.GetLayer(index) for index in range(dataset.GetLayerCount())]
    if wanted.startswith("#"):
        chosen = [layer for index, layer in enumerate(layers) if f"#{index}" == wanted]
    else:
        layers = [layer for layer in layers if layer.GetName() not in _NOT_DATA]
        chosen = [layer for layer in layers if wanted in ("", layer.GetName())]
    if len(chosen) == 1:
        return chosen[0]
    names = ", ".join(layer.GetName() for layer in layers) or "none"
    if wanted:
        raise InputError(f"{path}: has no layer {wanted!r} (layers: {names}): correct the name after |layername=")
    raise InputError(f"{path}: has {len(layers)} layers ({names}): name one: {os.path.basename(path)}|layername=LAYER")


def _read_layer(path: str, source: str, layer: ogr.Layer, driver: str) -> PointTable:
    definition = layer.GetLayerDefn()
    names = [definition.GetFieldDefn(index).GetName() for index in range(definition.GetFieldCount())]
    found = match_fields(names)
    types = [definition.GetFieldDefn(index).GetType() for index in range(definition.GetFieldCount())]
    has_geometry = definition.GetGeomFieldCount() > 0 and definition.GetGeomType() != ogr.wkbNone
    layer.ResetReading()
    wanted = {field: names[index] for field, index in found.items()}
    by_columns = driver in BY_COLUMNS and _is_narrow(path, source, layer, wanted)
    quick = arrow_columns(layer, wanted, has_geometry) if by_columns else None
    if quick is not None:
        ids = quick.feature_ids
        columns = {f: _read_column(source, f, names[found[f]], quick.values[f], ids) for f in found}
        return PointTable(source, columns, tuple(names), lambda row: f"feature {ids[row]}", quick.geometry, _crs(layer))
    values: dict[str, list] = {field: [] for field in found}
    positions: list[tuple[float, float, float]] = []
    feature_ids: list[int] = []
    plan = [(values[field].append, index, _choose_getter(field, types[index])) for field, index in found.items()]
    layer.ResetReading()
    for feature in layer:
        feature_ids.append(feature.GetFID())
        for append, index, get in plan:
            append(get(feature, index))
        if has_geometry:
            positions.append(_read_position(source, feature))
    columns = {f: _read_column(source, f, names[found[f]], values[f], feature_ids) for f in found}
    geometry = np.array(positions, dtype=np.float64).reshape(-1, 3) if has_geometry else None
    return PointTable(source, columns, tuple(names), lambda row: f"feature {feature_ids[row]}", geometry, _crs(layer))


def _is_narrow(path: str, source: str, layer: ogr.Layer, wanted: Mapping[str, str]) -> bool:
    """Tell whether a layer has only geometries of the size of a point; raise `InputError` for impossible texts.

    OGR's columns give each row the width of the longest: a polygon among a million points would take a petabyte.
    """
    if not is_database(path):
        return True
    texts, geometry = {name: field for field, name in wanted.items() if field in TEXT_FIELDS}, layer.GetGeometryColumn()
    found = widths(path, layer.GetName(), [*texts, *([geometry] if geometry else [])])
    for name in texts:
        require_texts(source, name, found.rows, found.longest[name])
    return not geometry or found.longest[geometry] <= OGR_POINTS.point_bytes


def _choose_getter(field: str, field_type: int):  # type: ignore[no-untyped-def]  # a function (feature, index) -> float | str
    return _get_float if field in NUMBER_FIELDS and field_type in _NUMERIC else _get_text


def _get_float(feature: ogr.Feature, index: int) -> float:
    return feature.GetFieldAsDouble(index) if feature.IsFieldSetAndNotNull(index) else np.nan


def _get_text(feature: ogr.Feature, index: int) -> str:
    return feature.GetFieldAsString(index) if feature.IsFieldSetAndNotNull(index) else ""


def _read_column(
    source: str, field: str, name: str, values: Sequence | np.ndarray, feature_ids: Sequence[int] | np.ndarray
) -> np.ndarray:
    if field not in NUMBER_FIELDS:
        return np.char.strip(values) if isinstance(values, np.ndarray) else strip_texts(values, source, name)
    where = f"field {name!r}"
    if len(values) and isinstance(values[0], str):
        return numbers(
            list(values),
            lambda row: f"{source}, feature {feature_ids[row]}, {where}",
            infinite=field in MAY_BE_INFINITE,
        )
    column = np.array(values, dtype=np.float64)
    if np.isinf(column).any() and field not in MAY_BE_INFINITE:
        row = int(np.flatnonzero(np.isinf(column))[0])
        raise InputError(f"{source}, feature {feature_ids[row]}, {where}: is infinite: give a number")
    return column


def _read_position(source: str, feature: ogr.Feature) -> tuple[float, float, float]:
    """Return x, y, z of a point or of a multi-point of one part; NaN where there is none."""
    geometry = feature.GetGeometryRef()
    if geometry is None or geometry.IsEmpty():
        return np.nan, np.nan, np.nan
    if ogr.GT_Flatten(geometry.GetGeometryType()) == ogr.wkbMultiPoint and geometry.GetGeometryCount() == 1:
        geometry = geometry.GetGeometryRef(0)
    if ogr.GT_Flatten(geometry.GetGeometryType()) != ogr.wkbPoint:
        name = geometry.GetGeometryName().capitalize()
        raise InputError(f"{source}, feature {feature.GetFID()}: is a {name}: give a layer of points")
    return geometry.GetX(), geometry.GetY(), geometry.GetZ() if geometry.Is3D() else np.nan


def _crs(layer: ogr.Layer) -> str:
    """Return the layer's CRS as WKT 2, which keeps a vertical part; empty where there is none."""
    reference = layer.GetSpatialRef()
    wkt = reference.ExportToWkt(["FORMAT=WKT2_2019"]) if reference is not None else ""
    return "" if "Undefined" in wkt[:40] else wkt


def _recognises(path: str, _name: str, _head: bytes) -> bool:
    dataset = open_vector(path)
    return dataset is not None and dataset.GetLayerCount() > 0


READER = PointReader("vector layer", _recognises, read)


def measurements_of(spec: str) -> str:
    """Return the name of a point file with the layer ``image_points``, where it has several and none is named."""
    if "|" in spec or not (spec.startswith("/vsi") or os.path.isfile(spec)):
        return spec
    dataset = open_vector(spec)
    names = [dataset.GetLayer(index).GetName() for index in range(dataset.GetLayerCount())] if dataset else []
    return f"{spec}|layername={_MEASUREMENTS}" if len(names) > 1 and _MEASUREMENTS in names else spec
