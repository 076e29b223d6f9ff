"""`--laser` in `triangulate` and `adjust`: tie points are measured at laser points, which hold the block's height."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_tests import mark_beyond
from osgeo import ogr

from hrsi.hrsi_engine.foundation.errors import InputError
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
    (reason,) = [reason for reason in verdict["reasons"] if reason["code"] == "heights-off-rpcs"]
    assert reason["message"].startswith("the heights of laser put the block")


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
    assert reason["code"] == "laser-holds-nothing" and "fewer than 10 photons" in reason["message"]
