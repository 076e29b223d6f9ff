"""Coordinate operations: the same as cs2cs at every place, told with their accuracy, and nowhere else in the code."""

import ast
import csv
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
from gdal_files import write_raster
from independent_formulas import table
from osgeo import gdal
from parsed_sources import walk_sources
from scipy.stats import norm

from hrsi.hrsi_engine.adjustment import adjust
from hrsi.hrsi_engine.adjustment.options import AdjustOptions
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.adjustment.statistics.precision import CIRCLE_90, LINE_90
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.crs_operations import operations_of
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.ground.geoids import find_substitute
from hrsi.hrsi_engine.ground.operation_uses import OperationUse, list_operation_warnings, require_strict_datums
from hrsi.hrsi_engine.ground.proj_operations import without_heights
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.ortho_rasters import open_ortho, resample_to_grid
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import point_session, run
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.point_session.files import ground_points
from hrsi.tests.ground.crs_comparison import convert_by_cs2cs, horizontal_m, read_places
from hrsi.tests.laser_scenes import laser_scene
from hrsi.tests.ortho.scenes import camera, rpc_image, write_dem
from hrsi.tests.simulated_blocks import block as simulated_block
from hrsi.tests.simulated_blocks import move_surveys

ROOT = Path(__file__).resolve().parents[2]
#: Where positions may be converted: the service and the modules that serve it.
SERVICE = {"crs_operations.py", "proj_operations.py", "geoids.py"}
#: It moves the map window to the extent of a layer as QGIS draws it; no coordinate of the block comes from that.
MAP_WINDOW = {"plugin/first_steps.py"}
FORBIDDEN = {
    "Transformer",
    "TransformerGroup",
    "CoordinateTransformation",
    "TransformPoint",
    "TransformPoints",
    "itransform",
    "QgsCoordinateTransform",
}
needs_cs2cs = pytest.mark.skipif(
    shutil.which("cs2cs") is None, reason="cs2cs is not installed: apt-get install proj-bin"
)


def only_proj(folder: Path) -> dict[str, str]:
    """Return an environment in which PROJ finds the files of a folder alone, and its database there."""
    shutil.copy(Path(pyproj.datadir.get_data_dir()) / "proj.db", folder)
    return os.environ | dict.fromkeys(("PROJ_DATA", "PROJ_LIB", "PROJ_USER_WRITABLE_DIRECTORY"), str(folder))


