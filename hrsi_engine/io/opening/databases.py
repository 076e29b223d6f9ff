"""Checks of SQLite databases (GeoPackage, SpatiaLite, MBTiles) before OGR reads them.

OGR does not check a database. In a damaged one the tree of pages can have cycles, and one text of a megabyte among
sixty thousand rows makes OGR's columns, in which every row has the width of the longest, larger than any memory. SQLite
finds such faults: ``PRAGMA quick_check`` reads all pages once, and queries return the lengths of texts and geometries.
Both together take a fifth of the time of reading and hardly any memory, and are stopped when they take longer than a
database of that size can.

Names are put into SQL texts, quoted, by `sql_text`; values never are: they are parameters of ``execute``. Names of
tables and columns cannot be parameters in SQL, and may come from files of others (trigger of a GeoPackage, field of a
layer). Therefore each is quoted, with its own quotes doubled: https://www.sqlite.org/lang_keywords.html.
"""

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterator, Sequence
from urllib.parse import quote

from ...foundation.errors import InputError, OutputError
from .budgets import database_seconds
from .files import file_bytes

_MAGIC = b"SQLite format 3\0"


def is_database(path: str) -> bool:
    """Return whether a file on disk is an SQLite database."""
    if path.startswith("/vsi") or not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def require_sound(path: str) -> None:
    """Raise `InputError` for a database whose pages are inconsistent; other files are not checked."""
    if not is_database(path):
        return
    with sound_database(path) as database:
        answers = [str(row[0]) for row in database.execute("PRAGMA quick_check(1)")]
        if answers != ["ok"]:
            raise sqlite3.DatabaseError(" ".join(" ".join(answers).split()))


def widths(path: str, table: str, columns: Sequence[str]) -> tuple[int, dict[str, int]]:
    """Return the number of a table's rows and the bytes of the longest values of columns, 0 where all are NULL.

    Raises `InputError` if the database is damaged, or a view takes too long.
    """
    places = {f"column_{number}": column for number, column in enumerate(columns)}
    query = ", ".join(["SELECT count(*)", *(f"max(length(CAST({{{place}}} AS BLOB)))" for place in places)])
    with sound_database(path) as database:
        row = database.execute(sql_text(query + " FROM {table}", table=table, **places)).fetchone()
    return int(row[0]), {column: int(size or 0) for column, size in zip(columns, row[1:], strict=True)}


@contextlib.contextmanager
def sound_database(path: str) -> Iterator[sqlite3.Connection]:
    """Open a database for reading; errors of SQLite and timeouts become `InputError`.

    A database in WAL mode without a log file (QGIS has closed it) is opened as immutable: SQLite would otherwise create
    a log next to it, or fail in a read-only folder.
    """
    limit_s = database_seconds(file_bytes(path) or 0)
    end = time.thread_time() + limit_s
    try:
        address = f"file:{quote(os.path.abspath(path))}?mode=ro"
        with open(path, "rb") as file:
            has_log = file.read(20)[18:] == b"\2\2"  # file format versions for writing and reading
        if has_log and not os.path.exists(f"{path}-wal"):
            address += "&immutable=1"
        with contextlib.closing(sqlite3.connect(address, uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")  # damaged names may have any bytes
            database.set_progress_handler(lambda: time.thread_time() > end, 100_000)  # steps between two checks
            yield database
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
        said = f"no answer after {limit_s:.0f} s" if "interrupt" in str(error) else str(error)
        raise InputError(
            f"{path}: is a damaged database ({said}): obtain it again, or try sqlite3's .recover"
        ) from None


def sql_text(template: str, **names: str | Sequence[str]) -> str:
    """Return an SQL text with names in its ``{places}``, each quoted as an identifier.

    The template is a constant text; names are those of tables, columns or triggers, and a sequence of names becomes a
    list with commas. Raises `OutputError` for a name that SQLite does not allow.
    """
    lists = {place: [value] if isinstance(value, str) else value for place, value in names.items()}
    return template.format(**{place: ", ".join(map(_quote, identifiers)) for place, identifiers in lists.items()})


def insert_text(table: str, columns: Sequence[str]) -> str:
    """Return the SQL text that inserts rows, with a parameter for each column."""
    head = sql_text("INSERT INTO {table} ({columns})", table=table, columns=columns)
    return f"{head} VALUES ({', '.join('?' * len(columns))})"


def _quote(name: str) -> str:
    if "\0" in name:
        raise OutputError(f"{name!r} contains a zero byte, which names of tables and columns cannot have: rename it")
    doubled = name.replace('"', '""')
    return f'"{doubled}"'
