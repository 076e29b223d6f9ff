"""Rows into SQLite, from columns: through Python's interface, or as pages (`sqlite_pages`).

Python's ``executemany`` needs an object for every value. Where numba is there, and nobody else has the file, the pages
that SQLite would make are written from the arrays: ten times as fast, and without the objects' memory.
"""

import sqlite3
from collections.abc import Sequence
from typing import Protocol

from ...foundation import compiled_code
from ...foundation.thresholds import threshold, thresholds
from ..opening.sql import insert_text
from .layer_words import Column
from .sqlite_pages import Pages, can_have_pages


@thresholds
class ROW_WRITING:
    """When rows are written by the compiled loop."""

    compiled_rows: int = threshold(20_000, "rows", "fewer are written before the compiled loop is loaded", "measured")


_REPLACE = "INSERT OR REPLACE INTO {table} ({columns})"


class Inserter(Protocol):
    """What rows are inserted through."""

    def begin(self) -> None:
        """Begin a transaction."""

    def insert(self, table: str, names: Sequence[str], columns: Sequence[Column]) -> None:
        """Insert rows into a table, whose last rows they become.

        names : of its columns, in its order, the key first
        columns : keys, which ascend; numbers (NaN becomes NULL), text, bytes (dtype ``V``), or objects: bytes and None
        """

    def commit(self) -> None:
        """End the transaction."""

    def close(self) -> None:
        """Let go of the file."""


class PythonRows:
    """Rows through Python's own interface. In the middle of a transaction of the connection they are a part of it."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database, self._began = database, False

    def begin(self) -> None:
        """As `Inserter.begin`."""
        self._began = not self._database.in_transaction
        if self._began:
            self._database.execute("BEGIN")

    def insert(self, table: str, names: Sequence[str], columns: Sequence[Column]) -> None:
        """As `Inserter.insert`."""
        rows = zip(*(column.tolist() for column in columns), strict=True)
        self._database.executemany(insert_text(table, names, _REPLACE), rows)

    def commit(self) -> None:
        """As `Inserter.commit`."""
        if self._began:
            self._database.execute("COMMIT")

    def close(self) -> None:
        """As `Inserter.close`: the connection is somebody else's."""


#: For a file that nobody sees before it is complete: it is flushed and renamed then.
WITHOUT_SAFETY = ("PRAGMA synchronous = OFF", "PRAGMA journal_mode = OFF")


def rows_of_new_file(path: str, database: sqlite3.Connection, count: int, columns: Sequence[Column]) -> Inserter:
    """Return the faster way to insert ``count`` rows into the empty tables of a new file: page writer or `sqlite3`."""
    if compiled_code.is_wanted(count >= ROW_WRITING.compiled_rows) and can_have_pages(path, columns):
        return Pages(path, database)
    return PythonRows(database)
