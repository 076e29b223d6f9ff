"""Rows that are written as pages are those that SQLite inserts, bit for bit, in a file that it calls sound."""

from __future__ import annotations

import ctypes
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.io.geopackage import sqlite_rows
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.geopackage.typed_rows import PickedColumn, StackedColumn, Words, is_any, make_shared_words

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
        "word": words, "level": make_shared_words("image", count),
        "number": number, "whole": np.round(number * 1e3) * 10.0 ** random.integers(0, 18, count),
        "single": number.astype(np.float32), "infinite": np.full(count, np.inf),
        "integer": random.integers(-(2**60), 2**60, count) >> random.integers(0, 60, count),
        "small": np.arange(count, dtype=np.int32),
        "flag": random.random(count) < 0.5,
    })  # fmt: skip


def content(path: Path) -> dict[str, list[tuple]]:
    with sqlite3.connect(path) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        tables = ("points", *(f"rtree_points_geom_{kind}" for kind in ("node", "rowid", "parent")))
        return {table: database.execute(f"SELECT * FROM {table}").fetchall() for table in tables}


def test_both_ways_write_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[str] = []
    insert = sqlite_rows.Pages.insert
    with monkeypatch.context() as patch:
        patch.setattr(sqlite_rows.Pages, "insert", lambda *given: (used.append("pages"), insert(*given)))
        write_geopackage(str(tmp_path / "pages.gpkg"), [layer()])
    assert used
    monkeypatch.setattr(sqlite_rows, "can_write_pages", lambda *given: False)
    write_geopackage(str(tmp_path / "sqlite.gpkg"), [layer()])
    assert content(tmp_path / "pages.gpkg") == content(tmp_path / "sqlite.gpkg")


@pytest.mark.parametrize("count", [1, 30, 600])
def test_small_tables_are_sound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """A page, a page with some others below it, and an index with one."""
    write_geopackage(str(tmp_path / "points.gpkg"), [layer(count)])
    assert len(content(tmp_path / "points.gpkg")["points"]) == count


