"""What a reader of one format hands over, and how a reader is described."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class PointTable:
    """Rows of a point file under the field names of `columns.FIELDS`.

    source : file and layer, as messages name them
    columns : text columns (n,) str, '' where empty; number columns (n,) float64, NaN where empty
    field_names : all fields of the file as they are spelled there
    row_name : name of a row in messages (``line 12``, ``feature 3``)
    geometry : (n, 3) x, y, z in ``crs``, NaN where missing; None where the file has no geometry
    crs : anything PROJ reads; empty where the file says nothing
    pairwise : matches of two images; the same point may stand in other files under another id
    operations : of HRSI's own layers, what brought the surveys to WGS84 (`block.points.describe_operations`)
    """

    source: str
    columns: dict[str, np.ndarray]
    field_names: tuple[str, ...]
    row_name: Callable[[int], str]
    geometry: np.ndarray | None = None
    crs: str = ""
    notes: tuple[str, ...] = field(default=())
    pairwise: bool = False
    operations: str = ""

    def __len__(self) -> int:
        columns = [*self.columns.values(), *([] if self.geometry is None else [self.geometry])]
        return len(columns[0]) if columns else 0

    def name_row(self, row: int) -> str:
        """Return file, layer, row and id for an error message."""
        ids = self.columns.get("id")
        point = f" (id {str(ids[row])!r})" if ids is not None and ids[row] else ""
        return f"{self.source}, {self.row_name(int(row))}{point}"


@dataclass(frozen=True)
class PointReader:
    """How to recognise and read one format of point files.

    title : as messages name the format
    recognises : whether a file is of this format, by its path, its name (lower case) and its first bytes
    read : the rows of a file; the second argument is the layer wanted (name, ``#number`` or empty)
    """

    title: str
    recognises: Callable[[str, str, bytes], bool]
    read: Callable[[str, str], PointTable]
