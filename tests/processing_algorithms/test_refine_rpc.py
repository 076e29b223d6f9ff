"""`refine-rpc` as a user runs it: real GCPs, a blunder, the comparison of models, wrong input."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
from osgeo import gdal
from real_control import quickbird, rmse_2d

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS

TEN = "H003,H022,H024,H035,H048,H058,H077,H098,H103,H105"


@pytest.fixture
def hobart(hobart) -> dict:
    return hobart | {"height_datum": "ellipsoidal", "gcp_ids": TEN.split(",")}


@pytest.fixture
def orthority(real_data) -> dict:
    folder = real_data / "qb2_gcp"
    return {"images": [str(folder / "qb2_basic1b.tif")], "gcps": str(folder / "gcps.geojson")}


def test_quickbird_is_written(orthority, real_data, tmp_path):
    report = run("refine-rpc", **orthority, output_dir=str(tmp_path))
    _, control = quickbird(real_data)
    entry = report["images"]["qb2_basic1b"]
    written = read_rpc(entry["output"]).rpc
    after = rmse_2d(control.xy - written.project(control.ground))
    assert report["model"] == "shift"
    assert after == pytest.approx(0.104, abs=0.001)
    assert entry["rpc_fit_max_px"] == 0.0
    assert "leave-one-out error" in report["image_models"]["qb2_basic1b"]["choice"]["reason"]
    assert json.loads((tmp_path / "report.json").read_text())["control"]["points"] == 5
    dataset = gdal.OpenEx(str(tmp_path / "block.gpkg"))
    assert dataset.GetLayerByName("residuals_utm").GetFeatureCount() == 10


@pytest.mark.real
def test_several_images_by_themselves(hobart, tmp_path):
    report = run("refine-rpc", **hobart, output_dir=str(tmp_path), compare=True)
    assert set(report["image_models"]) == {"hobart_ikonos_1", "hobart_ikonos_2", "hobart_ikonos_3"}
    assert report["check"]["points"] == 61
    assert report["check"]["rmse_east_m"] < 0.75 and report["check"]["rmse_height_m"] < 2.0
    assert set(report["models"]) == set(SINGLE_IMAGE_MODELS)
    assert report["models"]["shift"]["check"]["rmse_east_m"] == pytest.approx(report["check"]["rmse_east_m"])
    assert "needs 6 GCPs" in report["models"]["quadratic"]["note"]
    page = (tmp_path / "report.html").read_text()
    assert "Models compared" in page and "generic-affine" in page


def test_each_image_has_its_own_model(hobart, tmp_path):
    """The second image has three GCPs: the generic rule gives it another variant than the others may get."""
    report = run("refine-rpc", **hobart, output_dir=str(tmp_path), model="generic")
    models = {name: entry["model"] for name, entry in report["image_models"].items()}
    assert all(model.startswith("generic-") for model in models.values())
    for name, entry in report["image_models"].items():
        assert set(entry["parameters"]) == set(SINGLE_IMAGE_MODELS[models[name]].parameters)


def test_the_table_is_printed(orthority, tmp_path, capsys):
    words = ["refine-rpc", *orthority["images"], "--gcps", orthority["gcps"], "--output-dir", str(tmp_path)]
    assert main([*words, "--compare"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert any(line.startswith("shift ") and line.split()[-1] == "0.130" for line in lines)
    assert any(line.startswith("affine ") and line.split()[-1] == "0.519" for line in lines)


def test_a_blunder_is_named_and_left_out(orthority, tmp_path):
    source = json.loads(Path(orthority["gcps"]).read_text())
    source["features"][2]["properties"]["ji"][0] += 40.0
    wrong = tmp_path / "wrong.geojson"
    wrong.write_text(json.dumps(source))
    report = run("refine-rpc", **orthority | {"gcps": str(wrong)}, output_dir=str(tmp_path / "result"))
    name = source["features"][2]["properties"]["id"]
    assert report["image_models"]["qb2_basic1b"]["left_out"] == [name]
    assert any(name in warning and "left out" in warning for warning in report["warnings"])
    assert report["sigma0"] < 1.0


def only_first(hobart: dict, folder: Path) -> str:
    with open(hobart["image_points"], newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["image"] == "hobart_ikonos_1"]
    path = folder / "first.csv"
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return str(path)


def test_an_image_without_gcps(hobart, tmp_path, capsys):
    words = ["refine-rpc", *hobart["images"], "--gcps", hobart["gcps"], "--image-points", only_first(hobart, tmp_path)]
    assert main([*words, "--output-dir", str(tmp_path / "result")]) == 2
    assert "hobart_ikonos_2: no GCP is measured on it" in capsys.readouterr().err


def test_adjust_takes_auto(hobart, tmp_path):
    report = run("adjust", **hobart, model="auto", output_dir=str(tmp_path))
    assert report["model"] == "shift"
    assert report["model_choice"]["rule"] == "auto"
    assert "leave-one-out error" in report["model_choice"]["reason"]


# ---- a given covariance of the coefficients --------------------------------------------------------------------------


def cubic_terms(lon: np.ndarray, lat: np.ndarray, height: np.ndarray) -> np.ndarray:
    """The 20 terms of RPC00B ``(n, 20)`` in the order of the standard: L is the longitude, P the latitude."""
    L, P, H = lon, lat, height
    return np.stack(
        [L**0, L, P, H, L * P, L * H, P * H, L**2, P**2, H**2, P * L * H, L**3, L * P**2, L * H**2, L**2 * P, P**3,
         P * H**2, L**2 * H, P**2 * H, H**3], axis=1,
    )  # fmt: skip


@pytest.mark.thorough
def test_a_given_covariance_of_the_coefficients_is_a_least_squares_prior(orthority, real_data, tmp_path):
    """Against SciPy's minimum of ``|v / sigma|^2 + dc' C^-1 dc``, with the RPC written out from its standard."""
    image, control = quickbird(real_data)
    rng = np.random.default_rng(5)
    spread = np.where(np.isin(np.arange(78) % 39, range(20)), 3e-4, 3e-6)  # numerators vary more than denominators
    factor = spread[:, None] * (np.eye(78) + 0.2 * rng.normal(size=(78, 78)))
    covariance = factor @ factor.T
    np.savetxt(tmp_path / "covariance.txt", covariance)
    report = run(
        "refine-rpc", **orthority, output_dir=str(tmp_path / "out"), model="bils", leave_out=False, sigma_image=0.5,
        sigma_gcp_xy=1e-6, sigma_gcp_h=1e-6, coefficient_covariance=str(tmp_path / "covariance.txt"),
    )  # fmt: skip
    rpc = image.rpc
    lon, lat, height = control.ground.T
    terms = cubic_terms(
        (lon - rpc.long_off) / rpc.long_scale, (lat - rpc.lat_off) / rpc.lat_scale,
        (height - rpc.height_off) / rpc.height_scale,
    )  # fmt: skip

    def place(change: np.ndarray) -> np.ndarray:
        sample = terms @ (rpc.samp_num + change[:20]) / (terms @ (rpc.samp_den + np.r_[0, change[20:39]]))
        line = terms @ (rpc.line_num + change[39:59]) / (terms @ (rpc.line_den + np.r_[0, change[59:]]))
        return np.stack([sample * rpc.samp_scale + rpc.samp_off, line * rpc.line_scale + rpc.line_off], axis=1)

    def misfit(standard: np.ndarray) -> np.ndarray:  # dc = L s, with s standard normal before the observations
        return np.r_[((control.xy - place(factor @ standard)) / 0.5).ravel(), standard]

    expected = place(factor @ scipy.optimize.least_squares(misfit, np.zeros(78), xtol=1e-14, ftol=1e-14).x)
    written = read_rpc(report["images"]["qb2_basic1b"]["output"]).rpc.project(control.ground)
    assert np.abs(expected - rpc.project(control.ground)).max() > 0.5  # the prior lets the image move
    assert np.abs(expected - control.xy).max() > 0.05  # and holds it back
    np.testing.assert_allclose(written, expected, atol=1e-3)


def test_a_covariance_that_cannot_be_used_is_refused(orthority, tmp_path):
    (tmp_path / "small.txt").write_text("1 0\n0 1\n")
    (tmp_path / "words.txt").write_text("not numbers\n")
    np.savetxt(tmp_path / "negative.txt", -np.eye(78))
    given = {**orthority, "output_dir": str(tmp_path / "out")}
    for model, name, message in (
        ("shift", "small.txt", "does not estimate the coefficients"),
        ("bils", "small.txt", r"small.txt: .*\(78, 78\)"),
        ("bils", "words.txt", "78 lines with 78 numbers"),
        ("bils", "negative.txt", "positive definite"),
        ("bils", "missing.txt", "missing.txt"),
    ):
        with pytest.raises(InputError, match=message):
            run("refine-rpc", **given, model=model, coefficient_covariance=str(tmp_path / name))
