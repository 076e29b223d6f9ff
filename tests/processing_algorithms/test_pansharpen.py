"""`orthorectify --pansharpen`: pixels against Brovey's formula, pairs of exposures, and what is told."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osgeo import gdal
from scipy.optimize import nnls

from hrsi.hrsi_engine.block.block import Image, Tile
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.io.rpc_files import write_geotiff_copy
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.files.exposure_pairs import pair_exposures


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two exposures of a city, each with a panchromatic image and one of four bands."""
    folder = tmp_path_factory.mktemp("city")
    run("simulate", landform="city", images=2, along="-14,16", size=500, gcps=0, checks=0, ties=0, ms=True, seed=6,
        output_dir=str(folder))  # fmt: skip
    (folder / "ms").mkdir()
    for k in (1, 2):
        shutil.move(folder / f"image_{k}_ms.tif", folder / "ms" / f"image_{k}_ms.tif")
    return folder


def ortho(city: Path, out: Path, images: list[str], **options: Any) -> dict[str, Any]:
    given = {
        "dem": str(city / "dem.tif"),
        "height_datum": "ellipsoidal",
        "resolution": 0.7,
        "extent": "union",
        **options,
    }
    return run("orthorectify", images=[str(city / name) for name in images], output_dir=str(out), report=False, **given)


def test_pixels_are_those_of_weighted_brovey(city: Path, tmp_path: Path) -> None:
    """Of both images, orthorectified apart: a band times the panchromatic value over the weighted sum of the bands."""
    made = ortho(city, tmp_path / "sharp", ["image_1.tif"], pansharpen=str(city / "ms" / "image_1_ms.tif"))
    apart = ortho(city, tmp_path / "apart", ["image_1.tif", "ms/image_1_ms.tif"])
    sharp = gdal.Open(made["images"]["image_1"]["output"])
    assert sharp.GetMetadata("IMAGE_STRUCTURE")["LAYOUT"] == "COG" and sharp.GetRasterBand(1).GetOverviewCount() >= 1
    whole = sharp.GetGeoTransform()
    box = whole[0], whole[3], whole[0] + 0.7 * sharp.RasterXSize, whole[3] - 0.7 * sharp.RasterYSize
    pan, colour = (
        gdal.Translate("", entry["output"], format="MEM", projWin=box).ReadAsArray().astype(float)
        for entry in apart["images"].values()
    )
    values = sharp.ReadAsArray().astype(float)
    valid = (pan > 0) & (colour > 0).all(axis=0)
    assert np.mean((values > 0).all(axis=0) != valid) < 2e-3
    # Weights: of all pixels here, of windows there
    weights = nnls(colour[:, valid].T, pan[valid])[0]
    total = np.tensordot(weights, colour, 1)
    expected = colour * pan / np.where(total > 0.0, total, 1.0)
    ratio = (values / np.where(expected > 0, expected, 1.0))[:, valid]
    assert np.percentile(np.abs(ratio / np.median(ratio) - 1.0), 99) < 0.01
    assert np.median(ratio) == pytest.approx(1.0, abs=0.01)
    # Bands keep their level, and get the details of the panchromatic image
    for band, smooth in zip(values, colour, strict=True):
        assert band[valid].mean() == pytest.approx(smooth[valid].mean(), rel=0.03)
    detail = np.corrcoef(np.diff(values.mean(axis=0))[valid[:, 1:]], np.diff(pan)[valid[:, 1:]])[0, 1]
    assert detail > 0.9 > np.corrcoef(np.diff(colour.mean(axis=0))[valid[:, 1:]], np.diff(pan)[valid[:, 1:]])[0, 1]


def test_a_folder_has_the_images_of_all_exposures(city: Path, tmp_path: Path) -> None:
    """Each panchromatic image gets that of its exposure; hidden ground and the mosaic as without colours."""
    options: dict[str, Any] = {"visibility": True, "mosaic": True}
    made = ortho(city, tmp_path / "sharp", ["image_2.tif", "image_1.tif"], pansharpen=str(city / "ms"), **options)
    plain = ortho(city, tmp_path / "pan", ["image_2.tif", "image_1.tif"], **options)
    assert [Path(entry["output"]).name for entry in made["images"].values()] == [
        "image_2_pansharpened.tif", "image_1_pansharpened.tif"
    ]  # fmt: skip
    assert not [text for text in made["warnings"] if "displaced" in text]
    for name, entry in made["images"].items():
        assert entry["hidden_pixels"] == plain["images"][name]["hidden_pixels"] > 0
    mosaic = gdal.Open(made["mosaic"]["output"])
    shown = [(gdal.Open(one["mosaic"]["output"]).ReadAsArray() > 0) for one in (made, plain)]
    assert mosaic.RasterCount == 4 and np.mean(shown[0].all(axis=0) != shown[1]) < 5e-3
    again = ortho(city, tmp_path / "sharp", ["image_2.tif", "image_1.tif"], pansharpen=str(city / "ms"), **options)
    assert {entry["status"] for entry in again["images"].values()} == {"kept"} and again["mosaic"]["status"] == "kept"


def test_a_displaced_multispectral_image_is_told(city: Path, tmp_path: Path) -> None:
    """As if only the panchromatic image had been refined: its RPC is shifted by 5 px."""
    image = open_image(str(city / "image_1.tif"))
    write_geotiff_copy(str(city / "image_1.tif"), str(tmp_path / "image_1.tif"), image.rpc.shift(4.0, -3.0))
    made = ortho(city, tmp_path / "out", [str(tmp_path / "image_1.tif")], pansharpen=str(city / "ms"))
    (told,) = [text for text in made["warnings"] if "displaced" in text]
    assert 4.0 < float(told.split(" px")[0].split()[-1]) < 6.0


@pytest.mark.parametrize(("images", "pansharpen", "reason"), [
    (["image_1.tif"], "ms/image_2_ms.tif", "no multispectral image of its exposure"),
    (["image_1.tif"], "dem.tif", "RPC"),
    (["ms/image_1_ms.tif"], "image_1.tif", "pansharpen"),
    (["image_1.tif"], "missing.tif", "missing.tif"),
], ids=str)  # fmt: skip
def test_what_does_not_belong_together_is_refused(
    city: Path, tmp_path: Path, images: list[str], pansharpen: str, reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        ortho(city, tmp_path / "out", images, pansharpen=str(city / pansharpen))


def test_parts_of_an_exposure_are_paired_by_their_place(city: Path) -> None:
    """Two parts of a strip, each with a panchromatic and a multispectral file, in another order."""
    rpc = open_image(str(city / "image_1.tif")).rpc
    images = []
    for name, line, pixel in (("a", 0, 1.0), ("b", 800, 1.0), ("b_ms", 804, 4.0), ("a_ms", 4, 4.0)):
        size = (int(800 / pixel),) * 2
        images.append(Image(name, rpc, size, path=f"{name}.tif", tile=Tile("strip", (0.0, line), (800, 1600), pixel)))
    pan, pairs = pair_exposures(images, ["a_ms.tif", "b_ms.tif"])
    assert [image.id for image in pan] == ["a", "b"] and {k: one.id for k, one in pairs.items()} == {
        "a": "a_ms", "b": "b_ms"
    }  # fmt: skip
    other = replace(images[0], id="c", path="c.tif", tile=Tile("other", (0.0, 0.0)))
    with pytest.raises(InputError, match="c: `pansharpen` names no multispectral image"):
        pair_exposures([*images, other], ["a_ms.tif", "b_ms.tif"])
