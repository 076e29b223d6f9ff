"""An RPC of the whole scene beside an image cut from it: placed by the geotransform, or refused; never at (0, 0)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal
from rpc_samples import ground_grid, sample_rpc, write_image
from simulated_blocks import oblique_rpc

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.crop import crop_place
from hrsi.hrsi_engine.io.rpc_files.fields import rpc_from_gdal

SIZE = (400, 300)


def scene_rpc() -> RPC:
    """Return the RPC of a scene of 4000 x 4000 px."""
    return oblique_rpc(0.3, -0.2)


def written(folder: Path, rpc: RPC, geotransform: tuple[float, ...] | None, size: tuple[int, int] = SIZE) -> str:
    """Write a crop with its geotransform and an RPC beside it."""
    path = folder / "crop.tif"
    write_image(path, None, geotransform=geotransform, size=size)
    write_rpc_text(str(folder / "crop_RPC.TXT"), rpc)
    return str(path)


def through_geotransform(geotransform: tuple[float, ...], scene: np.ndarray) -> np.ndarray:
    """Return crop pixels of scene pixels by GDAL's inverse; GDAL counts from the corner."""
    inverse = gdal.InvGeoTransform(geotransform)
    return np.array([gdal.ApplyGeoTransform(inverse, s + 0.5, t + 0.5) for s, t in scene.tolist()]) - 0.5


@pytest.mark.parametrize(
    ("geotransform", "exact"),
    [
        ((1200.0, 1.0, 0.0, 2500.0, 0.0, 1.0), True),
        ((1200.0, 2.0, 0.0, 2500.0, 0.0, 2.0), True),  # half the resolution
        ((1200.0, 0.5, 0.0, 2500.0, 0.0, 0.25), True),  # enlarged, unlike in sample and line
        ((1600.0, -1.0, 0.0, 2500.0, 0.0, 1.0), True),  # mirrored left to right
        ((1200.0, 1.0, 0.0, 2800.0, 0.0, -1.0), True),  # upside down
        ((1600.0, -2.0, 0.0, 2800.0, 0.0, -2.0), True),  # turned by 180 degrees
        ((1200.0, 0.0, 1.0, 2900.0, -1.0, 0.0), False),  # by 90
        ((1500.0, 0.8, -0.6, 1500.0, 0.6, 0.8), False),  # by 37
        ((1500.0, 2.0, 0.3, 1500.0, 0.0, 2.0), False),  # sheared
    ],
)
def test_any_affine_crop(tmp_path: Path, geotransform: tuple[float, ...], exact: bool) -> None:
    """The crop's pixels lie where the geotransform puts them in the scene, within rounding or 1e-3 px of a refit."""
    scene = scene_rpc()
    found = read_rpc(written(tmp_path, scene, geotransform))
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 6), np.linspace(0, SIZE[1] - 1, 5)), -1).reshape(-1, 2)
    for height in (-100.0, 200.0, 500.0):
        ground = found.rpc.localize(grid, height).ground
        in_crop = through_geotransform(geotransform, scene.project(ground))
        np.testing.assert_allclose(in_crop, grid, atol=1e-7 if exact else 1e-3)
    assert "moved to the crop" in found.source


