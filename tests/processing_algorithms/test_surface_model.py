"""`surface-model`: heights against the simulated terrain, their standard deviations, and runs that are stopped."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from gdal_files import write_raster
from long_tests import mark_beyond
from osgeo import gdal
from scipy import ndimage

from hrsi.hrsi_engine.dense.disparity import compute_disparities, normalise_contrast
from hrsi.hrsi_engine.dense.tiles import rectify_tile
from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.ground.crs_operations import operations_of
from hrsi.hrsi_engine.io.output_dir import read_report
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rasters.surface_models import ShadedSurface
from hrsi.hrsi_engine.ortho.grid import GridWindow, MapGrid, choose_map_crs
from hrsi.hrsi_engine.surface.dem import surface_heights
from hrsi.processing_algorithms import run

SIZE = 420


def make_block(folder: Path, scene: dict[str, Any], images: int = 3, **options: Any) -> None:
    """Simulate images into ``made``, and adjust them into ``result``."""
    made = folder / "made"
    run("simulate", images=images, output_dir=str(made), **scene)
    run(
        "adjust", images=sorted(map(str, made.glob("image_?.tif"))), gcps=str(made / "ground_points.csv"),
        image_points=str(made / "image_points.csv"), height_datum="ellipsoidal", report=False,
        output_dir=str(folder / "result"), **options,
    )  # fmt: skip


EXACT = {"size": SIZE, "gcps": 30, "ties": 100, "noise_image": 0.02, "noise_gcp_xy": 0.01, "noise_gcp_h": 0.01,
         "vendor_error": 0.0}  # fmt: skip
SIGMAS = {"sigma_gcp_xy": 0.01, "sigma_gcp_h": 0.01, "sigma_image": 0.05}


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three simulated images of hills with exact RPCs, and the block adjusted with many GCPs."""
    folder = tmp_path_factory.mktemp("block")
    make_block(folder, EXACT | {"along": "-10,0,10", "checks": 2, "landform": "hills", "seed": 11}, **SIGMAS)
    return folder


def make(block: Path, name: str, **options: Any) -> tuple[Path, dict]:
    folder = block / name
    return folder, run("surface-model", result=str(block / "result"), output_dir=str(folder), **options)


