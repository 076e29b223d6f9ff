"""Writing RPCs: values come back exactly, pixels and layout stay, the original can be restored, nothing is torn."""

import hashlib
import os
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import rasterio
from osgeo import gdal
from osgeo_utils.samples.validate_cloud_optimized_geotiff import validate
from rpc_samples import ground_grid, restore, sample_rpc, write_image, write_in_place

from hrsi.hrsi_engine.foundation.errors import Cancelled, InputError, OutputError
from hrsi.hrsi_engine.io.rpc_files import (
    prepare_sidecar,
    read_rpc,
    tiff_tag,
    write_geotiff_copy,
    write_rpc_text,
    write_vrt,
)
from hrsi.hrsi_engine.io.rpc_files.fields import SCALARS, rpc_from_entries
from hrsi.hrsi_engine.io.safety.transactions import Transaction

OLD, NEW = sample_rpc(1, err_bias=3.0), sample_rpc(2)
LAYOUTS = {
    "plain": ("GTiff", ()),
    "bigtiff": ("GTiff", ("BIGTIFF=YES", "TILED=YES", "COMPRESS=DEFLATE", "PREDICTOR=2")),
    "big-endian": ("GTiff", ("ENDIANNESS=BIG", "COMPRESS=LZW")),
    "12 bits": ("GTiff", ("NBITS=12",)),
    "cog": ("COG", ("BLOCKSIZE=128", "COMPRESS=DEFLATE")),
    "cog bigtiff": ("COG", ("BLOCKSIZE=128", "COMPRESS=LZW", "BIGTIFF=YES")),
}  # fmt: skip