def test_keys_go_on_where_rows_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_geopackage(str(tmp_path / "points.gpkg"), [layer(5000)])
    with sqlite3.connect(tmp_path / "points.gpkg") as database:
        assert dict(database.execute("SELECT name, seq FROM sqlite_sequence"))["points"] == 5000
        for (trigger,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            database.execute(f"DROP TRIGGER {trigger}")  # they call functions of OGR
        database.execute("INSERT INTO points (id) SELECT id FROM points")  # the tree grows on
        assert database.execute("SELECT max(fid), count(*) FROM points").fetchone() == (10_000, 10_000)
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def test_the_page_of_locks_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SQLite never uses the page of byte 2**30; its own control for tests moves that to byte 2**18."""
    pending_byte, place = 11, 2**18
    try:
        library = ctypes.CDLL("libsqlite3.so.0")
    except OSError:
        pytest.skip("no SQLite of that name")
    if library.sqlite3_test_control(pending_byte, 0) != 2**30:
        pytest.skip("this SQLite has no controls for tests")
    monkeypatch.setattr(sqlite_rows, "_LOCKED_BYTE", place)
    before = library.sqlite3_test_control(pending_byte, place)
    try:
        write_geopackage(str(tmp_path / "points.gpkg"), [layer(30_000)])
        assert len(content(tmp_path / "points.gpkg")["points"]) == 30_000
        monkeypatch.setattr(sqlite_rows, "_LOCKED_BYTE", 2**30)
        write_geopackage(str(tmp_path / "wrong.gpkg"), [layer(30_000)])
        with sqlite3.connect(tmp_path / "wrong.gpkg") as database, pytest.raises(sqlite3.DatabaseError):
            database.execute("PRAGMA integrity_check").fetchone()  # so it does tell
    finally:
        library.sqlite3_test_control(pending_byte, before)


def test_rows_too_long_for_a_page_are_written_by_sqlite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = np.array(["x" * 5000, "y"])
    write_geopackage(str(tmp_path / "long.gpkg"), [Layer("long", "None", 4326, (), {"text": texts})])
    with sqlite3.connect(tmp_path / "long.gpkg") as database:
        assert database.execute("SELECT text FROM long").fetchall() == [(text,) for text in texts.tolist()]


def test_points_without_a_position_among_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = np.random.default_rng(4).uniform(0.0, 1.0, (1000, 2))
    place[::7] = np.nan
    write_geopackage(str(tmp_path / "p.gpkg"), [Layer("points", "Point", 4326, place, {"id": np.arange(1000)})])
    rows = content(tmp_path / "p.gpkg")["points"]
    assert [row[1] is None for row in rows] == np.isnan(place[:, 0]).tolist()
    assert [np.frombuffer(row[1][-16:]).tolist() for row in rows if row[1]] == place[np.isfinite(place[:, 0])].tolist()


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, before[1]))  # writing on fails as on a full disk
    try:
        with pytest.raises(OutputError, match=r"points\.gpkg: cannot be written \(.*: check free space"):
            write_geopackage(str(tmp_path / "points.gpkg"), [layer(30_000)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_words_are_compared_like_arrays() -> None:
    words = Words(np.array(["a", "b"]), np.array([0, 1, 1]))
    assert (words == "b").tolist() == [False, True, True]
    assert (words != "b").tolist() == [True, False, False]
    assert words[1] == "b" and words[1:].tolist() == ["b", "b"]
    assert np.asarray(words.concatenate(make_shared_words("c", 1))).tolist() == ["a", "b", "b", "c"]
    assert is_any(words, ("a", "z")).tolist() == is_any(np.asarray(words), ("a", "z")).tolist() == [True, False, False]


def test_stacked_columns_are_their_parts_one_behind_the_other() -> None:
    values = np.random.default_rng(1).normal(size=(3, 2))
    parts = (np.zeros((2, 2)), PickedColumn(values, np.array([2, 0, 0, 1])), np.empty((0, 2)))
    stacked, whole = StackedColumn(parts), np.vstack([np.zeros((2, 2)), values[[2, 0, 0, 1]]])
    assert len(stacked) == 6 and stacked.dtype == whole.dtype
    np.testing.assert_array_equal(np.asarray(stacked), whole)
    for begin in range(7):
        for end in range(begin, 9):
            np.testing.assert_array_equal(np.asarray(stacked[begin:end]), whole[begin:end])
    np.testing.assert_array_equal(stacked[whole[:, 0] == 0.0], whole[whole[:, 0] == 0.0])
    np.testing.assert_array_equal(np.hypot(2.0 - stacked, stacked), np.hypot(2.0 - whole, whole))


@pytest.mark.parametrize("as_pages", [True, False])
def test_shared_and_stacked_columns_are_written_row_by_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, as_pages: bool
) -> None:
    """More rows than are written at once, with the border between parts inside of such a piece."""
    if not as_pages:
        monkeypatch.setattr(sqlite_rows, "can_write_pages", lambda *given: False)
    random = np.random.default_rng(2)
    places, index = random.uniform(0.0, 1.0, (100, 3)), random.integers(0, 100, 60_000)
    first, nothing = random.normal(size=30), np.broadcast_to(np.nan, 60_000)
    coordinates = StackedColumn((places[:30], PickedColumn(places, index)))
    fields = {"number": StackedColumn((first, nothing)), "word": Words(np.array(["a", "b"]), np.arange(60_030) % 2)}
    write_geopackage(str(tmp_path / "p.gpkg"), [Layer("points", "PointZ", 4979, coordinates, fields)])
    rows = content(tmp_path / "p.gpkg")["points"]
    found = np.array([np.frombuffer(row[1][-24:]) for row in rows])
    np.testing.assert_array_equal(found, np.vstack([places[:30], places[index]]))
    assert [row[2] for row in rows] == [*first.tolist(), *[None] * 60_000]
    assert [row[3] for row in rows] == ["a", "b"] * 30_015


def test_leaves_of_a_packed_tree_are_nearly_square() -> None:
    """Of boxes scattered evenly, leaves that share the area as squares have 2 / sqrt(leaves) of half a perimeter.

    Every node's box, 4 byte numbers, holds the boxes under it, and every row is in the leaf that is told of it.
    """
    random = np.random.default_rng(5)
    middle, size = random.random((4000, 2)), 1e-3 * random.random((4000, 2))
    low, high = middle - size, middle + size
    rowids = np.arange(4000) * 2 + 5
    tables = sqlite_rows.pack_rtree(rowids, low, high)
    assert tables is not None
    nodes = {}
    for numbers, contents in tables[0][2]:
        for number, raw in zip(numbers.tolist(), contents, strict=True):
            raw = bytes(raw).ljust(4 + 51 * 24, b"\0")
            cells = int.from_bytes(raw[2:4], "big")
            ids = np.frombuffer(raw, ">i8", 51 * 3, 4)[: 3 * cells : 3]
            nodes[number] = ids, np.frombuffer(raw, ">f4", 51 * 6, 4).reshape(51, 6)[:cells, 2:]
    leaf_of = dict(zip(*(part.tolist() for part in tables[1][2][0]), strict=True))
    parent_of = {
        child: parent for level in tables[2][2] for child, parent in zip(*map(np.ndarray.tolist, level), strict=True)
    }
    leaves = sorted(set(leaf_of.values()))
    assert len(leaves) == -(-4000 // 51)
    boxes = {}
    for leaf in leaves:
        ids, box = nodes[leaf]
        assert [leaf_of[one] for one in ids.tolist()] == [leaf] * len(ids)
        rows = (ids - 5) // 2
        assert np.all(box[:, ::2] <= low[rows]) and np.all(box[:, 1::2] >= high[rows])
        assert np.abs(box[:, ::2] - low[rows]).max() < 2e-7 and np.abs(box[:, 1::2] - high[rows]).max() < 2e-7
        boxes[leaf] = np.r_[low[rows].min(axis=0), high[rows].max(axis=0)]
    for leaf, box in boxes.items():
        ids, above = nodes[parent_of[leaf]]
        here = above[ids.tolist().index(leaf)]
        assert np.abs(here[[0, 2, 1, 3]] - box).max() < 2e-7
    half = np.array([box[2:] - box[:2] for box in boxes.values()]).sum(axis=1)
    assert np.median(half) < 1.15 * 2.0 / np.sqrt(len(leaves))  # some reach from the end of a slice to the next