@pytest.mark.parametrize("reduced", [1, 2])
def test_as_gdal_moves_an_rpc(tmp_path: Path, reduced: int) -> None:
    """gdal_translate moves the RPC tag of a crop itself; its geotransform beside the scene's RPC says the same."""
    scene = sample_rpc()
    write_image(tmp_path / "scene.tif", scene, geotransform=(0.0, 1.0, 0.0, 0.0, 0.0, 1.0001))
    options = {"srcWin": [100, 60, 120, 100], "width": 120 // reduced, "height": 100 // reduced}
    gdal.Translate(str(tmp_path / "by_gdal.tif"), str(tmp_path / "scene.tif"), **options)
    moved = rpc_from_gdal("by_gdal", gdal.Open(str(tmp_path / "by_gdal.tif")).GetMetadata("RPC"))
    step = float(reduced)
    path = written(tmp_path, scene, (100.0, step, 0.0, 60.0, 0.0, step), (120 // reduced, 100 // reduced))
    ground = ground_grid(scene)
    # GDAL keeps the centre of the first pixel where the corner should stay: half a pixel of the difference in size
    np.testing.assert_allclose(
        read_rpc(path).rpc.project(ground), moved.project(ground), atol=0.26 * (reduced - 1) + 1e-6
    )


def test_a_reduced_copy_of_the_whole_scene(tmp_path: Path) -> None:
    scene = scene_rpc()
    path = written(tmp_path, scene, (0.0, 10.0, 0.0, 0.0, 0.0, 10.0), size=(400, 400))
    ground = ground_grid(scene)
    expected = through_geotransform((0.0, 10.0, 0.0, 0.0, 0.0, 10.0), scene.project(ground))
    np.testing.assert_allclose(read_rpc(path).rpc.project(ground), expected, atol=1e-7)


@pytest.mark.parametrize(
    ("geotransform", "first", "pixel"),
    [((12114.5, 1, 0, 5511.5, 0, 1), (12114, 5511), (1, 1)), ((5000, 1, 0, 5162, 0, 1), (5000, 5162), (1, 1)),
     ((0.5, 1, 0, -0.5, 0, -1), (0, 0), (1, 1)), ((100.5, 1, 0, -200.5, 0, -1), (100, 200), (1, 1)),
     ((5000, 2, 0, 5162, 0, 2), (5000.5, 5162.5), (2, 2)), ((5000.5, 2, 0, -5162.5, 0, -2), (5000.5, 5162.5), (2, 2))],
)  # fmt: skip
def test_origins(geotransform, first, pixel) -> None:  # type: ignore[no-untyped-def]
    """Airbus counts from 0.5 and perhaps upwards; the first pixel of a reduced crop has its centre in the scene's."""
    place = crop_place(geotransform, has_crs=False)
    assert place is not None
    np.testing.assert_allclose(place.first, first)
    np.testing.assert_allclose(place.matrix, np.diag(pixel))


def test_a_map_is_no_crop() -> None:
    assert crop_place((5000.0, 1.0, 0.0, 5162.0, 0.0, -1.0), has_crs=True) is None
    assert crop_place((5.44, 1e-5, 0.0, 43.2, 0.0, -1e-5), has_crs=False) is None
    assert crop_place(None, has_crs=False) is None


@pytest.mark.parametrize(
    "geotransform",
    [
        (5.44, 1e-5, 0.0, 43.2, 0.0, -1e-5),
        (698053.0, 0.5, 0.0, 4792984.0, 0.0, -0.5),
        (9000.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    ],
)
def test_a_part_of_a_scene_without_a_place_is_refused(tmp_path: Path, geotransform: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"crop\.tif: its RPC is of a scene of 4000 x 4000 px"):
        read_rpc(written(tmp_path, scene_rpc(), geotransform))


def test_an_rpc_that_may_be_of_both_is_refused(tmp_path: Path) -> None:
    """The upper left tenth at half the resolution: an RPC from 0 to 4000 may be the scene's, or one moved from 8000."""
    with pytest.raises(InputError, match="not known whether the RPC file belongs to the scene"):
        read_rpc(written(tmp_path, scene_rpc(), (0.0, 2.0, 0.0, 0.0, 0.0, 2.0)))


@pytest.mark.parametrize("geotransform", [(1200.0, 2.0, 0.0, 2500.0, 0.0, 2.0), (1600.0, -1.0, 0.0, 2500.0, 0.0, 1.0)])
def test_an_rpc_of_the_crop_stays(tmp_path: Path, geotransform: tuple[float, ...]) -> None:
    """The RPC that was read is written beside the crop: it is not moved a second time."""
    path = written(tmp_path, scene_rpc(), geotransform)
    own = read_rpc(path).rpc
    write_rpc_text(str(tmp_path / "crop_RPC.TXT"), own)
    again = read_rpc(path)
    assert again.rpc == own
    assert "moved" not in again.source


def test_a_half_resolution_copy_of_a_real_crop(tmp_path: Path, real_data: Path) -> None:
    """Pleiades: the ground under the middle of a crop is that under the middle of its half-size copy."""
    folder = real_data / "kahramanmaras_phr4"
    whole = str(folder / "pre_event_img1.tif")
    gdal.Translate(str(tmp_path / "half.tif"), whole, width=500, height=500)
    (tmp_path / "half.geom").write_bytes((folder / "pre_event_img1.geom").read_bytes())
    full = read_rpc(whole).rpc.localize(np.array([[499.5, 499.5], [20.5, 900.5]]), 704.0).ground
    half = read_rpc(str(tmp_path / "half.tif")).rpc.localize(np.array([[249.5, 249.5], [10.0, 450.0]]), 704.0).ground
    np.testing.assert_allclose(half, full, atol=1e-9)  # degrees: 0.1 mm


def test_the_scene_itself_mirrored(tmp_path: Path) -> None:
    scene = replace(sample_rpc(), samp_off=200.0, line_off=150.0)
    path = written(tmp_path, scene, (400.0, -1.0, 0.0, 0.0, 0.0, 1.0))
    ground = ground_grid(scene)
    mirrored = scene.project(ground) * [-1.0, 1.0] + [399.0, 0.0]
    np.testing.assert_allclose(read_rpc(path).rpc.project(ground), mirrored, atol=1e-7)
