"""`tie-points` and `triangulate` from files to files: layers, resuming, virtual file systems, what goes where."""

import csv
import json
import os
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import rendered_blocks as scenes
from long_tests import mark_beyond
from osgeo import gdal, ogr

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.io.point_files import ogr_layer, read_points
from hrsi.hrsi_engine.io.point_files.kept_columns import COLUMNS_FILE
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.simulated_files import write_image
from hrsi.hrsi_engine.laboratory.simulation.render import render_window
from hrsi.hrsi_engine.laboratory.simulation.surface import locate_on_surface
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.block_steps.tie_search import UNFINISHED
from hrsi.processing_algorithms.command_line.cli import main

FILES = ["block.gpkg", "report.json", "tie_points.csv", "tie_points.npz"]


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> list[str]:
    """Two images of 401 px on disk."""
    folder = tmp_path_factory.mktemp("pair")
    return [image.path for image in scenes.written(scenes.triplet(half=200.0)[:2], folder)]


@pytest.fixture(scope="module")
def result(pair, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("result") / "ties"
    run("tie-points", images=pair, output_dir=str(folder), csv=True)
    return folder


def test_files_of_a_result(result, pair):
    assert sorted(path.name for path in result.iterdir()) == FILES
    report = json.loads((result / "report.json").read_text())
    dataset = ogr.Open(str(result / "block.gpkg"))
    points, measured = dataset.GetLayer("tie_points"), dataset.GetLayer("image_points")
    assert points.GetFeatureCount() == report["ties"]["points"] > 80
    assert measured.GetFeatureCount() == report["ties"]["observations"] == 2 * report["ties"]["points"]
    row = measured.GetNextFeature().items()
    assert set(row) == {"id", "image", "sample", "line", "sigma", "quality", "kind"}
    assert row["kind"] and 0.0 < row["quality"] <= 1.0 and 0.0 < row["sigma"] < 1.0
    assert {entry["path"] for entry in report["images"].values()} == set(pair)
    assert all(image["cells"] > 30 for image in report["images"].values())


def test_layer_and_table_hold_the_same(result):
    from_layer = read_points(str(result / "block.gpkg|layername=image_points"), image_ids=["view0", "view1"]).image
    from_table = read_points(str(result / "tie_points.csv"), image_ids=["view0", "view1"]).image
    np.testing.assert_array_equal(from_layer.ids, from_table.ids)
    np.testing.assert_array_equal(from_layer.xy, from_table.xy)
    np.testing.assert_array_equal(from_layer.sigma_px, from_table.sigma_px)


@pytest.mark.parametrize("algorithm", ["adjust", "triangulate"])
def test_result_goes_into_the_adjustment(algorithm, result, pair, tmp_path):
    report = run(algorithm, images=pair, tie_points=str(result / "block.gpkg"), output_dir=str(tmp_path), write="none")
    assert report["ties"]["points"] > 80
    assert report["ties"]["rmse_px"] < 0.1 < report["ties"]["before_rmse_px"]


def test_folder_is_taken_for_its_layers_as_they_are_now(result, pair, tmp_path, monkeypatch):
    """Quick columns and layer give the same result to the bit; a point that was mended in the layer counts."""
    folder = Path(shutil.copytree(result, tmp_path / "ties"))
    layers_read, read_layer = [], ogr_layer._read_layer
    monkeypatch.setattr(ogr_layer, "_read_layer", lambda *told: layers_read.append(told) or read_layer(*told))

    def adjusted(name: str) -> dict:
        report = run("adjust", images=pair, tie_points=str(folder), output_dir=str(tmp_path / name), write="none")
        return {key: report[key] for key in ("ties", "observations", "sigma0", "images")}

    quick = adjusted("quick")
    assert not layers_read
    (folder / COLUMNS_FILE).rename(tmp_path / COLUMNS_FILE)
    assert adjusted("layer") == quick and layers_read
    (tmp_path / COLUMNS_FILE).rename(folder / COLUMNS_FILE)
    source = ogr.Open(str(folder / "block.gpkg"), update=1)
    layer = source.GetLayerByName("image_points")
    layer.DeleteFeature(layer.GetNextFeature().GetFID())
    del layer, source
    assert adjusted("mended")["observations"] < quick["observations"]


def test_automatic_tie_points_are_the_same(result, pair, tmp_path):
    report = run("triangulate", images=pair, output_dir=str(tmp_path), write="none", scheduler=None, hold_out=0.0)
    from_file = json.loads((result / "report.json").read_text())["ties"]
    assert report["ties"]["points"] == from_file["points"]
    assert not (tmp_path / UNFINISHED).exists()


def test_cancelled_run_leaves_only_what_is_finished(pair, tmp_path):
    with pytest.raises(Cancelled):
        run("tie-points", images=pair, output_dir=str(tmp_path / "ties"), progress=lambda fraction, _: fraction < 0.25)
    assert [path.name for path in (tmp_path / "ties").iterdir()] == [UNFINISHED]


def test_work_dir_serves_later_runs(pair, tmp_path):
    options = {"images": pair, "work_dir": str(tmp_path / "work"), "cells": 4}
    run("tie-points", output_dir=str(tmp_path / "a"), **options)
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "work").iterdir()}
    run("tie-points", output_dir=str(tmp_path / "b"), **options)
    assert {path.name: path.stat().st_mtime_ns for path in (tmp_path / "work").iterdir()} == kept
    os.utime(pair[0])  # the same content at another time
    run("tie-points", output_dir=str(tmp_path / "c"), **options)
    assert {path.name: path.stat().st_mtime_ns for path in (tmp_path / "work").iterdir()} == kept


