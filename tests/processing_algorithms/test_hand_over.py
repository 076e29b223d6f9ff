"""`hand-over`: projects read again by the rules of the programs that they are for, and the pairs that are chosen."""

import json
import struct
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyproj
import pytest
from long_tests import mark_beyond
from osgeo import gdal

from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.block.imaging_geometry import PairGeometry
from hrsi.hrsi_engine.block.stereo_pairs import choose_stereo_pairs
from hrsi.hrsi_engine.camera.perspective import fit_perspective_camera
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.sun import SunAngles
from hrsi.hrsi_engine.io.geopackage.layer_tables import read_layer_table
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.projects import PROJECT_PLANNERS
from hrsi.hrsi_engine.io.projects.views import CropView, PerspectiveView, write_shear
from hrsi.hrsi_engine.io.rasters.cropping import CropWindow
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.declarations.rpcs import NEXT_PROGRAMS


def simulate(made: Path, **options: object) -> None:
    run(
        "simulate", sensor="pleiades", images=3, along="-12,0,12", size=240, gcps=6, checks=4, ties=60, relief=40.0,
        seed=3, output_dir=str(made), **options,
    )  # fmt: skip


def adjust(made: Path, result: Path, **options: object) -> None:
    given = {"gcps": str(made / "ground_points.csv"), "image_points": str(made / "image_points.csv"),
             "height_datum": "ellipsoidal", "report": False}  # fmt: skip
    images = [str(made / f"image_{number}.tif") for number in (1, 2, 3)]
    run("adjust", images=images, output_dir=str(result), **given | options)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated block of three images with pixels, adjusted."""
    folder = tmp_path_factory.mktemp("block")
    simulate(folder / "made")
    adjust(folder / "made", folder / "result")
    return folder


def hand_over(block: Path, target: str, name: str, **options: object) -> tuple[Path, dict]:
    folder = block / name
    report = run("hand-over", result=str(block / "result"), to=target, output_dir=str(folder), **options)
    return folder, report


def gdal_rpc(path: Path) -> dict[str, str]:
    return gdal.Open(str(path)).GetMetadata("RPC")


@pytest.mark.thorough
def test_images_without_jitter_are_handed_over_where_they_were_written(tmp_path):
    """Images that were copied have their jitter still: a warning says so."""
    made, result, folder = tmp_path / "made", tmp_path / "without_jitter", tmp_path / "s2p_without_jitter"
    simulate(made, jitter="2,100")
    for write, place, told in (("copy", tmp_path / "shaken", True), ("resampled", result, False)):
        adjust(made, place, jitter="40", write=write)
        report = run("hand-over", result=str(place), to="s2p", output_dir=str(folder), overwrite=True)
        assert any("the images contain jitter" in warning for warning in report["warnings"]) == told
    for name in ("image_1.tif", "image_2.tif"):
        handed, without, shaken = (gdal.Open(str(place / name)).ReadAsArray() for place in (folder, result, made))
        assert np.array_equal(handed, without) and not np.array_equal(handed, shaken), name


def test_every_target_is_declared():
    assert tuple(PROJECT_PLANNERS) == NEXT_PROGRAMS


def test_cars_project(block):
    folder, report = hand_over(block, "cars", "cars")
    configuration = json.loads((folder / "cars.json").read_text())
    sensors, pairing = configuration["input"]["sensors"], configuration["input"]["pairing"]
    assert len(pairing) == 3 and {name for pair in pairing for name in pair} == set(sensors)
    for name, sensor in sensors.items():
        assert gdal_rpc(folder / sensor["image"]) == gdal_rpc(block / "result" / f"{name}.tif")
        assert gdal_rpc(folder / sensor["image"]) != gdal_rpc(block / "made" / f"{name}.tif")
    # no geoid of CARS's own, and no surface of tie points below its epipolar grids
    assert set(configuration["input"]) == {"sensors", "pairing"}
    assert configuration["output"]["geoid"] is False
    assert report["commands"] == [f"cd {folder}", "cars cars.json"]


def compare_with_truth(block: Path, folder: Path) -> np.ndarray:
    """Return the initial DEM's heights less the true ones, at its nodes in the area where these are known."""
    truth = open_dem(str(block / "made" / "dem.tif"), "ellipsoidal")
    dem = gdal.Open(str(folder / "dem.tif"))
    left, dx, _, top, _, dy = dem.GetGeoTransform()
    rows, columns = np.mgrid[: dem.RasterYSize, : dem.RasterXSize]
    lonlat = np.column_stack([left + dx * (columns.ravel() + 0.5), top + dy * (rows.ravel() + 0.5)])
    heights = dem.ReadAsArray().ravel()
    assert np.isfinite(heights).all()
    west, south, east, north = json.loads((folder / "report.json").read_text())["area"]
    inside = (lonlat > [west, south]).all(axis=1) & (lonlat < [east, north]).all(axis=1)
    known = np.where(inside, surface_heights(truth, lonlat), np.nan)
    return (heights - known)[np.isfinite(known)]


