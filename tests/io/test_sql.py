"""Names get into SQL texts as identifiers, whatever they hold."""

import sqlite3
from contextlib import closing

import pytest

from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.io.opening.databases import insert_text, sql_text

HOSTILE = ['a"b', '"; DROP TABLE kept; --', "it's", "{table}", "select", "naïve 名", "a]b`c", "%s ?", " "]


@pytest.mark.parametrize("name", HOSTILE)
def test_any_name_is_one_identifier(name: str):
    """SQLite itself tells the names of what was made with them; nothing else happened."""
    column = f"{name}x"
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("CREATE TABLE kept (a)")
        database.execute(sql_text("CREATE TABLE {table} ({columns})", table=name, columns=["one", column]))
        database.execute(insert_text(name, ["one", column]), (1, name))
        rows = database.execute(sql_text("SELECT {column} FROM {table}", table=name, column=column)).fetchall()
        columns = [row[1] for row in database.execute("SELECT * FROM pragma_table_info(?)", (name,))]
        tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
    assert rows == [(name,)]
    assert columns == ["one", column]
    assert tables == {"kept", name}


def test_a_zero_byte_is_refused():
    with pytest.raises(OutputError, match="zero byte"):
        sql_text("DELETE FROM {table}", table="a\0b")
