"""Measurements as columns of numbers beside the layer that holds the same: ``tie_points.npz`` beside ``block.gpkg``.

A layer is what people look at and mend; reading ten million rows of it takes minutes. The columns are read in seconds
(`numpy.load` reads them too): distinct names once, a number a row, and the rest as 64-bit floats, uncompressed. They
count only while the layer is, byte for byte, the one that they were written with: a mark of the GeoPackage stands with
them. After any change to it, in QGIS or elsewhere, and where the columns are damaged or missing, the layer is read.
"""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...block.columns import NameColumn, find_unique_ids
from ...block.points import ImagePoints
from ..opening.budgets import RPC_BUDGETS
from ..safety.array_files import DAMAGED, read_arrays, write_arrays
from ..safety.content_marks import files_mark
from .interpret import PointTables, matching_names

COLUMNS_FILE = "tie_points.npz"
LAYERS_FILE, LAYER = "block.gpkg", "image_points"  #: what the columns stand beside
_SCHEMA = 1
_NUMBERED = ("id", "image", "kind")  # columns of names: distinct ones, and the number of a row's


def write_columns(folder: str, points: ImagePoints) -> None:
    """Write measurements beside the finished GeoPackage of a folder, whose `LAYER` holds the same in the same order."""
    columns: dict[str, Any] = {
        "schema": np.int64(_SCHEMA), "mark": np.array(_database_mark(folder)),
        "sample": points.xy[:, 0], "line": points.xy[:, 1], "sigma": points.sigma_px, "quality": points.quality,
    }  # fmt: skip
    for name, ids in zip(_NUMBERED, (points.ids, points.image_ids, points.kind), strict=True):
        names, number = find_unique_ids(ids)
        columns |= {f"{name}_decode_names": names, name: number.astype(np.int32)}
    write_arrays(os.path.join(folder, COLUMNS_FILE), columns)


def read_columns(path: str, layer: str, image_ids: Sequence[str] = ()) -> PointTables | None:
    """Return the image points of a layer of a GeoPackage from the column cache beside it.

    None where there are no columns, the layer is another one or was changed since, or the columns are damaged.
    """
    folder, name = os.path.split(path)
    columns = os.path.join(folder, COLUMNS_FILE)
    if name != LAYERS_FILE or layer != LAYER or not os.path.isfile(columns):
        return None
    try:
        found = read_arrays(columns)
        if found["schema"] != _SCHEMA or str(found["mark"]) != _database_mark(folder):
            return None
        rows = len(found["id"])
        numbered = [_decode_names(found[f"{name}_decode_names"], found[name], rows) for name in _NUMBERED]
        floats = {name: found[name] for name in ("sample", "line", "sigma", "quality")}
        for column in floats.values():
            if column.dtype != np.float64 or column.shape != (rows,) or np.isinf(column).any():
                raise ValueError("floats")
    except DAMAGED:
        return None
    xy, sigma = np.column_stack([floats["sample"], floats["line"]]), floats["sigma"]
    if not rows or not (np.abs(xy).max() <= RPC_BUDGETS.image_px and (np.isnan(sigma) | (sigma > 0.0)).all()):
        return None
    ids: Any = numbered[0]  # stand for arrays
    images: Any = matching_names(numbered[1], image_ids)
    source = f"{path}, layer {layer!r}"
    return PointTables(None, ImagePoints(ids, images, xy, sigma, np.asarray(numbered[2]), floats["quality"], source))


def _database_mark(folder: str) -> str:
    """Return what tells the GeoPackage from itself after a change; copies and archives keep it.

    SQLite keeps the count of its changes in the first bytes.
    """
    path = os.path.join(folder, LAYERS_FILE)
    return files_mark([path, f"{path}-wal"], times=False)


def _decode_names(names: np.ndarray, number: np.ndarray, rows: int) -> NameColumn:
    if names.dtype.kind != "U" or names.ndim != 1 or number.dtype != np.int32 or number.shape != (rows,):
        raise ValueError("names")
    if rows and not (number.min() >= 0 and number.max() < len(names)):
        raise ValueError("numbers")
    return NameColumn(names, number)
