"""The packed spatial index is sound for SQLite, holds every box, and finds what a loop over all boxes finds."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from osgeo import ogr

from hrsi.hrsi_engine.foundation.errors import OutputError
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage


def write_points(path: Path, place: np.ndarray) -> None:
    kind = "PointZ" if place.shape[1] == 3 else "Point"
    texts = np.array(["", "Ångström", "点", "\U0001f6f0" * 3000])
    fields = {
        "id": np.arange(len(place)), "text": texts[np.arange(len(place)) % 4], "flag": np.arange(len(place)) % 2 > 0,
        "number": np.where(np.arange(len(place)) % 5, np.pi * np.arange(len(place)), np.nan),
        "integer": 2**60 - np.arange(len(place)), "infinite": np.full(len(place), np.inf),
    }  # fmt: skip
    write_geopackage(str(path), [Layer("points", kind, 4326, place, fields)])


@pytest.mark.parametrize("count", [0, 1, 51, 52, 2601, 2602, 30_000])
def test_index_and_rows_are_sound_and_complete(tmp_path: Path, count: int) -> None:
    """Up to the capacity of one node, of two levels, and beyond; every seventh point has no position."""
    place = np.random.default_rng(4).uniform(-80.0, 80.0, (count, 3))
    place[::7] = np.nan
    write_points(tmp_path / "p.gpkg", place)
    with sqlite3.connect(tmp_path / "p.gpkg") as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert database.execute("SELECT rtreecheck('rtree_points_geom')").fetchone() == ("ok",)
        (found,) = database.execute("SELECT count(*) FROM rtree_points_geom").fetchone()
        assert found == np.isfinite(place[:, 0]).sum()
    dataset = ogr.Open(str(tmp_path / "p.gpkg"))
    table = dataset.GetLayer(0)
    box = (-20.0, -7.0, 35.0, 60.0)
    table.SetSpatialFilterRect(*box)
    inside = (place[:, 0] >= box[0]) & (place[:, 0] <= box[2]) & (place[:, 1] >= box[1]) & (place[:, 1] <= box[3])
    assert sorted(feature["id"] for feature in table) == np.flatnonzero(inside).tolist()
    table.SetSpatialFilter(None)
    for row, feature in enumerate(table):
        if row % 7:
            assert feature.GetGeometryRef().GetPoint() == tuple(place[row].tolist())
        else:
            assert feature.GetGeometryRef() is None
        assert feature["number"] == (np.pi * row if row % 5 else None) and feature["integer"] == 2**60 - row
        assert feature["flag"] == row % 2 and feature["infinite"] == np.inf
        assert feature["text"] == ("", "Ångström", "点", "\U0001f6f0" * 3000)[row % 4]


def test_nodes_are_nearly_square(tmp_path: Path) -> None:
    """Of points scattered evenly, leaves that share the area as squares have 2 / sqrt(leaves) of half a perimeter."""
    write_points(tmp_path / "p.gpkg", np.random.default_rng(5).random((4000, 2)))
    with sqlite3.connect(tmp_path / "p.gpkg") as database:
        leaves = database.execute(
            "SELECT data FROM rtree_points_geom_node WHERE nodeno IN (SELECT nodeno FROM rtree_points_geom_rowid)"
        ).fetchall()
    assert len(leaves) == -(-4000 // 51)
    half = []
    for (data,) in leaves:
        cells = int.from_bytes(data[2:4], "big")
        box = np.frombuffer(data, ">f4", 51 * 6, 4).reshape(51, 6)[:cells, 2:]
        half.append(np.ptp(box[:, 0]) + np.ptp(box[:, 2]))
    assert np.median(half) < 1.15 * 2.0 / np.sqrt(len(leaves))  # some reach from the end of a slice to the next


def test_keys_go_on_where_rows_ended(tmp_path: Path) -> None:
    write_points(tmp_path / "p.gpkg", np.zeros((5000, 2)))
    dataset = ogr.Open(str(tmp_path / "p.gpkg"), update=True)
    table = dataset.GetLayer(0)
    feature = ogr.Feature(table.GetLayerDefn())
    feature.SetGeometry(ogr.CreateGeometryFromWkt("POINT (9 9)"))
    table.CreateFeature(feature)
    assert feature.GetFID() == 5001
    table.SetSpatialFilterRect(8.0, 8.0, 10.0, 10.0)  # the index grows on
    assert [one.GetFID() for one in table] == [5001]


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, before[1]))  # writing on fails as on a full disk
    try:
        with pytest.raises(OutputError, match=r"points\.gpkg: cannot be written \(.*: check free space"):
            write_points(tmp_path / "points.gpkg", np.zeros((30_000, 3)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
