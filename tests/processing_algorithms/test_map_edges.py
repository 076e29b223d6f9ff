"""Scenes at the edges of the map and of the heights, through the command line: simulated, adjusted, rectified, shown.

The truth is the simulator's cameras: the refined RPCs must see the true points where these do, and layers and
orthoimages must have the scene's own extent, not that of a map torn apart.
"""

import csv
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from gdal_files import write_raster
from long_tests import mark_beyond
from osgeo import gdal, ogr, osr

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.processing_algorithms.command_line import cli

SIZE = 320
NOISE_PX = 0.02
RIGHT_PX = 0.1


class Place(NamedTuple):
    """Where a scene lies, how high, and the maps that may be chosen there: one, or two at a border of zones."""

    lon: float
    lat: float
    height_m: float
    maps: tuple[int, ...]


PLACES = {
    "180": Place(180.0, -17.0, 100.0, (32701, 32760)),
    "88 N": Place(20.0, 88.0, 50.0, (5041,)),
    "west of 180": Place(179.9995, -17.0, 100.0, (32760, 32701)),
    "east of 180": Place(-179.9995, 65.0, 100.0, (32601, 32660)),
    "88 S": Place(-140.0, -88.0, 2800.0, (5042,)),
    "31V": Place(2.99, 60.0, 80.0, (32631,)),
    "32V": Place(4.5, 61.0, 80.0, (32632,)),
    "31X": Place(8.98, 78.0, 100.0, (32631,)),
    "33X": Place(9.02, 78.0, 100.0, (32633,)),
    "west of a zone's border": Place(5.9997, 45.0, 100.0, (32631, 32632)),
    "east of a zone's border": Place(6.0003, 45.0, 100.0, (32632, 32631)),
    "equator": Place(10.0, 0.0, 100.0, (32632, 32732)),
    "5000 m": Place(90.2, 30.0, 5000.0, (32646,)),
    "-400 m": Place(35.5, 31.5, -400.0, (32636,)),
}


def hrsi(*words: object, code: int = 0) -> None:
    assert cli.main([*map(str, words), "--quiet"]) == code


def image_files(folder: Path, ending: str = ".tif") -> list[Path]:
    return [folder / f"image_{number}{ending}" for number in (1, 2)]


def simulate(folder: Path, lon: float, lat: float, height_m: float) -> Path:
    hrsi("simulate", "--lon", lon, "--lat", lat, "--height", height_m, "--relief", 30, "--size", SIZE, "--gcps", 6,
         "--checks", 15, "--ties", 60, "--noise-image", NOISE_PX, "--noise-gcp-xy", 0.01, "--noise-gcp-h", 0.01,
         "--output-dir", folder)  # fmt: skip
    return folder


def layers_of(file: Path) -> dict[str, tuple[int, np.ndarray]]:
    """Return EPSG code and extent (west, south, east, north) of every layer with geometry."""
    dataset, found = ogr.Open(str(file)), {}
    for layer in (dataset.GetLayer(index) for index in range(dataset.GetLayerCount())):
        if layer.GetGeomType() != ogr.wkbNone and layer.GetFeatureCount():
            west, east, south, north = layer.GetExtent()
            code = int(layer.GetSpatialRef().GetAuthorityCode(None))
            found[layer.GetName()] = code, np.array([west, south, east, north])
    return found


def extent_m(code: int, extent: np.ndarray, lat: float) -> float:
    """Return the larger side of an extent on the ground."""
    sides = extent[2:] - extent[:2]
    if code in (4326, 4979):
        sides = sides * 111_195.0 * np.array([np.cos(np.radians(lat)), 1.0])
    return float(sides.max())


@pytest.fixture(scope="module", params=mark_beyond(1, "rendered", PLACES))
def place(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Place, Path]:
    """A scene with everything that is made of it."""
    chosen = PLACES[request.param]
    folder = tmp_path_factory.mktemp("place")
    scene = simulate(folder / "scene", *chosen[:3])
    hrsi("rpc-info", *image_files(scene), "--dem", scene / "dem.tif", "--output-dir", folder / "info")
    hrsi("triangulate", *image_files(scene), "--tie-points", "none", "--image-points", scene / "image_points.csv",
         "--gcps", scene / "ground_points.csv", "--model", "affine", "--output-dir", folder / "block")  # fmt: skip
    hrsi("orthorectify", *image_files(folder / "block"), "--dem", scene / "dem.tif", "--output-dir", folder / "ortho",
         "--format", "gtiff")  # fmt: skip
    hrsi("ortho-check", *image_files(folder / "ortho", "_ortho.tif"), "--output-dir", folder / "check")
    return chosen, folder