@pytest.fixture(params=LAYOUTS)
def image(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """An image with an RPC and some metadata, in each layout."""
    driver, options = LAYOUTS[request.param]
    write_image(tmp_path / "image.tif", OLD, options, driver, {"SENSOR": "none", "NOTE": "<&> ä"}, size=(500, 400))
    return tmp_path / "image.tif"


def everything_but_the_rpc(path: Path) -> tuple[object, ...]:
    """Return what must survive: pixels of all levels, structure and metadata."""
    dataset = gdal.Open(str(path))
    band = dataset.GetRasterBand(1)
    levels = [band.GetOverview(i).Checksum() for i in range(band.GetOverviewCount())]
    structure = dataset.GetMetadata("IMAGE_STRUCTURE") | band.GetMetadata("IMAGE_STRUCTURE")
    return band.Checksum(), levels, structure, dataset.GetMetadata(), band.GetBlockSize(), band.DataType


def assert_cog_where_it_was(path: Path, layout: object) -> None:
    if isinstance(layout, dict) and layout.get("LAYOUT") == "COG":
        _warnings, errors, _details = validate(str(path), full_check=True)
        assert errors == []


def tag_bytes(path: Path) -> bytes:
    numbers = tiff_tag.read_numbers(str(path))
    return b"" if numbers is None else struct.pack("92d", *numbers)


def assert_others_read(path: Path, rpc: object) -> None:
    """GDAL and rasterio find the RPC, to their 15 digits."""
    ground = ground_grid(NEW)
    found = rpc_from_entries("GDAL", gdal.Open(str(path)).GetMetadata("RPC"))
    np.testing.assert_allclose(found.project(ground), rpc.project(ground), atol=1e-7)  # type: ignore[attr-defined]
    with rasterio.open(path) as opened:
        for name in SCALARS:
            assert getattr(opened.rpcs, name) == pytest.approx(getattr(rpc, name), rel=1e-14)


# ---- copy -----------------------------------------------------------------------------------------------------


def test_copy_changes_the_rpc_alone(image: Path, tmp_path: Path) -> None:
    before, source = everything_but_the_rpc(image), hashlib.sha256(image.read_bytes()).digest()
    assert write_geotiff_copy(str(image), str(tmp_path / "copy.tif"), NEW) == ()
    assert read_rpc(str(tmp_path / "copy.tif")).rpc == NEW
    assert everything_but_the_rpc(tmp_path / "copy.tif") == before
    assert hashlib.sha256(image.read_bytes()).digest() == source
    assert_cog_where_it_was(tmp_path / "copy.tif", before[2])
    assert_others_read(tmp_path / "copy.tif", NEW)
    assert sorted(os.listdir(tmp_path)) == ["copy.tif", "image.tif"]


def test_copy_of_lossy_jpeg_keeps_every_pixel(real_data: Path, tmp_path: Path) -> None:
    source = real_data / "qb2_gcp" / "qb2_basic1b.tif"
    write_geotiff_copy(str(source), str(tmp_path / "copy.tif"), NEW)
    assert everything_but_the_rpc(tmp_path / "copy.tif") == everything_but_the_rpc(source)
    assert gdal.Open(str(tmp_path / "copy.tif")).GetGCPCount() == 5


@pytest.mark.parametrize("driver", ["NITF", "PNG", "VRT"])
def test_copy_of_another_format(driver: str, tmp_path: Path) -> None:
    source = tmp_path / f"source.{driver.lower()}"
    pixels = write_image(tmp_path / "in.tif", OLD)
    gdal.Translate(str(source), str(tmp_path / "in.tif"), format=driver)
    write_geotiff_copy(str(source), str(tmp_path / "copy.tif"), NEW)
    assert read_rpc(str(tmp_path / "copy.tif")).rpc == NEW
    copy = gdal.Open(str(tmp_path / "copy.tif"))
    assert copy.GetDriver().ShortName == "GTiff"
    np.testing.assert_array_equal(copy.ReadAsArray(), pixels)


def test_copy_takes_mask_overviews_and_auxiliary_metadata_along(tmp_path: Path) -> None:
    source = tmp_path / "in.tif"
    write_image(source, OLD)
    dataset = gdal.Open(str(source))
    dataset.GetRasterBand(1).ComputeStatistics(False)
    dataset.BuildOverviews("NEAREST", [2])
    dataset.CreateMaskBand(gdal.GMF_PER_DATASET)
    dataset.GetRasterBand(1).GetMaskBand().Fill(255)
    dataset.SetMetadata({"LINE_OFF": "stale"}, "RPC")
    dataset = None
    assert (tmp_path / "in.tif.aux.xml").exists()
    (tmp_path / "out").mkdir()
    write_geotiff_copy(str(source), str(tmp_path / "out" / "copy.tif"), NEW)
    copy = gdal.Open(str(tmp_path / "out" / "copy.tif"))
    band = copy.GetRasterBand(1)
    assert band.GetOverviewCount() == 1
    assert band.GetMaskFlags() == gdal.GMF_PER_DATASET
    assert "STATISTICS_MEAN" in band.GetMetadata()
    assert read_rpc(str(tmp_path / "out" / "copy.tif")).ignored == ()


def test_cancelled_or_failed_copy_leaves_nothing(image: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(Cancelled):
        write_geotiff_copy(str(image), str(tmp_path / "out" / "c.tif"), NEW, lambda fraction, message: False)
    with pytest.raises(OutputError, match="cannot be written"):
        write_geotiff_copy(str(image), str(tmp_path / "missing" / "c.tif"), NEW)
    assert os.listdir(tmp_path / "out") == []


def test_stale_sidecars_of_an_earlier_run_are_set_aside(image: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    write_rpc_text(str(out / "c_RPC.TXT"), OLD)  # ours: removed
    (out / "c.RPB").write_text((out / "c_RPC.TXT").read_text().replace("WRITTEN_BY: HRSI", ""))  # a stranger's: kept
    notices = write_geotiff_copy(str(image), str(out / "c.tif"), NEW)
    assert len(notices) == 2
    assert sorted(os.listdir(out)) == ["c.RPB.original", "c.tif"]
    assert_others_read(out / "c.tif", NEW)
    write_rpc_text(str(out / "c_RPC.TXT"), NEW)
    assert write_geotiff_copy(str(image), str(out / "c.tif"), NEW) == ()  # the same RPC may stay
    (out / "c_RPC.TXT").write_text("a stranger's")
    with pytest.raises(InputError, match="choose another output directory"):  # it may belong to an image there
        write_geotiff_copy(str(out / "c.tif"), str(out / "C.tif"), NEW)


# ---- in place --------------------------------------------------------------------------------------------------


def test_in_place_and_back_bit_by_bit(image: Path, tmp_path: Path) -> None:
    before, original = everything_but_the_rpc(image), tag_bytes(image)
    assert write_in_place(str(image), NEW) == ()
    write_in_place(str(image), sample_rpc(5))
    write_in_place(str(image), NEW)
    assert read_rpc(str(image)).rpc == NEW
    assert everything_but_the_rpc(image) == before
    assert_others_read(image, NEW)
    assert_cog_where_it_was(image, before[2])
    kept = gdal.Open(str(image)).GetMetadata("HRSI_ORIGINAL_RPC")
    assert float(kept["LINE_OFF"]) == OLD.line_off
    restore(str(image))
    assert tag_bytes(image) == original
    assert everything_but_the_rpc(image) == before
    assert_cog_where_it_was(image, before[2])
    assert gdal.Open(str(image)).GetMetadata("HRSI_ORIGINAL_RPC") == {}
    with pytest.raises(InputError, match="keeps no original RPC"):
        restore(str(image))
    assert os.listdir(tmp_path) == ["image.tif"]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_in_place_where_there_was_no_tag(layout: str, tmp_path: Path) -> None:
    driver, options = LAYOUTS[layout]
    image = tmp_path / "image.tif"
    write_image(image, None, options, driver, size=(500, 400))
    before = everything_but_the_rpc(image)
    notices = write_in_place(str(image), NEW)
    assert read_rpc(str(image)).rpc == NEW
    assert everything_but_the_rpc(image) == before
    _warnings, errors, _details = validate(str(image), full_check=True) if driver == "COG" else ([], [], {})
    assert bool(errors) == any("no longer a Cloud Optimized GeoTIFF" in notice for notice in notices)
    restore(str(image))
    assert tag_bytes(image) == b""
    assert everything_but_the_rpc(image) == before


def test_image_that_gdal_rewrote_can_still_be_restored(image: Path) -> None:
    original = tag_bytes(image)
    write_in_place(str(image), NEW)
    dataset = gdal.OpenEx(str(image), gdal.OF_UPDATE, open_options=["IGNORE_COG_LAYOUT_BREAK=YES"])
    dataset.SetMetadataItem("ADDED", "later")
    dataset = None
    restore(str(image))
    assert tag_bytes(image) == original
    assert gdal.Open(str(image)).GetMetadataItem("ADDED") == "later"


def test_sidecars_that_would_win_are_set_aside_and_come_back(tmp_path: Path, real_data: Path) -> None:
    image = tmp_path / "x.tif"
    write_image(image, OLD)
    for name in ("x.RPB", "x_RPC.TXT"):
        write_rpc_text(str(tmp_path / name), sample_rpc(6), kind="rpb" if name.endswith("RPB") else "rpc-txt")
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text.replace("HRSI", "vendor"))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    notices = write_in_place(str(image), NEW)
    assert len(notices) == 2
    assert "x.RPB.original" in notices[0]
    assert read_rpc(str(image)).rpc == NEW
    assert_others_read(image, NEW)
    restore(str(image))
    for name in ("x.RPB", "x_RPC.TXT"):
        assert (tmp_path / name).read_bytes() == before[name]
    assert sorted(os.listdir(tmp_path)) == sorted(before)


def test_vendors_xml_stays_and_an_rpb_wins_over_it(tmp_path: Path, real_data: Path) -> None:
    image = tmp_path / "x.tif"
    write_image(image, OLD)
    shutil.copy(real_data / "formats" / "wv_isd_xml" / "rpc_WV2.xml", tmp_path / "x.XML")
    vendors = read_rpc(str(image)).rpc
    write_in_place(str(image), NEW)
    assert (tmp_path / "x.RPB").exists()
    assert read_rpc(str(image)).rpc == NEW
    assert_others_read(image, NEW)
    restore(str(image))
    assert sorted(os.listdir(tmp_path)) == ["x.XML", "x.tif"]
    assert read_rpc(str(image)).rpc == vendors


def test_rpc_file_alone_in_place_and_back(tmp_path: Path) -> None:
    file = tmp_path / "x_RPC.TXT"
    write_rpc_text(str(file), OLD)
    file.write_text(file.read_text().replace("HRSI", "vendor") + "COMMENT: mine\n")
    before = file.read_bytes()
    write_in_place(str(file), NEW)
    write_in_place(str(file), sample_rpc(7))
    assert read_rpc(str(file)).rpc == sample_rpc(7)
    restore(str(file))
    assert file.read_bytes() == before
    assert os.listdir(tmp_path) == ["x_RPC.TXT"]


def test_in_place_only_into_geotiff(tmp_path: Path) -> None:
    write_image(tmp_path / "x.png", OLD, driver="PNG")
    with pytest.raises(InputError, match="only a GeoTIFF"):
        write_in_place(str(tmp_path / "x.png"), NEW)


def test_in_place_follows_a_link_and_keeps_permissions(image: Path, tmp_path: Path) -> None:
    image.chmod(0o640)
    (tmp_path / "link.tif").symlink_to(image)
    write_in_place(str(tmp_path / "link.tif"), NEW)
    assert (tmp_path / "link.tif").is_symlink()
    assert image.stat().st_mode & 0o777 == 0o640
    assert read_rpc(str(image)).rpc == NEW


# ---- other files ------------------------------------------------------------------------------------------------


def test_vrt_leaves_the_source_and_warps_like_the_copy(tmp_path: Path) -> None:
    image = tmp_path / "image.tif"
    write_image(image, OLD)
    before = image.read_bytes()
    (tmp_path / "other").mkdir()
    write_geotiff_copy(str(image), str(tmp_path / "copy.tif"), NEW)
    for vrt in (tmp_path / "beside.vrt", tmp_path / "other" / "away.vrt"):
        write_vrt(str(image), str(vrt), NEW)
        assert read_rpc(str(vrt)).rpc == NEW
        warped = [_warped(path) for path in (vrt, tmp_path / "copy.tif")]
        np.testing.assert_array_equal(*warped)
        assert warped[0].any()
    assert 'relativeToVRT="1">image.tif<' in (tmp_path / "beside.vrt").read_text()
    assert 'relativeToVRT="0"' in (tmp_path / "other" / "away.vrt").read_text()
    assert image.read_bytes() == before


def _warped(path: Path) -> np.ndarray:
    options = ["RPC_HEIGHT=300"]
    warped = gdal.Warp("", str(path), format="MEM", rpc=True, transformerOptions=options, dstSRS="EPSG:4326")
    assert warped.GetProjection()
    return warped.ReadAsArray()


def test_sidecar_keeps_the_vendors_and_says_what_wins(tmp_path: Path) -> None:
    write_image(tmp_path / "x.tif", OLD)
    write_rpc_text(str(tmp_path / "x.RPB"), OLD, kind="rpb")
    (tmp_path / "x_rpc.txt").write_text("vendor's")
    with Transaction(str(tmp_path)) as changes:
        notices = prepare_sidecar(str(tmp_path / "x_RPC.TXT"), NEW, changes)
        changes.commit()
    assert (tmp_path / "x_rpc.txt.original").read_text() == "vendor's"
    assert "x.RPB" in notices[0]
    assert read_rpc(str(tmp_path / "x.tif")).rpc == NEW
    assert_others_read(tmp_path / "x.tif", NEW)


def test_gdal_reads_the_text_formats_exactly(tmp_path: Path) -> None:
    for name, kind in (("x.RPB", "rpb"), ("x_RPC.TXT", "rpc-txt")):
        write_image(tmp_path / "x.tif", None)
        write_rpc_text(str(tmp_path / name), NEW, kind=kind)
        assert rpc_from_entries("GDAL", gdal.Open(str(tmp_path / "x.tif")).GetMetadata("RPC")) == NEW
        (tmp_path / name).unlink()
