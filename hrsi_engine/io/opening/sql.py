"""SQL texts: the one place where names get into them, quoted; values never do, they are parameters of ``execute``.

Names of tables and columns cannot be parameters in SQL. They may come from files of others (a trigger of a GeoPackage,
a field of a layer), so each is quoted here, with its own quotes doubled: https://www.sqlite.org/lang_keywords.html.
"""

from collections.abc import Sequence

from ...foundation.errors import OutputError


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
        raise OutputError(f"{name!r} holds a zero byte, which no table or column can: rename it")
    doubled = name.replace('"', '""')
    return f'"{doubled}"'
