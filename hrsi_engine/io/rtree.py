"""Filling the R-tree of an empty SQLite layer at once, all nodes packed: a hundred times faster than row by row.

The rectangles are sorted into tiles (sort-tile-recursive packing, Leutenegger et al. 1997) and written as the nodes of
SQLite's R-tree; https://www.sqlite.org/rtree.html, "Shadow tables", gives their layout: 2 bytes of depth (in the root
only), 2 bytes for the number of cells, then cells of an 8-byte id and four 4-byte floats, all big-endian.
"""

from __future__ import annotations

import sqlite3

import numpy as np

from .sql import insert_text, sql_text
from .sqlite_rows import Inserter

_MOST_CELLS = 51  # SQLite's limit
_CELL = np.dtype([("id", ">i8"), ("bounds", ">f4", (4,))])
_NODE = np.dtype([("depth", ">u2"), ("cells", ">u2"), ("cell", _CELL, (_MOST_CELLS,))])
_ROOT = 1
_REPLACE = "INSERT OR REPLACE INTO {table} ({columns})"


def fill_rtree(rows: Inserter, rtree: str, rowids: np.ndarray, bounds: np.ndarray) -> None:
    """Fill an empty R-tree of two dimensions.

    Parameters
    ----------
    rows : what its nodes are inserted through
    rtree : name of the virtual table
    rowids : (n,) int
    bounds : (n, 4) min x, max x, min y, max y
    """
    if not len(rowids):
        return
    # The order that puts neighbours together: vertical slices, each from bottom to top
    x, y = bounds[:, :2].sum(axis=1), bounds[:, 2:].sum(axis=1)
    slices = int(np.ceil(np.sqrt(len(x) / _MOST_CELLS)))
    by_x = np.argsort(x, kind="stable")
    strip = np.empty(len(x), dtype=np.int64)
    strip[by_x] = np.arange(len(x)) * slices // len(x)
    order = np.lexsort((y, strip))
    levels = [(rowids[order], _rounded_outwards(bounds[order]))]
    while len(levels[-1][0]) > _MOST_CELLS:
        levels.append(_parents(levels[-1][1]))
    first = _first_numbers([_node_of(len(ids)).max() + 1 for ids, _ in levels])
    for depth, (ids, boxes) in enumerate(levels):
        node = first[depth] + _node_of(len(ids))
        child = ids if depth == 0 else first[depth - 1] + ids
        top = depth if depth == len(levels) - 1 else 0
        # Number and content of a level's nodes
        starts = np.flatnonzero(np.r_[True, node[1:] != node[:-1]])
        content = np.zeros(len(starts), dtype=_NODE)
        content["depth"], content["cells"] = top, np.diff(np.r_[starts, len(node)])
        row, place = node - node[0], np.arange(len(node)) - starts[node - node[0]]
        content["cell"]["id"][row, place] = child
        content["cell"]["bounds"][row, place] = boxes
        nodes = [node[starts], content.view(f"V{_NODE.itemsize}")]
        rows.insert(insert_text(f"{rtree}_node", ("nodeno", "data"), _REPLACE), nodes)
        ascending = np.argsort(child)  # SQLite appends to the table's end
        table, key, value = ("rowid", "rowid", "nodeno") if depth == 0 else ("parent", "nodeno", "parentnode")
        rows.insert(insert_text(f"{rtree}_{table}", (key, value)), [child[ascending], node[ascending]])


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


def _rounded_outwards(bounds: np.ndarray) -> np.ndarray:
    """Return the bounds as float32 that hold the float64 ones."""
    single = bounds.astype(np.float32)
    for columns, wrong, towards in (((0, 2), np.greater, -np.inf), ((1, 3), np.less, np.inf)):
        for column in columns:
            inside = wrong(single[:, column], bounds[:, column])
            single[inside, column] = np.nextafter(single[inside, column], np.float32(towards))
    return single


def _node_of(count: int) -> np.ndarray:
    """Return which node each cell of a level belongs to, 0, 1, …; all nodes are about equally full."""
    nodes = -(-count // _MOST_CELLS)
    return np.arange(count) * nodes // count


def _parents(boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells of the next level: index and bounds of each node of this one."""
    node = _node_of(len(boxes))
    starts = np.flatnonzero(np.r_[True, node[1:] != node[:-1]])
    low, high = np.minimum.reduceat(boxes, starts), np.maximum.reduceat(boxes, starts)
    return np.arange(len(starts)), np.column_stack([low[:, 0], high[:, 1], low[:, 2], high[:, 3]])


def _first_numbers(counts: list[int]) -> list[int]:
    """Return the number of each level's first node; the root, alone on the last level, is node 1."""
    return [_ROOT + 1 + sum(counts[:depth]) for depth in range(len(counts) - 1)] + [_ROOT]
