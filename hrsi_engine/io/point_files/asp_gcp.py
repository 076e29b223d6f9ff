"""``.gcp`` of the Ames Stereo Pipeline, one point a line.

id, lat, lon, height above the ellipsoid, three sigmas (m), then for each image its name, column and row from the centre
of the first pixel, and their sigmas (px). Fields are separated by blanks or commas. The sigmas are those of the
geocentric x, y and z, as bundle_adjust takes them by default; where they differ, east, north and height are correlated.
"""

import math

import numpy as np

from ...foundation.errors import InputError
from ...ground.geodesy import east_north_up
from ..opening.budgets import require_size
from ..opening.numbers import has_decimal_commas, parse_finite
from .table import PointReader, PointTable

_POINT_FIELDS, _IMAGE_FIELDS = 7, 5
_NAMES = ("id", "lat", "lon", "height", "sigma_xy", "sigma_h", "image", "sample", "line", "sigma")
_GEOCENTRIC = (
    "{path}: the three sigmas of a point differ: they are taken along the geocentric x, y and z axes, as bundle_adjust "
    "does unless told otherwise"
)
_Row = tuple[int, str, str, list[float]]


def read(path: str, _layer: str = "") -> PointTable:
    """Return one row for each point and image; raise `InputError` naming the line where one is damaged."""
    require_size(path, "points")
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            lines = file.read().splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}): check the file") from None
    rows: list[_Row] = []
    for number, line in enumerate(lines, start=1):
        if has_decimal_commas(line.partition("#")[0].partition(" ")[2]):
            raise InputError(f"{path}, line {number}: has decimals behind commas: write them with a point")
        fields = line.partition("#")[0].replace(",", " ").split()
        rows += _parse_line(path, number, fields) if fields else []
    return _read_table(path, rows)


def _read_table(path: str, rows: list[_Row]) -> PointTable:
    values = np.array([row[3] for row in rows], dtype=np.float64).reshape(-1, 10)
    lat, lon, height, sx, sy, sz, sample, line, s_sample, s_line = values.T
    columns = {
        "id": np.array([row[1] for row in rows], dtype=str),
        "image": np.array([row[2] for row in rows], dtype=str),
        "sample": sample,
        "line": line,
        "sigma": np.hypot(s_sample, s_line) / math.sqrt(2.0),
    }
    geocentric = np.column_stack([sx, sy, sz])
    columns |= _read_accuracy(lon, lat, geocentric)
    notes = (_GEOCENTRIC.format(path=path),) if "cov_en" in columns else ()
    geometry = np.column_stack([lon, lat, height])
    return PointTable(path, columns, _NAMES, lambda row: f"line {rows[row][0]}", geometry, "EPSG:4979", notes)


def _read_accuracy(lon: np.ndarray, lat: np.ndarray, geocentric: np.ndarray) -> dict[str, np.ndarray]:
    """Return the sigmas, or the covariance of east, north and height where those of x, y, z ``(n, 3)`` differ."""
    if (geocentric == geocentric[:, :1]).all():
        return {"sigma_xy": geocentric[:, 0], "sigma_h": geocentric[:, 2]}
    axes = east_north_up(lon, lat)
    covariance = (axes * geocentric[:, None, :] ** 2) @ axes.swapaxes(1, 2)
    return {f"cov_{'enh'[i]}{'enh'[j]}": covariance[:, i, j] for i in range(3) for j in range(i, 3)}


def _parse_line(path: str, number: int, fields: list[str]) -> list[_Row]:
    """Return the rows of one line: a point that no image shows gives one without a measurement."""
    point, images = fields[:_POINT_FIELDS], fields[_POINT_FIELDS:]
    if len(point) < _POINT_FIELDS or len(images) % _IMAGE_FIELDS:
        raise InputError(
            f"{path}, line {number}: needs {_POINT_FIELDS} fields and {_IMAGE_FIELDS} more for each image: complete it"
        )
    position = _parse_floats(path, number, point[1:])
    if not images:
        return [(number, point[0], "", position + [math.nan] * 4)]
    groups = [images[start : start + _IMAGE_FIELDS] for start in range(0, len(images), _IMAGE_FIELDS)]
    return [(number, point[0], group[0], position + _parse_floats(path, number, group[1:])) for group in groups]


def _parse_floats(path: str, number: int, texts: list[str]) -> list[float]:
    values = []
    for text in texts:
        value = parse_finite(text)
        if value is None:
            raise InputError(f"{path}, line {number}: {text[:40]!r} is not a number: correct it")
        values.append(value)
    return values


READER = PointReader("Ames Stereo Pipeline GCPs", lambda _path, name, _head: name.endswith(".gcp"), read)
