"""`ortho-check` on orthoimages with known shifts, and the whole way from a simulated block to the true orthophoto."""

import os
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gdal_files import write_raster
from osgeo import gdal, ogr

from hrsi.hrsi_engine.foundation.errors import InputError, SolveError
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.ortho_check import summarise
from hrsi.tests.ortho.scenes import texture
from hrsi.tests.ortho.test_misregistration import shifted

SIDE = 400
SHIFT_PX = 0.05  # the issue's bound for the bias of a measured shift


def write_ortho(
    path: Path, grey: np.ndarray, west: float = 500_000.0, north: float = 5_250_000.0, step: float = 0.5
) -> str:
    path.parent.mkdir(exist_ok=True)
    return write_raster(path, np.rint(grey).astype(np.uint16), (west, step, 0.0, north, 0.0, -step), "EPSG:32755", 0)


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Orthoimages before, b lying 1.3 px right of and 0.6 px above a, and after, 0.04 px left and 0.02 px down."""
    folder = tmp_path_factory.mktemp("orthos")
    grey = 500.0 + 2000.0 * texture(SIDE, SIDE)
    for state, shift in (("before", (1.3, -0.6)), ("after", (-0.04, 0.02))):
        write_ortho(folder / state / "a.tif", grey)
        moved = shifted(grey, *shift)
        moved[:60, :60] = 0  # a corner without data
        write_ortho(folder / state / "b.tif", moved)
    return folder


def check(folder: Path, out: Path, **options: Any) -> dict[str, Any]:
    images = [str(folder / "after" / f"{name}.tif") for name in "ab"]
    return run("ortho-check", **({"images": images, "output_dir": str(out), "most": 12} | options))


@pytest.fixture(scope="module")
def both(sets: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """Report and folder of both states."""
    folder = tmp_path_factory.mktemp("both")
    return check(sets, folder, before=str(sets / "before")), folder


def test_before_and_after_in_one_table(both: tuple[dict[str, Any], Path]) -> None:
    report, folder = both
    (pair,) = report["pairs"]
    assert report["states"] == ["before", "after"] and (pair["first"], pair["second"]) == ("a", "b")
    assert pair["before"]["windows"] == pair["after"]["windows"] > 50
    for state, shift in (("before", (1.3, -0.6)), ("after", (-0.04, 0.02))):
        found = pair[state]
        assert (found["median_dx_px"], found["median_dy_px"]) == pytest.approx(shift, abs=SHIFT_PX / 2)
        assert found["median_px"] == pytest.approx(np.hypot(*shift), abs=SHIFT_PX / 2)
        assert found["median_m"] == pytest.approx(0.5 * found["median_px"])
        assert found["outcomes"]["nodata"] > 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count('<svg class="map"') == 2 and "before" in page
    assert page.count('<image id="picture-') == 2 == page.count('<use href="#picture-')  # arrows are on the imagery
    # The verdict by hand: 0.04 px in the median is within a pixel, and less than before
    assert report["verdict"]["level"] == "ok" and "(before 1.4" in report["verdict"]["sentence"]


def test_misregistration_is_doubtful_and_told_with_the_pair(sets: Path, tmp_path: Path) -> None:
    """Before and after exchanged: 1.43 px are beyond a pixel, and more than before."""
    images = [str(sets / "before" / f"{name}.tif") for name in "ab"]
    report = check(sets, tmp_path, images=images, before=str(sets / "after"))
    assert report["verdict"]["level"] == "doubtful"
    assert [reason["code"] for reason in report["verdict"]["reasons"]] == ["misregistration", "misregistration"]
    (beyond, _) = report["verdict"]["reasons"]
    assert f"{np.hypot(1.3, 0.6):.1f}" in beyond["message"] and beyond["images"] == ["a", "b"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.index("Doubtful") < page.index("1 of 1 pairs differ") < page.index('id="about-misregistration"')


@pytest.mark.rendered
def test_shifts_larger_than_the_search_are_found(tmp_path: Path) -> None:
    """Before the adjustment 12 px right and 5 px up, of other contrast; after it none: around each pair's own shift."""
    grey = 500.0 + 2000.0 * texture(SIDE, SIDE)
    shifts = {"before": (12.3, -5.4), "after": (0.1, -0.2)}
    for state, shift in shifts.items():
        write_ortho(tmp_path / state / "a.tif", grey)
        write_ortho(tmp_path / state / "c.tif", 200.0 + 0.5 * shifted(grey, *shift))
    images = [str(tmp_path / "after" / f"{name}.tif") for name in "ac"]
    report = check(tmp_path, tmp_path / "out", images=images, before=str(tmp_path / "before"), threads=2)
    (pair,) = report["pairs"]
    assert pair["before"]["windows"] > 0.8 * pair["before"]["tried"]
    for state, shift in shifts.items():
        assert (pair[state]["median_dx_px"], pair[state]["median_dy_px"]) == pytest.approx(shift, abs=SHIFT_PX / 2)
        assert np.abs(np.subtract(pair[state]["searched_around_px"], shift)).max() < 2.5
    same = check(tmp_path, tmp_path / "one", images=images, before=str(tmp_path / "before"), threads=1)
    assert same["pairs"] == report["pairs"]


