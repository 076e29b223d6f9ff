"""``.points`` of the QGIS Georeferencer: map coordinates and pixels, no heights and no names.

QGIS counts pixels from the upper left *corner* of the image, with y negative downwards. Points that were switched
off there are left out. Each point is called ``IMAGE-ROW``; the image is that of the file's name (``a.tif.points``).
"""

import csv
import os
from itertools import islice

import numpy as np

from ...foundation.errors import InputError
from ..opening.budgets import require_size
from ..rasters.images import image_id
from .columns import numbers
from .table import PointReader, PointTable

_X, _Y = ("sourcex", "pixelx"), ("sourcey", "pixely")  # QGIS 3.26 and later, and before


def read(path: str, _layer: str = "") -> PointTable:
    """Return the points that are switched on; raise `InputError` where the file is damaged."""
    require_size(path, "points")
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            lines = file.read().splitlines()
    except (OSError, UnicodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}): save the points again in the Georeferencer") from None
    crs = next((line.partition(":")[2].strip() for line in lines if line.lower().startswith("#crs:")), "")
    offset = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    try:
        rows = [row for row in csv.reader(islice(lines, offset, None)) if row]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read ({error}): save the points again in the Georeferencer") from None
    return _read_table(path, crs, rows)


def _read_table(path: str, crs: str, rows: list[list[str]]) -> PointTable:
    names = [name.strip() for name in rows[0]] if rows else []
    lower = [name.lower() for name in names]
    body = [(number, row) for number, row in enumerate(rows[1:], start=1) if _is_enabled(lower, row)]
    off = len(rows) - 1 - len(body)
    x, y, column, line = (_get_column(path, lower, aliases, body) for aliases in (("mapx",), ("mapy",), _X, _Y))
    image = image_id(os.path.splitext(path)[0])
    columns = {
        "id": np.array([f"{image}-{number}" for number, _ in body], dtype=str),
        "image": np.full(len(body), image),
        "sample": column - 0.5,
        "line": -line - 0.5,
    }
    notes = (f"{path}: {off} points are switched off and left out",) if off > 0 else ()
    geometry = np.column_stack([x, y, np.full(len(body), np.nan)])
    return PointTable(path, columns, tuple(names), lambda row: f"point {body[row][0]}", geometry, crs, notes)


def _is_enabled(names: list[str], row: list[str]) -> bool:
    index = names.index("enable") if "enable" in names else len(row)
    return index >= len(row) or row[index].strip() != "0"


def _get_column(path: str, names: list[str], aliases: tuple[str, ...], body: list[tuple[int, list[str]]]) -> np.ndarray:
    index = next((names.index(alias) for alias in aliases if alias in names), None)
    if index is None:
        raise InputError(f"{path}: has no field {aliases[0]!r}: save the points again in the Georeferencer")
    texts = [row[index] if index < len(row) else "" for _, row in body]
    return numbers(texts, lambda at: f"{path}, point {body[at][0]}, field {aliases[0]!r}")


READER = PointReader("QGIS Georeferencer points", lambda _path, name, _head: name.endswith(".points"), read)
