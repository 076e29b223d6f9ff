"""`simulate`: what it writes is a block that the other algorithms take, and its truth."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osgeo import ogr

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.laser_files import read_laser
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.laboratory.simulation import SENSORS
from hrsi.hrsi_engine.laboratory.simulation.options import SENSOR_NAMES
from hrsi.processing_algorithms import run

SMALL: dict[str, Any] = dict(size=300, gcps=4, checks=6, ties=30)


def test_choices_are_the_engines():
    assert tuple(SENSORS) == SENSOR_NAMES


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("block")
    run("simulate", output_dir=str(path), blunders=0.1, wrong_heights=0.5, ms=True, ortho=True, **SMALL)
    return path


def test_files(folder: Path):
    assert {file.name for file in folder.iterdir()} == {
        "image_1.tif", "image_1_ms.tif", "image_2.tif", "image_2_ms.tif", "orthophoto.tif", "dem.tif",
        "ground_points.csv", "image_points.csv", "truth.json", "truth.gpkg", "report.json",
    }  # fmt: skip


def test_laser_points(tmp_path: Path):
    run(
        "simulate",
        output_dir=str(tmp_path / "a"),
        pixels=False,
        laser_passes=3,
        laser_canopy=0.3,
        laser_clouds=0.1,
        **SMALL,
    )
    points = read_laser(str(tmp_path / "a" / "laser.csv"))
    truth = ogr.Open(str(tmp_path / "a" / "true_laser.gpkg"))
    rows = [(feature["met"], feature["error_m"]) for feature in truth.GetLayer(0)]
    met, error = (np.array(column) for column in zip(*rows, strict=True))
    assert len(points) == len(met) > 20
    assert set(points.track.tolist()) == {"pass 1", "pass 2", "pass 3"}
    assert np.abs(np.median(error[met == "ground"])) < 1.0 < np.median(error[met != "ground"])


def test_truth_agrees_with_the_files(folder: Path):
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    assert len(truth["ground_points"]) == 40
    assert len(truth["wrong_heights"]) == 2
    assert truth["blunders"]
    rpc = open_image(str(folder / "image_1.tif")).rpc
    np.testing.assert_array_equal(rpc.samp_num, truth["images"]["image_1"]["vendor_rpc"]["rpc"]["samp_num"])
    layers = ogr.Open(str(folder / "truth.gpkg"))
    counts = {layers.GetLayer(i).GetName(): layers.GetLayer(i).GetFeatureCount() for i in range(layers.GetLayerCount())}
    assert counts["true_ground_points"] == 40
    assert counts["true_image_points"] == len(truth["image_points"]) == 80
    assert counts["objects"] >= 20


def test_report(folder: Path):
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert report["points"] == {"gcp": 4, "check": 6, "tie": 30}
    assert report["images"]["image_2"]["rpc_fit_max_px"] < 1e-6


def test_the_adjustment_finds_the_vendors_error(tmp_path: Path):
    """Shifts of RPCs with an attitude error, from a block without pixels: check points close to the noise."""
    points = dict(gcps=8, checks=40, ties=100)
    run("simulate", output_dir=str(tmp_path / "in"), pixels=False, noise_image=0.1, size=2000, **points)
    images = [str(tmp_path / "in" / f"image_{number}_RPC.TXT") for number in (1, 2)]
    report = run(
        "adjust", images=images, gcps=str(tmp_path / "in" / "ground_points.csv"), report=False,
        image_points=str(tmp_path / "in" / "image_points.csv"), output_dir=str(tmp_path / "out"),
    )  # fmt: skip
    check = report["check"]
    assert report["images"]["image_1"]["before_rmse_line_px"] > 1.0
    assert check["points"] == 40
    assert check["rmse_east_m"] < 0.25  # survey 0.1 m, image 0.1 px of 0.7 m, drifts that a shift cannot follow
    assert check["rmse_north_m"] < 0.25
    assert check["rmse_height_m"] < 0.5


@pytest.mark.rendered
def test_dates_over_a_year(tmp_path: Path):
    """Three dates with two images each: named by date, under their own sun, with the truth of what changed."""
    run("simulate", output_dir=str(tmp_path), dates=3, images=2, off_nadir=5.0, size=128, gcps=0, checks=2, ties=5)
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert list(truth["images"]) == ["d1_1", "d1_2", "d2_1", "d2_2", "d3_1", "d3_2"]
    days = [image["acquisition"]["day"] for image in truth["images"].values()]
    assert days[0] == days[1] < days[2] == days[3] < days[4] < 365.0
    suns = {image["acquisition"]["sun_elevation_deg"] for image in truth["images"].values()}
    assert len(suns) == 3
    layers = ogr.Open(str(tmp_path / "truth.gpkg"))
    assert {layers.GetLayer(i).GetName() for i in range(layers.GetLayerCount())} >= {"changes", "objects"}
    kinds = {feature["kind"] for feature in layers.GetLayerByName("changes")}
    assert {"car", "ploughed", "built", "torn"} <= kinds


def test_options_reach_the_block(tmp_path: Path):
    run(
        "simulate", output_dir=str(tmp_path), sensor="spot5", images=3, along="20,0,-20", vendor_attitude="1e-5,0,0",
        jitter="0.5", jitter_period=1500.0, pixels=False, lines=200, **SMALL,
    )  # fmt: skip
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    image = truth["images"]["image_3"]
    assert image["size"] == [300, 200]
    assert image["along_deg"] == -20.0
    assert image["vendor_error"]["attitude_rad"] == [1e-5, 0.0, 0.0]
    ((period, amplitude, phase),) = image["jitter"]["vibration"]["waves"]
    assert (period, amplitude) == (1500.0, pytest.approx(0.5 * 2.5 / 832e3))
    assert phase != truth["images"]["image_1"]["jitter"]["vibration"]["waves"][0][2]  # another time, another phase


def test_images_of_a_pass_share_their_jitter(tmp_path: Path):
    """Scenes along a strip are shaken by one curve, as many lines later as they lie ahead."""
    run(
        "simulate", output_dir=str(tmp_path), images=2, places=2, overlap=0.5, jitter="0.5,800,0.2,150", pixels=False,
        **SMALL,
    )  # fmt: skip
    images = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))["images"]
    first, other, next_one = (images[name] for name in ("strip1_1_1", "strip1_1_2", "strip1_2_1"))
    of_pass = first["jitter"]["vibration"]["waves"]
    assert [wave[0] for wave in of_pass] == [800.0, 150.0]
    assert next_one["jitter"]["vibration"]["waves"] == of_pass != other["jitter"]["vibration"]["waves"]
    starts = [image["camera"]["error"]["vibration"]["start_line"] for image in (first, next_one)]
    # lines of oblique images are longer: 150 of 0.70 m are 143 at 15 degrees, by the slant range
    assert starts[1] - starts[0] == pytest.approx(150.0, rel=0.06)


def test_jitter_of_a_file(tmp_path: Path):
    lines = np.arange(0, 4001, 10)
    curve = tmp_path / "curve.csv"
    curve.write_text("line,across,along\n" + "".join(f"{k},{0.5 * np.sin(k / 100)},0\n" for k in lines))
    run("simulate", output_dir=str(tmp_path / "out"), jitter=str(curve), pixels=False, **SMALL)
    truth = json.loads((tmp_path / "out" / "truth.json").read_text(encoding="utf-8"))["images"]
    vibrations = [image["camera"]["error"]["vibration"] for image in truth.values()]
    assert vibrations[0]["curve"][7] == [70.0, pytest.approx(-0.5 * np.sin(0.7) * 0.70 / 694e3), 0.0]
    assert vibrations[0]["start_line"] != vibrations[1]["start_line"]
    (tmp_path / "bad.csv").write_text("line,across,along\n0,0,0\n20,1,1\n10,0,0\n")
    with pytest.raises(InputError, match="line 10 follows line 20"):
        run("simulate", output_dir=str(tmp_path / "no"), jitter=str(tmp_path / "bad.csv"), **SMALL)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (dict(along="1,2,3"), "`along` is 1,2,3: give 2 numbers"),
        (dict(vendor_attitude="a,b,c"), "`vendor_attitude` is a,b,c"),
        (dict(jitter="1,200,3"), "`jitter` is 1,200,3: give 4 numbers"),
        (dict(jitter="1,20"), "`jitter` is 1,20: give amplitudes in px and periods of 50 lines or more"),
        (dict(jitter="no_such.csv"), "no_such.csv"),
        (dict(dates=3, strips=2), "`dates` are taken of one place"),
        (dict(lat=91.0), "is not a place"),
        (dict(lat=89.99), "so near the pole"),
        (dict(sensor="landsat"), "not one of"),
    ],
)
def test_bad_input(tmp_path: Path, options: dict[str, Any], words: str):
    with pytest.raises(InputError, match=words):
        run("simulate", output_dir=str(tmp_path / "out"), **(SMALL | options))
    assert not (tmp_path / "out").exists()


def test_an_earlier_result_is_kept(folder: Path):
    with pytest.raises(InputError, match="overwrite"):
        run("simulate", output_dir=str(folder), **SMALL)
