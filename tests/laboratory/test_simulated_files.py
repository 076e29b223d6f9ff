"""Written images, terrain and points against GDAL, rasterio and the truth."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from long_tests import mark_beyond
from osgeo import gdal

from hrsi.hrsi_engine.foundation.errors import Cancelled, OutputError
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.laboratory.simulated_files import write_dem, write_ground_points, write_image, write_image_points


@pytest.fixture(scope="module")
def block() -> lab.BlockSimulation:
    views = lab.make_along_track_views(lab.SENSORS["ikonos"], 2, (600, 500))
    return lab.simulate_block(lab.SceneSpec(relief_m=60.0), views, lab.PointCounts(4, 16, 80), lab.Noise(vendor=0.0))


@pytest.fixture(scope="module")
def folder(block: lab.BlockSimulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The block's files: images, a multispectral image, terrain and points."""
    path = tmp_path_factory.mktemp("simulated")
    for image in block.block.images:
        write_image(str(path / f"{image.id}.tif"), [lab.make_renderer(block, image.id)], image.rpc, threads=2)
    rpc = lab.fit_multispectral_rpc(block.block.images[0].rpc, 4)
    write_image(str(path / "image_1_ms.tif"), lab.make_multispectral_renderers(block, "image_1"), rpc)
    terrain = block.scene.terrain
    write_dem(str(path / "dem.tif"), terrain.posts, terrain.geotransform)
    write_ground_points(str(path / "ground_points.csv"), block.block.points)
    write_image_points(str(path / "image_points.csv"), block.block)
    return path


def seen_on(block: lab.BlockSimulation, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return true ground and image positions of the points on an image."""
    points = block.truth.image_points
    seen = points.image == index
    return block.truth.ground[points.point[seen]], points.xy[seen]


@pytest.mark.parametrize("index", mark_beyond(1, "thorough", [0, 1]))
def test_gdals_transformer_agrees_with_the_truth_within_the_stated_fit(
    block: lab.BlockSimulation, folder: Path, index: int
):
    ground, xy = seen_on(block, index)
    dataset = gdal.Open(str(folder / f"image_{index + 1}.tif"))
    transformer = gdal.Transformer(dataset, None, ["METHOD=RPC"])
    pixels = np.array(transformer.TransformPoints(True, ground.tolist())[0])[:, :2] - 0.5
    stated = block.truth.vendor_rpcs[index].max_px
    off = np.hypot(*(pixels - xy).T).max()
    assert off <= stated


@pytest.mark.parametrize("name", lab.SENSORS)
def test_gdal_agrees_with_the_camera_over_a_large_image(name: str):
    """12 000 x 12 000 pixels, seen obliquely over 600 m of heights, at random places."""
    camera = lab.aim_camera(lab.SENSORS[name], (12000, 12000), np.array([5.45, 43.53, 250.0]), 12.0, 10.0)
    fitted = lab.fit_camera(camera, (-50.0, 550.0))
    rng = np.random.default_rng(8)
    xy = rng.uniform(0.0, 11999.0, (2000, 2))
    ground = camera.image_to_ground(xy, rng.uniform(-50.0, 550.0, 2000))
    dataset = gdal.GetDriverByName("MEM").Create("", 1, 1)
    dataset.SetMetadata(gdal_metadata(fitted.rpc), "RPC")
    transformer = gdal.Transformer(dataset, None, ["METHOD=RPC"])
    pixels = np.array(transformer.TransformPoints(True, ground.tolist())[0])[:, :2] - 0.5
    off = np.hypot(*(pixels - xy).T).max()
    assert off <= fitted.max_px


def test_gdal_takes_the_heights_of_the_written_terrain(block: lab.BlockSimulation, folder: Path):
    """Longitude and latitude alone, heights from dem.tif: ellipsoidal, bilinear, no half pixel lost."""
    ground, xy = seen_on(block, 0)
    options = ["METHOD=RPC", f"RPC_DEM={folder / 'dem.tif'}"]
    transformer = gdal.Transformer(gdal.Open(str(folder / "image_1.tif")), None, options)
    flat = np.column_stack([ground[:, :2], np.zeros(len(ground))])
    pixels = np.array(transformer.TransformPoints(True, flat.tolist())[0])[:, :2] - 0.5
    off = np.hypot(*(pixels - xy).T).max()
    assert off < 1e-3  # float32 weights in GDAL's interpolation


def test_pixels_are_the_rendered_ones(block: lab.BlockSimulation, folder: Path):
    with rasterio.open(folder / "image_1.tif") as image:
        assert image.profile["tiled"]
        assert image.dtypes == ("uint16",)
        assert image.nodata is None
        np.testing.assert_array_equal(image.read(1), lab.make_renderer(block, "image_1").window(0, 0, 600, 500))


def test_multispectral_pixels_cover_four_by_four(block: lab.BlockSimulation, folder: Path):
    image = open_image(str(folder / "image_1_ms.tif"))
    ground, xy = seen_on(block, 0)
    assert gdal.Open(str(folder / "image_1_ms.tif")).RasterCount == 4
    np.testing.assert_allclose(image.rpc.project(ground), (xy - 1.5) / 4.0, atol=1e-8)


def test_terrain_is_the_true_surface(block: lab.BlockSimulation, folder: Path):
    surface = block.scene.terrain
    with rasterio.open(folder / "dem.tif") as dem:
        np.testing.assert_array_equal(dem.read(1), surface.posts)
        lon, lat = dem.xy(3, 5)
        post = surface.chart.from_ground(np.array([[lon, lat, 0.0]]))[0]
        np.testing.assert_allclose(post, [surface.west_m + 5 * surface.post_m, surface.north_m - 3 * surface.post_m])
    dem = open_dem(str(folder / "dem.tif"))
    found = dem.heights(dem.grid_coordinates(block.truth.ground[:, :2]))
    np.testing.assert_allclose(found, block.truth.ground[:, 2], atol=1e-6)  # ellipsoidal, bilinear like ours


def test_orthophoto_is_georeferenced(block: lab.BlockSimulation, tmp_path: Path):
    ortho = lab.make_orthophoto(block.scene, 1.5, half_extent_m=300.0)
    write_image(str(tmp_path / "ortho.tif"), [ortho], geotransform=ortho.geotransform)
    with rasterio.open(tmp_path / "ortho.tif") as image:
        target = next(position for position in block.scene.targets_m if np.abs(position).max() < 280.0)
        lon, lat, _ = block.scene.chart.to_ground(target[None], np.zeros(1))[0]
        row, column = image.index(lon, lat)
        around = image.read(1)[row - 1 : row + 2, column - 1 : column + 2]
    assert around.min() > 1000  # the bright disc


def test_cancel_and_failure_leave_nothing(block: lab.BlockSimulation, tmp_path: Path):
    image = lab.make_renderer(block, "image_1")
    with pytest.raises(Cancelled):
        write_image(str(tmp_path / "image.tif"), [image], progress=lambda fraction, message: fraction < 0.4)
    with pytest.raises(OutputError):
        write_image(str(tmp_path / "nowhere" / "image.tif"), [image])
    assert list(tmp_path.iterdir()) == []