def test_columns_of_the_printed_table_stay_apart(both: tuple[dict[str, Any], Path]) -> None:
    head, first, *_ = summarise(both[0]).splitlines()
    assert " ".join(head.split()) == "pair windows before median px before 90 % px after median px after 90 % px"
    assert len(head) == len(first) and len(first.split()) == 8


def test_arrows_as_a_layer(both: tuple[dict[str, Any], Path]) -> None:
    report, folder = both
    dataset = ogr.Open(str(folder / "misregistration.gpkg"))
    layer = dataset.GetLayerByName("misregistration_utm")
    assert layer.GetSpatialRef().GetAuthorityCode(None) == "32755"
    rows = [feature for feature in layer if feature["outcome"] == "matched" and feature["state"] == "before"]
    assert len(rows) >= report["pairs"][0]["before"]["windows"]
    x = rows[0].GetGeometryRef().GetX()
    assert 500_000.0 < x < 500_200.0
    with sqlite3.connect(folder / "misregistration.gpkg") as database:
        styles = dict(database.execute("SELECT f_table_name, styleQML FROM layer_styles"))
    assert set(styles) == {"misregistration_utm", "misregistration_wgs84"} and "east_m" in styles["misregistration_utm"]


def test_other_origins_on_the_lattice_are_compared_pixel_to_pixel(sets: Path, tmp_path: Path) -> None:
    grey = gdal.Open(str(sets / "after" / "a.tif")).ReadAsArray()
    other = write_ortho(tmp_path / "in" / "c.tif", grey[40:, 100:], west=500_050.0, north=5_249_980.0)
    report = check(sets, tmp_path / "out", images=[str(sets / "after" / "a.tif"), other])
    assert report["warnings"] == [] and report["pairs"][0]["after"]["p90_px"] < 0.001


def test_a_reference_on_other_pixels_is_resampled(sets: Path, tmp_path: Path) -> None:
    """The reference has larger pixels, half a pixel aside; its content lies where it should."""
    a = str(sets / "after" / "a.tif")
    gdal.Warp(
        str(tmp_path / "r.tif"), a, xRes=0.6, yRes=0.6, resampleAlg="cubic",
        outputBounds=(500_010.25, 5_249_820.1, 500_190.25, 5_249_988.1),
    )  # fmt: skip
    report = check(sets, tmp_path / "out", images=[a], reference=str(tmp_path / "r.tif"))
    (pair,) = report["pairs"]
    assert (pair["first"], pair["second"]) == ("r", "a")
    assert pair["after"]["median_px"] < SHIFT_PX and any("resampled" in text for text in report["warnings"])


def test_faults_are_told(sets: Path, tmp_path: Path) -> None:
    a = str(sets / "after" / "a.tif")
    far = write_ortho(tmp_path / "far.tif", np.full((50, 50), 9.0), west=600_000.0)
    other = write_ortho(tmp_path / "other.tif", 500.0 + 2000.0 * texture(SIDE, SIDE, seed=77))
    plain = write_raster(tmp_path / "plain.tif", np.zeros((10, 10)))
    for images, options, message in (
        ([a], {}, "nothing to be compared with"),
        ([a, far], {}, "no two of the orthoimages overlap"),
        ([a, plain], {}, "no orthoimage"),
        ([a, str(sets / "after" / "b.tif")], {"before": str(tmp_path / "nowhere")}, "does not exist"),
    ):
        with pytest.raises(InputError, match=message):
            check(sets, tmp_path / "out", images=images, **options)
    with pytest.raises(SolveError, match="no window could be matched"):
        check(sets, tmp_path / "out", images=[a, other])
    assert not os.path.exists(tmp_path / "out" / "report.json")


# ---- the whole way ---------------------------------------------------------------------------------------------------


@pytest.mark.rendered
def test_refined_orthoimages_lie_on_the_true_orthophoto(tmp_path: Path) -> None:
    """Five well-measured GCPs (0.1 px, 3 cm, 5 cm) bring orthoimages of 0.7 m within 0.2 px of the truth."""
    block = tmp_path / "block"
    run("simulate", output_dir=str(block), size=700, images=2, along=["-12", "12"], relief=60.0, gcps=5, checks=0,
        ties=60, ortho=True, seed=4, noise_image=0.1, noise_gcp_xy=0.03, noise_gcp_h=0.05)  # fmt: skip
    images = [str(block / f"image_{k}.tif") for k in (1, 2)]
    run("adjust", images=images, gcps=str(block / "ground_points.csv"), height_datum="ellipsoidal",
        image_points=str(block / "image_points.csv"), output_dir=str(tmp_path / "refined"), report=False,
        model="affine")  # fmt: skip
    run("orthorectify", images=[str(tmp_path / "refined" / Path(image).name) for image in images], resolution=0.7,
        dem=str(block / "dem.tif"), height_datum="ellipsoidal", output_dir=str(tmp_path / "orthos"))  # fmt: skip
    orthos = [str(tmp_path / "orthos" / f"image_{k}_ortho.tif") for k in (1, 2)]
    report = run("ortho-check", images=orthos, reference=str(block / "orthophoto.tif"), most=8,
                 output_dir=str(tmp_path / "check"))  # fmt: skip
    for pair in report["pairs"]:
        assert pair["after"]["windows"] > 20 and pair["after"]["median_px"] < 0.2
