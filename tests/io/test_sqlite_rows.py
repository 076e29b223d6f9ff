"""Rows that the compiled loop inserts are those that Python's own interface inserts, bit for bit."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.io import sqlite_rows
from hrsi.hrsi_engine.io.layer_words import Words, is_any, shared_word
from hrsi.hrsi_engine.io.layers import Layer, write_geopackage

pytest.importorskip("numba")
COUNT = 120_000  # rows: several chunks


def layer(count: int = COUNT) -> Layer:
    """Return a layer with every kind of column."""
    random = np.random.default_rng(3)
    place = random.uniform(-80.0, 80.0, (count, 3))
    words = Words(np.array(["", "Ångström", "点", "a"]), random.integers(0, 4, count).astype(np.int8))
    number = np.where(random.random(count) < 0.1, np.nan, random.normal(size=count))
    return Layer("points", "PointZ", 4326, place, {
        "id": np.array([f"P{row}" for row in range(count)]),
        "unicode": np.array(["ñ", "long" * 20, "\U0001f6f0"])[np.arange(count) % 3],
        "word": words, "level": shared_word("image", count),
        "number": number, "single": number.astype(np.float32), "infinite": np.full(count, np.inf),
        "integer": random.integers(-(2**60), 2**60, count), "small": np.arange(count, dtype=np.int32),
        "flag": random.random(count) < 0.5,
    })  # fmt: skip


def content(path: Path) -> dict[str, list[tuple]]:
    with sqlite3.connect(path) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        tables = ("points", *(f"rtree_points_geom_{kind}" for kind in ("node", "rowid", "parent")))
        return {table: database.execute(f"SELECT * FROM {table}").fetchall() for table in tables}


def test_both_ways_write_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, used = {}, []
    insert = sqlite_rows.CompiledRows.insert
    monkeypatch.setattr(sqlite_rows.CompiledRows, "insert", lambda *given: (used.append(way), insert(*given)))
    for way in ("0", "1"):
        monkeypatch.setenv("HRSI_COMPILED", way)
        write_geopackage(str(tmp_path / f"{way}.gpkg"), [layer()])
        written[way] = content(tmp_path / f"{way}.gpkg")
    assert written["0"] == written["1"]
    assert set(used) == {"1"}


def test_a_library_that_is_not_found_is_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HRSI_COMPILED", "1")
    monkeypatch.setattr(sqlite_rows, "_LIBRARY", "libnosuchsqlite.so")
    sqlite_rows._library.cache_clear()
    write_geopackage(str(tmp_path / "points.gpkg"), [layer(100)])
    sqlite_rows._library.cache_clear()
    assert len(content(tmp_path / "points.gpkg")["points"]) == 100


def test_what_sqlite_refuses_is_an_error_that_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HRSI_COMPILED", "1")
    monkeypatch.setattr(sqlite_rows, "WITHOUT_SAFETY", ("PRAGMA max_page_count = 50",))  # a disk that is full
    with pytest.raises(OutputError, match=r"points\.gpkg: cannot be written \(database or disk is full\)"):
        write_geopackage(str(tmp_path / "points.gpkg"), [layer(30_000)])
    assert not list(tmp_path.iterdir())


def test_words_are_compared_like_arrays() -> None:
    words = Words(np.array(["a", "b"]), np.array([0, 1, 1]))
    assert (words == "b").tolist() == [False, True, True]
    assert (words != "b").tolist() == [True, False, False]
    assert words[1] == "b" and words[1:].tolist() == ["b", "b"]
    assert np.asarray(words.then(shared_word("c", 1))).tolist() == ["a", "b", "b", "c"]
    assert is_any(words, ("a", "z")).tolist() == is_any(np.asarray(words), ("a", "z")).tolist() == [True, False, False]
