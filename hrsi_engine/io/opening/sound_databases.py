"""SQLite databases (GeoPackage, SpatiaLite, MBTiles) looked through before OGR reads them.

OGR trusts a database. In a damaged one a tree of pages can lead in circles, and one text of a megabyte among sixty
thousand rows makes OGR's columns, which give every row the width of the longest, larger than any memory. SQLite itself
finds that out: ``PRAGMA quick_check`` goes through all pages once, and the lengths of texts and geometries are asked
for. Both together take a fifth of the time of reading and no memory to speak of, and are ended when they take longer
than a database of that size can.
"""

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from urllib.parse import quote

from ...foundation.errors import InputError
from .budgets import database_seconds, file_bytes
from .sql import sql_text

_MAGIC = b"SQLite format 3\0"
_WRITE_AHEAD = slice(18, 20)  # of its head: versions that write and read it
_STEPS = 100_000  # of SQLite's machine between two looks at the clock


class Widths(NamedTuple):
    """Number of rows of a table, and length of the longest value of columns (bytes)."""

    rows: int
    longest: dict[str, int]


def is_database(path: str) -> bool:
    """Tell whether a file of the disk is an SQLite database."""
    if path.startswith("/vsi") or not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def require_sound(path: str) -> None:
    """Raise `InputError` for a database whose pages contradict each other; other files pass."""
    if not is_database(path):
        return
    with sound_database(path) as database:
        found = [str(row[0]) for row in database.execute("PRAGMA quick_check(1)")]
        if found != ["ok"]:
            raise sqlite3.DatabaseError(" ".join(" ".join(found).split()))


def widths(path: str, table: str, columns: Sequence[str]) -> Widths:
    """Return a table's rows and the bytes of the longest values of columns, 0 where all are NULL.

    Raises `InputError` where the database is damaged, or a view gives no answer in time.
    """
    places = {f"column_{number}": column for number, column in enumerate(columns)}
    asked = ", ".join(["SELECT count(*)", *(f"max(length(CAST({{{place}}} AS BLOB)))" for place in places)])
    with sound_database(path) as database:
        found = database.execute(sql_text(asked + " FROM {table}", table=table, **places)).fetchone()
    return Widths(int(found[0]), {column: int(size or 0) for column, size in zip(columns, found[1:], strict=True)})


@contextlib.contextmanager
def sound_database(path: str) -> Iterator[sqlite3.Connection]:
    """Open a database for reading; errors of SQLite and timeouts become `InputError`."""
    most = database_seconds(file_bytes(path) or 0)
    end = time.thread_time() + most
    try:
        with contextlib.closing(_connect_read_only(path)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")  # names in a damaged one may be anything
            database.set_progress_handler(lambda: time.thread_time() > end, _STEPS)
            yield database
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
        said = f"no answer after {most:.0f} s" if "interrupt" in str(error) else str(error)
        raise InputError(f"{path}: is a damaged database ({said}): get it again, or try sqlite3's .recover") from None


def _connect_read_only(path: str) -> sqlite3.Connection:
    """Open a database that others may write.

    One with a write-ahead log of which there is none at the moment (QGIS has closed it) is taken as it is: SQLite would
    leave a new log beside it, or fail where the folder takes no files.
    """
    address = f"file:{quote(os.path.abspath(path))}?mode=ro"
    with open(path, "rb") as file:
        has_log = file.read(_WRITE_AHEAD.stop)[_WRITE_AHEAD] == b"\2\2"
    if has_log and not os.path.exists(f"{path}-wal"):
        address += "&immutable=1"
    return sqlite3.connect(address, uri=True)