def test_initial_dem_of_tie_points_is_near_the_true_terrain(block):
    folder, _ = hand_over(block, "s2p", "terrain")
    # 60 tie points on a relief of 40 m tell it to a fraction of that; an undulation of the geoid would be about 50 m
    assert np.median(np.abs(compare_with_truth(block, folder))) < 8.0


def test_initial_dem_reaches_beyond_the_images_without_a_step(block):
    """A quarter of the extent and 0.02 degrees around the images, all of it at heights of the terrain."""
    folder, report = hand_over(block, "s2p", "margin")
    dem = gdal.Open(str(folder / "dem.tif"))
    left, dx, _, top, _, dy = dem.GetGeoTransform()
    west, south, east, north = report["area"]
    wide, high = 0.25 * (east - west) + 0.02, 0.25 * (north - south) + 0.02
    right, bottom = left + dx * dem.RasterXSize, top + dy * dem.RasterYSize
    assert left < west - wide and right > east + wide and bottom < south - high and top > north + high
    # all nodes have heights of this terrain, none is 0
    known = read_layer_table(str(block / "result" / "block.gpkg"), "ground_points")["height"]
    assert dem.GetRasterBand(1).GetNoDataValue() is not None
    assert np.abs(dem.ReadAsArray() - known.mean()).max() < 1.5 * np.abs(known - known.mean()).max()


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


def test_pairs_under_one_sun_come_first_and_those_of_one_pass_stay():
    """Shadows of the morning and of the afternoon are other objects; half an hour moves them by a few degrees."""
    incidence = dict(zip("ABCD", (1.0, 12.0, 13.0, 14.0), strict=True))
    pairs = [PairGeometry("A", other, (0.9, 0.9), 15.0, 0.26) for other in "BCD"]
    suns = {name: SunAngles(azimuth, 45.0) for name, azimuth in zip("ABCD", (120.0, 240.0, 128.0, 120.0), strict=True)}
    found = choose_stereo_pairs(pairs, incidence, suns, dict.fromkeys("ABCD"), {}, 8)
    assert [one.right for one in found[:2]] == ["D", "C"]
    assert all(one.score < 0.5 * found[0].score for one in found[2:])


def evaluate_rpcm(rpc: dict, ground: np.ndarray) -> np.ndarray:
    """Return sample, line (n, 2) by the RPC's definition (NGA STDI-0002, RPC00B), from the names of `rpcm`."""
    P, L, H = (
        (ground[:, axis] - rpc[f"{name}_offset"]) / rpc[f"{name}_scale"]
        for axis, name in ((1, "lat"), (0, "lon"), (2, "alt"))
    )
    one = np.ones_like(P)
    terms = np.array([
        one, L, P, H, L * P, L * H, P * H, L * L, P * P, H * H, P * L * H, L**3, L * P * P, L * H * H, L * L * P, P**3,
        P * H * H, L * L * H, P * P * H, H**3,
    ])  # fmt: skip
    return np.column_stack([
        np.array(rpc[f"{axis}_num"]) @ terms / (np.array(rpc[f"{axis}_den"]) @ terms) * rpc[f"{axis}_scale"]
        + rpc[f"{axis}_offset"]
        for axis in ("col", "row")
    ])  # fmt: skip


def read_adjusted(block: Path) -> tuple[dict, dict]:
    """Return the adjusted ground points, and residuals (sample, line) by image and point."""
    told, ground = (
        read_layer_table(str(block / "result" / "block.gpkg"), name) for name in ("image_points", "ground_points")
    )
    columns = (told[name] for name in ("image", "id", "residual_sample_px", "residual_line_px"))
    return ground, {(image, name): (dx, dy) for image, name, dx, dy in zip(*columns, strict=True)}