def test_virtual_file_systems(pair, result, tmp_path):
    """Images in a zip file, results in GDAL's memory, and on to the adjustment."""
    archive = tmp_path / "images.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in pair:
            file.write(path, os.path.basename(path))
    images = [f"/vsizip/{archive}/{os.path.basename(path)}" for path in pair]
    report = run("tie-points", images=images, output_dir="/vsimem/ties", csv=True)
    assert report["ties"] == json.loads((result / "report.json").read_text())["ties"]
    assert sorted(gdal.ReadDir("/vsimem/ties")) == FILES
    adjusted = run(
        "adjust", images=images, tie_points="/vsimem/ties/block.gpkg", output_dir="/vsimem/adjusted", write="none"
    )
    assert adjusted["ties"]["rmse_px"] < 0.1
    with pytest.raises(InputError, match="already contains a result"):
        run("tie-points", images=images, output_dir="/vsimem/ties")
    assert not Path("/vsimem").exists()


def test_virtual_file_system_that_takes_no_files(pair, tmp_path):
    with pytest.raises(Exception, match="cannot be written"):
        run("tie-points", images=pair, output_dir="/vsicurl/http://127.0.0.1:9/ties", cells=2)


@pytest.mark.rendered
def test_thousands_of_ties_do_not_outvote_the_gcps(tmp_path):
    """A shift cannot follow the drift of the vendor's attitude; GCPs of 0.1 m must hold the block all the same."""
    block = tmp_path / "block"
    run("simulate", images=3, along=["-12", "0", "12"], size=700, gcps=6, checks=12, ties=0, output_dir=str(block))
    report = run(
        "triangulate", images=[str(block / f"image_{k}.tif") for k in (1, 2, 3)], gcps=str(block / "ground_points.csv"),
        image_points=str(block / "image_points.csv"), height_datum="ellipsoidal", write="none",
        output_dir=str(tmp_path / "result"),
    )  # fmt: skip
    assert report["ties"]["points"] > 500
    assert report["control"]["rmse_east_m"] < 0.2  # twice the sigma of the survey
    assert np.hypot(report["check"]["rmse_east_m"], report["check"]["rmse_north_m"]) < 0.5  # 0.3 px of 0.7 m, twice
    predicted = report["check"]["predicted"]
    for axis in ("east", "north", "height"):  # 12 points: 20 %; the block's own error, of 6 GCPs, is common to all
        assert 0.5 < report["check"][f"rmse_{axis}_m"] / predicted[f"rmse_{axis}_m"] < 2.0


def test_changed_pixels_are_matched_again_though_size_and_time_are_the_same(pair, tmp_path):
    """Parts of an image whose pixels were changed and whose time was put back are not taken from the work directory."""
    copies = [tmp_path / Path(path).name for path in pair]
    for source, copy in zip(pair, copies, strict=True):
        shutil.copyfile(source, copy)
    options = {"images": list(map(str, copies)), "work_dir": str(tmp_path / "work"), "cells": 4}
    run("tie-points", output_dir=str(tmp_path / "a"), **options)
    kept = {path.name for path in (tmp_path / "work").iterdir()}
    status = copies[0].stat()
    dataset = gdal.Open(str(copies[0]), gdal.GA_Update)
    pixels = dataset.GetRasterBand(1).ReadAsArray()
    pixels[5, 5] += 1
    dataset.GetRasterBand(1).WriteArray(pixels)
    del dataset
    os.utime(copies[0], ns=(status.st_atime_ns, status.st_mtime_ns))
    run("tie-points", output_dir=str(tmp_path / "b"), **options)
    made = {path.name for path in (tmp_path / "work").iterdir()} - kept
    assert {name.partition("-")[0] for name in made} == {"pair", "windows"}


@pytest.mark.parametrize("trap", mark_beyond(0, "rendered", ["negative", "cliffs"]))
def test_a_negative_and_cliffs_give_no_false_tie_points(tmp_path: Path, trap: str) -> None:
    """Through the command line, against the cameras and the surface that made the images."""
    simulated = lab.simulate_block(
        lab.SceneSpec(seed=3, cliff_m=60.0 if trap == "cliffs" else 0.0),
        lab.make_along_track_views(lab.SENSORS["pleiades"], 2, (500, 500)), lab.PointCounts(0, 0, 10), lab.Noise(),
    )  # fmt: skip
    files = []
    for index, image in enumerate(simulated.block.images):
        grey = render_window(simulated, image.id, 0, 0, 500, 500)
        if index and trap == "negative":
            grey = grey.max() + grey.min() - grey
        files.append(tmp_path / f"{image.id}.tif")
        write_image(str(files[-1]), [ArrayRaster(grey)], image.rpc)
    assert main(["tie-points", *map(str, files), "--csv", "--output-dir", str(tmp_path / "out"), "--quiet"]) == 0
    with open(tmp_path / "out" / "tie_points.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    seen: list[dict[str, list[float]]] = [
        {row["id"]: [float(row["sample"]), float(row["line"])] for row in rows if row["image"] == image.id}
        for image in simulated.block.images
    ]
    names = sorted(set(seen[0]) & set(seen[1]))
    assert len(names) > 500
    first, second = (np.array([places[name] for name in names]) for places in seen)
    cameras, terrain = simulated.truth.cameras, simulated.scene.terrain
    true = cameras[1].ground_to_image(locate_on_surface(cameras[0], terrain, first))
    assert np.linalg.norm(true - second, axis=1).max() < 3.0