def run_code(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python where PROJ finds the files of a folder alone."""
    words = [sys.executable, "-c", code]
    return subprocess.run(words, env=only_proj(folder), capture_output=True, text=True, check=False)


def test_nothing_else_converts_coordinates() -> None:
    found = []
    for path, node in walk_sources(FORBIDDEN):
        if path.parent.name == "ground" and path.name in SERVICE:
            continue
        forbidden = FORBIDDEN
        if path.relative_to(ROOT).as_posix() in MAP_WINDOW:
            forbidden = FORBIDDEN - {"QgsCoordinateTransform"}
        name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
        names = [alias.name for alias in node.names] if isinstance(node, ast.ImportFrom) else [name]
        found += [f"{path.relative_to(ROOT)}: {one}" for one in names if one in forbidden]
    assert found == []


@pytest.mark.thorough
@needs_cs2cs
def test_sixty_crs_are_as_cs2cs_has_them() -> None:
    """Within 1 mm at 180 of 186 places; elsewhere cs2cs takes a ballpark operation, tens of metres off."""
    same, codes = 0, read_places()
    for code, lonlat in codes.items():
        operations = operations_of(f"EPSG:{code}")
        xy = operations.from_wgs84(lonlat)
        ground, _ = operations.convert(np.pad(xy, ((0, 0), (0, 1))))
        apart = horizontal_m(ground, convert_by_cs2cs(xy, operations.crs))
        assert ((apart < 1e-3) | (apart > 10.0)).all(), code
        same += int((apart < 1e-3).sum())
    assert len(codes) >= 60
    assert same >= 180


@needs_cs2cs
def test_each_point_of_a_file_goes_by_the_operation_of_its_area(tmp_path: Path) -> None:
    """ED50 in Spain and in Turkey."""
    crs = operations_of("EPSG:4230")
    xy, file = crs.from_wgs84(np.array([(-3.7, 40.4), (-2.0, 37.5), (33.0, 39.0), (35.0, 38.0)])), tmp_path / "two.csv"
    rows = [f"P{number},{x!r},{y!r},100" for number, (x, y) in enumerate(xy.tolist())]
    file.write_text("\n".join(["id,x,y,z", *rows]))
    points = read_points(str(file), ground_crs="EPSG:4230", height_datum="ellipsoidal").ground
    assert horizontal_m(points.ground, convert_by_cs2cs(xy, crs.crs)).max() < 1e-3
    assert len(points.operations) == 2 and points.operation.tolist() in ([0, 0, 1, 1], [1, 1, 0, 0])


@pytest.mark.thorough
def test_dem_cells_and_points_with_the_same_map_coordinates_lie_together(tmp_path: Path) -> None:
    for code, places in read_places().items():
        operations = operations_of(f"EPSG:{code}")
        cell = 1e-4 if operations.crs.is_geographic else 10.0
        for x, y in operations.from_wgs84(places).tolist():
            place = (x - 4.5 * cell, cell, 0.0, y + 4.5 * cell, 0.0, -cell)
            wkt = operations.crs.to_wkt("WKT1_GDAL")
            file = write_raster(tmp_path / f"dem_{code}.tif", np.full((9, 9), 100.0), place, wkt)
            point = operations.to_wgs84(np.array([[x, y, 100.0]]))
            at = open_dem(file, "ellipsoidal").grid_coordinates(point[:, :2])[0]
            assert np.abs(at - 4.0).max() < 1e-4, code  # 1 mm


@pytest.mark.parametrize(
    ("code", "utm", "place"),
    [(24879, 32719, (-70.6, -33.5)), (4267, 32606, (-150.0, 65.0)), (27700, 32630, (-0.1, 51.5))],
)
def test_an_orthoimage_on_the_pixels_of_another_datum_goes_by_the_same_operation(
    tmp_path: Path, code: int, utm: int, place: tuple[float, float]
) -> None:
    """GDAL takes PROJ's best operation between the two CRS: here by way of WGS84."""
    row, column = np.mgrid[:60, :60]
    for name, crs, size in (("source", code, 60), ("like", utm, 20)):
        operations = operations_of(f"EPSG:{crs}")
        (x, y), cell = operations.from_wgs84(np.array([place]))[0], 1e-5 if operations.crs.is_geographic else 1.0
        corner = (x - cell * size / 2.0, cell, 0.0, y + cell * size / 2.0, 0.0, -cell)
        values = (column + 1000.0 * row)[:size, :size].astype(np.float32)
        write_raster(tmp_path / name, values, corner, operations.crs.to_wkt("WKT1_GDAL"))
    source, like = (open_ortho(str(tmp_path / name)) for name in ("source", "like"))
    inner = np.stack(np.meshgrid(np.arange(5, 15), np.arange(5, 15)), -1).reshape(-1, 2)
    x, y = operations_of(f"EPSG:{code}").from_wgs84(like.lonlat(inner)).T
    west, step, _, north, _, _ = source.geotransform
    expected = (x - west) / step - 0.5 + 1000.0 * ((north - y) / step - 0.5)
    moved = resample_to_grid(source, like).raster.dataset.GetRasterBand(1).ReadAsArray()
    assert np.abs(moved[inner[:, 1], inner[:, 0]] - expected).max() < 10.0  # 0.01 of a row


@pytest.mark.parametrize("code", [23030, 24879, 4267, 27700, 28355, 4807, 3031, 31467])
def test_there_and_back(code: int) -> None:
    operations = operations_of(f"EPSG:{code}")
    area = operations.crs.area_of_use
    east = area.east if area.east > area.west else area.east + 360.0
    lon, lat = np.meshgrid(np.linspace(area.west, east, 15)[1:-1], np.linspace(area.south, area.north, 15)[1:-1])
    lonlat = np.column_stack([lon.ravel(), lat.ravel()])
    back = operations.to_wgs84(np.pad(operations.from_wgs84(lonlat), ((0, 0), (0, 1))))
    apart = horizontal_m(back, lonlat)
    # An operation and its inverse agree to 1e-7 degrees, that is PROJ's own; no point changes from one to another
    assert np.nanmax(apart) < 0.02


def test_a_ballpark_operation_serves_only_where_there_is_no_real_one() -> None:
    alaska = operations_of("EPSG:26705")  # PROJ lists one operation for the mainland, and a ballpark one
    assert not any(one.is_ballpark for one in alaska.operations)
    # What lacks its grid names it
    assert all(one.grids for one in operations_of("EPSG:4267").unavailable if not one.is_ballpark)
    (use,) = operations_of("EPSG:2333").uses_at("gcps.csv", np.array([[116.4, 40.0]]))  # Xian 1980
    assert use.operation.is_ballpark
    assert any("PROJ has no operation" in text for text in list_operation_warnings([use]))


def test_the_accuracy_of_positions_and_of_heights() -> None:
    (use,) = operations_of("EPSG:24879").uses_at("gcps.csv", np.array([[-70.6, -33.5]]))
    assert (use.operation.accuracy_m, use.operation.code) == (17.0, "EPSG:6972")
    assert use.operation.sigma_m == pytest.approx((17.0 / np.sqrt(3.0), 0.0))
    (exact,) = operations_of("EPSG:32719").uses_at("gcps.csv", np.array([[-70.6, -33.5]]))
    assert exact.operation.sigma_m == (0.0, 0.0)
    assert list_operation_warnings([exact]) == []


def test_a_crs_loses_its_heights_alone() -> None:
    for code, flat in (("EPSG:4979", 4326), ("EPSG:25832+5783", 25832), ("EPSG:4937", 4258)):
        assert without_heights(pyproj.CRS.from_user_input(code)).equals(
            pyproj.CRS.from_epsg(flat), ignore_axis_order=True
        )


@pytest.mark.skipif(find_substitute("any") is None, reason="no geoid grid is installed")
def test_a_missing_geoid_is_replaced_unless_that_is_forbidden() -> None:
    operations = operations_of("EPSG:25832+5783")
    if operations.substitute is None or not any("for DHHN92" in one.name for one in operations.operations):
        pytest.skip("the geoid of DHHN92 is installed")
    ground, number = operations.convert(np.array([[6e5, 5.3e6, 100.0]]))
    uses = operations.uses("gcps.csv", ground, number)
    assert ground[0, 2] == pytest.approx(146.0, abs=5.0)
    assert uses[0].operation.sigma_m[1] == 1.0
    with pytest.raises(InputError, match=r"geoid of DHHN92 height is not installed.*projsync"):
        require_strict_datums(uses, strict_datum=True)
    require_strict_datums(uses, strict_datum=False)


@pytest.mark.thorough
def test_where_no_grid_is_installed_every_loss_is_told(tmp_path: Path) -> None:
    done = run_code("from hrsi.tests.ground.crs_comparison import list_losses; print(list_losses())", tmp_path)
    assert done.returncode == 0, done.stderr
    losses = ast.literal_eval(done.stdout.splitlines()[-1])
    assert len(losses) > 20
    assert [code for code, is_reported in losses if not is_reported] == []


def test_without_any_geoid_heights_are_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    code = "from hrsi.hrsi_engine.ground.crs_operations import operations_of; operations_of('EPSG:25832+5783')"
    done = run_code(code, tmp_path)
    assert "no PROJ grid to convert the heights of" in done.stderr
    assert "projsync" in done.stderr


# ---- plates -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "place", "expected_m"),
    [
        # ITRF2014 plate motion model (Altamimi et al. 2017) and the national agencies' own figures, to 5 cm:
        (7844, (147.3, -42.9), (0.05, 0.20)),  # GDA2020, 3.5 years after its epoch at 5.5 cm a year to the north
        (4258, (10.0, 50.0), (0.64, 0.61)),  # ETRS89, 34.5 years at 2.5 cm a year to the north-east
        (6318, (-120.0, 40.0), (-1.50, 0.27)),  # NAD83(2011): its origin is 2 m off the Earth's centre
    ],
)
def test_points_on_a_plate_are_brought_to_the_year_of_the_images(
    code: int, place: tuple[float, float], expected_m: tuple[float, float]
) -> None:
    at_place = np.array([[*place, 100.0]])
    still, moved = operations_of(f"EPSG:{code}"), operations_of(f"EPSG:{code}", 2023.5)
    shift = ground_difference_m(moved.to_wgs84(at_place), still.to_wgs84(at_place))[0]
    assert shift[:2] == pytest.approx(expected_m, abs=0.05)
    assert shift[2] == 0.0
    np.testing.assert_allclose(moved.from_wgs84(moved.to_wgs84(at_place)), at_place[:, :2], atol=1e-8)
    (before,), (after,) = still.uses_at("gcps.csv", at_place), moved.uses_at("gcps.csv", at_place)
    assert before.treats_plate_as_wgs84
    assert not after.treats_plate_as_wgs84
    assert "2023.5" in after.operation.name
    assert after.operation.sigma_m[0] < 0.1 < before.operation.sigma_m[0]