@pytest.mark.parametrize("factor", [1.0, 0.5, 0.37])
def test_views_reproject_tie_points_to_the_adjusted_residuals(block, factor):
    """After crop and scale: the view's RPC misses its keypoints by the adjustment's residuals, in the crop's pixels."""
    folder, _ = hand_over(block, "nerf", f"nerf_{factor}", factor=factor)
    ground, residual = read_adjusted(block)
    position = {name: row for row, name in enumerate(ground["id"])}
    lonlat = np.column_stack([ground[name] for name in ("lon", "lat", "height")])
    points = np.load(folder / "pts3d.npy")
    for number in (1, 2, 3):
        view = json.loads((folder / f"image_{number}.json").read_text())
        crop = gdal.Open(str(folder / view["img"]))
        assert (crop.RasterXSize, crop.RasterYSize) == (view["width"], view["height"])
        rows = np.array(view["keypoints"]["pts3d_indices"])
        ties = ground["role"][rows] == "tie"
        keypoints, rows = np.array(view["keypoints"]["2d_coordinates"])[ties], rows[ties]
        assert len(rows) > 20
        names = [ground["id"][row] for row in rows]
        xyz = np.array(pyproj.Transformer.from_crs(4979, 4978, always_xy=True).transform(*lonlat[rows].T)).T
        np.testing.assert_allclose(points[rows], xyz, atol=1e-6)
        expected = np.array([residual[f"image_{number}", name] for name in names])
        scale = np.array([view["width"], view["height"]]) / view["window"][2:]
        found = keypoints - evaluate_rpcm(view["rpc"], lonlat[[position[name] for name in names]])
        assert np.abs(found - expected * scale).max() < 1e-3
        assert view["min_alt"] < lonlat[rows, 2].min() and view["max_alt"] > lonlat[rows, 2].max()
    listed = [(folder / name).read_text().split() for name in ("train.txt", "test.txt")]
    assert sorted(listed[0] + listed[1]) == ["image_1.json", "image_2.json", "image_3.json"] and len(listed[1]) == 1


def read_colmap(folder: Path) -> tuple[dict, dict, dict]:
    """Return cameras, images and points of a COLMAP text model, by https://colmap.github.io/format.html."""
    lines = {
        name: [line for line in (folder / f"{name}.txt").read_text().splitlines() if not line.startswith("#")]
        for name in ("cameras", "images", "points3D")
    }
    cameras = {int(words[0]): words[1:] for words in map(str.split, lines["cameras"])}
    points = {int(words[0]): words[1:] for words in map(str.split, lines["points3D"])}
    images = {}
    for pose, seen in zip(lines["images"][::2], lines["images"][1::2], strict=True):
        number, *numbers, camera, name = pose.split()
        xy = np.array(seen.split(), float).reshape(-1, 3)
        images[int(number)] = (np.array(numbers, float), int(camera), name, xy)
    return cameras, images, points


@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_colmap_project(block, factor):
    """The model's cameras see its points at their measurements, off by the adjusted residuals and the stated error."""
    folder, report = hand_over(block, "colmap", f"colmap_{factor}", factor=factor)
    cameras, images, points = read_colmap(folder)
    assert sorted(cameras) == sorted(images) == [1, 2, 3]
    ground, residual = read_adjusted(block)
    for number, (pose, camera, name, xy) in images.items():
        w, x, y, z, *t = pose
        rotation = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-12)
        model, width, height, fx, fy, cx, cy = cameras[camera]
        assert model == "PINHOLE"
        png = gdal.Open(str(folder / name))
        assert (png.RasterXSize, png.RasterYSize) == (int(width), int(height))
        ids = xy[:, 2].astype(int)
        position = np.array([points[one][:3] for one in ids], float)
        seen = position @ rotation.T + t
        assert (seen[:, 2] > 2e5).all()
        projected = seen[:, :2] / seen[:, 2:] * [float(fx), float(fy)] + [float(cx), float(cy)]
        error = report["perspective"][name.removesuffix(".png")]
        assert error["max_px"] < 0.25  # well below what matching resolves
        ties = ground["role"][ids - 1] == "tie"  # residuals of GCPs are those of their surveyed positions
        left = np.array([residual[name.removesuffix(".png"), ground["id"][one - 1]] for one in ids])
        allowed = np.hypot(*left.T) * factor
        assert (np.hypot(*(projected - xy[:, :2]).T) < allowed + error["max_px"] + 1e-3)[ties].all()
        for row, one in enumerate(ids):  # the track leads back
            track = np.array(points[one][7:], int).reshape(-1, 2).tolist()
            assert [number, row] in track
    # the frame: geocentric distances are kept
    place = np.array([points[one + 1][:3] for one in range(len(ground["id"]))], float)
    xyz = np.array(
        pyproj.Transformer.from_crs(4979, 4978, always_xy=True).transform(
            *(ground[k] for k in ("lon", "lat", "height"))
        )
    ).T
    np.testing.assert_allclose(
        np.linalg.norm(place - place[0], axis=1), np.linalg.norm(xyz - xyz[0], axis=1), rtol=1e-9, atol=1e-5
    )


