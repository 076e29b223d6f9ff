"""Opening images and reading windows of pixels."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from osgeo import gdal
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine import camera
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rasters.images import GdalRaster, image_id, open_image, open_image_and_source, placement_doubt
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text

RPC = sample_rpc(1)


@pytest.mark.parametrize(
    ("path", "expected"),
    [("a/img_01.tif", "img_01"), ("zy301a_fwd_rpc.txt", "zy301a_fwd"), ("x_RPC.TXT", "x"), ("_RPC.TXT", "_RPC"),
     ("RPC_1A.xml", "RPC_1A"), ("07JAN27.RPB", "07JAN27"), ("a.b.tif", "a.b"), ("scene_rpc.tif", "scene_rpc")],
)  # fmt: skip
def test_id(path: str, expected: str) -> None:
    assert image_id(path) == expected


def test_image_with_pixels(tmp_path: Path) -> None:
    pixels = write_image(tmp_path / "img.tif", RPC)
    image = open_image(str(tmp_path / "img.tif"))
    assert (image.id, image.size, image.rpc) == ("img", (400, 300), RPC)
    grey, valid = image.raster.read(100, 50, 30, 20)
    np.testing.assert_array_equal(grey, pixels[50:70, 100:130])
    assert valid.all()


def test_rpc_file_alone_has_no_pixels(tmp_path: Path) -> None:
    write_rpc_text(str(tmp_path / "img_RPC.TXT"), RPC)
    image = open_image(str(tmp_path / "img_RPC.TXT"))
    assert (image.id, image.size, image.raster, image.rpc) == ("img", None, None, RPC)


def test_source_for_the_log(tmp_path: Path) -> None:
    write_image(tmp_path / "img.tif", RPC)
    write_rpc_text(str(tmp_path / "img.RPB"), RPC, kind="rpb")
    _image, found = open_image_and_source(str(tmp_path / "img.tif"))
    assert found.summary == "RPC from .RPB img.RPB; not used: GeoTIFF tag of img.tif"


def test_other_rpcs_are_told_with_how_far_off_they_are(tmp_path: Path) -> None:
    """Two deliveries mixed up, or a refined RPC beside the vendor's: said in pixels; the same RPC twice is no news."""
    write_image(tmp_path / "img.tif", RPC)
    write_rpc_text(str(tmp_path / "img.RPB"), replace(RPC, line_off=RPC.line_off + 37.0), kind="rpb")
    _image, found = open_image_and_source(str(tmp_path / "img.tif"))
    assert found.ignored == ("GeoTIFF tag of img.tif (37 px off)",)


def test_an_orthoimage_that_kept_the_rpc_of_the_raw_image_is_doubted(tmp_path: Path) -> None:
    """Warped by GDAL and given the raw image's RPC; an image on a map's grid with an RPC of its own is not."""
    write_image(tmp_path / "raw.tif", RPC)
    assert not placement_doubt(open_image(str(tmp_path / "raw.tif")))
    gdal.Warp(str(tmp_path / "ortho.tif"), str(tmp_path / "raw.tif"), dstSRS="EPSG:4326", rpc=True)
    ortho = gdal.Open(str(tmp_path / "ortho.tif"), gdal.GA_Update)
    ortho.SetMetadata(gdal.Open(str(tmp_path / "raw.tif")).GetMetadata("RPC"), "RPC")
    size = np.array([ortho.RasterXSize, ortho.RasterYSize])
    geotransform, crs = ortho.GetGeoTransform(), ortho.GetProjection()
    ortho = None
    doubt = placement_doubt(open_image(str(tmp_path / "ortho.tif")))
    assert doubt is not None and doubt.contradictory
    assert "does not follow" in doubt.message and "WGS 84" in doubt.message
    # an RPC that is the map's grid, 40 pixels off as RPCs are
    own = fit_grid_rpc(geotransform, size)
    write_image(tmp_path / "geo.tif", own.shift(40.0, -25.0))
    geo = gdal.Open(str(tmp_path / "geo.tif"), gdal.GA_Update)
    geo.SetGeoTransform(geotransform)
    geo.SetProjection(crs)
    geo = None
    assert not placement_doubt(open_image(str(tmp_path / "geo.tif")))


def fit_grid_rpc(geotransform: tuple[float, ...], size: np.ndarray) -> camera.RPC:
    """Return the RPC of a grid of longitudes and latitudes that leans 15 degrees to the east."""
    middle = np.array([geotransform[0], geotransform[3]]) + 0.5 * size * [geotransform[1], geotransform[5]]
    one, lon, lat, height = np.eye(20)[:4]
    scale = 0.5 * size * [geotransform[1], -geotransform[5]]
    return replace(
        RPC,
        line_off=0.5 * size[1] - 0.5, samp_off=0.5 * size[0] - 0.5, lat_off=middle[1], long_off=middle[0],
        height_off=RPC.height_off, line_scale=0.5 * size[1], samp_scale=0.5 * size[0], lat_scale=scale[1],
        long_scale=scale[0], height_scale=500.0, line_num=-lat, line_den=one, samp_num=lon + 0.1 * height, samp_den=one,
    )  # fmt: skip