@pytest.mark.parametrize("code", [32632, 7912, 9990, 9057, 9019])
def test_wgs84_and_the_itrs_move_with_no_plate(code: int) -> None:
    """Points of GNSS and laser in ITRF2014 or ITRF2020 are where they say; PROJ lists a ballpark operation for them."""
    operations, place = operations_of(f"EPSG:{code}", 2023.5), np.array([[10.0, 50.0, 100.0]])
    assert operations.motion_in(2023.5) is None
    (use,) = operations.uses_at("laser.gpkg", place)
    assert not use.operation.is_ballpark and not use.treats_plate_as_wgs84
    assert list_operation_warnings([use]) == []
    if code != 32632:
        np.testing.assert_array_equal(operations.to_wgs84(place), place)


@pytest.mark.parametrize("code", [3006, 2154, 2180])
def test_realisations_of_etrs89_move_with_it(code: int) -> None:
    """SWEREF99 TM, RGF93 / Lambert-93 and ETRF2000-PL / CS92; Japan and New Zealand have no motion in PROJ."""
    place = np.array([[10.0, 50.0]])
    xy = np.pad(operations_of(f"EPSG:{code}").from_wgs84(place), ((0, 0), (0, 1)))
    moved, of_etrs89 = operations_of(f"EPSG:{code}", 2023.5), operations_of("EPSG:4258", 2023.5)
    still = operations_of(f"EPSG:{code}").to_wgs84(xy)
    np.testing.assert_allclose(moved.to_wgs84(xy), of_etrs89.to_wgs84(still), atol=1e-11)
    assert operations_of("EPSG:6668").motion_in(2023.5) is None
    assert operations_of("EPSG:5252").motion_in(2023.5) is None  # TUREF: Anatolia does not follow Eurasia


