"""`gcps-from-reference` and `triangulate --reference` on files; height datums of GCPs and DEM."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from long_tests import mark_beyond

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geoids import height_difference
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.block_steps.reference_control import default_sigma_m
from hrsi.processing_algorithms.command_line.cli import main


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated pair with orthophoto, DEM, GCPs and check points."""
    folder = tmp_path_factory.mktemp("block")
    run("simulate", images=2, size=500, ortho=True, seed=3, gcps=4, checks=20, ties=60, output_dir=str(folder))
    return folder


@pytest.fixture(scope="module")
def moved(block: Path) -> Path:
    """The orthophoto 20 m beside its place."""
    from osgeo import gdal

    path = block / "moved.tif"
    gdal.Translate(str(path), str(block / "orthophoto.tif"))
    dataset = gdal.Open(str(path), gdal.GA_Update)
    geotransform = list(dataset.GetGeoTransform())
    geotransform[0] += 16.0 / 80_700.0
    geotransform[3] += 12.0 / 111_100.0
    dataset.SetGeoTransform(geotransform)
    dataset.FlushCache()
    return path


def options(block: Path, **more: Any) -> dict[str, Any]:
    return {
        "images": [str(block / "image_1.tif"), str(block / "image_2.tif")],
        "reference": str(block / "orthophoto.tif"), "dem": str(block / "dem.tif"), "reference_points": 60,
    } | more  # fmt: skip


def triangulate(block: Path, tmp_path: Path, **more: Any) -> dict[str, Any]:
    given = {
        "tie_points": str(block / "image_points.csv"), "write": "none", "report": False, "output_dir": str(tmp_path),
        "height_datum": "ellipsoidal",
    }  # fmt: skip
    return run("triangulate", **options(block, **(given | more)))


def test_layer_is_read_back_as_gcps(block, tmp_path):
    report = run("gcps-from-reference", **options(block, output_dir=str(tmp_path), reference_sigma=1.5))
    assert report["points"] > 20 and not report["warnings"]
    # a datum named for other files must not touch heights that are ellipsoidal already
    tables = read_points(
        f"{tmp_path / 'gcps.gpkg'}|layername=gcps", height_datum="egm96", image_ids=["image_1", "image_2"]
    )
    assert tables.ground is not None and tables.image is not None
    assert len(tables.ground) == report["points"] and len(tables.image) == report["measurements"]
    # 0.8 of the sigma is shared by all, 0.4 by those of a part of the area: this one is too small for parts
    np.testing.assert_allclose(tables.ground.sigma_m[:, 0], 1.5 * np.sqrt(0.8 * report["points"] + 0.2), rtol=1e-6)
    assert np.all((tables.ground.ground[:, 2] > 150.0) & (tables.ground.ground[:, 2] < 350.0))
    assert np.all((tables.image.sigma_px > 0.0) & (tables.image.sigma_px < 1.0))
    adjusted = run(
        "adjust", images=options(block)["images"], gcps=f"{tmp_path / 'gcps.gpkg'}|layername=gcps", write="none",
        report=False, output_dir=str(tmp_path / "adjusted"),
    )  # fmt: skip
    assert adjusted["control"]["points"] == report["points"]
    # their scatter, some centimetres, is not taken for what all of them may be off by
    (part,) = adjusted["parts"]
    assert part["sigma_east_m"] == pytest.approx(1.5 * np.sqrt(0.8), rel=0.05)
    assert not [text for text in adjusted["warnings"] if "given sigma" in text]
    assert json.loads((tmp_path / "report.json").read_text())["algorithm"] == "gcps-from-reference"


@pytest.mark.thorough
def test_triangulate_takes_its_gcps_from_a_reference(block, tmp_path):
    """Check points, which are surveyed to 0.1 m, are right to a fraction of a metre without any surveyed GCP."""
    gcps = str(block / "ground_points.csv")
    surveyed = {"gcps": gcps, "image_points": str(block / "image_points.csv"), "gcp_ids": ["G000001"]}
    report = triangulate(block, tmp_path, **surveyed)
    assert report["reference"]["used"]
    assert report["control"]["points"] > 20  # those of the reference stay control beside the one that is named
    assert report["check"]["points"] >= 20
    assert np.hypot(report["check"]["rmse_east_m"], report["check"]["rmse_north_m"]) < 0.6
    assert not report["outliers"]  # GCPs of the reference are not judged by the image sigma alone


@pytest.mark.rendered
def test_surveyed_gcps_win_over_a_reference_that_contradicts_them(block, moved, tmp_path):
    surveyed = {"gcps": str(block / "ground_points.csv"), "image_points": str(block / "image_points.csv")}
    report = triangulate(block, tmp_path, reference=str(moved), **surveyed)
    assert not report["reference"]["used"]
    assert any("from the reference" in text and "is not used" in text for text in report["warnings"])
    found = report["reference"]["surveyed_gcps"]
    assert (found["east_m"], found["north_m"]) == pytest.approx((-16.0, -12.0), abs=1.0)
    assert report["control"]["points"] == 4
    assert report["check"]["rmse_east_m"] < 0.5