def test_images_of_a_skewed_camera_are_sheared(block):
    """A grey ramp along the lines ends up where the sheared camera has it."""
    camera = fit_perspective_camera(*_skewed_camera())
    assert camera.shear == pytest.approx(0.04, rel=1e-3)
    local, xy, _ = _skewed_camera()
    np.testing.assert_allclose(camera.project(local), camera.shear_points(xy), atol=2e-3)
    ramp = np.tile(np.arange(200.0), (100, 1)).astype(np.float32)
    path = block / "ramp.tif"
    made = gdal.GetDriverByName("GTiff").Create(str(path), 200, 100, 1, gdal.GDT_Float32)
    made.WriteRaster(0, 0, 200, 100, ramp.tobytes())
    del made
    rpc = read_rpc(str(block / "result" / "image_1.tif")).rpc
    shown = Image("ramp", rpc, (200, 100), str(path), ArrayRaster(ramp))
    left = np.floor(camera.shear_points(np.array([[-0.5, 99.5], [-0.5, -0.5]]))[:, 0].min())
    view = CropView(shown, rpc, CropWindow((0, 0, 200, 100), (200, 100)), np.zeros((0, 2)), np.zeros(0, int))
    write_shear(PerspectiveView(view, camera.begin_at(left), (210, 100), (0.0, 0.0)), str(block / "ramp.png"))
    grey = gdal.Open(str(block / "ramp.png")).ReadAsArray()
    low, high = np.percentile(ramp, (1, 99))
    for line in (5, 50, 94):
        at = camera.begin_at(left).shear_points(np.array([[100.0, line]]))[0, 0]
        expected = (100.0 - low) / (high - low) * 255.0
        assert np.interp(at, np.arange(210), grey[line]) == pytest.approx(expected, abs=1.0)  # 8 bit


def _skewed_camera() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ground points, and pixels of a camera 600 km above whose rows have a skew of 0.04."""
    east, north, up = np.meshgrid(np.linspace(-50, 50, 7), np.linspace(-25, 25, 7), np.linspace(-40, 40, 3))
    local = np.column_stack([east.ravel(), north.ravel(), up.ravel()])
    depth = (6e5 - local[:, 2]) / 6e5
    x, y = 2.0 * local[:, 0] / depth + 100.0, -2.0 * local[:, 1] / depth + 50.0
    return local, np.column_stack([x + 0.04 * (y - 50.0), y]), np.array([0.0, 0.0, -1.0])


def test_asp_project(block):
    """Field by field by ASP's rules: RPC XML of each image, ellipsoidal DEM last, one run a pair, one mosaic."""
    folder, report = hand_over(block, "asp", "asp")
    commands = [line.split() for line in report["commands"][1:]]
    mapped = [line for line in commands if line[0] == "mapproject"]
    stereo = [line for line in commands if line[0] == "parallel_stereo"]
    assert [line[0] for line in commands] == ["mapproject"] * 3 + ["parallel_stereo", "point2dem"] * 3 + ["dem_mosaic"]
    for line in mapped:  # mapproject [options] DEM IMAGE CAMERA OUTPUT
        assert line[1:3] == ["-t", "rpc"] and line[-4] == "dem.tif" and (folder / line[-3]).exists()
        assert line[-1] == line[-2].replace(".xml", "_map.tif")
    for line in stereo:  # parallel_stereo [options] LEFT RIGHT LEFT_CAMERA RIGHT_CAMERA PREFIX DEM
        left, right, left_camera, right_camera, prefix, dem = line[-6:]
        assert line[line.index("-t") + 1] == "rpcmaprpc" and line[line.index("--alignment-method") + 1] == "none"
        assert {left, right} <= {one[-1] for one in mapped} and dem == "dem.tif"
        assert (left_camera, right_camera) == (left.replace("_map.tif", ".xml"), right.replace("_map.tif", ".xml"))
        after = commands[commands.index(line) + 1]
        assert (after[0], after[-1]) == ("point2dem", f"{prefix}-PC.tif")
        assert f"{prefix}-DEM.tif" in commands[-1]
    for number in (1, 2, 3):
        rpb = ElementTree.parse(folder / f"image_{number}.xml").getroot().find("RPB/IMAGE")
        told = gdal_rpc(block / "result" / f"image_{number}.tif")
        for tag, name in (
            ("LINEOFFSET", "LINE_OFF"), ("SAMPOFFSET", "SAMP_OFF"), ("LATOFFSET", "LAT_OFF"),
            ("LONGOFFSET", "LONG_OFF"), ("HEIGHTOFFSET", "HEIGHT_OFF"), ("LINESCALE", "LINE_SCALE"),
            ("SAMPSCALE", "SAMP_SCALE"), ("LATSCALE", "LAT_SCALE"), ("LONGSCALE", "LONG_SCALE"),
            ("HEIGHTSCALE", "HEIGHT_SCALE"),
        ):  # fmt: skip
            assert float(rpb.findtext(tag)) == pytest.approx(float(told[name]), rel=1e-14), tag
        for tag, name in (
            ("LINENUMCOEFList/LINENUMCOEF", "LINE_NUM_COEFF"), ("LINEDENCOEFList/LINEDENCOEF", "LINE_DEN_COEFF"),
            ("SAMPNUMCOEFList/SAMPNUMCOEF", "SAMP_NUM_COEFF"), ("SAMPDENCOEFList/SAMPDENCOEF", "SAMP_DEN_COEFF"),
        ):  # fmt: skip
            np.testing.assert_allclose(
                np.array(rpb.findtext(tag).split(), float), np.array(told[name].split(), float), rtol=1e-14
            )