@pytest.mark.thorough
def test_the_epoch_of_the_command_line_moves_gcps_as_pyproj_does(tmp_path: Path) -> None:
    """GDA2020 to ITRF2014 in 2023.5 by pyproj alone; JGD2011 stays, and that is told."""
    simulate = dict(lon=147.3, lat=-42.9, size=300, gcps=6, checks=4, ties=20, images=2)
    run("simulate", **simulate, output_dir=str(tmp_path / "block"))
    with (tmp_path / "block" / "ground_points.csv").open() as file:
        rows = {row["id"]: np.array([float(row["lon"]), float(row["lat"])]) for row in csv.DictReader(file)}
    images = [str(tmp_path / "block" / f"image_{number}.tif") for number in (1, 2)]
    to_itrf = pyproj.Transformer.from_crs("EPSG:7844", "EPSG:9000", always_xy=True)
    for code, told in (("EPSG:7844", "in 2023.5"), ("EPSG:6668", "PROJ has no motion of the plate of JGD2011")):
        folder = tmp_path / code[5:]
        words = ["adjust", *images, "--gcps", str(tmp_path / "block" / "ground_points.csv"), "--ground-crs", code,
                 "--image-points", str(tmp_path / "block" / "image_points.csv"), "--height-datum", "ellipsoidal",
                 "--gcp-epoch", "2023.5", "--write", "none", "--output-dir", str(folder)]  # fmt: skip
        done = subprocess.run([sys.executable, "-m", "hrsi", *words], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert told in (folder / "report.json").read_text()
        points = read_points(f"{folder / 'block.gpkg'}|layername=ground_points").ground
        for name, lonlat in rows.items():
            moved = lonlat if code == "EPSG:6668" else to_itrf.transform(*lonlat, 0.0, 2023.5)[:2]
            place = points.ground[points.ids == name][0, :2]
            np.testing.assert_allclose(place, moved, atol=2e-10)  # 0.02 mm


# ---- the block ----------------------------------------------------------------------------------------------------


def take_operation(code: str, place: tuple[float, float]) -> OperationUse:
    """Return what converts points of a CRS at a place."""
    return operations_of(code).uses_at("points", np.array([place]))[0]


def name_operation(block: Block, use: OperationUse, checks: bool = True) -> Block:
    """Return a block whose GCPs, and check points unless not, came by an operation."""
    came = (block.points.role == Role.GCP) | (checks & (block.points.role == Role.CHECK))
    return replace(block, points=replace(block.points, operation=np.where(came, 0, -1), operations=(use,)))


def test_the_error_of_an_operation_is_in_what_the_block_predicts_and_not_in_what_its_check_points_see() -> None:
    block, _, _ = simulated_block(gcps=10, checks=10, ties=20, noise_m=0.05)
    use = take_operation("EPSG:24879", (-70.6, -33.5))
    plain = adjust(block, AdjustOptions(model="affine"))
    shared = adjust(name_operation(block, use), AdjustOptions(model="affine"))
    np.testing.assert_allclose(shared.values, plain.values)
    added = shared.ground_sigma_m**2 - plain.ground_sigma_m**2
    # nothing but the GCPs holds the block, so that every point moves with them
    np.testing.assert_allclose(added[:, :2], use.operation.sigma_m[0] ** 2, rtol=1e-3)
    np.testing.assert_allclose(added[:, 2], 0.0, atol=1e-2)
    check = np.flatnonzero(block.points.role == Role.CHECK)
    alike, other = shared.covariance_to_surveys_m2(check), adjust(
        name_operation(block, use, checks=False), AdjustOptions(model="affine")
    ).covariance_to_surveys_m2(check)  # fmt: skip
    np.testing.assert_allclose(alike, plain.ground_covariance_m2[check], rtol=1e-2, atol=1e-3)
    expected = plain.ground_covariance_m2[check][:, 0, 0] + use.operation.sigma_m[0] ** 2
    np.testing.assert_allclose(other[:, 0, 0], expected, rtol=1e-3)


def inside(result: Adjustment, truth: np.ndarray) -> tuple[float, float]:
    """Return the shares of tie points whose errors are within the CE90 and the LE90 that each states."""
    ties = np.flatnonzero((result.block.points.role == Role.TIE) & np.isfinite(result.ground).all(axis=1))
    error, sigma = ground_difference_m(result.ground[ties], truth[ties]), result.ground_sigma_m[ties]
    circle = np.linalg.norm(error[:, :2], axis=1) <= CIRCLE_90 * np.linalg.norm(sigma[:, :2], axis=1)
    return float(circle.mean()), float((np.abs(error[:, 2]) <= LINE_90 * sigma[:, 2]).mean())


@pytest.mark.thorough
def test_predicted_accuracies_cover_errors_drawn_from_the_stated_accuracy() -> None:
    """40 blocks; the errors are quantiles in random order (Latin hypercube), so that the draw has no chance in it."""
    use, count, rng = take_operation("EPSG:23030", (-3.7, 40.4)), 40, np.random.default_rng(36)
    quantile = norm.ppf((np.arange(count) + 0.5) / count)
    draws = np.column_stack([rng.permutation(quantile) for _ in range(3)]) * np.array(use.operation.sigma_m)[[0, 0, 1]]
    shares = []
    for seed, shift in enumerate(draws):
        block, truth, _ = simulated_block(gcps=12, checks=0, ties=40, seed=1000 + seed, noise_m=0.05)
        block = name_operation(move_surveys(block, block.points.role == Role.GCP, shift), use)
        shares.append(inside(adjust(block, AdjustOptions(model="affine")), truth))
    assert (np.abs(np.mean(shares, axis=0) - 0.9) < 0.04).all()


@pytest.mark.thorough
def test_the_error_of_a_geoid_is_in_the_heights_that_laser_points_hold() -> None:
    """24 blocks without GCPs; laser heights in DHHN92 by EGM96, whose errors are drawn as above."""
    use, count = take_operation("EPSG:25832+5783", (9.0, 50.0)), 24
    draws = np.random.default_rng(36).permutation(norm.ppf((np.arange(count) + 0.5) / count)) * use.operation.sigma_m[1]
    shares = []
    for seed, draw in enumerate(draws.tolist()):
        scene = laser_scene(500 + seed, size=6000, checks=60)
        shifted = replace(scene.points, ground=scene.points.ground + [0.0, 0.0, draw], operations=(use,))
        result = adjust(scene.block, AdjustOptions(model="shift", laser=shifted))
        sigma = result.ground_sigma_m[result.block.points.role == Role.CHECK, 2]
        shares.append((np.abs(scene.height_errors_m(result)[:, 2]) <= LINE_90 * sigma).mean())
    assert abs(np.mean(shares) - 0.9) < 0.04


@pytest.mark.thorough
def test_the_command_line_tells_the_operation_and_says_what_check_points_cannot(tmp_path: Path) -> None:
    """A job in Chile with GCPs in PSAD56, beside the same with GCPs in WGS84."""
    folder = tmp_path / "Chile"
    run("simulate", lon=-70.6, lat=-33.5, size=400, gcps=12, checks=20, ties=60, images=2, output_dir=str(folder))
    rows = table(folder / "ground_points.csv")
    to_map = pyproj.Transformer.from_crs(4326, 24879, always_xy=True)
    for row in rows:
        row["x"], row["y"] = map(repr, to_map.transform(float(row.pop("lon")), float(row.pop("lat"))))
        row["z"] = row.pop("height")
    with (folder / "map_points.csv").open("w") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    images = [str(folder / f"image_{number}.tif") for number in (1, 2)]
    for name, crs in (("ground", []), ("map", ["--ground-crs", "EPSG:24879"])):
        words = ["adjust", *images, "--gcps", str(folder / f"{name}_points.csv"), *crs, "--image-points",
                 str(folder / "image_points.csv"), "--height-datum", "ellipsoidal", "--model", "affine",
                 "--output-dir", str(folder / name), "--quiet"]  # fmt: skip
        assert main(words) in (0, 3)
    xy = [read_rpc(str(folder / name / "image_1.tif")).rpc.project([[-70.6, -33.5, 0.0]]) for name in ("ground", "map")]
    assert np.abs(xy[0] - xy[1]).max() < 0.05
    report = json.loads((tmp_path / "Chile" / "map" / "report.json").read_text())
    assert report["crs_operations"][0]["code"] == "EPSG:6972"
    assert "PSAD56 to WGS 84 (16)" in (tmp_path / "Chile" / "map" / "report.html").read_text()
    assert report["untested_by_check_points"]["ce90_m"] == pytest.approx(1.5175 * 17.0 * np.sqrt(2.0 / 3.0), rel=1e-3)
    assert "which the check points cannot test" in report["verdict"]["sentence"]
    assert report["images"]["image_1"]["err_bias_m"] == pytest.approx(17.0 / np.sqrt(3.0), rel=0.01)
    given = dict(gcps=str(folder / "map_points.csv"), ground_crs="EPSG:24879", height_datum="ellipsoidal")
    given |= dict(image_points=str(folder / "image_points.csv"), output_dir=str(tmp_path / "judged"))
    evaluated = run("evaluate", images=images, **given)
    assert [row["code"] for row in evaluated["crs_operations"]] == ["EPSG:6972"]
    # The finished GeoPackage tells the same, is adjusted again with it, and the panel keeps it
    file = folder / "map" / "block.gpkg"
    layers = gdal.OpenEx(str(file))
    told = layers.GetLayerByName("images").GetMetadataItem("HRSI_CRS_OPERATIONS")
    assert told == "PSAD56 to WGS 84 (16) (EPSG:6972, 17 m)"
    points = dict(gcps=f"{file}|layername=ground_points", image_points=str(file), height_datum="ellipsoidal")
    again = run("adjust", images=images, **points, model="affine", output_dir=str(tmp_path / "again"))
    for key in ("name", "code", "accuracy_m", "sigma_plan_m", "points"):
        assert again["crs_operations"][0][key] == report["crs_operations"][0][key]
    assert again["parts"][0]["ce90_m"] == pytest.approx(report["parts"][0]["ce90_m"], rel=1e-3)
    assert again["untested_by_check_points"]["ce90_m"] == pytest.approx(
        report["untested_by_check_points"]["ce90_m"], rel=1e-4
    )
    kept = tmp_path / "panel.gpkg"
    point_session.save(point_session.open_block(str(file)), str(kept))
    session = point_session.open_block(str(kept))
    for damaged in ("[1]", '[{"ids": []}]', "{", "[" * 100_000):
        layers = gdal.OpenEx(str(kept), gdal.OF_VECTOR | gdal.OF_UPDATE)
        layers.GetLayerByName("ground_points").SetMetadataItem("HRSI_POINT_OPERATIONS", damaged)
        del layers
        with pytest.raises(InputError, match="its list of coordinate operations is damaged"):
            read_points(f"{kept}|layername=ground_points")
    assert {json.loads(point.operation)["code"] for point in session.points.values()} == {"EPSG:6972"}
    block_of_panel = ground_points(session)
    assert block_of_panel.operations[0].operation.sigma_m[0] == pytest.approx(17.0 / np.sqrt(3.0), abs=1e-4)


def test_the_commands_as_typed(tmp_path: Path) -> None:
    """`rpc-info --crs`, and README's `orthorectify --dem-datum egm2008` where only EGM96 is installed."""
    bare = tmp_path / "proj"
    bare.mkdir()
    egm96 = Path("/usr/share/proj/egm96_15.gtx")
    if not egm96.is_file():
        pytest.skip("EGM96 is not installed: apt-get install proj-data")
    shutil.copy(egm96, bare)

    def hrsi(code: int, *words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "hrsi", *words], env=only_proj(bare), capture_output=True, text=True, check=False
        )
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    rpc_image(tmp_path / "a.tif", camera(0.35))
    write_dem(tmp_path / "dem.tif")
    image, ortho = str(tmp_path / "a.tif"), ("--dem", str(tmp_path / "dem.tif"), "--dem-datum", "egm2008")
    assert "ETRS89 to WGS 84 (1)" in hrsi(0, "rpc-info", image, "--crs", "EPSG:25832")
    told = hrsi(0, "orthorectify", image, *ortho, "--output-dir", str(tmp_path / "ortho"))
    assert "the geoid of egm2008 is not installed, egm96 is used instead" in told
    strict = hrsi(2, "orthorectify", image, *ortho, "--strict-datum", "--output-dir", str(tmp_path / "strict"))
    assert "projsync" in strict
