"""Filling the R-tree of an empty SQLite layer at once, all nodes packed: a hundred times faster than row by row.

The rectangles are sorted into tiles (sort-tile-recursive packing, Leutenegger et al. 1997) and written as the nodes of
SQLite's R-tree; https://www.sqlite.org/rtree.html, "Shadow tables", gives their layout: 2 bytes of depth (in the root
only), 2 bytes for the number of cells, then cells of an 8-byte id and four 4-byte floats, all big-endian.
"""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..opening.databases import insert_text, sql_text
from .sqlite_rows import Inserter

_MOST_CELLS = 51  # SQLite's limit
_CELL = np.dtype([("id", ">i8"), ("bounds", ">f4", (4,))])
_NODE = np.dtype([("depth", ">u2"), ("cells", ">u2"), ("cell", _CELL, (_MOST_CELLS,))])
_ROOT = 1
_ROWS_AT_ONCE, _NODES_AT_ONCE = 25_000, 1000


_Level = tuple[np.ndarray, np.ndarray]  # ascending keys, and a value for each


@dataclass(frozen=True)
class RtreeTables:
    """The tables of an R-tree.

    nodes : by level, numbers of nodes and their contents (dtype ``V``)
    rowids : rows and the nodes that they are in; parents : by level, nodes and the ones that they are in
    """

    nodes: Sequence[_Level]
    rowids: _Level
    parents: Sequence[_Level]


def pack_rtree(rowids: np.ndarray, low: np.ndarray, high: np.ndarray) -> RtreeTables | None:
    """Return a packed two-dimensional R-tree of boxes; None without any box.

    rowids : (n,) int, ascending; low, high : (n, 2) least and largest x, y; the same for points
    """
    if not len(rowids):
        return None
    counts = [len(rowids)]  # cells of each level
    while counts[-1] > _MOST_CELLS:
        counts.append(-(-counts[-1] // _MOST_CELLS))
    first = [_ROOT + 1 + sum(counts[1 : level + 1]) for level in range(len(counts) - 1)] + [_ROOT]
    # The order that puts neighbours together: vertical slices, each from bottom to top
    count = len(low)
    slices = int(np.ceil(np.sqrt(count / _MOST_CELLS)))
    strip = np.zeros(count, dtype=np.uint64)
    strip[_order_by_keys(strip, low[:, 0] + high[:, 0])] = np.arange(count, dtype=np.uint64) * slices // count
    order = _order_by_keys(strip, low[:, 1] + high[:, 1])
    # Min x, max x, min y, max y as float32, rounded outwards, so that they hold the float64 ones, ``(n, 4)``
    single = np.empty((len(low), 4), dtype=np.float32)
    for corner, exact, wrong, towards in ((0, low, np.greater, -np.inf), (1, high, np.less, np.inf)):
        for axis in (0, 1):
            column = single[:, 2 * axis + corner]
            column[:] = exact[:, axis]
            inside = wrong(column, exact[:, axis])
            column[inside] = np.nextafter(column[inside], np.float32(towards))
    boxes = single[order]
    nodes, places = [], []  # of each level: node numbers with contents, and in which node each cell is
    for level, count in enumerate(counts):
        number = -(-count // _MOST_CELLS)
        bounds = -(-np.arange(number + 1) * count // number)  # all nodes are about equally full
        child = rowids[order] if level == 0 else first[level - 1] + np.arange(count)
        depth = level if level == len(counts) - 1 else 0  # the root tells it
        numbers = first[level] + np.arange(number, dtype=np.int32)
        node = np.empty(count, dtype=np.int32)
        node[order if level == 0 else slice(None)] = np.repeat(numbers, np.diff(bounds))
        places.append((rowids if level == 0 else child, node))
        nodes.append((numbers, _pack_nodes(depth, child, boxes, bounds)))
        least, largest = (f.reduceat(boxes, bounds[:-1]) for f in (np.minimum, np.maximum))
        boxes = np.column_stack([least[:, 0], largest[:, 1], least[:, 2], largest[:, 3]])
    return RtreeTables([nodes[-1], *nodes[:-1]], places[0], places[1:])  # the root first, as its number is


def fill_rtree(rows: Inserter, rtree: str, tree: RtreeTables | None) -> None:
    """Fill an empty R-tree, a virtual table, through ``rows``: its tables grow at their ends."""
    if tree is None:
        return
    for table, names, levels in (
        ("node", ("nodeno", "data"), tree.nodes),
        ("rowid", ("rowid", "nodeno"), [tree.rowids]),
        ("parent", ("nodeno", "parentnode"), tree.parents),
    ):
        for keys, values in levels:
            for begin in range(0, len(keys), _ROWS_AT_ONCE):
                part = slice(begin, begin + _ROWS_AT_ONCE)
                rows.insert(f"{rtree}_{table}", names, [keys[part], values[part]])


def _pack_nodes(depth: int, child: np.ndarray, boxes: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return nodes as bytes (dtype ``V``): node i has the cells from ``bounds[i]`` to ``bounds[i + 1]``."""
    cells = np.diff(bounds)
    content = np.zeros(len(cells), dtype=_NODE)
    content["depth"], content["cells"] = depth, cells
    for begin in range(0, len(cells), _NODES_AT_ONCE):
        part = slice(begin, min(begin + _NODES_AT_ONCE, len(cells)))
        used, given = np.arange(_MOST_CELLS) < cells[part, None], slice(bounds[part.start], bounds[part.stop])
        content["cell"]["id"][part][used] = child[given]
        content["cell"]["bounds"][part][used] = boxes[given]
    return content.view(f"V{_NODE.itemsize}")


def _order_by_keys(major: np.ndarray, minor: np.ndarray) -> np.ndarray:
    """Return the order of rows by small numbers, then by others to as many bits as there are left in 64.

    One sort of keys that end with the number of the row: a fifth of the time of a stable sort of two columns.
    """
    row_bits, major_bits = len(major).bit_length(), int(major.max()).bit_length()
    least, most = float(minor.min()), (1 << min(64 - row_bits - major_bits, 52)) - 1  # a float has no more
    spread = float(minor.max()) - least
    place = minor - least
    place *= most / spread if spread > 0.0 else 0.0
    key = np.minimum(place, most, out=place).astype(np.uint64)
    key <<= np.uint64(row_bits)
    key |= np.arange(len(major), dtype=np.uint64)
    if major_bits:
        key |= major << np.uint64(64 - major_bits)
    key.sort()
    key &= np.uint64((1 << row_bits) - 1)
    return key.view(np.int64)


def empty_rtree(database: sqlite3.Connection, rtree: str) -> None:
    """Empty an R-tree, if it is there; row by row, as SQLite does it, would take minutes for a million rows."""
    if not database.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (f"{rtree}_node",)).fetchone():
        return
    nodes = f"{rtree}_node"
    size = database.execute(sql_text("SELECT length(data) FROM {nodes} WHERE nodeno = ?", nodes=nodes), (_ROOT,))
    root = bytes(size.fetchone()[0])
    for shadow in ("node", "rowid", "parent"):
        database.execute(sql_text("DELETE FROM {table}", table=f"{rtree}_{shadow}"))
    database.execute(insert_text(nodes, ("nodeno", "data")), (_ROOT, root))
