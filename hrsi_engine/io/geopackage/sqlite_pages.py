"""Rows as pages of an SQLite file: tables that are empty are filled at once, without SQLite.

SQLite spends some microseconds on a row, most of it on finding again and again that it belongs behind the one before. A
compiled loop (`compiled_pages`) writes the same pages from the arrays in a tenth of the time. They are put behind the
file's own, and the page where an empty table begins becomes the root of its tree. The file's format is described at
https://www.sqlite.org/fileformat2.html and is promised to stay as it is.
"""

import sqlite3
import struct
from collections.abc import Sequence

import numpy as np

from .layer_words import Column
from .row_cells import Cells, Texts

_HEAD = 100  # bytes of the file's head
_CHANGES, _PAGES, _VALID_FOR = 24, 28, 92  # where it tells the number of changes, of pages, and which change that is of
#: What the head must say: plain journal, no bytes reserved; newest schema; no page map; UTF-8.
_PLAIN = {18: b"\1\1\0", 44: b"\0\0\0\4", 52: b"\0\0\0\0", 56: b"\0\0\0\1"}
_LOCKED_BYTE = 2**30  # the page that has it is not used
_BUFFER_PAGES = 512
#: What SQLite keeps of tables whose keys are not given out twice.
_LARGEST_KEY = """INSERT INTO sqlite_sequence SELECT name, ? FROM sqlite_master
    WHERE name = ? AND sql LIKE '%AUTOINCREMENT%'"""
_MARGIN = 35  # bytes of a page that a row may not have without pages of its own
_LONGEST_TYPE = 9  # bytes of a value's serial type, and of a number


class Pages:
    """Rows into empty tables of a file, whose keys ascend; one table after the other.

    The database is that of the file; it is not used from `begin` to `commit`.
    """

    def __init__(self, path: str, database: sqlite3.Connection) -> None:
        self._database, self._texts = database, Texts()
        self._file = open(path, "r+b")  # noqa: SIM115

    def begin(self) -> None:
        """As `Inserter.begin`."""
        tables = self._database.execute("SELECT name, rootpage FROM sqlite_master WHERE type = 'table'").fetchall()
        self._roots, self._table, self._filled = dict(tables), "", dict[str, int]()
        head = self._file.read(_HEAD)
        self._size = _page_size(head)
        self._changes, pages = struct.unpack_from(">II", head, _CHANGES)
        self._next, self._locked = pages + 1, _LOCKED_BYTE // self._size + 1
        self._pages = np.zeros((_BUFFER_PAGES, self._size), dtype=np.uint8)
        self._last_keys = np.empty(_BUFFER_PAGES, dtype=np.int64)

    def insert(self, table: str, names: Sequence[str], columns: Sequence[Column]) -> None:
        """As `Inserter.insert`; columns in the table's order, keys first."""
        from .compiled_pages import add_rows

        if table != self._table:
            self._end_table()
            self._table, self._children, self._state = table, [], np.array([0, 0, self._size, 0])
            self._pages[0] = 0
        cells = Cells(columns, self._texts)
        done, rows = 0, cells.words.shape[1]
        while done < rows:
            done = add_rows(
                self._pages, self._state, self._last_keys, done, cells.kinds, cells.words,
                cells.words.view(np.float64), cells.lengths, cells.content,
            )  # fmt: skip
            if self._state[0] == len(self._pages):
                self._children.append((self._write(self._pages), self._last_keys.copy()))
                self._pages[0], self._state[0] = 0, 0

    def commit(self) -> None:
        """As `Inserter.commit`."""
        self._end_table()
        count = struct.pack(">II", self._changes + 1, self._next - 1)
        for place, content in ((_CHANGES, count), (_VALID_FOR, count[:4])):
            self._file.seek(place)
            self._file.write(content)
        self.close()
        self._database.executemany(_LARGEST_KEY, [(key, table) for table, key in self._filled.items()])

    def close(self) -> None:
        """As `Inserter.close`."""
        self._file.close()

    def _end_table(self) -> None:
        """Write the last leaves of the table and the branches above them, the uppermost where the table begins."""
        from .compiled_pages import BRANCH_HEAD, CHILD, LONGEST_VARINT, PLACE, end_page, fill_branches

        if not self._table:
            return
        end_page(self._pages, self._state, self._last_keys)
        pages, last_keys = self._pages[: self._state[0] + 1], self._last_keys[: self._state[0] + 1]
        if self._children or len(pages) > 1:
            self._children.append((self._write(pages), last_keys))
            children, last_keys = (np.concatenate(parts) for parts in zip(*self._children, strict=True))
            most = (self._size - BRANCH_HEAD) // (PLACE + CHILD + LONGEST_VARINT)
            while True:
                count = -(-len(children) // most)
                bounds = np.arange(count + 1) * len(children) // count  # all are about equally full
                pages = np.zeros((count, self._size), dtype=np.uint8)
                fill_branches(pages, bounds, children, last_keys)
                if count == 1:
                    break
                children, last_keys = self._write(pages), last_keys[bounds[1:] - 1]
        self._put(self._roots[self._table], pages)
        self._filled[self._table] = int(self._state[3])

    def _write(self, pages: np.ndarray) -> np.ndarray:
        """Write pages behind the file's others; return their numbers."""
        numbers = self._next + np.arange(len(pages))
        if self._next <= self._locked:
            numbers += numbers >= self._locked
        before = int(np.sum(numbers < self._locked))
        for part in (slice(0, before), slice(before, None)):
            if len(numbers[part]):
                self._put(numbers[part][0], pages[part])
        self._next = int(numbers[-1]) + 1
        return numbers

    def _put(self, number: int, pages: np.ndarray) -> None:
        self._file.seek((int(number) - 1) * self._size)
        self._file.write(pages.data)


def can_have_pages(path: str, columns: Sequence[Column]) -> bool:
    """Return whether rows of these columns can be written as pages of a file."""
    with open(path, "rb") as file:
        head = file.read(_HEAD)
    plain = all(head[place : place + len(content)] == content for place, content in _PLAIN.items())
    # Texts as UTF-8 are not longer than as NumPy has them; each value has a serial type
    widest = sum(column.dtype.itemsize + _LONGEST_TYPE for column in columns)
    return plain and all(column.dtype.kind in "biufUV" for column in columns) and widest <= _page_size(head) - _MARGIN


def _page_size(head: bytes) -> int:
    size = int.from_bytes(head[16:18], "big")
    return 65536 if size == 1 else size
