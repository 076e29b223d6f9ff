"""Rows into SQLite, from columns: through Python, or by a compiled loop over SQLite's own interface in C.

Python's ``executemany`` needs an object for every value. Where numba is there, and the library of SQLite is found, the
same calls (bind each value, step, reset; https://www.sqlite.org/cintro.html) are made by a compiled loop, straight from
the arrays: three times as fast, and without the objects' memory. It has a connection of its own, which holds the file
only from `begin` to `commit`.
"""

from __future__ import annotations

import ctypes
import sqlite3
import sys
from collections.abc import Sequence
from functools import cache
from typing import Protocol

import numpy as np

from ..foundation import compiled_code
from .layer_words import Column
from .row_cells import Cells

WORTH_COMPILED_CODE = 20_000  # rows; fewer are written before the compiled loop is loaded
_LIBRARY = {"win32": "sqlite3.dll", "darwin": "libsqlite3.dylib"}.get(sys.platform, "libsqlite3.so.0")
_LOOP_FUNCTIONS = ("bind_double", "bind_int64", "bind_text", "bind_blob", "bind_null", "step", "reset")
_OPEN_FOR_WRITING = 0x2 | 0x8000  # SQLITE_OPEN_READWRITE, and NOMUTEX: one thread at a time has the connection


class Inserter(Protocol):
    """What rows are inserted through."""

    def begin(self) -> None:
        """Begin a transaction."""

    def insert(self, statement: str, columns: Sequence[Column]) -> None:
        """Insert rows.

        Parameters
        ----------
        statement : str
            SQL with a place for each column.
        columns : sequence of (n,) ndarray or Words
            Numbers (NaN becomes NULL), text, or bytes (dtype ``V``).
        """

    def commit(self) -> None:
        """End the transaction."""

    def close(self) -> None:
        """Let go of the file."""


class PythonRows:
    """Rows through Python's own interface; columns may also hold objects, None among them.

    In the middle of a transaction of the connection they are a part of it.
    """

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database, self._began = database, False

    def begin(self) -> None:
        """As `Inserter.begin`."""
        self._began = not self._database.in_transaction
        if self._began:
            self._database.execute("BEGIN")

    def insert(self, statement: str, columns: Sequence[Column]) -> None:
        """As `Inserter.insert`."""
        self._database.executemany(statement, zip(*(column.tolist() for column in columns), strict=True))

    def commit(self) -> None:
        """As `Inserter.commit`."""
        if self._began:
            self._database.execute("COMMIT")

    def close(self) -> None:
        """As `Inserter.close`: the connection is somebody else's."""


class CompiledRows:
    """Rows by the compiled loop.

    Parameters
    ----------
    path : file, which is there
    library : SQLite's
    """

    def __init__(self, path: str, library: ctypes.CDLL) -> None:
        self._path, self._library = path, library
        self._database = ctypes.c_void_p()
        self._functions = np.array(
            [ctypes.cast(getattr(library, f"sqlite3_{name}"), ctypes.c_void_p).value for name in _LOOP_FUNCTIONS],
            dtype=np.int64,
        )

    def begin(self) -> None:
        """As `Inserter.begin`."""
        place, flags = self._path.encode("utf-8"), ctypes.c_int(_OPEN_FOR_WRITING)
        self._require(self._library.sqlite3_open_v2(place, ctypes.byref(self._database), flags, None))
        for statement in (*WITHOUT_SAFETY, "BEGIN"):
            self._execute(statement)

    def insert(self, statement: str, columns: Sequence[Column]) -> None:
        """As `Inserter.insert`."""
        from .compiled_rows import insert

        prepared = ctypes.c_void_p()
        text = statement.encode("utf-8")
        self._require(self._library.sqlite3_prepare_v2(self._database, text, -1, ctypes.byref(prepared), None))
        try:
            cells = [Cells.of(column) for column in columns]
            kinds = np.array([cell.kind for cell in cells], dtype=np.int8)
            words, lengths = np.stack([cell.words for cell in cells]), np.stack([cell.lengths for cell in cells])
            failed = insert(prepared.value or 0, self._functions, kinds, words, words.view(np.float64), lengths)
            self._require(int(failed))
        finally:
            self._library.sqlite3_finalize(prepared)

    def commit(self) -> None:
        """As `Inserter.commit`."""
        self._execute("COMMIT")
        self.close()

    def close(self) -> None:
        """As `Inserter.close`."""
        self._library.sqlite3_close(self._database)
        self._database = ctypes.c_void_p()

    def _execute(self, statement: str) -> None:
        self._require(self._library.sqlite3_exec(self._database, statement.encode("utf-8"), None, None, None))

    def _require(self, code: int) -> None:
        """Raise as Python's interface does where SQLite says that something failed."""
        if code:
            message = ctypes.cast(self._library.sqlite3_errmsg(self._database), ctypes.c_char_p).value or b""
            raise sqlite3.OperationalError(message.decode("utf-8", "replace"))


#: For a file that nobody sees before it is complete: it is flushed and renamed then.
WITHOUT_SAFETY = ("PRAGMA synchronous = OFF", "PRAGMA journal_mode = OFF")


def compiled_rows(path: str, rows: int, columns: Sequence[Column]) -> CompiledRows | None:
    """Return the compiled loop for a file, None where it is not to be had, or not for these columns.

    Parameters
    ----------
    path : file
    rows : number that will be written
    columns : of the layer
    """
    if any(column.dtype.kind not in "biufUV" for column in columns):
        return None
    library = _library() if compiled_code.is_wanted(rows >= WORTH_COMPILED_CODE) else None
    return None if library is None else CompiledRows(path, library)


@cache
def _library() -> ctypes.CDLL | None:
    """Return SQLite's library, which GDAL and Python have loaded already; None where it has another name."""
    try:
        library = ctypes.CDLL(_LIBRARY)
        for name in ("open_v2", "prepare_v2", "finalize", "exec", "close", "errmsg", *_LOOP_FUNCTIONS):
            getattr(library, f"sqlite3_{name}")
    except (OSError, AttributeError):
        return None
    library.sqlite3_errmsg.restype = ctypes.c_void_p
    return library
