"""The GeoPackage: what OGR and SQLite read is what was written, with indices and styles in order.

That QGIS draws the styles is tested in ``tests/qgis``; here their XML and their arrow scale.
"""

import os
import re
import sqlite3
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal, ogr
from shapely.geometry import Polygon

from hrsi.hrsi_engine.foundation.errors import Cancelled, OutputError
from hrsi.hrsi_engine.ground.map_crs import map_epsg, project_to_map
from hrsi.hrsi_engine.io.geopackage.layer_styles import GROUND_ARROW_MM, STYLES, Style, default_style
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.output_dir import stage_folder
from hrsi.hrsi_engine.io.point_files import read_points

RING = np.array([[147.18, -42.78], [147.38, -42.77], [147.40, -42.97], [147.19, -42.97]])


def find_residual_fields(count: int, seed: int = 5) -> dict[str, np.ndarray]:
    """Return half ground rows, half image rows, with the report's field names."""
    random = np.random.default_rng(seed)
    ground = np.arange(count) < count // 2
    numbers = {
        name: np.where(ground == name.endswith("_m"), random.normal(size=count), np.nan)
        for name in (
            "residual_sample_px", "residual_line_px", "residual_east_m", "residual_north_m", "residual_height_m",
        )
    }  # fmt: skip
    return {
        "id": np.array([f"P{k}" for k in range(count)]),
        "role": np.where(np.arange(count) % 3 == 0, "gcp", "check"),
        "image": np.where(ground, "", "a<b&"),
        "level": np.where(ground, "ground", "image"),
        "flag": np.where(np.arange(count) == 1, "outlier", "ok"),
        "rays": np.arange(count),
        "used": np.arange(count) % 2 == 0,
        **numbers,
    }


def positions(count: int, seed: int = 6) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.column_stack(
        [random.uniform(147.2, 147.4, count), random.uniform(-43.0, -42.8, count), random.uniform(0.0, 300.0, count)]
    )


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result as `triangulate` writes it, small."""
    path = tmp_path_factory.mktemp("layers") / "block.gpkg"
    place, fields = positions(400), find_residual_fields(400)
    utm = map_epsg(147.3, -42.9)
    images = {"id": np.array(["img_01", "img_02"])}
    empty = {name: column[:0] for name, column in fields.items()}
    write_geopackage(str(path), [
        Layer("images", "Polygon", 4326, [Polygon(RING), Polygon(RING + 0.1)], images),
        Layer("residuals_wgs84", "PointZ", 4326, place, fields),
        Layer("residuals_utm", "PointZ", utm, np.column_stack([project_to_map(place, utm), place[:, 2]]), fields),
        Layer("flat", "Point", 4326, place[:, :2], {"id": fields["id"]}),
        Layer("table", "None", 4326, (), {"id": fields["id"], "value": fields["residual_east_m"]}),
        Layer("image_points", "PointZ", 4326, np.empty((0, 3)), empty),
    ])  # fmt: skip
    return path


def read(path: Path, layer: str) -> tuple[np.ndarray, dict[str, list]]:
    """Return coordinates and fields of a layer as OGR reads them."""
    dataset = gdal.OpenEx(str(path), gdal.OF_VECTOR)
    table = dataset.GetLayerByName(layer)
    names = [table.GetLayerDefn().GetFieldDefn(k).GetName() for k in range(table.GetLayerDefn().GetFieldCount())]
    place, fields = [], {name: [] for name in names}
    for feature in table:
        geometry = feature.GetGeometryRef()
        place.append(geometry.GetPoint(0) if geometry is not None else None)
        for name in names:
            fields[name].append(feature.GetField(name))
    return np.array(place, dtype=float), fields


@pytest.mark.parametrize("layer", ["residuals_wgs84", "residuals_utm"])
def test_ogr_reads_what_was_written(block: Path, layer: str) -> None:
    place, fields = read(block, layer)
    wanted = positions(400)
    if layer == "residuals_utm":
        wanted = np.column_stack([project_to_map(wanted, 32755), wanted[:, 2]])
    np.testing.assert_array_equal(place, wanted)
    for name, column in find_residual_fields(400).items():
        expected = [None if isinstance(value, float) and np.isnan(value) else value for value in column.tolist()]
        assert fields[name] == expected, name


def test_extent_count_crs_and_index(block: Path) -> None:
    dataset = gdal.OpenEx(str(block), gdal.OF_VECTOR)
    layer = dataset.GetLayerByName("residuals_wgs84")
    place = positions(400)
    assert layer.GetFeatureCount() == 400
    extent = (place[:, 0].min(), place[:, 0].max(), place[:, 1].min(), place[:, 1].max())
    assert layer.GetExtent() == pytest.approx(extent, abs=1e-9)  # OGR reads it with 15 digits
    assert layer.GetSpatialRef().GetAuthorityCode(None) == "4326"
    assert dataset.GetLayerByName("residuals_utm").GetSpatialRef().GetAuthorityCode(None) == "32755"
    assert layer.TestCapability(ogr.OLCFastSpatialFilter)
    layer.SetSpatialFilterRect(147.25, -42.95, 147.30, -42.90)
    inside = (place[:, 0] >= 147.25) & (place[:, 0] <= 147.30) & (place[:, 1] >= -42.95) & (place[:, 1] <= -42.90)
    assert layer.GetFeatureCount() == inside.sum() > 10
    assert dataset.GetLayerByName("image_points").GetFeatureCount() == 0
    assert dataset.GetLayerByName("table").GetGeomType() == ogr.wkbNone


def test_polygons_are_closed_once(block: Path) -> None:
    dataset = gdal.OpenEx(str(block), gdal.OF_VECTOR)
    for feature, shift in zip(dataset.GetLayerByName("images"), (0.0, 0.1), strict=True):
        ring = feature.GetGeometryRef().GetGeometryRef(0)
        assert ring.GetPointCount() == 5
        np.testing.assert_array_equal(np.array(ring.GetPoints())[:, :2], np.vstack([RING, RING[:1]]) + shift)
        assert feature.GetGeometryRef().IsValid()


def test_the_file_is_sound_and_can_be_edited(block: Path, tmp_path: Path) -> None:
    """SQLite's own checks; and OGR can add a feature, which needs the triggers that were taken away."""
    copy = tmp_path / "copy.gpkg"
    copy.write_bytes(block.read_bytes())
    dataset = gdal.OpenEx(str(copy), gdal.OF_VECTOR | gdal.OF_UPDATE)
    layer = dataset.GetLayerByName("residuals_wgs84")
    feature = ogr.Feature(layer.GetLayerDefn())
    feature.SetGeometry(ogr.CreateGeometryFromWkt("POINT Z (10 20 30)"))
    layer.CreateFeature(feature)
    del layer, feature, dataset
    with sqlite3.connect(copy) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert database.execute("PRAGMA foreign_key_check").fetchall() == []
        assert database.execute("SELECT rtreecheck('rtree_residuals_wgs84_geom')").fetchone() == ("ok",)
        counts = dict(database.execute("SELECT table_name, feature_count FROM gpkg_ogr_contents"))
    assert counts["residuals_wgs84"] == 401


