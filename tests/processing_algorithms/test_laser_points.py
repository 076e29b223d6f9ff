"""`--laser` in `triangulate` and `adjust`: tie points are measured at laser points, which hold the block's height."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from long_tests import mark_beyond
from osgeo import gdal, ogr

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.io.laser_files import read_laser
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("laser") / "block"
    run(
        "simulate", output_dir=str(folder), size=700, images=2, gcps=0, checks=6, ties=40, relief=15.0, laser_passes=12,
        laser_canopy=0.1, seed=4,
    )  # fmt: skip
    return folder


def options(block: Path, out: Path, **more: Any) -> dict[str, Any]:
    images = [str(block / f"image_{number}.tif") for number in (1, 2)]
    return dict(images=images, output_dir=str(out), write="none", report=False, height_datum="ellipsoidal") | more


def height_offset_m(block: Path, out: Path) -> float:
    """Return the median of adjusted tie points over the true terrain."""
    layer = ogr.Open(str(out / "block.gpkg"))
    rows = [f.GetGeometryRef().GetPoint() for f in layer.GetLayerByName("ground_points") if f["role"] == "tie"]
    ground = np.array(rows)
    return float(
        np.median(ground[:, 2] - surface_heights(open_dem(str(block / "dem.tif"), "ellipsoidal"), ground[:, :2]))
    )


def test_triangulate_measures_at_laser_points(block: Path, tmp_path: Path):
    ties = str(block / "image_points.csv")
    free = run("triangulate", **options(block, tmp_path / "free", tie_points=ties))
    assert abs(height_offset_m(block, tmp_path / "free")) > 2.0
    report = run("triangulate", **options(block, tmp_path / "held", tie_points=ties, laser=str(block / "laser.csv")))
    assert report["laser"]["used"] > 20
    assert report["laser"]["ties"] > 60
    assert report["ties"]["points"] > free["ties"]["points"] + 60
    assert abs(height_offset_m(block, tmp_path / "held")) < 0.3  # passes are 0.1 m off each, and all 0.05 m
    (entry,) = report["heights"]
    assert entry["source"] == "laser" and entry["share"] == 1.0
    layers = ogr.Open(str(tmp_path / "held" / "block.gpkg"))
    rows = [(f["used"], f["reason"]) for f in layers.GetLayerByName("laser_points")]
    assert len(rows) == report["laser"]["points"]
    assert all((reason in (None, "")) == bool(used) for used, reason in rows)


def test_adjust_takes_the_ties_that_are_there(block: Path, tmp_path: Path):
    points = dict(image_points=str(block / "image_points.csv"), laser=str(block / "laser.csv"), laser_reach=40.0)
    report = run("adjust", **options(block, tmp_path / "out", **points))
    assert 0 < report["laser"]["used"] < report["laser"]["points"]
    assert "no tie points near it" in report["laser"]["left_out"]


def test_laser_points_of_another_area_are_refused(block: Path, tmp_path: Path):
    file = tmp_path / "far.csv"
    file.write_text("lon,lat,height\n100,10,20\n")
    with pytest.raises(InputError, match="none of its laser points lies on an image"):
        run("adjust", **options(block, tmp_path / "out", image_points=str(block / "image_points.csv"), laser=str(file)))


def test_laser_points_in_a_national_crs(block: Path, tmp_path: Path):
    """Their operation is told, its error is in LE90, and `gcp_epoch` moves them with the plate."""
    to_map = pyproj.Transformer.from_crs(4258, 25831, always_xy=True)
    file, rows = tmp_path / "map.csv", list(csv.DictReader((block / "laser.csv").open()))
    lonlat = np.array([[float(row["lon"]), float(row["lat"])] for row in rows])
    with file.open("w", newline="") as target:
        writer = csv.writer(target)
        writer.writerow(["id", "track", "x", "y", "height", "sigma_h"])
        for row, x, y in zip(rows, *to_map.transform(*lonlat.T), strict=True):
            writer.writerow([row["id"], row["track"], repr(float(x)), repr(float(y)), row["h_mean"], row["h_sigma"]])
    moved = read_laser(str(file), ground_crs="EPSG:25831", epoch=2023.5)
    realised = pyproj.Transformer.from_crs("EPSG:9067", "EPSG:9000", always_xy=True)  # ETRF2000 to ITRF2014
    expected = np.column_stack(realised.transform(*lonlat.T, np.zeros(len(rows)), np.full(len(rows), 2023.5))[:2])
    np.testing.assert_allclose(moved.ground[:, :2], expected, atol=2e-9)
    assert 0.5 < np.hypot(*ground_difference_m(moved.ground, np.pad(lonlat, ((0, 0), (0, 1))))[0, :2]) < 1.2
    given = dict(image_points=str(block / "image_points.csv"), laser=str(file), laser_reach=40.0)
    given |= dict(ground_crs="EPSG:25831+5720", laser_datum="layer")  # NGF-IGN69: its geoid is a grid
    report = run("adjust", **options(block, tmp_path / "out", **given, gcp_epoch=2023.5))
    (entry,) = report["crs_operations"]
    assert (entry["source"], entry["code"]) == (str(file), "EPSG:1149") and "in 2023.5" in entry["name"]
    if entry["geoid_stands_for"] is None:
        pytest.skip("the geoid of NGF-IGN69 is installed")
    assert entry["sigma_height_m"] == 1.0
    assert report["parts"][0]["le90_m"] > 1.645
    with pytest.raises(InputError, match="geoid of NGF-IGN69 height is not installed"):
        run("adjust", **options(block, tmp_path / "strict", **given, strict_datum=True))


@pytest.mark.thorough
def test_surveyed_points_take_the_error_of_the_dem_that_gives_their_heights(block: Path, tmp_path: Path):
    """GCPs without heights, and a DEM above a geoid that another model stands in for."""
    rows = list(csv.DictReader((block / "ground_points.csv").open()))
    file = tmp_path / "flat.csv"
    file.write_text("id,lon,lat\n" + "".join(f"{row['id']},{row['lon']},{row['lat']}\n" for row in rows))
    dem = gdal.Translate(str(tmp_path / "dem.tif"), str(block / "dem.tif"), outputSRS="EPSG:4258+5720")
    del dem
    given = dict(image_points=str(block / "image_points.csv"), gcps=str(file), dem=str(tmp_path / "dem.tif"))
    report = run("adjust", **options(block, tmp_path / "out", **given, dem_datum="layer"))
    of_points, of_dem = report["crs_operations"]
    if of_dem["geoid_stands_for"] is None:
        pytest.skip("the geoid of NGF-IGN69 is installed")
    assert of_points["source"] == str(file) and "heights of a DEM by" in of_points["name"]
    assert of_points["sigma_height_m"] == of_dem["sigma_height_m"] == 1.0
    assert report["parts"][0]["le90_m"] > 1.6


def with_heights(block: Path, file: Path, change: Callable[[float], float]) -> str:
    """Write the block's laser points with other heights; return the path."""
    with (block / "laser.csv").open() as source, file.open("w", newline="") as target:
        rows = csv.DictReader(source)
        written = csv.DictWriter(target, rows.fieldnames or ())
        written.writeheader()
        for row in rows:
            written.writerow(row | {"h_mean": change(float(row["h_mean"]))})
    return str(file)


