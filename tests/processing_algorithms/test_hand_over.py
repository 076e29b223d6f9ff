"""`hand-over`: projects read again by the rules of the programs that they are for, and the pairs that are chosen."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal

from hrsi.hrsi_engine.block.imaging_geometry import PairGeometry
from hrsi.hrsi_engine.block.stereo_pairs import choose_stereo_pairs
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.sun import SunAngles
from hrsi.hrsi_engine.io.projects import PROJECT_WRITERS
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.declarations.rpcs import NEXT_PROGRAMS


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated block of three images with pixels, adjusted."""
    folder = tmp_path_factory.mktemp("block")
    made = folder / "made"
    run(
        "simulate", sensor="pleiades", images=3, along="-12,0,12", size=240, gcps=6, checks=4, ties=60, relief=40.0,
        seed=3, output_dir=str(made),
    )  # fmt: skip
    run(
        "adjust", images=[str(made / f"image_{number}.tif") for number in (1, 2, 3)],
        gcps=str(made / "ground_points.csv"), image_points=str(made / "image_points.csv"),
        height_datum="ellipsoidal", report=False, output_dir=str(folder / "result"),
    )  # fmt: skip
    return folder


def hand_over(block: Path, target: str, name: str, **options: object) -> tuple[Path, dict]:
    folder = block / name
    report = run("hand-over", result=str(block / "result"), to=target, output_dir=str(folder), **options)
    return folder, report


def gdal_rpc(path: Path) -> dict[str, str]:
    return gdal.Open(str(path)).GetMetadata("RPC")


def test_every_target_is_declared():
    assert tuple(PROJECT_WRITERS) == NEXT_PROGRAMS


def test_cars_project(block):
    folder, report = hand_over(block, "cars", "cars")
    configuration = json.loads((folder / "cars.json").read_text())
    sensors, pairing = configuration["input"]["sensors"], configuration["input"]["pairing"]
    assert len(pairing) == 3 and {name for pair in pairing for name in pair} == set(sensors)
    for name, sensor in sensors.items():
        assert gdal_rpc(folder / sensor["image"]) == gdal_rpc(block / "result" / f"{name}.tif")
        assert gdal_rpc(folder / sensor["image"]) != gdal_rpc(block / "made" / f"{name}.tif")
    # ellipsoidal in and out: no geoid of CARS's own
    assert configuration["input"]["initial_elevation"] == {"dem": "dem.tif", "geoid": None}
    assert configuration["output"]["geoid"] is False
    assert report["commands"] == [f"cd {folder}", "cars cars.json"]


def compare_with_truth(block: Path, folder: Path) -> np.ndarray:
    """Return the initial DEM's heights less the true ones, at its nodes where these are known."""
    truth = open_dem(str(block / "made" / "dem.tif"), "ellipsoidal")
    dem = gdal.Open(str(folder / "dem.tif"))
    left, dx, _, top, _, dy = dem.GetGeoTransform()
    rows, columns = np.mgrid[: dem.RasterYSize, : dem.RasterXSize]
    lonlat = np.column_stack([left + dx * (columns.ravel() + 0.5), top + dy * (rows.ravel() + 0.5)])
    heights = dem.ReadAsArray().ravel()
    assert np.isfinite(heights).all()
    known = surface_heights(truth, lonlat)
    return (heights - known)[np.isfinite(known)]


def test_initial_dem_of_tie_points_is_near_the_true_terrain(block):
    folder, _ = hand_over(block, "cars", "terrain")
    # 60 tie points on a relief of 40 m tell it to a fraction of that; an undulation of the geoid would be about 50 m
    assert np.median(np.abs(compare_with_truth(block, folder))) < 8.0


def test_given_dem_comes_in_ellipsoidal_heights(block):
    difference = {}
    for datum in ("egm96", "ellipsoidal"):
        folder, _ = hand_over(block, "s2p", datum, dem=str(block / "made" / "dem.tif"), height_datum=datum)
        difference[datum] = compare_with_truth(block, folder)
    assert np.abs(difference["ellipsoidal"]).max() < 0.01  # the same grid, resampled
    undulation = np.median(difference["egm96"])
    assert abs(undulation) > 1.0 and np.abs(difference["egm96"] - undulation).max() < 0.1


