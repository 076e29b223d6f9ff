"""Images resampled by GDAL or others with an RPC that does not follow: found, with the offset; sound ones are not."""

from __future__ import annotations

import json
import logging
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal
from rpc_samples import sample_rpc, write_image

import hrsi
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rasters.images import open_image, resampling_doubt
from hrsi.hrsi_engine.io.rpc_files import write_rpb
from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main

SIZE = (400, 300)
#: OFF and SCALE as vendors have them: Airbus and `simulate`, then SPOT 6 and WorldView-1.
HABITS = {"first to last": (0.5, 0.5), "one more": (1.0, 0.0)}


def vendor_rpc(habit: str, size: tuple[int, int] = SIZE) -> RPC:
    off, scale = HABITS[habit]
    return replace(
        sample_rpc(2), samp_off=size[0] / 2 - off, line_off=size[1] / 2 - off,
        samp_scale=size[0] / 2 - scale, line_scale=size[1] / 2 - scale,
    )  # fmt: skip


def offset_px(path: Path) -> float | None:
    found = resampling_doubt(open_image(str(path)))
    return None if found is None else found.offset_px


@pytest.mark.parametrize("factor", [0.37, 1 / 3, 0.5, 1.5])
@pytest.mark.parametrize("habit", HABITS)
def test_gdals_half_pixel_is_found(habit: str, factor: float, tmp_path: Path) -> None:
    """What GDAL's RPC is off is measured here with GDAL's own transformer, at the middle of the picture."""
    write_image(tmp_path / "a.tif", vendor_rpc(habit), size=SIZE)
    gdal.Translate(
        str(tmp_path / "b.tif"), str(tmp_path / "a.tif"), width=round(factor * 400), height=round(factor * 300)
    )
    gdal.Translate(
        str(tmp_path / "b.vrt"), str(tmp_path / "a.tif"), width=round(factor * 400), height=round(factor * 300),
        format="VRT",
    )  # fmt: skip
    seen = []
    for name in ("a.tif", "b.tif"):
        dataset = gdal.Open(str(tmp_path / name))
        transformer = gdal.Transformer(dataset, None, ["METHOD=RPC"])
        point = [(vendor_rpc(habit).long_off, vendor_rpc(habit).lat_off, vendor_rpc(habit).height_off)]
        corner = np.array(transformer.TransformPoints(True, point)[0])[0, :2]
        seen.append(corner / [dataset.RasterXSize, dataset.RasterYSize])
    truth = np.abs((seen[1] - seen[0]) * [round(factor * 400), round(factor * 300)]).max()
    told = habit == "first to last" or (2.0 * factor) % 1.0  # halved, the second habit looks like the first one
    assert offset_px(tmp_path / "b.vrt") == pytest.approx(truth, abs=1e-4)
    assert offset_px(tmp_path / "b.tif") == (pytest.approx(truth, abs=1e-4) if told else None)
    print(f"{habit}, factor {factor:.3f}: GDAL is {truth:.4f} px off, told {offset_px(tmp_path / 'b.tif')}")


@pytest.mark.parametrize("habit", HABITS)
def test_sound_images_are_not_doubted(habit: str, tmp_path: Path) -> None:
    """As delivered, and as cut and resampled by `crop`, also where a refinement shifted the RPC."""
    for shift in (0.0, 3.37):
        write_image(tmp_path / "a.tif", vendor_rpc(habit).shift(shift, -shift), size=SIZE)
        assert offset_px(tmp_path / "a.tif") is None
        for factor in (0.37, 1 / 3, 0.5, 1.5, 2.0):
            for format in ("gtiff", "vrt"):
                given = {"images": [str(tmp_path / "a.tif")], "output_dir": str(tmp_path / "out"), "overwrite": True}
                (entry,) = run("crop", factor=factor, format=format, **given)["images"].values()
                assert offset_px(Path(entry["output"])) is None
        gdal.Translate(str(tmp_path / "cut.tif"), str(tmp_path / "a.tif"), srcWin=[37, 41, 200, 150])
        assert offset_px(tmp_path / "cut.tif") is None


