"""Columns of measurements beside their layer: the same as the layer to the bit, and unused once that was changed."""

import shutil
import sqlite3
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from osgeo import ogr

from hrsi.hrsi_engine.block.points import ImagePoints
from hrsi.hrsi_engine.ground.geodesy import WGS84_3D
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.point_files import read_image_points, read_points
from hrsi.hrsi_engine.io.point_files.kept_columns import COLUMNS_FILE, read_columns, write_columns
from hrsi.hrsi_engine.io.safety import content_marks
from hrsi.hrsi_engine.io.safety.array_files import write_arrays

LAYER = "block.gpkg|layername=image_points"


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result as `tie-points` writes it: 400 measurements of 200 points on three images."""
    made, rng = tmp_path_factory.mktemp("result"), np.random.default_rng(3)
    track = np.repeat(np.arange(200), 2)
    points = ImagePoints(
        np.char.add("T", track.astype(str)), np.array(["a", "b", "c"])[(track + np.arange(400) % 2) % 3],
        rng.uniform(0.0, 4e4, (400, 2)), rng.uniform(0.05, 0.2, 400), np.where(track % 2, "corner", "center"),
        np.where(track % 7, rng.uniform(0.0, 1.0, 400), np.nan),
    )  # fmt: skip
    columns = {
        "id": points.ids, "image": points.image_ids, "sample": points.xy[:, 0], "line": points.xy[:, 1],
        "sigma": points.sigma_px, "quality": points.quality, "kind": points.kind,
    }  # fmt: skip
    ground = rng.uniform(0.0, 1.0, (200, 3))
    layers = [Layer(name, "PointZ", WGS84_3D, ground[track], columns) for name in ("tie_points", "image_points")]
    write_geopackage(str(made / "block.gpkg"), layers, {})
    write_columns(str(made), points)
    return made


@pytest.fixture
def folder(result: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    shutil.copytree(result, tmp_path / "result")
    return tmp_path / "result"


def is_kept(folder: Path) -> bool:
    return read_columns(str(folder / "block.gpkg"), "image_points", ["a", "b", "c"]) is not None


def test_chosen_fields_are_those_of_the_layer(folder: Path) -> None:
    assert is_kept(folder)
    image = read_image_points(f"{folder}/{LAYER}|columns=id=fid", image_ids=["a", "b", "c"]).image
    assert image.ids.tolist() == [str(number) for number in range(1, 401)]


def test_they_are_what_the_layer_holds(folder: Path) -> None:
    kept, layer = read_image_points(f"{folder}/{LAYER}", image_ids=["b"]), read_points(f"{folder}/{LAYER}")
    assert kept.ground is None and layer.ground is not None  # so they were read, not the layer
    assert kept.image is not None and layer.image is not None
    for name in ("ids", "image_ids", "kind"):
        assert np.asarray(getattr(kept.image, name)).tolist() == np.asarray(getattr(layer.image, name)).tolist()
    for name in ("xy", "sigma_px", "quality"):
        np.testing.assert_array_equal(getattr(kept.image, name), getattr(layer.image, name))
    assert kept.image.source == layer.image.source


def test_another_layer_and_a_single_image_are_not_taken_from_them(folder: Path) -> None:
    assert read_columns(str(folder / "block.gpkg"), "tie_points") is None
    assert not is_kept(folder.parent)


def test_a_copy_of_the_folder_keeps_them(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "copy")
    assert is_kept(tmp_path / "copy")


@pytest.mark.parametrize("sampled", [False, True])
def test_an_edit_of_the_layer_is_noticed(folder: Path, sampled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of large files only samples are read: the count of changes in SQLite's first bytes is among them."""
    if sampled:
        sampling = replace(content_marks.CONTENT_SAMPLING, whole_bytes=0, blocks=1)
        monkeypatch.setattr(content_marks, "CONTENT_SAMPLING", sampling)
        points = read_points(f"{folder}/{LAYER}").image
        assert points is not None
        write_columns(str(folder), points)
    assert is_kept(folder)
    before = (folder / "block.gpkg").read_bytes()
    source = ogr.Open(str(folder / "block.gpkg"), update=1)
    feature = source.GetLayerByName("image_points").GetFeature(123)
    feature["sample"] += 1.0
    source.GetLayerByName("image_points").SetFeature(feature)
    edited = feature["sample"]
    del feature, source
    assert len((folder / "block.gpkg").read_bytes()) == len(before)  # so its size does not tell
    assert not is_kept(folder)
    found = read_image_points(f"{folder}/{LAYER}").image
    assert found is not None and found.xy[122, 0] == edited


def test_edits_that_are_still_in_the_journal_are_noticed(folder: Path) -> None:
    """QGIS writes ahead: while a project has the layer open, edits lie in a file beside it."""
    connection = sqlite3.connect(folder / "block.gpkg")
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA user_version=1")  # any change; the layer's triggers are GDAL's
    connection.commit()
    assert (folder / "block.gpkg-wal").stat().st_size > 0
    assert not is_kept(folder)
    connection.close()
    assert not is_kept(folder)


def test_those_of_another_result_do_not_count(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    points = read_points(f"{folder}/{LAYER}").image
    shutil.copy(folder / COLUMNS_FILE, other)
    columns = {"id": points.ids, "image": np.asarray(points.image_ids), "sample": points.xy[:, 0] + 1.0,
               "line": points.xy[:, 1]}  # fmt: skip
    write_geopackage(
        str(other / "block.gpkg"), [Layer("image_points", "PointZ", WGS84_3D, np.zeros((len(points), 3)), columns)], {}
    )
    assert not is_kept(other)


@pytest.mark.parametrize("seed", range(40))
def test_damaged_columns_are_passed_over(folder: Path, seed: int) -> None:
    """What is damaged is not taken: bits, pieces cut off, arrays of other types, other lengths and numbers."""
    file, rng = folder / COLUMNS_FILE, np.random.default_rng(seed)
    good = read_columns(str(folder / "block.gpkg"), "image_points")
    if seed < 20:
        data = bytearray(file.read_bytes())
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        file.write_bytes(data[: int(rng.integers(len(data)))] if seed < 10 else data)
        found = read_columns(str(folder / "block.gpkg"), "image_points")
        if found is not None:  # a bit that says nothing, as one of a date
            assert good is not None and good.image is not None and found.image is not None
            np.testing.assert_array_equal(found.image.xy, good.image.xy)
        return
    with np.load(file) as arrays:
        columns = {name: arrays[name] for name in arrays.files}
    name = sorted(columns)[seed % len(columns)]
    wrong = {
        0: columns[name][:-1] if columns[name].ndim else np.array("0"),
        1: columns[name].astype("S") if columns[name].dtype.kind == "U" else columns[name].astype(np.complex128),
    }[seed % 2]
    np.savez(file, **{**columns, name: wrong})
    assert not is_kept(folder)


def test_a_compressed_file_that_unfolds_is_not_read(folder: Path) -> None:
    with zipfile.ZipFile(folder / COLUMNS_FILE) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(folder / COLUMNS_FILE, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
    assert not is_kept(folder)


def test_the_same_arrays_are_the_same_bytes_at_any_time(tmp_path, monkeypatch):
    arrays = {"first": np.arange(6.0).reshape(2, 3), "names": np.array(["a", "bc"]), "one": np.float64(3.0)}
    for name, when in (("a.npz", 1e9), ("b.npz", 1.7e9)):
        monkeypatch.setattr("time.time", lambda when=when: when)
        write_arrays(str(tmp_path / name), arrays)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as read:
        assert all(np.array_equal(read[name], array) for name, array in arrays.items())
