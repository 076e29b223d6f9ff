"""Columns of a vector layer in one go, through OGR's Arrow stream: twenty times as fast as feature by feature.

It serves what point layers are made of: numbers, texts and points, in formats that hold such columns. For all else, and
for GDAL before 3.6, `arrow_columns` returns None, and the features are read one by one.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from osgeo import ogr

from .columns import NUMBER_FIELDS

#: Drivers with columns of one type. What GDAL 3.6 makes of damaged text formats can end the program.
BY_COLUMNS = ("GPKG", "Arrow", "Parquet")
_POINT, _POINT_Z = (1,), (1001, 0x80000001)  # type codes of ISO and of old WKB
_WKB_BYTES = {21: (_POINT, 2), 29: (_POINT_Z, 3)}


class ArrowColumns(NamedTuple):
    """Fields of a layer: numbers (n,) float64, NaN where NULL, or texts (n,) str; feature ids; positions (n, 3)."""

    values: dict[str, np.ndarray]
    feature_ids: np.ndarray
    geometry: np.ndarray | None


def arrow_columns(layer: ogr.Layer, names: Mapping[str, str], with_geometry: bool) -> ArrowColumns | None:
    """Return fields of a layer from OGR's Arrow stream (``names``: ours -> the layer's), or None."""
    stream = _open_stream(layer)
    fid = layer.GetFIDColumn() or "OGC_FID"
    if stream is None:
        return None
    batches: list[tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]] = []
    for batch in stream:
        if fid not in batch or any(name not in batch for name in names.values()):
            return None
        fields = {field: _read_field(field, batch[name]) for field, name in names.items()}
        place = _read_positions(layer, batch) if with_geometry else np.empty((len(batch[fid]), 3))
        if place is None or any(column is None for column in fields.values()):
            return None
        batches.append((fields, batch[fid], place))  # type: ignore[arg-type]
    if not batches:
        return None
    return ArrowColumns(
        {field: np.concatenate([fields[field] for fields, _, _ in batches]) for field in names},
        np.concatenate([ids for _, ids, _ in batches]),
        np.concatenate([place for _, _, place in batches]) if with_geometry else None,
    )


def _open_stream(layer: ogr.Layer) -> Any:
    try:
        return layer.GetArrowStreamAsNumPy(["USE_MASKED_ARRAYS=YES"])
    except (AttributeError, ImportError, RuntimeError):  # GDAL before 3.6, or without its arrays
        return None


def _read_field(field: str, column: np.ndarray) -> np.ndarray | None:
    """Return a column as numbers or texts, None where it is neither."""
    kind, missing = column.dtype.kind, np.ma.getmaskarray(column)
    plain = np.ma.getdata(column)
    if kind == "S":
        try:
            texts = plain.astype(str)  # ASCII
        except UnicodeDecodeError:
            try:
                texts = np.char.decode(plain, "utf-8")
            except UnicodeDecodeError:
                return None
        return np.where(missing, "", texts)
    if field in NUMBER_FIELDS and kind in "iuf":
        return np.where(missing, np.nan, plain.astype(np.float64))
    if field not in NUMBER_FIELDS and kind in "iu":
        return np.where(missing, "", plain.astype(str))
    return None  # OGR has its own way of writing real numbers and dates as text


def _read_positions(layer: ogr.Layer, batch: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the points of a batch ``(n, 3)``, NaN where there are none, None where they are not all plain points."""
    column = batch.get(layer.GetGeometryColumn() or "wkb_geometry")
    if column is None or column.dtype.kind != "V" or column.dtype.itemsize not in _WKB_BYTES:
        return None
    codes, axes = _WKB_BYTES[column.dtype.itemsize]
    missing = np.ma.getmaskarray(column)
    layout = np.dtype([("order", "u1"), ("code", "<u4"), ("xyz", "<f8", (axes,))])
    wkb = np.ascontiguousarray(np.ma.getdata(column)).view(layout)
    if not np.all(missing | ((wkb["order"] == 1) & np.isin(wkb["code"], codes))):
        return None
    place = np.full((len(column), 3), np.nan)
    place[:, :axes] = np.where(missing[:, None], np.nan, wkb["xyz"])
    return place
