"""GeoParquet as SlideRule writes it, through PyArrow: GDAL has a driver for it only where it was built with one."""

import json
from functools import partial
from typing import Any

import numpy as np

from ...foundation.errors import InputError
from ...foundation.json_values import json_text
from ..opening.budgets import FILE_BUDGETS
from ..point_files.table import NUMBER_FIELDS, PointTable, match_fields

PARQUET_HEAD = b"PAR1"
POINT_LAYOUTS = {21: 2, 29: 3}  # bytes of a WKB point -> its coordinates
DEFAULT_CRS = "OGC:CRS84"  # of a GeoParquet file that names none


def read_parquet(path: str) -> PointTable:
    """Return the known fields and the points of a GeoParquet file."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(
            f"{path}: reading GeoParquet needs PyArrow (pip install pyarrow), or a GDAL with a Parquet driver; or save "
            "the points as GeoPackage or CSV"
        ) from None
    try:
        file = parquet.ParquetFile(path)
        if file.metadata.num_rows > FILE_BUDGETS.laser_values:
            raise InputError(f"{path}: claims {file.metadata.num_rows} rows, more than any table of laser points has: "
                             "get it again")  # fmt: skip
        # What the file says of its geometry
        try:
            geo = json.loads((file.schema_arrow.metadata or {}).get(b"geo", b"{}"))
        except (ValueError, RecursionError):
            geo = None
        if not isinstance(geo, dict) or not isinstance(geo.get("columns", {}), dict):
            raise InputError(f"{path}: its description of the geometry ('geo') is damaged: get it again")
        names = list(file.schema_arrow.names)
        found = {field: names[index] for field, index in match_fields(names).items() if field in NUMBER_FIELDS}
        place = geo.get("primary_column", "geometry")
        wanted = [*found.values(), *([place] if place in names else [])]
        table = file.read(columns=wanted)
        columns = {field: _read_numbers(path, name, table.column(name)) for field, name in found.items()}
        geometry = _parse_points(path, table.column(place)) if place in names else None
    except (ArrowException, OSError, ValueError, MemoryError, OverflowError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read as GeoParquet ({reason}): get it again") from None
    crs = geo.get("columns", {}).get(place, {}).get("crs", DEFAULT_CRS)
    text = json_text(crs) if isinstance(crs, dict) else str(crs or "")
    return PointTable(path, columns, tuple(names), partial("row {}".format), geometry, text)


def _read_numbers(path: str, name: str, column: Any) -> np.ndarray:
    """Return a column as float64, NaN where it is null."""
    values = column.to_numpy()
    if values.dtype.kind not in "iufb" and not all(
        value is None or isinstance(value, (int, float)) for value in values
    ):
        raise InputError(f"{path}: field {name!r} holds no numbers: correct it")
    return np.asarray(values, dtype=np.float64)


def _parse_points(path: str, column: Any) -> np.ndarray:
    """Return points ``(n, 3)`` from their well-known binary; NaN for missing heights."""
    texts = [value for value in column.to_pylist() if isinstance(value, bytes)]
    lengths = {len(text) for text in texts}
    if len(texts) != len(column) or len(lengths) > 1 or not lengths <= POINT_LAYOUTS.keys():
        raise InputError(f"{path}: its geometry is not points alone: give a layer of points")
    place = np.full((len(texts), 3), np.nan)
    for length in lengths:
        axes = POINT_LAYOUTS[length]
        layout = np.dtype([("order", "u1"), ("code", "<u4"), ("xyz", "<f8", (axes,))])
        rows = np.frombuffer(b"".join(texts), dtype=layout)
        if (rows["order"] != 1).any() or (rows["code"] % 1000 != 1).any():
            raise InputError(f"{path}: its geometry is not points alone: give a layer of points")
        place[:, :axes] = rows["xyz"]
    return place
