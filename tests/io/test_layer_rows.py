"""Rows replaced inside a GeoPackage: OGR reads the new ones, finds them by its index, and the other layers stay."""

import os
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal, ogr

from hrsi.hrsi_engine.foundation.errors import InputError, OutputError
from hrsi.hrsi_engine.io.geopackage.layer_tables import layer_names, replace_layers, text_columns
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.point_files import read_points


def points(count: int, seed: int = 1, **more: np.ndarray) -> Layer:
    random = np.random.default_rng(seed)
    place = np.column_stack([random.uniform(5.0, 6.0, count), random.uniform(43.0, 44.0, count), np.zeros(count)])
    fields = {"id": np.array([f"P{k}" for k in range(count)]), "role": np.full(count, "gcp"), **more}
    return Layer("ground_points", "PointZ", 4326, place, fields)


def other() -> Layer:
    return Layer("mine", "Point", 4326, np.array([[5.5, 43.5]]), {"note": np.array(["keep me"])})


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = str(tmp_path / "block.gpkg")
    write_geopackage(path, [points(300), other()])
    return path


def found_within(path: str, layer: str, box: tuple[float, float, float, float]) -> int:
    dataset = ogr.Open(path)
    table = dataset.GetLayerByName(layer)
    table.SetSpatialFilterRect(box[0], box[2], box[1], box[3])
    return sum(1 for _ in table)


@pytest.mark.parametrize("count", [0, 1, 40, 2000])
def test_rows_index_and_extent(file: str, count: int) -> None:
    new = points(count, seed=2, sigma_xy=np.full(count, 0.3))
    replace_layers(file, [new])
    dataset = ogr.Open(file)
    table = dataset.GetLayerByName("ground_points")
    assert table.GetFeatureCount() == count
    assert dataset.GetLayerByName("mine").GetFeature(1)["note"] == "keep me"
    if count:
        assert table.GetFeature(1)["sigma_xy"] == 0.3  # a field that the layer had not
        low, high = new.coordinates.min(axis=0), new.coordinates.max(axis=0)
        assert table.GetExtent() == pytest.approx((low[0], high[0], low[1], high[1]))
    box = (5.2, 5.5, 43.1, 43.6)
    inside = (new.coordinates[:, 0] > box[0]) & (new.coordinates[:, 0] < box[1])
    inside &= (new.coordinates[:, 1] > box[2]) & (new.coordinates[:, 1] < box[3])
    assert found_within(file, "ground_points", box) == inside.sum()
    with sqlite3.connect(file) as database:
        assert database.execute("SELECT rtreecheck('rtree_ground_points_geom')").fetchone()[0] == "ok"
        assert database.execute("PRAGMA integrity_check").fetchone()[0] == "ok"


def test_ogr_can_edit_it_afterwards(file: str) -> None:
    """The triggers that keep count and index are back."""
    replace_layers(file, [points(20)])
    dataset = gdal.OpenEx(file, gdal.OF_VECTOR | gdal.OF_UPDATE)
    table = dataset.GetLayerByName("ground_points")
    feature = ogr.Feature(table.GetLayerDefn())
    feature.SetGeometry(ogr.CreateGeometryFromWkt("POINT Z (9.5 43.5 0)"))
    table.CreateFeature(feature)
    del table, dataset
    assert found_within(file, "ground_points", (9.0, 10.0, 43.0, 44.0)) == 1


def test_new_file_new_layer_and_styles(tmp_path: Path) -> None:
    path = str(tmp_path / "new.gpkg")
    replace_layers(path, [other()])
    replace_layers(path, [points(5)])
    replace_layers(path, [points(6)])
    assert layer_names(path)["ground_points"] == 6
    with sqlite3.connect(path) as database:
        styles = database.execute("SELECT f_table_name FROM layer_styles").fetchall()
    assert styles == [("ground_points",)]  # once


def test_nothing_changes_where_it_fails(file: str) -> None:
    broken = points(3, wrong=np.array([1, 2, 2**70], dtype=object))  # no number of SQLite
    before = layer_names(file)
    with pytest.raises((OutputError, OverflowError)):
        replace_layers(file, [broken])
    assert layer_names(file) == before
    assert found_within(file, "ground_points", (4.0, 7.0, 42.0, 45.0)) == 300


def test_locked_by_another_program(file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hrsi.hrsi_engine.io.geopackage.layer_tables._WAIT_S", 0.1)
    with sqlite3.connect(file, isolation_level=None) as database:
        database.execute("BEGIN EXCLUSIVE")
        with pytest.raises(OutputError, match=os.path.basename(file)):
            replace_layers(file, [points(3)])


def test_text_columns_name_what_is_missing(file: str) -> None:
    assert text_columns(file, "mine", ("note",)) == {"note": ["keep me"]}
    with pytest.raises(InputError, match="no field 'path'"):
        text_columns(file, "mine", ("path",))


def test_surveyed_position_counts_not_the_adjusted_one(tmp_path: Path) -> None:
    """A layer of results holds both; read as ground points it must not give its own adjustment back."""
    path = str(tmp_path / "block.gpkg")
    survey = {
        "survey_lon": np.array([5.1, np.nan]), "survey_lat": np.array([43.2, np.nan]),
        "survey_height": np.array([77.5, np.nan]),
    }  # fmt: skip
    write_geopackage(path, [points(2, **survey)])
    found = read_points(
        f"{path}|layername=ground_points", height_datum="egm96"
    )  # of other layers: these are ellipsoidal
    assert found.ground.ids.tolist() == ["P0"]
    assert found.ground.ground.tolist() == [[5.1, 43.2, 77.5]]
