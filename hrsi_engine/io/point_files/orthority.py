"""Orthority's GCP GeoJSON: points with ``ji`` = [column, row] from the centre of the first pixel, and ``filename``.

Positions are longitude, latitude and ellipsoidal height, as GeoJSON (RFC 7946) says.
"""

import math
from typing import Any

import numpy as np

from ...foundation.errors import InputError
from ..opening.json_files import read_json
from .table import PointReader, PointTable


def read(path: str, _layer: str = "") -> PointTable:
    """Return the GCPs of a file; raise `InputError` naming the feature where one is damaged."""
    try:
        features = read_json(path, "points")["features"]
    except (TypeError, KeyError) as error:
        raise InputError(f"{path}: is no GeoJSON feature collection ({error}): check the file") from None
    if not isinstance(features, list):
        raise InputError(f"{path}: 'features' is no list: check the file")
    rows = [_read_feature(path, number, feature) for number, feature in enumerate(features)]
    numbers = np.array([row[2] for row in rows], dtype=np.float64).reshape(-1, 5)
    columns = {
        "id": np.array([row[0] for row in rows], dtype=str),
        "image": np.array([row[1] for row in rows], dtype=str),
        "sample": numbers[:, 0],
        "line": numbers[:, 1],
    }
    return PointTable(path, columns, ("id", "filename", "ji"), "feature {}".format, numbers[:, 2:], "EPSG:4979")


def _read_feature(path: str, number: int, feature: Any) -> tuple[str, str, list[float]]:
    """Return id, file name and column, row, lon, lat, height of one feature."""
    try:
        properties, coordinates = feature["properties"], feature["geometry"]["coordinates"]
        values = [float(value) for value in (*properties["ji"], *coordinates)]
        name, filename = properties["id"], properties["filename"]
        if len(properties["ji"]) != 2 or len(coordinates) not in (2, 3) or not all(map(math.isfinite, values)):
            raise ValueError("numbers are missing or too many")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}, feature {number}: needs id, filename, ji and point ({error}): correct it") from None
    return str(name).strip(), str(filename).strip(), values + [math.nan] * (5 - len(values))


def _recognises(_path: str, name: str, head: bytes) -> bool:
    return name.endswith((".geojson", ".json")) and b'"ji"' in head


READER = PointReader("Orthority GCPs", _recognises, read)