def test_points_without_a_position_have_no_geometry(tmp_path: Path) -> None:
    path = tmp_path / "p.gpkg"
    place = np.array([[1.0, 2.0, 3.0], [np.nan, np.nan, np.nan]])
    write_geopackage(str(path), [Layer("p", "PointZ", 4326, place, {"id": np.array(["a", "b"])})])
    dataset = gdal.OpenEx(str(path), gdal.OF_VECTOR)
    assert [feature.GetGeometryRef() is None for feature in dataset.GetLayer("p")] == [False, True]
    assert dataset.GetLayer("p").GetExtent() == (1.0, 1.0, 2.0, 2.0)


def test_a_written_layer_is_a_point_file(block: Path) -> None:
    fields = {"id": np.array(["a", "b"]), "role": np.array(["gcp", "check"]), "sigma_xy": np.array([0.1, np.nan])}
    path = block.parent / "gcps.gpkg"
    write_geopackage(str(path), [Layer("gcps", "PointZ", 4979, positions(2), fields)])
    tables = read_points(f"{path}|layername=gcps")
    assert tables.warnings == ()
    np.testing.assert_allclose(tables.ground.ground, positions(2), rtol=0.0, atol=1e-12)


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "block.gpkg"
    layers = [Layer("p", "PointZ", 4326, positions(10), {"id": np.arange(10)})]
    write_geopackage(str(path), layers)
    before = path.read_bytes()
    with pytest.raises(Cancelled):
        write_geopackage(str(path), layers, progress=lambda fraction, message="": False)
    with pytest.raises(OutputError, match="differ in length"):
        write_geopackage(str(path), [Layer("p", "PointZ", 4326, positions(9), {"id": np.arange(10)})])
    with pytest.raises(OutputError, match="cannot be written"):
        write_geopackage(str(tmp_path / "none" / "b.gpkg"), layers)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["block.gpkg"]