@pytest.mark.parametrize(
    "change",
    mark_beyond(0, "wrong_inputs", [lambda h: h + 97.2, lambda h: h / 0.3048]),
    ids=["undulation twice", "feet"],
)
def test_the_verdict_doubts_laser_heights_that_are_far_from_the_rpcs(block, tmp_path, change):
    """No check point and no DEM is there; the block follows the laser over several look-ups, and that is said."""
    laser = with_heights(block, tmp_path / "wrong.csv", change)
    verdict = run(
        "triangulate", **options(block, tmp_path / "out", tie_points=str(block / "image_points.csv"), laser=laser)
    )["verdict"]
    assert verdict["level"] != "ok"
    # heights in feet also steepen the ground, so that passes contradict one another: further reasons of the same code
    told = [reason["message"] for reason in verdict["reasons"] if reason["code"] == "sources-disagree"]
    assert sum(message.startswith("the heights of laser move the block") for message in told) == 1


@pytest.mark.rendered
def test_the_verdict_doubts_laser_points_that_hold_nothing(block: Path, tmp_path: Path):
    file = tmp_path / "dim.csv"
    rows = list(csv.DictReader((block / "laser.csv").open()))
    with file.open("w", newline="") as target:
        written = csv.DictWriter(target, list(rows[0]))
        written.writeheader()
        written.writerows(row | {"n_fit_photons": 4} for row in rows)
    given = options(block, tmp_path / "out", image_points=str(block / "image_points.csv"), laser=str(file))
    (reason,) = run("adjust", **given)["verdict"]["reasons"]
    assert reason["code"] == "laser-few" and "fewer than 10 photons" in reason["message"]
