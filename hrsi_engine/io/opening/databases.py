"""SQLite databases (GeoPackage, SpatiaLite, MBTiles) looked through before OGR reads them.

OGR trusts a database. In a damaged one a tree of pages can lead in circles, and one text of a megabyte among sixty
thousand rows makes OGR's columns, which give every row the width of the longest, larger than any memory. SQLite itself
finds that out: ``PRAGMA quick_check`` goes through all pages once, and the lengths of texts and geometries are asked
for. Both together take a fifth of the time of reading and no memory to speak of, and are ended when they take longer
than a database of that size can.

Names get into SQL texts by `sql_text`, quoted; values never do, they are parameters of ``execute``. Names of tables and
columns cannot be parameters in SQL, and may come from files of others (a trigger of a GeoPackage, a field of a layer),
so each is quoted, with its own quotes doubled: https://www.sqlite.org/lang_keywords.html.
"""

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterator, Sequence
from urllib.parse import quote

from ...foundation.errors import InputError, OutputError
from .budgets import database_seconds, file_bytes

_MAGIC = b"SQLite format 3\0"


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


def widths(path: str, table: str, columns: Sequence[str]) -> tuple[int, dict[str, int]]:
    """Return the number of a table's rows and the bytes of the longest values of columns, 0 where all are NULL.

    Raises `InputError` where the database is damaged, or a view gives no answer in time.
    """
    places = {f"column_{number}": column for number, column in enumerate(columns)}
    asked = ", ".join(["SELECT count(*)", *(f"max(length(CAST({{{place}}} AS BLOB)))" for place in places)])
    with sound_database(path) as database:
        found = database.execute(sql_text(asked + " FROM {table}", table=table, **places)).fetchone()
    return int(found[0]), {column: int(size or 0) for column, size in zip(columns, found[1:], strict=True)}


@contextlib.contextmanager
def sound_database(path: str) -> Iterator[sqlite3.Connection]:
    """Open a database for reading; errors of SQLite and timeouts become `InputError`.

    One with a write-ahead log of which there is none at the moment (QGIS has closed it) is taken as it is: SQLite would
    leave a new log beside it, or fail where the folder takes no files.
    """
    most = database_seconds(file_bytes(path) or 0)
    end = time.thread_time() + most
    try:
        address = f"file:{quote(os.path.abspath(path))}?mode=ro"
        with open(path, "rb") as file:
            has_log = file.read(20)[18:] == b"\2\2"  # the versions that write and read it
        if has_log and not os.path.exists(f"{path}-wal"):
            address += "&immutable=1"
        with contextlib.closing(sqlite3.connect(address, uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")  # names in a damaged one may be anything
            database.set_progress_handler(lambda: time.thread_time() > end, 100_000)  # steps between two looks
            yield database
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
        said = f"no answer after {most:.0f} s" if "interrupt" in str(error) else str(error)
        raise InputError(
            f"{path}: is a damaged database ({said}): obtain it again, or try sqlite3's .recover"
        ) from None


def sql_text(template: str, **names: str | Sequence[str]) -> str:
    """Return an SQL text with names in its ``{places}``, each an identifier and nothing else.

    The template is a constant text; names are those of tables, columns or triggers, and a sequence of them becomes a
    list with commas. Raises `OutputError` for a name that SQLite cannot hold.
    """
    lists = {place: [given] if isinstance(given, str) else given for place, given in names.items()}
    return template.format(**{place: ", ".join(map(_quote, listed)) for place, listed in lists.items()})


def insert_text(table: str, columns: Sequence[str], template: str = "INSERT INTO {table} ({columns})") -> str:
    """Return the SQL text that inserts rows with a value for each column."""
    return f"{sql_text(template, table=table, columns=columns)} VALUES ({', '.join('?' * len(columns))})"


def _quote(name: str) -> str:
    if "\0" in name:
        raise OutputError(f"{name!r} contains a zero byte, which names of tables and columns cannot have: rename it")
    doubled = name.replace('"', '""')
    return f'"{doubled}"'
