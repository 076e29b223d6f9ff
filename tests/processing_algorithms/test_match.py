"""`match`: from two files to layers, table, page and report."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from gdal_files import write_raster
from independent_formulas import layer
from network_scenes import TruePair, true_pair
from osgeo import ogr

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main


@pytest.fixture(scope="module")
def pair() -> TruePair:
    return true_pair("grass", 300, 45.0)


@pytest.fixture(scope="module")
def files(pair: TruePair, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Both views without RPC; the second one has no data in its first 40 lines."""
    folder = tmp_path_factory.mktemp("pair")
    second = pair.second.grey.copy()
    second[:40] = 0
    return [
        write_raster(folder / "first.tif", pair.first.grey.astype(np.uint16)),
        write_raster(folder / "second.tif", second.astype(np.uint16), nodata=0),
    ]


def test_results_are_written(files: list[str], pair: TruePair, tmp_path: Path):
    report = run("match", images=files, output_dir=tmp_path / "out", threads=1)
    assert report["status"] == "found"
    assert report["rotation_deg"] == pytest.approx(45.0, abs=0.3)
    assert report["scale"] == pytest.approx(1.0, abs=0.01)
    rows = layer(tmp_path / "out" / "match.gpkg", "correspondences")
    assert len(rows) == report["correspondences"] >= 150
    first, second = (np.array([[row[f"{n}_sample"], row[f"{n}_line"]] for row in rows]) for n in ("first", "second"))
    assert np.hypot(*(second - pair.carried(first)).T).max() < 1.5
    assert second[:, 1].min() >= 40
    assert all(0.0 < row["sigma"] < 0.5 and 0.7 < row["quality"] <= 1.0 and row["kind"] for row in rows)
    ids = {row["id"] for row in rows}
    assert {row["father"] for row in rows} - {None, ""} <= ids
    with open(tmp_path / "out" / "correspondences.csv", newline="") as file:
        assert [row["id"] for row in csv.DictReader(file)] == [row["id"] for row in rows]
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert page.count("<circle") == 2 * len(rows)
    assert json.loads((tmp_path / "out" / "report.json").read_text())["network"]["correspondences"] >= 20


def test_points_go_on_to_register(files: list[str], tmp_path: Path):
    run("match", images=files, output_dir=tmp_path / "out", report=False, threads=1)
    assert not (tmp_path / "out" / "report.html").exists()
    matched = f"{tmp_path / 'out' / 'match.gpkg'}|layername=matched_points"
    points = read_points(matched).image
    assert set(points.image_ids.tolist()) == {"first", "second"}
    report = run("register", image_points=matched, model="affine", output_dir=tmp_path / "registered")
    assert report["together"]["corner"]["distance"] < 5.0  # the relief


def test_windows_of_one_file_get_ids_of_their_own(files: list[str], tmp_path: Path):
    report = run(
        "match", images=[files[0], files[0]], window_1="0,0,220,220", window_2="60,50,220,220",
        output_dir=tmp_path / "out", threads=1,
    )  # fmt: skip
    assert [image["id"] for image in report["images"]] == ["first_1", "first_2"]
    assert report["images"][1]["window"] == [60, 50, 220, 220]
    rows = layer(tmp_path / "out" / "match.gpkg", "correspondences")
    moved = [(row["second_sample"] - row["first_sample"], row["second_line"] - row["first_line"]) for row in rows]
    np.testing.assert_allclose(moved, 0.0, atol=1e-3)  # the same pixels


@pytest.mark.parametrize("form", [[], ["--json"], ["--quiet"]])
def test_no_match_ends_with_1_on_the_command_line(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture, form: list[str]
):
    """Results are written, one line says why; stdout is one document with --json, and what is unknown in it is null."""
    flat = write_raster(tmp_path / "flat.tif", np.full((300, 300), 700, np.uint16))
    out = tmp_path / "out"
    assert main(["match", files[0], flat, "--output-dir", str(out), "--threads", "1", *form]) == 1
    told = capsys.readouterr()
    errors = [line for line in told.err.splitlines() if line.startswith("ERROR: ")]
    assert len(errors) == 1 and "no match: the second window has 0 interest points" in errors[0]
    written = json.loads((out / "report.json").read_text(), parse_constant=pytest.fail)
    if form == ["--json"]:
        assert json.loads(told.out, parse_constant=pytest.fail) == written
    else:
        assert ("first and flat: no match\n" in told.err) == (not form)
        assert told.out.splitlines() == ([] if form else [str(path) for path in sorted(out.iterdir())])
    assert (written["status"], written["correspondences"], written["rotation_deg"]) == ("no match", 0, None)
    assert layer(out / "match.gpkg", "correspondences") == []


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"window_1": "1,2,3"}, "`window_1` '1,2,3' is not SAMPLE,LINE,SAMPLES,LINES"),
        ({"window_2": "500,500,100,100"}, "less than 32 x 32 pixels in the image of 300 x 300"),
        ({"scale": "wide"}, "--scale 'wide' is not a number"),
        ({"scale": "2,1"}, "the lower one first"),
        ({"band": 2}, "has 1 bands, band 2 is wanted"),
    ],
)
def test_wrong_options_are_named(files: list[str], tmp_path: Path, options: dict, reason: str):
    with pytest.raises(InputError, match=reason):
        run("match", images=files, output_dir=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_two_images_are_needed(files: list[str], tmp_path: Path):
    with pytest.raises(InputError, match="match takes two images, 1 are given"):
        run("match", images=files[:1], output_dir=tmp_path / "out")


def test_with_rpc_the_layer_lies_on_the_ground(real_data: Path, tmp_path: Path):
    images = [real_data / "s2p_triplet_phr" / f"img_0{number}.tif" for number in (1, 2)]
    report = run(
        "match", images=images, window_1="600,600,300,300", window_2="580,560,340,340", height=206.0,
        output_dir=tmp_path / "out", threads=1,
    )  # fmt: skip
    assert report["correspondences"] >= 100
    dataset = ogr.Open(str(tmp_path / "out" / "match.gpkg"))
    west, east, south, north = dataset.GetLayerByName("correspondences").GetExtent()
    assert 5.43 < west < east < 5.46 and 43.25 < south < north < 43.27