def differences(block: Path, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return errors against the true terrain and stated sigmas (m), where there is a height; both read anew by GDAL."""
    dataset = gdal.Open(str(path))
    height, sigma = dataset.GetRasterBand(1).ReadAsArray(), dataset.GetRasterBand(2).ReadAsArray()
    row, column = np.nonzero(height != dataset.GetRasterBand(1).GetNoDataValue())
    west, step, _, north, _, _ = dataset.GetGeoTransform()
    to_wgs84 = pyproj.Transformer.from_crs(32631, 4326, always_xy=True)
    lonlat = np.column_stack(to_wgs84.transform(west + (column + 0.5) * step, north - (row + 0.5) * step))
    truth = surface_heights(open_dem(str(block / "made" / "dem.tif")), lonlat)
    return height[row, column] - truth, sigma[row, column]


@pytest.fixture(scope="module")
def surface(block: Path) -> tuple[Path, dict]:
    return make(block, "surface", reference=str(block / "made" / "dem.tif"))


def test_heights_are_those_of_the_terrain(block: Path, surface: tuple[Path, dict]):
    """To a tenth of a pixel of disparity, 0.05 px x 2.1 m/px for the widest pair, and 0.1 m in the mean."""
    folder, report = surface
    error, sigma = differences(block, folder / "surface.tif")
    bias = np.median(error)
    assert abs(bias) < 0.1
    assert 1.4826 * np.median(np.abs(error - bias)) < 0.25
    assert np.percentile(np.abs(error), 90.0) < 0.5
    assert np.mean(np.abs(error) < 1.645 * sigma) > 0.86
    assert report["cells_with_height"] == len(error) > 0.6 * report["cells"]


def test_comparison_agrees_with_own_figures(block: Path, surface: tuple[Path, dict]):
    folder, report = surface
    error, _ = differences(block, folder / "surface.tif")
    figures = report["reference"]
    assert figures["compared"] == len(error)
    assert figures["bias_m"] == pytest.approx(np.median(error), abs=1e-3)
    assert figures["le90_m"] == pytest.approx(np.percentile(np.abs(error), 90.0), abs=1e-3)
    difference = gdal.Open(str(folder / "difference.tif")).ReadAsArray()
    assert np.median(difference[difference != -9999.0]) == pytest.approx(figures["bias_m"], abs=1e-3)


def test_file_states_what_it_contains(surface: tuple[Path, dict]):
    folder, report = surface
    dataset = gdal.Open(str(folder / "surface.tif"))
    assert [dataset.GetRasterBand(k).GetDescription() for k in (1, 2, 3)] == ["height", "standard deviation", "pairs"]
    pairs = dataset.GetRasterBand(3).ReadAsArray()
    assert {1.0, 2.0, 3.0} >= set(np.unique(pairs[pairs != -9999.0]).tolist()) >= {3.0}
    assert gdal.Info(dataset, format="json")["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"] == "COG"
    open_dem(str(folder / "surface.tif"))  # the height datum is in the CRS: nothing has to be told
    assert "hillshade" in (folder / "surface.qml").read_text()
    assert all(pair["rectification_px"] < 0.1 for pair in report["pairs"])
    assert not (folder / "unfinished_surface").exists()


def test_vertical_crs_changes_heights_by_the_geoid(block: Path, surface: tuple[Path, dict]):
    """49.7 m at this place, from PROJ's grid by the independent way of cs2cs."""
    folder, _ = make(block, "egm96", vertical="egm96", report=False)
    above_geoid, ellipsoidal = (gdal.Open(str(one / "surface.tif")).ReadAsArray()[0] for one in (folder, surface[0]))
    exists = above_geoid != -9999.0
    geoid = pyproj.Transformer.from_crs("EPSG:4326+5773", 4979, always_xy=True).transform(5.45, 43.53, 0.0)[2]
    assert (ellipsoidal - above_geoid)[exists] == pytest.approx(geoid, abs=0.1)
    assert open_dem(str(folder / "surface.tif")).operations[0].operation.name


def test_stopped_run_continues(block: Path, surface: tuple[Path, dict]):
    """With the tiles that are finished, and with the same result, byte for byte."""
    matched: list[float] = []

    def stop(fraction: float, message: str) -> bool:
        matched.append(fraction)
        return not message.startswith("matching tiles (3")

    options = {"tile": 128, "report": False, "resolution": 1.0}
    with pytest.raises(Cancelled):
        make(block, "stopped", progress=stop, **options)
    stored = sorted((block / "stopped" / "unfinished_surface").glob("*.npz"))
    assert len(stored) >= 3
    messages: list[str] = []
    folder, _ = make(block, "stopped", log=messages.append, **options)
    assert any(f"continues with {len(stored)} finished tiles" in text for text in messages)
    straight, _ = make(block, "straight", **options)
    assert (folder / "surface.tif").read_bytes() == (straight / "surface.tif").read_bytes()


def test_pair_without_angle_is_refused(block: Path, tmp_path: Path):
    """Two images from the same direction: the message has the angle of the pair."""
    scene = {"along": "0,0.4", "size": 160, "gcps": 8, "checks": 0, "ties": 40, "seed": 2}
    make_block(tmp_path, scene, images=2, force_write=True)
    with pytest.raises(InputError, match=r"image_1 and image_2: convergence 0\.\d\d deg"):
        run("surface-model", result=str(tmp_path / "result"), output_dir=str(tmp_path / "surface"))


@pytest.mark.parametrize(("vertical", "crs", "text"), [
    ("EPSG:4326", None, "is no vertical reference"), ("ellipsoidal", "EPSG:4326", "is not projected"),
])  # fmt: skip
def test_wrong_options(block: Path, tmp_path: Path, vertical: str, crs: str | None, text: str):
    with pytest.raises(InputError, match=text):
        run("surface-model", result=str(block / "result"), output_dir=str(tmp_path), vertical=vertical, crs=crs)


def cover(path: Path, area: tuple[slice, slice], kind: str) -> None:
    """Paint water (noise of the sensor), a cloud (smooth and bright) or nothing at all over a part of an image."""
    dataset = gdal.Open(str(path), gdal.GA_Update)
    grey = dataset.ReadAsArray().astype(float)
    shape = grey[area].shape
    seed = sum(path.name.encode())
    noise = np.random.default_rng(seed).normal(0.0, 3.0, shape)
    grey[area] = (20.0 if kind == "water" else 2500.0) + noise
    dataset.GetRasterBand(1).WriteArray(grey)


@pytest.mark.parametrize("kind", mark_beyond(1, "thorough", ["water", "cloud"]))
def test_water_and_clouds_are_nodata(block: Path, tmp_path: Path, kind: str):
    """Less than 5 % of the cells in the middle of a patch without texture have a height."""
    shutil.copytree(block, tmp_path / "block")
    for k in (1, 2, 3):
        cover(tmp_path / "block" / "made" / f"image_{k}.tif", np.s_[150:290, 150:290], kind)
    record = tmp_path / "block" / "result" / "block.json"
    record.write_text(record.read_text().replace(str(block), str(tmp_path / "block")))
    folder, report = make(tmp_path / "block", f"with_{kind}", report=False)
    height = gdal.Open(str(folder / "surface.tif")).ReadAsArray()[0]
    middle = tuple(slice(size // 2 - 35, size // 2 + 35) for size in height.shape)
    assert np.mean(height[middle] != -9999.0) < 0.05
    assert report["cells_with_height"] > 0.4 * report["cells"]


def test_run_makes_the_surface_and_orthoimages_on_it(block: Path, tmp_path: Path):
    """A table in the project file is enough, and the orthoimages take their terrain from the surface."""
    made = block / "made"
    (tmp_path / "project.toml").write_text(
        f'images = [{", ".join(f""""{made}/image_{k}.tif" """ for k in (1, 2, 3))}]\n'
        f'gcps = "{made}/ground_points.csv"\nimage_points = "{made}/image_points.csv"\nheight_datum = "ellipsoidal"\n'
        f'[triangulate]\ntie_points = "{made}/image_points.csv"\nreport = false\n'
        "[surface-model]\nresolution = 1.0\n[orthorectify]\n[ortho-check]\n[evaluate]\nskip = true\n"
    )
    report = run("run", project=str(tmp_path / "project.toml"), output_dir=str(tmp_path / "result"))
    assert [entry["status"] for entry in report["steps"].values()] == ["done"] * 4 + ["left out"]
    # Cells of the surface without height take those of the adjusted points: the orthoimages are complete and match
    (orthoimages, check), names = (
        [read_report(str(tmp_path / "result" / name / "report.json")) for name in ("orthoimages", "check")],
        ["image_1", "image_2", "image_3"],
    )
    assert [orthoimages["images"][name]["unknown_pixels"] for name in names] == [0, 0, 0]
    assert check["all"]["after"]["median_px"] < 0.2
    assert "median sigma" in report["steps"]["surface-model"]["told"]
    surface = tmp_path / "result" / "surface" / "surface.tif"
    made_from = gdal.Open(str(tmp_path / "result" / "orthoimages" / "image_1_ortho.tif")).GetMetadata()["HRSI_TERRAIN"]
    assert Path(made_from).name == surface.name
    assert 'id="surface-model-' in (tmp_path / "result" / "report.html").read_text() or surface.exists()


@pytest.mark.thorough
def test_workers_make_the_same_surface(block: Path):
    """Tiles that two Dask workers match have the bytes of tiles that threads match."""
    distributed = pytest.importorskip("distributed")
    options = {"tile": 128, "report": False, "resolution": 1.0, "overwrite": True}
    threads, _ = make(block, "by_threads", **options)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        workers, _ = make(block, "by_workers", scheduler=cluster.scheduler_address, **options)
    assert (workers / "surface.tif").read_bytes() == (threads / "surface.tif").read_bytes()


def test_rectified_positions_intersect_at_the_ground_point(block: Path):
    """Ground points, projected by both RPCs and rectified, are found again to a millimetre; their lines agree."""
    images = [open_image(str(block / "result" / f"image_{k}.tif")) for k in (1, 3)]
    centre = np.array([[images[0].rpc.long_off, images[0].rpc.lat_off, 250.0]])
    xy = operations_of(choose_map_crs(centre)).from_wgs84(centre)[0]
    grid = MapGrid.from_bounds(choose_map_crs(centre), 0.7, (*(xy - 150.0), *(xy + 150.0)))
    window, plane = GridWindow(0, 0, 400, 400), np.array([0.01, 0.0, 245.0])
    tile = rectify_tile((images[0], images[1]), grid, window, (200.0, 300.0), plane)
    rng = np.random.default_rng(5)
    cells = rng.uniform(20.0, 380.0, (50, 2))
    heights = rng.uniform(205.0, 295.0, 50)
    ground = np.column_stack([grid.lonlat(cells), heights])
    rectified = []
    for image, affine in zip(images, (tile.left, tile.right), strict=True):
        rectified.append(np.linalg.solve(affine[:, :2], (image.rpc.project(ground) - affine[:, 2]).T))
    (u1, v1), (u2, v2) = rectified
    assert np.abs(v1 - v2).max() < 0.02
    assert np.abs(tile.intersect(u1, (v1 + v2) / 2.0, u1 - u2) - np.vstack([cells.T, heights])).max() < 2e-3


def test_disparities_have_no_preference_for_whole_pixels():
    """A texture shifted by 3.5 px: no bias, and a fifth of the 0.25 px usual for semi-global matching."""
    rng = np.random.default_rng(3)
    wide = ndimage.gaussian_filter(rng.normal(0.0, 1.0, (120, 400)), 1.2) * 100.0
    left, right = (ndimage.shift(wide, (0.0, by), order=5, mode="reflect") for by in (0.0, -3.5))
    both = [part + rng.normal(0.0, 1.0, part.shape) for part in (left, right)]
    valid = np.ones(left.shape, bool)
    first, second = (normalise_contrast(part, valid) for part in both)
    found = compute_disparities(first, second, valid, (-10.0, 10.0))
    inner = np.s_[20:-20, 60:-60]
    error, sigma = found.disparity[inner] - 3.5, found.sigma_px[inner]
    assert np.isfinite(error).mean() > 0.95
    assert abs(np.nanmedian(error)) < 0.01
    assert 1.4826 * np.nanmedian(np.abs(error)) < 0.05
    assert 0.4 < np.nanmedian(sigma) / np.nanstd(error) < 2.0


@pytest.mark.parametrize("seed", mark_beyond(1, "thorough", [71, 72, 73]))
def test_roofs_without_texture_say_so(tmp_path: Path, seed: int):
    """A city of uniform roofs between lit and dark walls: less than a tenth is wrong by 1 m and three sigma."""
    make_block(tmp_path, EXACT | {"along": "-12,2,14", "checks": 0, "landform": "city", "seed": seed}, **SIGMAS)
    made, result = tmp_path / "made", tmp_path / "result"
    run("surface-model", result=str(result), output_dir=str(tmp_path / "surface"), report=False, resolution=0.7)
    grid = gdal.Open(str(tmp_path / "surface" / "surface.tif"))
    height, sigma, _ = grid.ReadAsArray()
    west, step, _, north, _, _ = grid.GetGeoTransform()
    box = (west, north - step * grid.RasterYSize, west + step * grid.RasterXSize, north)
    truth = gdal.Warp(
        "", str(made / "dem.tif"), format="MEM", dstSRS="EPSG:32631", outputBounds=box, xRes=step, yRes=step,
        resampleAlg="bilinear", dstNodata=-9999,
    ).ReadAsArray()  # fmt: skip
    ground = ndimage.grey_opening(truth, (71, 71))
    row, column = np.indices(truth.shape) - np.array(truth.shape)[:, None, None] / 2.0
    seen_by_all = np.hypot(row, column) < 0.4 * 420
    roofs = ndimage.binary_erosion((truth > ground + 2.0) & (truth != -9999.0), np.ones((5, 5))) & seen_by_all
    exists = roofs & (height != -9999.0)
    error = np.abs(height - truth)
    assert roofs.sum() > 1000
    assert exists.sum() > 0.4 * roofs.sum()
    assert (exists & (error > np.maximum(1.0, 3.0 * sigma))).sum() < 0.1 * roofs.sum()
    assert np.mean(error[exists] < 1.645 * sigma[exists]) > 0.75


def test_shading_is_lit_from_the_north_west(tmp_path: Path):
    """A slope that faces the north-west is brighter than the plane, one that faces the south-east darker."""
    row, column = np.indices((9, 9)).astype(np.float32)
    brightness = []
    for name, slope in (("facing", 0.3), ("plane", 0.0), ("averted", -0.3)):
        heights = slope * (row + column)  # rises to the south-east
        path = write_raster(tmp_path / name, heights, (0.0, 1.0, 0.0, 9.0, 0.0, -1.0))
        shade, valid = ShadedSurface(path).read_means(1)
        brightness.append(float(np.median(shade[valid])))
    assert brightness[0] > brightness[1] > brightness[2]