def test_points_project(block):
    folder, _ = hand_over(block, "points", "points")
    ground = read_layer_table(str(block / "result" / "block.gpkg"), "ground_points")
    head, body = (folder / "tie_points.ply").read_bytes().split(b"end_header\n")
    rows = np.frombuffer(body, [("xyz", "<f8", 3), ("sigma", "<f4", 2), ("rays", "<i4")])
    assert f"element vertex {len(ground['id'])}" in head.decode()
    epsg = int(head.decode().split("EPSG:")[1].split(",")[0])
    east, north = pyproj.Transformer.from_crs(4326, epsg, always_xy=True).transform(ground["lon"], ground["lat"])
    np.testing.assert_allclose(rows["xyz"], np.column_stack([east, north, ground["height"]]), atol=1e-4)
    np.testing.assert_allclose(rows["rays"], ground["rays"])
    # the GCPs come back from ASP's file as they were surveyed
    known = read_points(str(folder / "gcps.gcp")).ground
    table = np.genfromtxt(block / "made" / "ground_points.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    surveyed = {row["id"]: (row["lon"], row["lat"], row["height"]) for row in table}
    assert len(known) == 10
    for name, place in zip(known.ids.tolist(), known.ground, strict=True):
        np.testing.assert_allclose(place, surveyed[name], atol=1e-4)
    las = (folder / "tie_points.las").read_bytes()  # by the tables of the LAS 1.4 specification
    assert las[:4] == b"LASF" and las[24:26] == bytes([1, 4])
    first, records, form, length = struct.unpack_from("<IIBH", las, 96)
    assert (records, form, struct.unpack_from("<Q", las, 247)[0]) == (2, 6, len(rows))
    scale, offset = np.array(struct.unpack_from("<3d", las, 131)), np.array(struct.unpack_from("<3d", las, 155))
    points = np.array([struct.unpack_from("<3i", las, first + length * row) for row in range(len(rows))])
    np.testing.assert_allclose(points * scale + offset, rows["xyz"], atol=0.00051)
    laspy = pytest.importorskip("laspy")
    cloud = laspy.read(folder / "tie_points.las")
    np.testing.assert_allclose(np.column_stack([cloud.x, cloud.y, cloud.z]), rows["xyz"], atol=0.00051)
    np.testing.assert_array_equal(np.column_stack([cloud["sigma_plan"], cloud["sigma_height"]]), rows["sigma"])
    np.testing.assert_array_equal(cloud["rays"], rows["rays"])
    assert f"EPSG:{epsg}" in cloud.header.parse_crs().to_wkt()


def test_a_block_without_gcps_is_handed_over(block, tmp_path):
    free = {"gcps": None, "image_points": None, "tie_points": str(block / "made" / "image_points.csv")}
    adjust(block / "made", tmp_path / "result", **free)
    report = run("hand-over", result=str(tmp_path / "result"), to="points", output_dir=str(tmp_path / "out"))
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"report.json", "tie_points.las", "tie_points.ply"}
    assert report["warnings"] == []