def test_the_refined_cameras_see_true_points_where_they_are(place: tuple[Place, Path]) -> None:
    _, folder = place
    truth = json.loads((folder / "scene" / "truth.json").read_text())
    points = truth["ground_points"]
    for image in image_files(folder / "block"):
        seen = [(points[name]["ground"], xy) for name, on, *xy in truth["image_points"] if on == image.stem]
        ground, true = (np.array(part) for part in zip(*seen, strict=True))
        away = np.linalg.norm(open_image(str(image)).rpc.project(ground) - true, axis=1)
        assert len(away) > 50
        assert np.sqrt(np.mean(away**2)) < RIGHT_PX


def test_layers_have_the_extent_of_the_scene(place: tuple[Place, Path]) -> None:
    chosen, folder = place
    files = [
        folder / "info" / "rpc_info.gpkg",
        folder / "block" / "block.gpkg",
        folder / "check" / "misregistration.gpkg",
    ]
    for file in files:
        for name, (code, extent) in layers_of(file).items():
            assert 80.0 < extent_m(code, extent, chosen.lat) < 450.0, (
                file.name,
                name,
                extent,
            )  # 320 px of 0.7 m, oblique
            if name.endswith("_utm"):
                assert code in chosen.maps


def test_all_layers_of_a_file_lie_on_one_another(place: tuple[Place, Path]) -> None:
    """On one side of 180 degrees, whichever: not a turn apart."""
    layers = layers_of(place[1] / "block" / "block.gpkg")
    images = layers["images"][1]
    for name in ("ground_points", "image_points", "residuals_wgs84"):
        west, south, east, north = layers[name][1]
        assert images[0] < west < east < images[2], name
        assert images[1] < south < north < images[3], name


def test_orthoimages_lie_on_the_map_of_the_place_and_on_one_another(place: tuple[Place, Path]) -> None:
    chosen, folder = place
    for image in image_files(folder / "ortho", "_ortho.tif"):
        dataset = gdal.Open(str(image))
        assert int(dataset.GetSpatialRef().GetAuthorityCode(None)) in chosen.maps
        assert max(dataset.RasterXSize, dataset.RasterYSize) < 2 * SIZE
        middle = gdal.ApplyGeoTransform(dataset.GetGeoTransform(), dataset.RasterXSize / 2, dataset.RasterYSize / 2)
        wgs84, own = osr.SpatialReference(), dataset.GetSpatialRef()
        wgs84.ImportFromEPSG(4326)
        for reference in (wgs84, own):
            reference.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
        lon, lat, _ = osr.CoordinateTransformation(own, wgs84).TransformPoint(*middle)
        assert lat == pytest.approx(chosen.lat, abs=1e-3)
        assert (lon - chosen.lon + 180.0) % 360.0 - 180.0 == pytest.approx(
            0.0, abs=1e-3 / np.cos(np.radians(chosen.lat))
        )
    report = json.loads((folder / "check" / "report.json").read_text())
    (pair,) = report["pairs"]
    assert abs(pair["after"]["median_dx_px"]) < RIGHT_PX
    assert abs(pair["after"]["median_dy_px"]) < RIGHT_PX


# ---- neighbours of the meridian of 180 degrees ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def date_line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("line") / "scene", 180.0, -17.0, 100.0)


def test_orthoimages_in_degrees_go_on_beyond_180(date_line: Path, tmp_path: Path) -> None:
    hrsi("orthorectify", *image_files(date_line), "--dem", date_line / "dem.tif", "--crs", "EPSG:4326", "--output-dir",
         tmp_path, "--format", "gtiff")  # fmt: skip
    dataset = gdal.Open(str(tmp_path / "image_1_ortho.tif"))
    west, step = dataset.GetGeoTransform()[:2]
    assert 179.99 < west < 180.0 < west + step * dataset.RasterXSize < 180.01
    assert (dataset.ReadAsArray() > 0).mean() > 0.6  # the image lies turned in its frame


