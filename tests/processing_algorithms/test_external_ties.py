"""`adjust` with tie points of MicMac and the Ames Stereo Pipeline, and GCPs with covariances, as a user names them."""

import json
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main

NOISE_PX = 0.2


@pytest.fixture(scope="module")
def scene(repository) -> dict:
    """Three IKONOS cameras, 150 ground points and their positions in pixels, one of them wrong by 30 px."""
    paths = [str(repository / "examples" / "hobart" / f"hobart_ikonos_{k}_RPC.TXT") for k in (1, 2, 3)]
    images = [open_image(path) for path in paths]
    rng = np.random.default_rng(4)
    rpc = images[0].rpc
    reach = np.array([rpc.long_scale, rpc.lat_scale, 200.0]) * [0.3, 0.3, 1.0]
    ground = np.array([rpc.long_off, rpc.lat_off, rpc.height_off]) + rng.uniform(-1, 1, (150, 3)) * reach
    xy = {
        image.id: image.rpc.project(ground) + rng.normal(0, 3.0, 2) + rng.normal(0, NOISE_PX, (150, 2))
        for image in images
    }
    xy[images[1].id][17] += [0.0, 30.0]
    return {"images": paths, "ids": [image.id for image in images], "ground": ground, "xy": xy}


def write_pmul(folder: Path, scene: dict, names: list[str]) -> list[str]:
    paths = []
    for image, name in zip(scene["ids"], names, strict=True):
        rows = [f"{x + 0.5:.6f},{y + 0.5:.6f},{k}" for k, (x, y) in enumerate(scene["xy"][image].tolist())]
        path = folder / f"PMUL-{name}.csv"
        path.write_text("\n".join(["Pt.x,Pt.y,Id", *rows]))
        paths.append(str(path))
    return paths


def test_micmac_files_by_wildcard_and_by_name(scene, tmp_path):
    write_pmul(tmp_path, scene, [f"{name}.tif" for name in scene["ids"]])
    by_name = write_pmul(tmp_path, scene, ["a.tif", "b.tif", "c.tif"])
    named = ";".join(f"{path}|image={image}" for path, image in zip(by_name, scene["ids"], strict=True))
    reports = [
        run(
            "adjust",
            images=scene["images"],
            tie_points=ties,
            write="none",
            report=False,
            output_dir=str(tmp_path / out),
        )
        for ties, out in ((str(tmp_path / "PMUL-hobart*.csv"), "a"), (named, "b"))
    ]
    assert reports[0]["ties"] == reports[1]["ties"]
    assert reports[0]["ties"]["points"] == 150
    assert reports[0]["ties"]["rmse_px"] < 1.5 * NOISE_PX
    worst = reports[0]["rejected"]["measurements"][0]
    assert (worst["id"], worst["image"]) == ("17", scene["ids"][1])
    assert reports[0]["outliers"][0]["id"] == "17"
    assert any("by more than 10 sigma: 17 on hobart_ikonos_2" in text for text in reports[0]["warnings"])


def test_files_of_images_that_are_not_there_say_what_to_do(scene, tmp_path, capsys):
    write_pmul(tmp_path, scene, ["a.tif", "b.tif", "c.tif"])
    command = [
        "adjust",
        *scene["images"],
        "--tie-points",
        str(tmp_path / "PMUL-*.csv"),
        "--output-dir",
        str(tmp_path / "o"),
    ]
    assert main(command) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "a.tif" in error
    assert "FILE|image=ID" in error


def test_covariances_reach_the_report(scene, tmp_path):
    """The same GCPs with small sigmas and with a covariance: the report says which accuracy they came with."""
    rows = ["id,lon,lat,height,sigma_east,sigma_north,sigma_h,corr_en,image,sample,line"]
    for k in range(8):
        place = ",".join(f"{value:.9f}" for value in scene["ground"][k])
        for image in scene["ids"]:
            x, y = scene["xy"][image][k]
            rows.append(f"G{k},{place},0.1,0.3,0.5,-0.6,{image},{x:.4f},{y:.4f}")
    gcps = tmp_path / "gcps.csv"
    gcps.write_text("\n".join(rows))
    report = run(
        "adjust", images=scene["images"], gcps=str(gcps), height_datum="ellipsoidal", variance_components=True,
        output_dir=str(tmp_path / "out"), write="none",
    )  # fmt: skip
    control = json.loads((tmp_path / "out" / "report.json").read_text())["control"]
    assert control["sigma_survey_east_m"] == pytest.approx(0.1)
    assert control["sigma_survey_north_m"] == pytest.approx(0.3)
    assert control["sigma_survey_height_m"] == pytest.approx(0.5)
    assert "GCP covariances" in [part["group"] for part in report["variance_components"]]