def test_an_rpc_of_twice_the_size(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Inside the image and beside it; in a product whose file states the size, whatever its centre is."""
    full = vendor_rpc("first to last")
    write_image(tmp_path / "half.tif", full, size=(200, 150))
    assert offset_px(tmp_path / "half.tif") == pytest.approx(199.0)  # pixel 199 of 200 is 398.5 of 400
    write_image(tmp_path / "beside.tif", None, size=(200, 150))
    write_rpb(str(tmp_path / "beside.RPB"), full)
    assert offset_px(tmp_path / "beside.tif") == pytest.approx(199.0)
    write_image(tmp_path / "product.tif", None, size=(200, 150))
    size = "<IMD><NUMCOLUMNS>400</NUMCOLUMNS><NUMROWS>301</NUMROWS></IMD>"
    (tmp_path / "product.XML").write_text(isd_text(full.shift(-18.0, -36.0)).replace("<isd>", f"<isd>{size}"))
    assert offset_px(tmp_path / "product.tif") == pytest.approx(199.0)
    warnings = run("rpc-info", images=[str(tmp_path / "half.tif")], height=300.0)["warnings"]
    assert any("half: its RPC is that of an image 2 times as long and wide" in text for text in warnings)
    with caplog.at_level(logging.WARNING, logger="hrsi"):
        hrsi.open(str(tmp_path / "half.tif"))
    assert "up to 199 px" in caplog.text


@pytest.mark.wrong_inputs
def test_blocks_are_doubted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Half the pixels with the whole RPC make a block doubtful; GDAL's quarter of a pixel is a warning in the log."""
    block = tmp_path / "block"
    run("simulate", images=2, along="-6,6", size=300, gcps=4, checks=0, ties=20, output_dir=str(block))
    first, second = str(block / "image_1.tif"), str(block / "image_2.tif")
    for name in ("half", "wrong"):
        (tmp_path / name).mkdir()
    half, wrong = (str(tmp_path / name / "image_1.tif") for name in ("half", "wrong"))
    gdal.Translate(half, first, width=150, height=150)
    shutil.copy(half, wrong)
    run("write-rpc", images=[wrong], rpc=first, write="in-place")
    for image, doubted in ((wrong, True), (half, False)):
        points = ["--gcps", str(block / "ground_points.csv"), "--image-points", str(block / "image_points.csv")]
        words = ["adjust", image, second, *points, "--height-datum", "ellipsoidal", "--dry-run", "--json"]
        capsys.readouterr()
        main([*words, "--output-dir", str(tmp_path / "out")])
        out, told = capsys.readouterr()
        codes = [reason["code"] for reason in json.loads(out)["verdict"]["reasons"]]
        assert ("resampled-rpc" in codes) is doubted
        assert ("up to 149 px" if doubted else "up to 0.25 px") in told


def test_a_vrt_with_the_rpc_of_its_source(tmp_path: Path) -> None:
    """Of a window of it, moved or not; a VRT that shows several images, or one as it is, is not judged."""
    write_image(tmp_path / "a.tif", vendor_rpc("first to last"), size=SIZE)
    gdal.Translate(
        str(tmp_path / "b.vrt"),
        str(tmp_path / "a.tif"),
        srcWin=[100, 50, 200, 200],
        width=100,
        height=100,
        format="VRT",
    )
    virtual = gdal.Open(str(tmp_path / "b.vrt"), gdal.GA_Update)
    virtual.SetMetadata(gdal.Open(str(tmp_path / "a.tif")).GetMetadata("RPC"), "RPC")
    del virtual
    assert offset_px(tmp_path / "b.vrt") == pytest.approx(np.hypot(199.0, 149.0), rel=0.1)
    (tmp_path / "moved").mkdir()
    shutil.move(tmp_path / "b.vrt", tmp_path / "moved" / "b.vrt")
    shutil.move(tmp_path / "a.tif", tmp_path / "moved" / "a.tif")
    assert offset_px(tmp_path / "moved" / "b.vrt") is not None
    text = (tmp_path / "moved" / "b.vrt").read_text()
    (tmp_path / "moved" / "b.vrt").write_text(text.replace('xSize="200" ySize="200"', 'xSize="100" ySize="100"'))
    assert offset_px(tmp_path / "moved" / "b.vrt") is None


def test_real_images_are_not_doubted(real_data: Path) -> None:
    """Crops with RPCs of their scenes among them."""
    names = ["s2p_triplet_phr/img_01.tif", "qb2_gcp/qb2_basic1b.tif", "kahramanmaras_phr4/pre_event_img1.tif",
             "ventoux_phr_pair/left_image.tif", "formats/geotiff_tag/PHR1B_P_201709281038393_SEN_PRG_FC_178609-001.tif",
             "formats/nitf_rpc00b/wv3_20.NTF"]  # fmt: skip
    assert [name for name in names if offset_px(real_data / name) is not None] == []