@pytest.mark.parametrize("turns", mark_beyond(1, "thorough", [-360.0, 360.0]))
def test_gcps_a_turn_away_are_the_same(date_line: Path, tmp_path: Path, turns: float) -> None:
    with open(date_line / "ground_points.csv", newline="") as file:
        rows = list(csv.reader(file))
    lon = rows[0].index("lon")
    for row in rows[1:]:
        row[lon] = repr(float(row[lon]) + turns)
    (tmp_path / "turned.csv").write_text("\n".join(map(",".join, rows)))
    found = []
    for number, gcps in enumerate((date_line / "ground_points.csv", tmp_path / "turned.csv")):
        hrsi("adjust", *image_files(date_line), "--image-points", date_line / "image_points.csv", "--gcps", gcps,
             "--output-dir", tmp_path / str(number), "--write", "none")  # fmt: skip
        found.append(json.loads((tmp_path / str(number) / "report.json").read_text())["check"]["rmse_sample_px"])
    assert found[1] == pytest.approx(found[0], abs=1e-6)


def test_no_longitudes_are_three_turns_away(date_line: Path, tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "metres.csv").write_text("id,lon,lat,height\nA,543210,-17,3\nB,543211,-17,3\n")
    hrsi("adjust", *image_files(date_line), "--image-points", date_line / "image_points.csv", "--gcps",
         tmp_path / "metres.csv", "--output-dir", tmp_path / "out", code=2)  # fmt: skip
    assert "no degrees" in capsys.readouterr().err


def global_dem(path: Path, west: float, columns: int = 720) -> str:
    """A DEM round the whole Earth: 100 m, but for what depends on the longitude."""
    step = 360.0 / columns
    lon = np.radians(west + step * (np.arange(columns) + 0.5))
    heights = np.tile(100.0 + 80.0 * np.sin(2.0 * lon), (columns // 2, 1)).astype(np.float32)
    return write_raster(path, heights, (west, step, 0.0, 90.0, 0.0, -step), "EPSG:4979")


@pytest.mark.parametrize("west", mark_beyond(1, "thorough", [-180.0, 0.0]))
@pytest.mark.parametrize("lon", mark_beyond(1, "thorough", [180.0, 0.0]))
def test_a_dem_round_the_earth_has_no_edge(tmp_path: Path, west: float, lon: float) -> None:
    """Heights at 0 and 180 are interpolated between the last and the first column."""
    scene = simulate(tmp_path / "scene", lon, -17.0, 100.0)
    dem = global_dem(tmp_path / "dem.tif", west)
    hrsi("rpc-info", *image_files(scene), "--dem", dem, "--output-dir", tmp_path / "info")
    report = json.loads((tmp_path / "info" / "report.json").read_text())
    assert report["warnings"] == []
    for image in report["images"].values():
        assert image["height_m"] == pytest.approx(100.0 + 80.0 * np.sin(2.0 * np.radians(image["lon"])), abs=0.1)


@pytest.mark.wrong_inputs
def test_a_dem_on_the_other_side_of_the_earth_is_told_at_once(date_line: Path, tmp_path: Path, capsys: Any) -> None:
    """Rays at the meridian opposite to a DEM do not lie a turn of its cells wide."""
    scene = simulate(tmp_path / "scene", 0.0, -17.0, 100.0)
    hrsi("rpc-info", *image_files(scene), "--dem", date_line / "dem.tif", code=1)
    assert "has no position on the terrain (outside)" in capsys.readouterr().err


def test_points_at_180_that_are_the_same_point_count_once(date_line: Path, tmp_path: Path) -> None:
    """2 cm apart across the date line: the same id may stand in two files."""
    (tmp_path / "a.csv").write_text("id,lon,lat,height\nA,179.9999999,-17,100\nG,179.9995,-17.0001,100\n")
    (tmp_path / "b.csv").write_text("id,lon,lat,height\nA,-179.9999999,-17,100\n")
    (tmp_path / "xy.csv").write_text("id,image,sample,line\nA,image_1,160,160\nA,image_2,160,160\nG,image_1,90,90\n")
    hrsi("adjust", *image_files(date_line), "--gcps", f"{tmp_path / 'a.csv'};{tmp_path / 'b.csv'}", "--image-points",
         tmp_path / "xy.csv", "--output-dir", tmp_path / "out", "--write", "none", "--no-report",
         code=3)  # fmt: skip