def test_window_over_the_edge_is_not_valid_there(tmp_path: Path) -> None:
    pixels = write_image(tmp_path / "img.tif", RPC)
    grey, valid = GdalRaster(str(tmp_path / "img.tif")).read(-3, 295, 10, 8)
    assert grey.shape == valid.shape == (8, 10)
    np.testing.assert_array_equal(grey[:5, 3:], pixels[295:, :7])
    assert valid.sum() == 5 * 7
    assert not grey[~valid].any()
    grey, valid = GdalRaster(str(tmp_path / "img.tif")).read(5000, 0, 4, 3)
    assert grey.shape == (3, 4)
    assert not valid.any()


def _image_with(path: Path, bands: int, kind: int = gdal.GDT_Byte) -> gdal.Dataset:
    dataset = gdal.GetDriverByName("GTiff").Create(str(path), 20, 10, bands, kind)
    for band in range(1, bands + 1):
        dataset.GetRasterBand(band).WriteArray(np.full((10, 20), 10 * band))
    return dataset


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_mask_from_nodata_alpha_mask_band_and_nan(tmp_path: Path) -> None:
    hole = np.zeros((10, 20), dtype=bool)
    hole[2:4, 5:9] = True
    nodata = _image_with(tmp_path / "nodata.tif", 1)
    nodata.GetRasterBand(1).SetNoDataValue(0)
    nodata.GetRasterBand(1).WriteArray(np.where(hole, 0, 10))
    alpha = _image_with(tmp_path / "alpha.tif", 4)
    alpha.GetRasterBand(4).SetColorInterpretation(gdal.GCI_AlphaBand)
    alpha.GetRasterBand(4).WriteArray(np.where(hole, 0, 255))
    masked = _image_with(tmp_path / "masked.tif", 1)
    masked.CreateMaskBand(gdal.GMF_PER_DATASET)
    masked.GetRasterBand(1).GetMaskBand().WriteArray(np.where(hole, 0, 255))
    nan = _image_with(tmp_path / "nan.tif", 1, gdal.GDT_Float32)
    nan.GetRasterBand(1).WriteArray(np.where(hole, np.nan, 10.0))
    nodata = alpha = masked = nan = None
    for name in ("nodata", "alpha", "masked", "nan"):
        grey, valid = GdalRaster(str(tmp_path / f"{name}.tif")).read(0, 0, 20, 10)
        np.testing.assert_array_equal(valid, ~hole, err_msg=name)
        assert (grey[valid] == 10).all()  # the first band
        with rasterio.open(tmp_path / f"{name}.tif") as opened:
            if name != "nan":
                np.testing.assert_array_equal(valid, opened.dataset_mask() != 0)


def test_threads_read_at_the_same_time(tmp_path: Path) -> None:
    pixels = write_image(tmp_path / "img.tif", RPC, ("TILED=YES", "COMPRESS=DEFLATE", "BLOCKXSIZE=16", "BLOCKYSIZE=16"))
    raster = GdalRaster(str(tmp_path / "img.tif"))
    barrier = threading.Barrier(4)

    def read_all(offset: int) -> bool:
        barrier.wait()
        windows = [(s, li) for s in range(offset, 360, 37) for li in range(offset, 260, 23)]
        return all(np.array_equal(raster.read(s, li, 40, 40)[0], pixels[li : li + 40, s : s + 40]) for s, li in windows)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(read_all, range(4)))


def test_gdal_exceptions_make_no_difference(tmp_path: Path) -> None:
    (tmp_path / "x.tif").write_bytes(b"no image")
    before = gdal.GetUseExceptions()
    try:
        for switch in (gdal.UseExceptions, gdal.DontUseExceptions):
            switch()
            with pytest.raises(InputError, match="neither an image nor an RPC file"):
                open_image(str(tmp_path / "x.tif"))
    finally:
        (gdal.UseExceptions if before else gdal.DontUseExceptions)()


def test_cut_short_pixels_are_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_image(tmp_path / "img.tif", RPC, ("COMPRESS=DEFLATE",))
    content = bytearray((tmp_path / "img.tif").read_bytes())
    content[2000:60000] = bytes(58000)
    (tmp_path / "img.tif").write_bytes(content)
    raster = open_image(str(tmp_path / "img.tif")).raster
    with pytest.raises(InputError, match=r"img.tif: pixels at sample 0, line 0 cannot be read"):
        raster.read(0, 0, 400, 300)
    assert capfd.readouterr().err == ""


def test_band_that_is_not_there(tmp_path: Path) -> None:
    write_image(tmp_path / "img.tif", RPC)
    with pytest.raises(InputError, match="has 1 bands, band 2"):
        GdalRaster(str(tmp_path / "img.tif"), 2)