@pytest.mark.parametrize("in_staged_folder", [False, True])
def test_the_log_of_a_replaced_file_is_not_played_into_the_new_one(tmp_path: Path, in_staged_folder: bool) -> None:
    """QGIS holds GeoPackages open with a write-ahead log beside them."""
    path = tmp_path / "block.gpkg"
    write_geopackage(str(path), [Layer("p", "Point", 4326, positions(3)[:, :2], {"id": np.arange(3)})])
    viewer = sqlite3.connect(path)
    viewer.execute("PRAGMA journal_mode = WAL")
    viewer.execute("CREATE TABLE extra (a)")
    viewer.commit()
    assert (tmp_path / "block.gpkg-wal").stat().st_size > 0
    layers = [Layer("q", "Point", 4326, positions(5)[:, :2], {"id": np.arange(5)})]
    if in_staged_folder:
        with stage_folder(str(tmp_path), [], overwrite=True) as folder:
            write_geopackage(str(folder / path.name), layers)
    else:
        write_geopackage(str(path), layers)
    dataset = gdal.OpenEx(str(path), gdal.OF_VECTOR)
    assert [dataset.GetLayer(k).GetName() for k in range(dataset.GetLayerCount())] == ["q"]
    assert dataset.GetLayer(0).GetFeatureCount() == 5
    viewer.close()


def test_styles_are_stored_as_defaults(block: Path) -> None:
    with sqlite3.connect(block) as database:
        rows = database.execute(
            "SELECT f_table_name, f_geometry_column, useAsDefault, styleQML FROM layer_styles"
        ).fetchall()
    assert {row[0] for row in rows} == {"images", "residuals_wgs84", "residuals_utm", "image_points"}
    for _, column, default, qml in rows:
        assert (column, default) == ("geom", 1)
        assert ET.fromstring(qml).tag == "qgis"


def test_the_typical_arrow_has_the_typical_length() -> None:
    fields = find_residual_fields(400)
    good = (fields["level"] == "ground") & (fields["flag"] != "outlier")
    typical = np.percentile(np.hypot(fields["residual_east_m"], fields["residual_north_m"])[good], 90.0)
    style = ET.fromstring(default_style("residuals_utm", fields, 1e4).qml)
    lengths = [option.get("value", "") for option in style.iter("Option") if option.get("name") == "expression"]
    scales = {float(text.split(" * sqrt")[0]) for text in lengths if re.match(r"[\d.]+ \* sqrt\(.*east", text)}
    assert len(scales) == 1
    assert scales.pop() * typical == pytest.approx(GROUND_ARROW_MM, rel=1e-5)
    labels = [rule.get("label") or "" for rule in style.iter("rule")]
    assert any(f"{GROUND_ARROW_MM:g} mm = {typical:.2g} m" in label for label in labels)


@pytest.mark.parametrize("name", STYLES)
def test_every_style_is_made_without_residuals_too(name: str) -> None:
    shifts = {"state": np.array(["before", "after"] * 2), "east_m": np.ones(4), "north_m": np.full(4, np.nan)}
    full = find_residual_fields(4) | shifts
    empty = {field: column[:0] for field, column in full.items()}
    for fields in (empty, full):
        style = STYLES[name](fields, 1e4)
        assert isinstance(style, Style)
        ET.fromstring(style.qml)


def test_many_points_are_thinned_by_scale(tmp_path: Path) -> None:
    """A map of all of the block, or a closer one, shows between 150 and 1500 of its points, if it has so many."""
    width_m, map_m = 8000.0, 0.25
    for count, rules in ((100, 1), (3000, 2), (30_000, 3)):
        qml = default_style("ground_points", {"role": np.full(count, "tie")}, width_m).qml
        ties = [rule for rule in ET.fromstring(qml).iter("rule") if "'tie'" in (rule.get("filter") or "")]
        for closer in (1.0, 2.0, 5.0, 20.0):
            scale = width_m / map_m / closer
            (every,) = [
                10**power
                for power, rule in enumerate(ties)
                if float(rule.get("scalemindenom") or 0) <= scale < float(rule.get("scalemaxdenom") or np.inf)
            ]
            on_map = count / closer**2
            assert on_map / every <= 1500
            assert every == 1 or on_map / every >= 149
        limits = [(rule.get("scalemindenom"), rule.get("scalemaxdenom")) for rule in ties]
        assert len(ties) == rules
        assert limits[0][0] is None and limits[-1][1] is None
        assert all(near[1] == far[0] for near, far in pairwise(limits))  # no gap, no overlap


def test_layers_of_the_same_name_without_residuals_have_no_style() -> None:
    for name in ("image_points", "ground_points"):
        assert default_style(name, {"id": np.array(["A"])}, 1e4) is None


def test_fields_are_described_in_a_file_without_geometries(tmp_path: Path) -> None:
    """Such a file has no R-tree, and GDAL makes no table of extensions in it."""
    path = str(tmp_path / "table.gpkg")
    write_geopackage(path, [Layer("residuals", "None", 4326, np.empty((0, 2)), {"id": np.array(["A"])})])
    with sqlite3.connect(path) as database:
        assert database.execute("SELECT column_name FROM gpkg_data_columns").fetchall() == [("id",)]
        assert database.execute("SELECT DISTINCT extension_name FROM gpkg_extensions").fetchall() == [("gpkg_schema",)]
    assert ogr.Open(path).GetLayerByName("residuals").GetFeatureCount() == 1