def test_s2p_project_of_a_region(block):
    middle = read_rpc(str(block / "result" / "image_2.tif")).rpc.localize(np.array([[120.0, 120.0]]), 200.0).ground[0]
    extent = f"{middle[0] - 3e-4},{middle[1] - 2e-4},{middle[0] + 3e-4},{middle[1] + 2e-4}"
    folder, report = hand_over(block, "s2p", "s2p", extent=extent, link=True)
    configuration = json.loads((folder / "s2p.json").read_text())
    images, roi = configuration["images"], configuration["roi"]
    assert len(images) == 3 and configuration["exogenous_dem_geoid_mode"] is False
    reference = folder / images[0]["img"]
    # the region's corners at the terrain's heights lie in the window, by GDAL's own RPC transformer
    heights = gdal.Open(str(folder / "dem.tif")).ReadAsArray()
    west, south, east, north = map(float, extent.split(","))
    ground = [[lon, lat, float(np.median(heights))] for lon in (west, east) for lat in (south, north)]
    transformer = gdal.Transformer(gdal.Open(str(reference)), None, ["METHOD=RPC"])
    xy = np.array(transformer.TransformPoints(1, ground)[0])[:, :2]
    slack = 40.0 * np.tan(np.radians(13.0)) / 0.5  # the relief, seen under 13 degrees
    assert (xy[:, 0] > roi["x"] - slack).all() and (xy[:, 0] < roi["x"] + roi["w"] + slack).all()
    assert (xy[:, 1] > roi["y"] - slack).all() and (xy[:, 1] < roi["y"] + roi["h"] + slack).all()
    assert 0 < roi["w"] < 240 and 0 < roi["h"] < 240
    assert report["expected"] == str(folder / "out/dsm.tif")


def test_a_block_without_pixels_and_one_without_refined_rpcs_are_refused(hobart_result, block, tmp_path):
    with pytest.raises(InputError, match="no pixels"):
        run("hand-over", result=str(hobart_result), to="cars", output_dir=str(tmp_path / "a"))
    assert not (tmp_path / "a").exists()
    empty = tmp_path / "copy"
    empty.mkdir()
    for name in ("block.json", "block.gpkg", "report.json"):
        (empty / name).write_bytes((block / "result" / name).read_bytes())
    report = json.loads((empty / "report.json").read_text())
    report["images"] = {}
    (empty / "report.json").write_text(json.dumps(report))
    with pytest.raises(InputError, match="no refined RPC of image_1"):
        run("hand-over", result=str(empty), to="cars", output_dir=str(tmp_path / "b"))


def test_pairs_by_convergence_sun_season_and_similarity():
    def pair(first, second, angle):
        return PairGeometry(first, second, (0.9, 0.8), angle, 2.0 * np.tan(np.radians(angle) / 2.0))

    summer, winter = datetime(2021, 7, 1), datetime(2021, 1, 5)
    names = "ABCD"
    incidence = dict(zip(names, (1.0, 12.0, 13.0, 30.0), strict=True))
    ties = {"A": {"1", "2", "3", "4"}, "B": {"1", "2", "3"}, "C": {"1", "2", "3"}, "D": {"4"}}
    pairs = [pair("B", "A", 12.0), pair("A", "C", 12.0), pair("A", "D", 50.0), pair("B", "C", 1.0)]
    suns: dict[str, SunAngles | None] = dict.fromkeys(names, SunAngles(150.0, 60.0))
    times: dict[str, datetime | None] = dict.fromkeys(names, summer)
    found = choose_stereo_pairs(pairs, incidence, suns, times, ties, 8)
    assert [(one.left, one.right) for one in found] == [("A", "B"), ("A", "C")]  # 50 and 1 degrees are of no use
    # full convergence; the smaller overlap; 3 common points of 4 and 3
    assert found[0].score == pytest.approx(0.8 * 3 / np.sqrt(12))
    # half a year and another sun: the pair comes last, and is left out below a quarter of the best
    times["C"], suns["C"] = winter, SunAngles(165.0, 25.0)
    found = choose_stereo_pairs(pairs, incidence, suns, times, ties, 8)
    assert [one.right for one in found] == ["B"]
    assert choose_stereo_pairs(pairs, incidence, suns, times, ties, 1)[0].height_sigma_m(0.5) == pytest.approx(
        0.25 * 0.5 / (2.0 * np.tan(np.radians(6.0)))
    )