def test_gcps_for_gdal_and_qgis(block, tmp_path):
    """GDAL takes its file as it stands, QGIS's is read by its own rules; both have the measurements of ASP's file."""
    folder, _ = hand_over(block, "points", "gcps")
    asp = {}
    for line in (folder / "gcps.gcp").read_text().splitlines():
        words = line.replace(",", " ").split()
        for at in range(7, len(words), 5):  # id lat lon height sigmas, then image x y sigmas
            position = (float(words[2]), float(words[1]), float(words[3]))
            asp.setdefault(Path(words[at]).stem, []).append((*position, float(words[at + 1]), float(words[at + 2])))
    assert sorted(asp) == ["image_1", "image_2", "image_3"]
    for image, rows in asp.items():
        expected = np.array(sorted(rows))
        source = gdal.Open(str(block / "made" / f"{image}.tif"))
        words = (folder / f"{image}_gcps.txt").read_text().split()
        made = gdal.Translate(str(tmp_path / f"{image}.tif"), source, options=["-a_srs", "EPSG:4979", *words])
        gcps = sorted((gcp.GCPX, gcp.GCPY, gcp.GCPZ, gcp.GCPPixel - 0.5, gcp.GCPLine - 0.5) for gcp in made.GetGCPs())
        np.testing.assert_allclose(gcps, expected, atol=2e-4)  # four digits of pixels and metres
        np.testing.assert_allclose(np.array(gcps)[:, :2], expected[:, :2], atol=1e-9)
        lines = [line for line in (folder / f"{image}.points").read_text().splitlines() if not line.startswith("#")]
        assert lines[0].split(",")[:5] == ["mapX", "mapY", "pixelX", "pixelY", "enable"]
        qgis = np.array(sorted([float(value) for value in line.split(",")[:5]] for line in lines[1:]))
        np.testing.assert_allclose(qgis[:, :2], expected[:, :2], atol=1e-7)
        # from the corner, downwards negative, all of them switched on
        np.testing.assert_allclose(qgis[:, 2:4], expected[:, 3:] * [1.0, -1.0] + [0.5, -0.5], atol=2e-4)
        assert (qgis[:, 4] == 1.0).all()


