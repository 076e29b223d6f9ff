"""Points in the memory of a program: tables of pandas and GeoPandas, columns by name, arrays, and HRSI's own columns.

They become a `PointTable` as the rows of a file do, under the same field names, and `interpret` checks both in the
same way. No library of tables is imported: a table is any object with columns by name; a geometry has ``x`` and ``y``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...block.points import GroundPoints, ImagePoints
from ...foundation.errors import InputError
from ...foundation.options import InMemory
from .interpret import PointTables, interpret
from .positions import Reference
from .table import TEXT_FIELDS, PointTable, match_fields, parse_numbers, strip_texts

#: Columns of arrays without names: ground points, and image points of one image.
ARRAY_COLUMNS = {3: ("lon", "lat", "height"), 2: ("sample", "line")}


class PointsInMemory(InMemory):
    """Points in memory; the text is their name in messages.

    points : a table of pandas or GeoPandas, or a dict of columns, with the field names of point files; an array (n, 3)
    of lon, lat in degrees and height, or (n, 2) of sample and line in the only image, with the points 1, 2, … as rows;
    or points of the engine (`PointTables`, `GroundPoints`, `ImagePoints`)
    """

    __slots__ = ("points",)
    points: Any

    def __new__(cls, points: Any) -> PointsInMemory:
        """Create the points with a name of type and number: ``DataFrame of 12 points``."""
        instance = super().__new__(cls, f"{type(points).__name__} of {_count_points(points)} points")
        instance.points = points
        return instance

    def tables(self, reference: Reference, image_ids: Sequence[str]) -> PointTables:
        """Return the ground points and the image points, with the same checks as those of a file.

        ``reference`` is the reference of the coordinates if the table does not state it. Raises `InputError` with row,
        column or id, and the remedy.
        """
        points = self.points
        if isinstance(points, PointTables):
            return points
        if isinstance(points, GroundPoints):
            return PointTables(points, None)
        if isinstance(points, ImagePoints):
            return PointTables(None, points)
        return interpret(self.table(), reference, image_ids)

    def table(self) -> PointTable:
        """Return the unchecked table under the field names of point files, as a reader of point files does.

        Raises `InputError` for columns of different lengths, texts that are no numbers, and objects that are no tables.
        """
        columns = _columns_of(self.points)
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            reason = ", ".join(f"{name} {count}" for name, count in lengths.items())
            raise InputError(f"{self}: its columns differ in length ({reason}): give one value a point")

        index = getattr(self.points, "index", None)
        labels = list(index) if index is not None and not callable(index) else range(1, _count_points(self.points) + 1)

        def row_name(row: int) -> str:
            return f"row {labels[row]}"

        position = match_fields(list(columns))
        names = list(columns)
        fields = {name: self._field(name, columns[names[current]], row_name) for name, current in position.items()}
        xyz, crs = None, ""  # of a table with geometries
        if _has_places(self.points):
            xyz = np.full((len(self.points), 3), np.nan)
            for row, place in enumerate(self.points.geometry):
                if place is None or place.is_empty:
                    continue
                if place.geom_type != "Point":
                    raise InputError(f"{self}, row {row + 1}: its geometry is a {place.geom_type}: give points")
                xyz[row] = place.x, place.y, place.z if place.has_z else np.nan
            crs = "" if self.points.crs is None else self.points.crs.to_wkt()
        return PointTable(str(self), fields, tuple(names), row_name, xyz, crs)

    def _field(self, field: str, values: Any, row_text: Callable[[int], str]) -> np.ndarray:
        """Return a column as texts or numbers; missing values are empty or NaN."""
        column = np.asarray(values)
        if field not in TEXT_FIELDS and column.dtype.kind in "iufb":
            return column.astype(np.float64)
        # Integers that a table stores as floats, because other values are missing, are written as integers
        values_as_integers = [int(v) if isinstance(v, float) and v.is_integer() else v for v in column.tolist()]
        texts = ["" if _is_missing(value) else str(value) for value in values_as_integers]
        if field in TEXT_FIELDS:
            return strip_texts(texts, str(self), field)
        return parse_numbers(texts, lambda row: f"{self}, {row_text(row)}, column {field!r}", infinite=True)


def _count_points(points: Any) -> int:
    if isinstance(points, PointTables):
        return sum(len(table) for table in (points.ground, points.image) if table is not None)
    if isinstance(points, Mapping):
        return max((len(column) for column in points.values()), default=0)
    try:
        return len(points)
    except TypeError:
        raise InputError(
            f"points given as {type(points).__name__}: give a file, a table, columns by name, or an array"
        ) from None


def _columns_of(points: Any) -> dict[str, Any]:
    """Return columns by name; the index of a table is included if it has a name."""
    if isinstance(points, ImagePoints):
        return {"id": points.ids, "image": points.image_ids, "sample": points.xy[:, 0], "line": points.xy[:, 1]}
    if isinstance(points, GroundPoints):
        return {"id": points.ids, **dict(zip(ARRAY_COLUMNS[3], points.ground.T, strict=True))}
    if isinstance(points, Mapping):
        return {str(name): values for name, values in points.items()}
    if hasattr(points, "columns") and hasattr(points, "__getitem__"):
        place = getattr(getattr(points, "geometry", None), "name", None) if _has_places(points) else None
        columns = {str(name): points[name] for name in points.columns if name != place}
        name = getattr(getattr(points, "index", None), "name", None)
        return {str(name): points.index, **columns} if name is not None else columns
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] not in ARRAY_COLUMNS:
        raise InputError(
            f"points given as an array {array.shape}: give (n, 3) lon, lat, height or (n, 2) sample, line, "
            "or a table with field names"
        )
    return {"id": np.arange(1, len(array) + 1), **dict(zip(ARRAY_COLUMNS[array.shape[1]], array.T, strict=True))}


def _has_places(points: Any) -> bool:
    """Return whether a table is one of GeoPandas, by attributes that only such tables have."""
    try:
        return points.geometry is not None and hasattr(points, "crs")
    except AttributeError:  # of a GeoDataFrame without geometry
        return False


def _is_missing(value: Any) -> bool:
    """Return whether a value means a missing one: None, NaN, NaT, pandas's NA."""
    is_nan = isinstance(value, float) and value != value
    return value is None or is_nan or type(value).__name__ in ("NAType", "NaTType")
