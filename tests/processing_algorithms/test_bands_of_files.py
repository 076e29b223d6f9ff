"""PAN and MS files through the algorithms: GDAL sees the refined MS where the refined PAN is, over the pixels' size."""

from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal

from hrsi.processing_algorithms import run

FACTOR = 0.25
FOLLOWS_PX = 0.05  # what issue 38 asks of a band without a match, px of the band


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two PAN images with ties that were measured on both, and MS images of the same pixels without any point."""
    folder = tmp_path_factory.mktemp("bands")
    run("simulate", sensor="pleiades", images=2, along="-10,10", size=240, gcps=0, checks=0, ties=60, seed=4,
        output_dir=str(folder))  # fmt: skip
    run(
        "crop",
        images=[str(folder / f"image_{k}.tif") for k in (1, 2)],
        factor=FACTOR,
        overwrite=True,
        output_dir=str(folder),
    )
    return folder


def names(scene: Path, ending: str) -> list[str]:
    return [str(scene / f"image_{k}{ending}.tif") for k in (1, 2)]


def read_by_gdal(path: Path, ground: np.ndarray) -> np.ndarray:
    """Return where GDAL sees ground points, pixels from the corner ``(n, 2)``."""
    transformer = gdal.Transformer(gdal.Open(str(path)), None, ["METHOD=RPC"])
    return np.array(transformer.TransformPoints(True, ground.tolist())[0])[:, :2]


def require_followed(scene: Path, out: Path) -> None:
    for k in (1, 2):
        rpc = gdal.Open(str(scene / f"image_{k}.tif")).GetMetadata("RPC")
        middle, reach = (
            np.array([float(rpc[f"{axis}_{part}"]) for axis in ("LONG", "LAT", "HEIGHT")]) for part in ("OFF", "SCALE")
        )
        ground = middle + reach * np.random.default_rng(k).uniform(-0.6, 0.6, (200, 3))
        pan = read_by_gdal(out / f"image_{k}.tif", ground)
        moved = pan - read_by_gdal(scene / f"image_{k}.tif", ground)
        assert np.hypot(*moved.T).min() > 4.0 * FOLLOWS_PX / FACTOR  # there is a correction to follow
        assert np.abs(pan * FACTOR - read_by_gdal(out / f"image_{k}_crop.tif", ground)).max() < FOLLOWS_PX


@pytest.mark.parametrize("shared", [(), (("image_1", "image_1_crop"), ("image_2", "image_2_crop"))])
def test_a_band_without_points_is_written_with_the_correction_of_its_pan(scene, tmp_path, shared):
    report = run(
        "adjust", images=[*names(scene, "_crop"), *names(scene, "")], image_points=str(scene / "image_points.csv"),
        shared_images=shared, output_dir=str(tmp_path / "out"),
    )  # fmt: skip
    require_followed(scene, tmp_path / "out")
    assert "few-ties" not in [reason["code"] for reason in report["verdict"]["reasons"]]


def test_bands_join_a_block_of_tie_points_that_was_adjusted_before(scene, tmp_path):
    first, out = str(tmp_path / "first"), tmp_path / "second"
    run("adjust", images=names(scene, ""), image_points=str(scene / "image_points.csv"), output_dir=first)
    run("adjust", images=names(scene, "_crop"), add_to=first, output_dir=str(out))
    require_followed(scene, out)
