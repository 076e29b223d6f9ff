"""`orthorectify --mosaic`: pixels, seamlines, repetition, and what is told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osgeo import gdal, ogr
from scipy import ndimage

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError
from hrsi.hrsi_engine.ortho.mosaicking import MOSAIC
from hrsi.processing_algorithms import run


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three images of a city with exact RPCs, and the true surface; the second is darker."""
    folder = tmp_path_factory.mktemp("city")
    run("simulate", landform="city", images=3, along="-15,2,20", size=420, gcps=0, checks=0, ties=0, vendor_error=0.0,
        ms=True, seed=4, output_dir=str(folder))  # fmt: skip
    dataset = gdal.Open(str(folder / "image_2.tif"), gdal.GA_Update)
    dataset.GetRasterBand(1).WriteArray((dataset.ReadAsArray() * 0.7 + 40.0).astype(np.uint16))
    return folder


def ortho(city: Path, out: Path, images: str = "123", **options: Any) -> dict[str, Any]:
    given = {"dem": str(city / "dem.tif"), "height_datum": "ellipsoidal", "report": False, "visibility": True,
             "mosaic": True, **options}  # fmt: skip
    return run("orthorectify", images=[str(city / f"image_{k}.tif") for k in images], output_dir=str(out), **given)


def read(path: str, like: str) -> np.ndarray:
    """Return a raster on the pixels of another one of the same lattice."""
    dataset = gdal.Open(like)
    west, step, _, north, _, _ = dataset.GetGeoTransform()
    box = west, north, west + step * dataset.RasterXSize, north - step * dataset.RasterYSize
    return np.asarray(gdal.Translate("", path, format="MEM", projWin=box).ReadAsArray()).astype(float)


@pytest.fixture(scope="module")
def made(city: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return ortho(city, tmp_path_factory.mktemp("made") / "out")


def labels_of(report: dict[str, Any]) -> np.ndarray:
    """Return the image of each pixel by the polygons of the seamlines, from 1; 0: none."""
    grid = gdal.Open(report["mosaic"]["output"])
    labels = gdal.GetDriverByName("MEM").Create("", grid.RasterXSize, grid.RasterYSize, 1, gdal.GDT_Byte)
    labels.SetGeoTransform(grid.GetGeoTransform())
    source = ogr.Open(report["mosaic"]["seamlines"])
    for number, name in enumerate(report["images"], 1):
        gdal.RasterizeLayer(labels, [1], source.ExecuteSQL(f"SELECT * FROM seamlines WHERE id = '{name}'"),
                            burn_values=[number])  # fmt: skip
    return np.asarray(labels.ReadAsArray())


def test_each_pixel_is_the_levelled_one_of_the_image_of_its_polygon(made: dict[str, Any]) -> None:
    entry, labels = made["mosaic"], labels_of(made)
    mosaic = gdal.Open(entry["output"]).ReadAsArray()
    assert np.array_equal(labels > 0, mosaic > 0) and entry["shown_pixels"] == np.count_nonzero(mosaic)
    reach = 6  # of blending
    side = 2 * reach + 1
    alone = ndimage.maximum_filter(labels, side) == ndimage.minimum_filter(labels, side)
    shares = []
    for number, (name, one) in enumerate(made["images"].items(), 1):
        ((gain, offset),) = entry["gain_offset"][name]
        inside = alone & (labels == number)
        expected = gain * read(one["output"], entry["output"]) + offset
        shares.append(inside.mean())
        assert np.abs(mosaic - expected)[inside].max(initial=0.0) <= 0.51
    assert shares[1] == max(shares) > 0.5  # the image that looks most steeply down


def test_levels_follow_the_darkened_image(made: dict[str, Any]) -> None:
    gains = {name: level[0][0] for name, level in made["mosaic"]["gain_offset"].items()}
    for other in ("image_1", "image_3"):
        assert gains[other] / gains["image_2"] == pytest.approx(0.7, abs=0.02)


def test_hidden_ground_is_filled_and_the_rest_told(made: dict[str, Any]) -> None:
    entry = made["mosaic"]
    shown = [read(one["output"], entry["output"]) > 0 for one in made["images"].values()]
    mosaic = gdal.Open(entry["output"]).ReadAsArray() > 0
    assert np.array_equal(mosaic, np.any(shown, axis=0))
    assert all(made["images"][name]["hidden_share"] > 0.005 for name in ("image_1", "image_3"))
    told = [text for text in made["warnings"] if "mosaic" in text]
    assert bool(told) == bool(entry["unfilled_pixels"])


def test_bands_masks_and_formats(city: Path, tmp_path: Path) -> None:
    """Four bands with a mask in a plain GeoTIFF."""
    images = [str(city / f"image_{k}_ms.tif") for k in (1, 3)]
    made = run("orthorectify", images=images, dem=str(city / "dem.tif"), height_datum="ellipsoidal", mosaic=True,
               nodata="mask", format="gtiff", output_dir=str(tmp_path))  # fmt: skip
    dataset = gdal.Open(made["mosaic"]["output"])
    assert dataset.RasterCount == 4 and dataset.GetRasterBand(1).GetMaskFlags() & gdal.GMF_PER_DATASET
    assert np.array_equal(dataset.GetRasterBand(1).GetMaskBand().ReadAsArray() > 0, labels_of(made) > 0)
    assert dataset.GetRasterBand(2).GetDescription() == gdal.Open(images[0]).GetRasterBand(2).GetDescription()


def test_repeated_and_interrupted_runs(city: Path, tmp_path: Path) -> None:
    """A run that is stopped while it makes the mosaic leaves the orthoimages, and the next one completes it."""
    first = ortho(city, tmp_path, images="12")
    content = Path(first["mosaic"]["output"]).read_bytes()
    again = ortho(city, tmp_path, images="12")
    assert again["mosaic"]["status"] == "kept" and {one["status"] for one in again["images"].values()} == {"kept"}
    assert again["mosaic"]["unfilled_pixels"] == first["mosaic"]["unfilled_pixels"]
    Path(first["mosaic"]["output"]).unlink()
    with pytest.raises(Cancelled):
        ortho(city, tmp_path, images="12", progress=lambda _fraction, text: "mosaic" not in text)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    assert ortho(city, tmp_path, images="12")["mosaic"]["status"] == "made"
    assert Path(first["mosaic"]["output"]).read_bytes() == content


def test_images_of_two_kinds_are_refused(city: Path, tmp_path: Path) -> None:
    images = [str(city / "image_1.tif"), str(city / "image_1_ms.tif")]
    with pytest.raises(InputError, match="number of bands of image_1_ms is 4"):
        run("orthorectify", images=images, dem=str(city / "dem.tif"), height_datum="ellipsoidal", mosaic=True,
            output_dir=str(tmp_path))  # fmt: skip


def test_a_constant_height_hides_nothing(city: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="surface model"):
        ortho(city, tmp_path, dem=None, height=250.0)


def test_large_mosaics_find_seamlines_at_a_lower_resolution(
    city: Path, tmp_path: Path, made: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(MOSAIC), "reduced_px", 20_000)
    reduced = ortho(city, tmp_path)
    assert np.mean(labels_of(reduced) != labels_of(made)) < 0.1
    assert reduced["mosaic"]["shown_pixels"] == made["mosaic"]["shown_pixels"]