@pytest.mark.parametrize("link", mark_beyond(1, "thorough", [False, True]))
@pytest.mark.parametrize("target", mark_beyond(2, "thorough", NEXT_PROGRAMS))
def test_a_dry_run_names_the_files_of_the_project(block, tmp_path, capsys, target, link):
    words = ["hand-over", str(block / "result"), "--to", target, "--output-dir", str(tmp_path / "out"), "--json"]
    words += ["--link"] * link
    assert main([*words, "--dry-run"]) == 0
    planned = json.loads(capsys.readouterr().out)["files"]
    assert not (tmp_path / "out").exists()
    assert main(words) == 0
    written = {str(path) for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {one["path"] for one in planned} == written and not any(one["replaces"] for one in planned)


def test_micmac_project(block):
    """Read as MicMac does: each tag looked up by its name, and there once."""
    folder, report = hand_over(block, "micmac", "micmac", link=True)
    assert report["warnings"] == ["MicMac reads no VRTs: the images are copied"] and not list(folder.glob("*.vrt"))
    system = ElementTree.parse(folder / "WGS84toUTM.xml").getroot().find("BSC")
    assert system.findtext("TypeCoord").strip() == "eTC_Proj4"
    assert [one.text.strip() for one in system.findall("AuxR")] == ["1", "1", "1"]
    assert pyproj.CRS(system.findtext("AuxStr").strip()).to_epsg() == report["epsg"]
    for number in (1, 2, 3):
        root = ElementTree.parse(folder / f"image_{number}.xml").getroot()
        told = gdal_rpc(block / "result" / f"image_{number}.tif")

        def unique(tag, root=root):
            (found,) = root.iter(tag)
            return found

        assert (float(unique("NUMROWS").text), float(unique("NUMCOLUMNS").text)) == (240.0, 240.0)
        for tag in ("LINE", "SAMP", "LAT", "LONG", "HEIGHT"):
            for word, short in (("OFFSET", "OFF"), ("SCALE", "SCALE")):
                assert float(unique(f"{tag}{word}").text) == pytest.approx(float(told[f"{tag}_{short}"]), rel=1e-14)
        for tag in ("LINENUM", "LINEDEN", "SAMPNUM", "SAMPDEN"):
            numbers = told[f"{tag[:4]}_{tag[4:]}_COEFF"].split()
            np.testing.assert_allclose(
                np.array(unique(f"{tag}COEF").text.split(), float), np.array(numbers, float), rtol=1e-14
            )
        assert float(unique("ERRBIAS").text) >= 0.0
        # corners by GDAL's transformer at the RPC's middle height; it counts pixels from the corner
        image = gdal.Open(str(folder / f"image_{number}.tif"))
        transformer = gdal.Transformer(image, None, ["METHOD=RPC", f"RPC_HEIGHT={told['HEIGHT_OFF']}"])
        for corner, x, y in (("UL", 0.5, 0.5), ("UR", 239.5, 0.5), ("LR", 239.5, 239.5), ("LL", 0.5, 239.5)):
            lon, lat, _ = transformer.TransformPoint(0, x, y)[1]
            band = unique("BAND_P")
            assert float(band.findtext(f"{corner}LON")) == pytest.approx(lon, abs=1e-6)
            assert float(band.findtext(f"{corner}LAT")) == pytest.approx(lat, abs=1e-6)


@pytest.fixture(scope="module")
def matched(block: Path) -> tuple[Path, list[str], list[tuple[int, int, np.ndarray]]]:
    """The block's tie points as the matches of its three pairs, in float32 as ASP keeps them."""
    told = read_layer_table(str(block / "result" / "block.gpkg"), "image_points")
    ties = told["role"] == "tie"
    xy = np.column_stack([told["sample"], told["line"]]).astype(np.float32).astype(np.float64)
    by_image = [
        {told["id"][row]: xy[row] for row in np.flatnonzero(ties & (told["image"] == f"image_{number}"))}
        for number in (1, 2, 3)
    ]
    pairs = []
    for one, two in ((0, 1), (0, 2), (1, 2)):
        shared = [name for name in by_image[one] if name in by_image[two]]
        pairs.append((one, two, np.array([[*by_image[one][name], *by_image[two][name]] for name in shared])))
    rows = [
        f"{name},image_{number + 1},{x!r},{y!r}"
        for number, points in enumerate(by_image)
        for name, (x, y) in points.items()
        if sum(name in other for other in by_image) > 1
    ]
    measured = (block / "made" / "image_points.csv").read_text().splitlines()
    known = {row.partition(",")[0] for row in (block / "made" / "ground_points.csv").read_text().splitlines()}
    on_known = [row for row in measured if row.partition(",")[0] in known]  # the header is among both
    (block / "known_points.csv").write_text("\n".join(on_known) + "\n")
    (block / "ties.csv").write_text("\n".join(["id,image,sample,line", *rows]) + "\n")
    return block, [f"image_{number}" for number in (1, 2, 3)], pairs


def write_asp_text(folder: Path, names: list[str], pairs: list) -> str:
    for one, two, xy in pairs:
        lines = [f"{a!r} {b!r} 1 {c!r} {d!r} 1" for a, b, c, d in xy.tolist()]
        (folder / f"run-{names[one]}__{names[two]}.txt").write_text("\n".join(lines) + "\n")
    return str(folder / "run-*.txt")


def write_asp_binary(folder: Path, names: list[str], pairs: list) -> str:
    """As `ip_record` of VisionWorkbench: two counts, then the records of the first image, then of the second."""
    for one, two, xy in pairs:
        content = struct.pack("<QQ", len(xy), len(xy))
        for columns in (xy[:, :2], xy[:, 2:]):
            for x, y in columns.tolist():
                content += struct.pack("<ffiifffBIIQ", x, y, int(x), int(y), 0.0, 1.0, 1.0, 0, 0, 0, 0)
        (folder / f"run-{names[one]}__{names[two]}.match").write_bytes(content)
    return str(folder / "run-*.match")


def write_sat_bundleadjust(folder: Path, names: list[str], pairs: list) -> str:
    (folder / "keypoints").mkdir()
    (folder / "filenames.txt").write_text("".join(f"/elsewhere/{name}.tif\n" for name in names))
    keypoints: list[list[tuple[float, float]]] = [[] for _ in names]
    rows = []
    for one, two, xy in pairs:
        for a, b, c, d in xy.tolist():
            for number, place in ((one, (a, b)), (two, (c, d))):
                if place not in keypoints[number]:
                    keypoints[number].append(place)
            rows.append([keypoints[one].index((a, b)), keypoints[two].index((c, d)), one, two])
    for name, places in zip(names, keypoints, strict=True):
        np.save(folder / "keypoints" / f"{name}.npy", np.column_stack([places, np.ones(len(places))]))
    np.save(folder / "matches.npy", np.array(rows))
    return str(folder / "matches.npy")


def write_homol_text(folder: Path, names: list[str], pairs: list) -> str:
    """As `ElPackHomologue::StdPutInFile` prints them, from the corner of the first pixel; each pair once."""
    for one, two, xy in pairs:
        pastis = folder / "HomolTest" / f"Pastis{names[two]}.tif"
        pastis.mkdir(parents=True, exist_ok=True)
        lines = ["%f %f %f %f %f\n" % (c, d, a, b, 1.0) for a, b, c, d in (xy + 0.5).tolist()]  # noqa: UP031
        (pastis / f"{names[one]}.tif.txt").write_text("".join(lines))
    return str(folder / "HomolTest")


def write_homol_binary(folder: Path, names: list[str], pairs: list) -> str:
    """As `ElPackHomologue` dumps them: dimension and number, then dimension, weight and points; both directions."""
    for number, (one, two, xy) in enumerate(pairs):
        order = "<>"[number % 2]
        for first, second, rows in ((one, two, xy), (two, one, np.roll(xy, 2, axis=1))):
            pastis = folder / "Homol" / f"Pastis{names[first]}.tif"
            pastis.mkdir(parents=True, exist_ok=True)
            content = struct.pack(f"{order}ii", 2, len(rows))
            for row in (rows + 0.5).tolist():
                content += struct.pack(f"{order}id4d", 2, 1.0, *row)
            (pastis / f"{names[second]}.tif.dat").write_bytes(content)
    return str(folder / "Homol")


def write_homol_files(folder: Path, names: list[str], pairs: list) -> str:
    """The same files one by one, by a wildcard."""
    return f"{write_homol_binary(folder, names, pairs)}/*/*.dat"


MATCH_WRITERS = [
    write_asp_text, write_asp_binary, write_sat_bundleadjust, write_homol_text, write_homol_binary, write_homol_files,
]  # fmt: skip


@pytest.mark.parametrize("write", mark_beyond(2, "thorough", MATCH_WRITERS))
def test_matches_of_others_adjust_as_csv(matched, tmp_path, write):
    """The refined RPCs see the block's ground at the same pixels to 1e-6 px."""
    block, names, pairs = matched
    files = {"csv": str(block / "ties.csv"), "other": write(tmp_path, names, pairs)}
    cameras = {}
    for kind, ties in files.items():
        folder = tmp_path / f"result_{kind}"
        run(
            "adjust", images=[str(block / "made" / f"{name}.tif") for name in names], tie_points=ties,
            gcps=str(block / "made" / "ground_points.csv"), image_points=str(block / "known_points.csv"),
            height_datum="ellipsoidal", hold_out=0.0, report=False, output_dir=str(folder),
        )  # fmt: skip
        cameras[kind] = [read_rpc(str(folder / f"{name}.tif")).rpc for name in names]
    for one, other in zip(cameras["csv"], cameras["other"], strict=True):
        xy = np.stack(np.meshgrid(np.linspace(0, 239, 5), np.linspace(0, 239, 5)), axis=-1).reshape(-1, 2)
        np.testing.assert_allclose(other.project(one.localize(xy, 250.0).ground), xy, atol=1e-6)


def test_adjusted_rpcs_of_sat_bundleadjust(block, tmp_path):
    rpc = read_rpc(str(block / "result" / "image_1.tif")).rpc
    write_rpc_text(str(tmp_path / "a_RPC.TXT"), rpc)
    (tmp_path / "a_RPC.TXT").rename(tmp_path / "image_1.rpc_adj")
    assert read_rpc(str(tmp_path / "image_1.rpc_adj")).rpc == rpc
