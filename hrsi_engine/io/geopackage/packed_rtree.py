"""Spatial index of a layer, written at once: the R-tree of a GeoPackage with all nodes packed.

Boxes are sorted into vertical slices and each slice from south to north (sort-tile-recursive packing, Leutenegger et
al. 1997). Consecutive boxes become a node, and consecutive nodes a node of the next level, up to the root. The nodes
are rows of the shadow tables of SQLite's R-tree (https://www.sqlite.org/rtree.html, "Shadow tables"): 2 bytes of
depth (in the root only), 2 bytes for the number of cells, then cells of an 8-byte id and four 4-byte floats, all
big-endian. SQLite itself would need a hundred times as long, row by row.
"""

import sqlite3
from collections.abc import Iterable

import numpy as np

from ..opening.databases import insert_text, sql_text

_CELL = np.dtype([("id", ">i8"), ("box", ">f4", (4,))])
_HEAD_BYTES, _ROOT = 4, 1


def fill_rtree(database: sqlite3.Connection, rtree: str, low: np.ndarray, high: np.ndarray) -> None:
    """Replace the contents of an R-tree, if it exists, by the boxes of the rows 1 to n.

    low, high : (n, 2) minimum and maximum x, y, equal for points; NaN for a row without geometry
    """
    if not database.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (f"{rtree}_node",)).fetchone():
        return
    size = database.execute(sql_text("SELECT length(data) FROM {node} WHERE nodeno = 1", node=f"{rtree}_node"))
    capacity = (int(size.fetchone()[0]) - _HEAD_BYTES) // _CELL.itemsize
    node_type = np.dtype([("depth", ">u2"), ("cells", ">u2"), ("cell", _CELL, (capacity,))])
    for shadow in ("node", "rowid", "parent"):
        database.execute(sql_text("DELETE FROM {table}", table=f"{rtree}_{shadow}"))
    ids = np.flatnonzero(np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)) + 1
    boxes = _round_outwards(low[ids - 1], high[ids - 1])
    order = _order_in_tiles(boxes, capacity)
    ids, boxes, depth, first = ids[order], boxes[order], 0, _ROOT + 1
    while True:
        count = max(1, -(-len(ids) // capacity))
        bounds = np.arange(count + 1) * len(ids) // count  # all nodes are about equally full
        numbers = first + np.arange(count) if count > 1 else np.array([_ROOT])
        node, cells = np.repeat(np.arange(count), np.diff(bounds)), np.diff(bounds)
        place = np.arange(len(ids)) - bounds[node]
        content = np.zeros(count, dtype=node_type)
        content["cells"], content["depth"] = cells, depth if count == 1 else 0
        content["cell"]["id"][node, place], content["cell"]["box"][node, place] = ids, boxes
        _insert(database, f"{rtree}_node", ("nodeno", "data"), zip(numbers.tolist(), map(bytes, content), strict=True))
        table, key = ("parent", "nodeno") if depth else ("rowid", "rowid")
        by_id = np.argsort(ids)
        parents = zip(ids[by_id].tolist(), numbers[node[by_id]].tolist(), strict=True)
        _insert(database, f"{rtree}_{table}", (key, "parentnode" if depth else "nodeno"), parents)
        if count == 1:
            return
        smallest, largest = (extreme.reduceat(boxes, bounds[:-1]) for extreme in (np.minimum, np.maximum))
        boxes = np.column_stack([smallest[:, 0], largest[:, 1], smallest[:, 2], largest[:, 3]])
        ids, depth, first = numbers, depth + 1, first + count


def _insert(database: sqlite3.Connection, table: str, columns: tuple[str, str], rows: Iterable[tuple]) -> None:
    database.executemany(insert_text(table, columns), rows)


def _round_outwards(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return min x, max x, min y, max y as float32 ``(n, 4)``, rounded so that they contain the float64 boxes."""
    boxes = np.empty((len(low), 4), dtype=np.float32)
    for column, exact, exceeds, limit in ((0, low, np.greater, -np.inf), (1, high, np.less, np.inf)):
        for axis in (0, 1):
            single = exact[:, axis].astype(np.float32)
            inside = exceeds(single, exact[:, axis])
            boxes[:, 2 * axis + column] = np.where(inside, np.nextafter(single, np.float32(limit)), single)
    return boxes


def _order_in_tiles(boxes: np.ndarray, capacity: int) -> np.ndarray:
    """Return an order in which neighbours follow each other: vertical slices, each from south to north."""
    count = len(boxes)
    slices = int(np.ceil(np.sqrt(count / capacity)))
    strip = np.empty(count, dtype=np.int64)
    strip[np.argsort(boxes[:, 0] + boxes[:, 1], kind="stable")] = np.arange(count) * slices // max(count, 1)
    return np.lexsort((boxes[:, 2] + boxes[:, 3], strip))
