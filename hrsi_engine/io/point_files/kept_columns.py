"""Column cache: measurements as arrays next to the layer that contains them, ``tie_points.npz`` and ``block.gpkg``.

The layer is for users, who may edit it; reading its ten million rows takes minutes. The columns are read in seconds
(`numpy.load` reads them too): distinct names once with a number for each row, all else as float64, uncompressed. They
are valid only if the layer is, byte for byte, the one with which they were written: they contain a mark of the
GeoPackage. After any change to it, in QGIS or elsewhere, and if the columns are damaged or missing, the layer is read.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...block.columns import NameColumn, find_unique_ids
from ...block.points import ImagePoints
from ...ground.geodesy import WGS84_3D
from ..opening.budgets import RPC_BUDGETS
from ..safety.array_files import DAMAGED, read_arrays, write_arrays
from ..safety.content_marks import files_mark
from . import csv_text
from .interpret import PointTables, matching_names
from .table import PointTable

COLUMNS_FILE = "tie_points.npz"
LAYERS_FILE, LAYER = "block.gpkg", "image_points"  #: GeoPackage and layer of the same measurements
#: Tables next to the GeoPackage with all rows of layers that show a selection of them
COMPLETE_FILES = {"image_points": "block_image_points.csv", "ground_points": "block_ground_points.csv"}
_SCHEMA = 1
_NUMBERED = ("id", "image", "kind")  # columns of names: distinct names, and the name's number of each row


def write_columns(folder: str, points: ImagePoints) -> None:
    """Write measurements next to the finished GeoPackage of a folder, whose `LAYER` has the same rows in this order."""
    columns: dict[str, Any] = {
        "schema": np.int64(_SCHEMA),
        "mark": np.array(_database_mark(folder)),
        "sample": points.xy[:, 0],
        "line": points.xy[:, 1],
        "sigma": points.sigma_px,
        "quality": points.quality,
    }
    for name, ids in zip(_NUMBERED, (points.ids, points.image_ids, points.kind), strict=True):
        names, number = find_unique_ids(ids)
        columns |= {f"{name}_decode_names": names, name: number.astype(np.int32)}
    write_arrays(os.path.join(folder, COLUMNS_FILE), columns)


def read_complete_table(path: str, layer: str) -> PointTable | None:
    """Return all rows of a layer of which the GeoPackage shows a selection, from the table next to it; else None."""
    folder, name = os.path.split(path)
    table = os.path.join(folder, COMPLETE_FILES.get(layer, ""))
    if name != LAYERS_FILE or not os.path.isfile(table):
        return None
    rows = csv_text.READER.read(table, "")
    positions = np.column_stack([rows.columns[name] for name in ("lon", "lat", "height")])
    return replace(rows, geometry=positions, crs=f"EPSG:{WGS84_3D}")


def read_columns(path: str, layer: str, image_ids: Sequence[str] = ()) -> PointTables | None:
    """Return the image points of a layer of a GeoPackage from the column cache next to it.

    None if there are no columns, the layer is another one or has been changed since, or the columns are damaged.
    """
    folder, name = os.path.split(path)
    columns = os.path.join(folder, COLUMNS_FILE)
    if name != LAYERS_FILE or layer != LAYER or not os.path.isfile(columns):
        return None
    try:
        result = read_arrays(columns)
        if result["schema"] != _SCHEMA or str(result["mark"]) != _database_mark(folder):
            return None
        rows = len(result["id"])
        numbered = [_decode_names(result[f"{name}_decode_names"], result[name], rows) for name in _NUMBERED]
        floats = {name: result[name] for name in ("sample", "line", "sigma", "quality")}
        for column in floats.values():
            if column.dtype != np.float64 or column.shape != (rows,) or np.isinf(column).any():
                raise ValueError("floats")
    except DAMAGED:
        return None
    xy, sigma = np.column_stack([floats["sample"], floats["line"]]), floats["sigma"]
    if not rows or not (np.abs(xy).max() <= RPC_BUDGETS.image_px and (np.isnan(sigma) | (sigma > 0.0)).all()):
        return None
    ids: Any = numbered[0]  # used as arrays
    images: Any = matching_names(numbered[1], image_ids)
    source = f"{path}, layer {layer!r}"
    return PointTables(
        None,
        ImagePoints(
            ids, images, xy, sigma_px=sigma, kind=np.asarray(numbered[2]), quality=floats["quality"], source=source
        ),
    )


def _database_mark(folder: str) -> str:
    """Return a mark of the GeoPackage that differs after any change to it; copies and archives keep the mark.

    The first bytes of a database contain its change counter.
    """
    path = os.path.join(folder, LAYERS_FILE)
    return files_mark([path, f"{path}-wal"], times=False)


def _decode_names(names: np.ndarray, number: np.ndarray, rows: int) -> NameColumn:
    if names.dtype.kind != "U" or names.ndim != 1 or number.dtype != np.int32 or number.shape != (rows,):
        raise ValueError("names")
    if rows and not (number.min() >= 0 and number.max() < len(names)):
        raise ValueError("numbers")
    return NameColumn(names, number)