@pytest.mark.wrong_inputs
def test_the_verdict_doubts_a_reference_of_another_place(block, tmp_path):
    """The same orthoimage upside down: it lies over the block, and shows nothing of it."""
    other = tmp_path / "other.tif"
    with rasterio.open(options(block)["reference"]) as source:
        profile, pixels = source.profile, source.read()
    with rasterio.open(other, "w", **profile) as target:
        target.write(np.ascontiguousarray(pixels[:, ::-1, ::-1]))
    verdict = triangulate(block, tmp_path / "out", reference=str(other))["verdict"]
    (reason,) = [reason for reason in verdict["reasons"] if reason["code"] == "reference-not-found"]
    assert verdict["level"] == "doubtful" and "other.tif" in reason["message"]


def test_command_line_and_errors(block, tmp_path, capsys):
    given = options(block, output_dir=str(tmp_path / "out"))
    command = ["gcps-from-reference", *given["images"], "--reference", given["reference"], "--dem", given["dem"]]
    command += ["--reference-points", "40", "--output-dir", given["output_dir"]]
    assert main(command) == 0
    assert "matches agree to" in capsys.readouterr().err
    with pytest.raises(InputError, match="no coordinate reference system"):
        run("gcps-from-reference", **options(block, reference=given["images"][0], output_dir=str(tmp_path / "a")))
    with pytest.raises(InputError, match="`dem`"):
        triangulate(block, tmp_path / "b", dem=None)
    written = run("write-rpc", images=given["images"][:1], write="sidecar", output_dir=str(tmp_path / "rpc"))
    alone = [written["images"]["image_1"]["output"]]
    with pytest.raises(InputError, match="have pixels"):
        run("gcps-from-reference", **options(block, images=alone, output_dir=str(tmp_path / "c")))


# ---- height datums -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("datum", "flagged"), mark_beyond(1, "real", [("ellipsoidal", True), ("egm96", False)]))
def test_quickbird_dem_with_the_right_and_the_wrong_datum(real_data, tmp_path, datum, flagged):
    """The DEM is above EGM2008, which EGM96 equals to a metre here; the GCPs are ellipsoidal."""
    folder = real_data / "qb2_gcp"
    report = run(
        "triangulate", images=[str(folder / "qb2_basic1b.tif")], gcps=str(folder / "gcps.geojson"), tie_points="none",
        dem=str(folder / "dem_egm2008_24m.tif"), dem_datum=datum, height_datum="ellipsoidal", write="none",
        report=False, output_dir=str(tmp_path),
    )  # fmt: skip
    said = [reason for reason in report["verdict"]["reasons"] if reason["code"] == "height-datum"]
    assert bool(said) == flagged
    assert all(
        "the geoid undulation is +28" in reason["message"] and "dem_datum" in reason["advice"] for reason in said
    )


@pytest.mark.parametrize(
    ("gsd_m", "published_m", "largest_m"),
    [
        (0.1, 0.1, 0.2),  # aerial orthoimages: RMSE of one and two pixels, the first classes of ASPRS 2014
        (10.0, 12.5 / 2.49, 10.0),  # Sentinel-2: 12.5 m for 95.5 %; a pixel would be coarse
        (30.0, 12.0 / 2.146, 30.0),  # Landsat: CE90 of 12 m
    ],
)
def test_the_default_sigma_is_that_of_orthoimages_of_this_kind(gsd_m: float, published_m: float, largest_m: float):
    assert 0.95 * published_m < default_sigma_m(gsd_m) <= largest_m


@pytest.mark.real
def test_quickbird_positions_differ_as_the_geoid_says(real_data):
    """With the wrong datum the ground lies N tan(incidence) aside, in the direction of the view."""
    from hrsi.hrsi_engine.block.imaging_geometry import ViewDirection
    from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
    from hrsi.hrsi_engine.ground.geoids import geoid_heights
    from hrsi.hrsi_engine.io.rasters.dems import open_dem
    from hrsi.hrsi_engine.io.rasters.images import open_image
    from hrsi.hrsi_engine.surface.dem import intersect_surface

    image = open_image(str(real_data / "qb2_gcp" / "qb2_basic1b.tif"))
    path = str(real_data / "qb2_gcp" / "dem_egm2008_24m.tif")
    right, wrong = (open_dem(path, datum) for datum in ("egm96", "ellipsoidal"))
    grid = image.grid_px(12, 12)
    ground, apart = intersect_surface(image.rpc, grid, right), intersect_surface(image.rpc, grid, wrong)
    both = np.isfinite(ground.ground).all(axis=1) & np.isfinite(apart.ground).all(axis=1)
    difference = ground_difference_m(apart.ground[both], ground.ground[both])
    undulation = geoid_heights(ground.ground[both], "egm96")
    view = ViewDirection(image, right).geometry()
    expected = float(np.median(undulation)) * np.tan(np.radians(view.incidence_deg))
    away = np.radians(view.azimuth_deg)
    towards = difference[:, 0] * np.sin(away) + difference[:, 1] * np.cos(
        away
    )  # lower ground: towards the satellite's foot
    assert abs(np.median(towards)) == pytest.approx(expected, rel=0.05)
    assert expected > 7.0  # more than a pixel of 6.5 m


def test_few_or_scattered_heights_say_nothing():
    nothing = height_difference(np.array([np.nan, 3.0]), np.array([1.0, np.nan]), np.zeros(2))
    assert nothing is None
    few = height_difference(np.array([45.0, 45.0]), np.zeros(2), np.full(2, 45.0))
    assert few is not None and not few.significant
    rng = np.random.default_rng(2)
    rough = height_difference(rng.normal(10.0, 30.0, 6), np.zeros(6), np.full(6, 45.0))
    assert rough is not None and not rough.significant
