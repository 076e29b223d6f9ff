"""`strip`: WorldView-1, tiles, parts cut from an image, refined ones; their places, pixels and the RPC of the whole."""

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from deliveries import cut_tile, dimap_product, dimap_rpc
from osgeo import gdal
from rpc_samples import ground_grid, sample_rpc, write_image

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.block.exposures import fit_strip, place_parts
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.camera.rpc_fit import refit_rpc
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text
from hrsi.processing_algorithms import run

CAMERA = sample_rpc(1)
SIZE = (403, 301)
#: First sample and line, samples, lines: along the flight with overlap and without, and tiles.
CUTS = {
    "overlapping": [(0, 0, 403, 120), (0, 100, 403, 111), (0, 190, 403, 111)],
    "adjacent": [(0, 0, 403, 150), (0, 150, 403, 151)],
    "tiles": [(0, 0, 200, 150), (200, 0, 203, 150), (0, 150, 200, 151), (200, 150, 203, 151)],
}
HOLD_PX = 0.1


def cut_parts(source: Path, windows: list[tuple[int, int, int, int]], folder: Path) -> list[str]:
    """Cut parts by GDAL, in an order that is not theirs; the RPC moves with them."""
    parts = []
    for number in np.random.default_rng(3).permutation(len(windows)):
        gdal.Translate(str(folder / f"P{number:03}.tif"), str(source), srcWin=windows[number])
        parts.append(str(folder / f"P{number:03}.tif"))
    return parts


def join(parts: list[str], folder: Path, **options: Any) -> tuple[str, dict[str, Any]]:
    report = run("strip", images=parts, output_dir=str(folder), **options)
    (entry,) = report["images"].values()
    return entry["output"], report


def own_rpc(rpc: RPC, size: tuple[int, int]) -> RPC:
    """Return an RPC fitted anew over an image, with OFF and SCALE of its own, as vendors make those of parts."""
    return refit_rpc(rpc, lambda xy, _ground: xy, (0.0, size[0] - 1.0, 0.0, size[1] - 1.0), rpc.height_range).rpc


@pytest.fixture
def image(tmp_path: Path) -> Path:
    write_image(tmp_path / "a.tif", CAMERA, size=SIZE)
    return tmp_path / "a.tif"


@pytest.mark.parametrize("format", ["vrt", "gtiff", "cog"])
@pytest.mark.parametrize("cut", CUTS)
def test_parts_of_an_image_become_the_image(cut: str, format: str, image: Path, tmp_path: Path) -> None:
    """Every pixel and the RPC come back, whatever the order; GDAL sees every point where it was."""
    output, report = join(cut_parts(image, CUTS[cut], tmp_path), tmp_path / "out", format=format)
    np.testing.assert_array_equal(gdal.Open(output).ReadAsArray(), gdal.Open(str(image)).ReadAsArray())
    seen = [
        np.array(gdal.Transformer(gdal.Open(path), None, ["METHOD=RPC"]).TransformPoints(True, points)[0])
        for path in (output, str(image)) for points in [ground_grid(CAMERA).tolist()]
    ]  # fmt: skip
    np.testing.assert_allclose(*seen, atol=1e-6)
    assert not report["warnings"]
    placed = {name: (part["sample"], part["line"]) for name, part in report["images"].popitem()[1]["parts"].items()}
    assert placed == {f"P{number:03}": window[:2] for number, window in enumerate(CUTS[cut])}


def test_parts_with_rpcs_of_their_own(image: Path, tmp_path: Path) -> None:
    """Fitted together the strip's RPC is the camera that the parts were cut from."""
    parts = cut_parts(image, CUTS["overlapping"], tmp_path)
    for path in parts:
        window = CUTS["overlapping"][int(Path(path).stem[1:])]
        rpc = own_rpc(CAMERA.shift(-window[0], -window[1]), window[2:])
        write_rpc_text(str(Path(path).with_suffix("")) + "_RPC.TXT", rpc)
    output, report = join(parts, tmp_path / "out")
    ground = CAMERA.localize(np.array([[0.0, 0.0], [402.0, 0.0], [402.0, 300.0], [200.0, 150.0]]), 300.0).ground
    np.testing.assert_allclose(read_rpc(output).rpc.project(ground), CAMERA.project(ground), atol=1e-3)
    assert not report["warnings"]


@pytest.mark.parametrize("format", ["vrt", "gtiff"])
def test_refined_parts_make_a_refined_strip(format: str, image: Path, tmp_path: Path) -> None:
    parts = cut_parts(image, CUTS["adjacent"], tmp_path)
    for path in parts:
        write_rpc_text(str(tmp_path / "new_RPC.TXT"), read_rpc(path).rpc.shift(3.25, -1.5))
        run("write-rpc", images=[path], rpc=str(tmp_path / "new_RPC.TXT"), write="in-place")
    output, _ = join(parts, tmp_path / "out", format=format)
    ground = ground_grid(CAMERA)
    np.testing.assert_allclose(read_rpc(output).rpc.project(ground), CAMERA.project(ground) + [3.25, -1.5], atol=1e-6)
    if format == "gtiff":
        run("write-rpc", images=[output], restore=True)
        np.testing.assert_allclose(read_rpc(output).rpc.project(ground), CAMERA.project(ground), atol=1e-6)


def test_tiles_of_an_airbus_scene(image: Path, tmp_path: Path) -> None:
    """R1C1 … with one RPC beside them: the strip has exactly that, and no fit."""
    folder, size = tmp_path / "IMG_01", (200, 150)
    folder.mkdir()
    (folder / "RPC_x.XML").write_text(dimap_rpc(CAMERA))
    parts = {}
    for number, (sample, line, samples, lines) in enumerate(CUTS["tiles"]):
        name = f"IMG_x_R{line // 150 + 1}C{sample // 200 + 1}.TIF"
        cut_tile(image, folder / name, (sample, line, samples, lines))
        parts[name] = (number, 0)
    (folder / "DIM_x.XML").write_text(dimap_product("RPC_x.XML", SIZE, size, {}))
    output, report = join([str(folder / name) for name in parts], tmp_path / "out")
    np.testing.assert_array_equal(gdal.Open(output).ReadAsArray(), gdal.Open(str(image)).ReadAsArray())
    ground = ground_grid(CAMERA)
    np.testing.assert_allclose(read_rpc(output).rpc.project(ground), CAMERA.project(ground), atol=1e-6)
    assert report["images"]["IMG_x_R1C1_strip"]["rpc_fit_max_px"] < 1e-6


def test_tiles_of_a_worldview_product(image: Path, tmp_path: Path) -> None:
    """…_R1C1-…_P001.TIF have one XML, which places them; a tile that it does not list is refused."""
    listed = "".join(
        f"<TILE><FILENAME>21FEB-P1BS_R{line // 150 + 1}C{sample // 200 + 1}-01_P001.TIF</FILENAME>"
        f"<ULCOLOFFSET>{sample}</ULCOLOFFSET><ULROWOFFSET>{line}</ULROWOFFSET></TILE>"
        for sample, line, _samples, _lines in CUTS["tiles"]
    )
    size = f"<IMD><NUMCOLUMNS>{SIZE[0]}</NUMCOLUMNS><NUMROWS>{SIZE[1]}</NUMROWS></IMD><TIL>{listed}</TIL>"
    (tmp_path / "21FEB-P1BS-01_P001.XML").write_text(isd_text(CAMERA).replace("<isd>", f"<isd>{size}"))
    tiles = re.findall("<FILENAME>(.*?)</FILENAME>", listed)
    for name, window in zip(tiles, CUTS["tiles"], strict=True):
        cut_tile(image, tmp_path / name, window)
        assert read_rpc(str(tmp_path / name)).rpc == CAMERA.shift(-window[0], -window[1])
    output, report = join([str(tmp_path / name) for name in reversed(tiles)], tmp_path / "out")
    np.testing.assert_array_equal(gdal.Open(output).ReadAsArray(), gdal.Open(str(image)).ReadAsArray())
    assert read_rpc(output).rpc == CAMERA
    assert not report["warnings"]
    shutil.copy(tmp_path / tiles[0], tmp_path / "21FEB-P1BS_R9C9-01_P001.TIF")
    with pytest.raises(InputError, match=r"is a tile that 21FEB-P1BS-01_P001\.XML does not place"):
        read_rpc(str(tmp_path / "21FEB-P1BS_R9C9-01_P001.TIF"))


def test_masks_bands_and_metadata(tmp_path: Path) -> None:
    """Two 16-bit bands, a mask in one part; what both parts say stays, what one says does not."""
    rng = np.random.default_rng(5)
    pixels = rng.integers(1, 4000, (2, 80, 60)).astype(np.uint16)
    for number, line in enumerate((0, 50)):
        path = str(tmp_path / f"part_{number}.tif")
        memory = gdal.GetDriverByName("MEM").Create("", 60, 50 - 20 * number, 2, gdal.GDT_UInt16)
        memory.WriteArray(pixels[:, line : line + 50])
        memory.SetMetadata({"both": "yes", "own": str(number)})
        memory.GetRasterBand(2).SetDescription("nir")
        write_rpc_text(str(tmp_path / f"part_{number}_RPC.TXT"), CAMERA.shift(0.0, -line))
        made = gdal.GetDriverByName("GTiff").CreateCopy(path, memory)
        if number:
            made.CreateMaskBand(gdal.GMF_PER_DATASET)
            mask = np.full((30, 60), 255, np.uint8)
            mask[:, :7] = 0
            made.GetRasterBand(1).GetMaskBand().WriteArray(mask)
        del made
    parts = [str(tmp_path / f"part_{number}.tif") for number in (0, 1)]
    output, _ = join(parts, tmp_path / "out", id="whole", format="gtiff")
    strip = gdal.Open(output)
    np.testing.assert_array_equal(strip.ReadAsArray(), pixels)
    mask = strip.GetRasterBand(1).GetMaskBand().ReadAsArray()
    assert (mask[:50] == 255).all() and (mask[50:, :7] == 0).all() and (mask[50:, 7:] == 255).all()
    assert strip.GetRasterBand(2).GetDescription() == "nir"
    assert strip.GetMetadataItem("both") == "yes" and strip.GetMetadataItem("own") is None
    assert strip.GetMetadataItem("HRSI_STRIP_PARTS") == "part_0.tif 0,0; part_1.tif 0,50"
    assert Path(output).name == "whole.tif"


@pytest.fixture
def wv1(real_data: Path) -> tuple[list[str], RPC, tuple[int, int]]:
    folder = real_data / "wv1_tiles"
    strip = read_rpc(str(folder / "10200100A1865800.r100.xml"))
    assert strip.size is not None
    return [str(path) for path in sorted(folder.glob("WV01*.xml"))], strip.rpc, strip.size


def test_parts_of_worldview_1(wv1: tuple[list[str], RPC, tuple[int, int]], tmp_path: Path) -> None:
    """One RPC holds both parts to 0.1 px where each of them counts; they themselves differ by 0.11 px at the seam.

    The strip's RPC in the data, of all 186 540 lines, is 8.5 px from the parts' RPCs: an RPC holds no 110 km of flight.
    Ours is as far from it, to the difference between ours and the parts.
    """
    paths, whole, _size = wv1
    output, report = join(paths, tmp_path / "out")
    (entry,) = report["images"].values()
    assert [(part["sample"], part["line"]) for part in entry["parts"].values()] == [(0, 0), (0, 18440)]
    assert not report["warnings"]
    strip, end = read_rpc(output).rpc, [18440, 25996]
    worst, beyond = [], []
    for path, line, lines in zip(paths, (0, 18440), end, strict=True):
        rpc = read_rpc(path).rpc
        xy = np.stack(np.meshgrid(np.linspace(0, 35179, 23), np.linspace(0, lines - 1, 57)), axis=-1).reshape(-1, 2)
        for height in (*rpc.height_range, rpc.height_off):
            ground = rpc.localize(xy, height).ground
            worst.append(np.hypot(*(strip.project(ground) - xy - [0, line]).T).max())
            beyond.append(np.hypot(*(whole.project(ground) - xy - [0, line]).T).max())
    assert max(worst) < HOLD_PX
    assert entry["rpc_fit_max_px"] == pytest.approx(max(worst), abs=0.02)


def test_a_strip_cut_into_parts_is_the_strip(wv1: tuple[list[str], RPC, tuple[int, int]]) -> None:
    """The strip's RPC of WorldView-1 cut into nine overlapping parts with RPCs of their own, over all its lines."""
    _paths, whole, (samples, lines) = wv1
    firsts = range(0, lines - 24000, 20317)
    parts = []
    for number, line in enumerate(firsts):
        size = samples, min(26000, lines - line)
        parts.append(Image(f"P{number + 1:03}", own_rpc(whole.shift(0.0, -float(line)), size), size))
    places = place_parts(parts)
    assert places.first[:, 1].tolist() == list(firsts) and places.size == (samples, lines)
    strip = fit_strip(parts, places.first)
    xy = np.stack(np.meshgrid(np.linspace(0, samples - 1, 15), np.linspace(0, lines - 1, 201)), axis=-1).reshape(-1, 2)
    off = [
        np.hypot(*(strip.rpc.project(whole.localize(xy, height).ground) - xy).T).max()
        for height in (*whole.height_range, whole.height_off)
    ]
    assert max(off) < HOLD_PX


def test_what_one_rpc_cannot_hold_is_told(tmp_path: Path) -> None:
    """Parts that swing by half a pixel: a warning, and the grid as a table that fit-rpc reads."""
    for number, off in enumerate((0.0, 0.45, -0.4, 0.3)):
        write_image(tmp_path / f"p{number}.tif", CAMERA.shift(off, -75.0 * number), size=(403, 80))
    parts = [str(tmp_path / f"p{number}.tif") for number in range(4)]
    output, report = join(parts, tmp_path / "out", id="s")
    (entry,) = report["images"].values()
    assert entry["rpc_fit_max_px"] > HOLD_PX
    told = " ".join(report["warnings"])
    assert re.search(r"one RPC cannot represent the strip: the difference is up to 0\.\d+ px in p\d", told)
    assert "px from whole pixels" in told
    fitted = run("fit-rpc", points=str(tmp_path / "out" / "s_grid.csv"), output_dir=str(tmp_path / "fit"))
    assert fitted["rms_px"] < 0.5
    assert Path(output).suffix == ".vrt"


def test_what_is_no_strip_is_refused(image: Path, tmp_path: Path) -> None:
    first, second = cut_parts(image, CUTS["adjacent"], tmp_path)
    with pytest.raises(InputError, match="two parts and more"):
        join([first], tmp_path / "out")
    far = replace(CAMERA, lat_off=CAMERA.lat_off + 1.0)
    write_image(tmp_path / "far.tif", far, size=SIZE)
    with pytest.raises(InputError, match="far has no common ground"):
        join([first, second, str(tmp_path / "far.tif")], tmp_path / "out")
    run("crop", images=[second], factor=0.5, output_dir=str(tmp_path))
    half = str(tmp_path / f"{Path(second).stem}_crop.tif")
    with pytest.raises(InputError, match="not parts of one strip"):
        join([str(image), half], tmp_path / "out")
    write_image(tmp_path / "b.tif", CAMERA, size=SIZE)
    gdal.Translate(str(tmp_path / "c.tif"), str(tmp_path / "b.tif"), outputType=gdal.GDT_Float32)
    with pytest.raises(InputError, match="its bands are not those of"):
        join([str(image), str(tmp_path / "c.tif")], tmp_path / "out")
    assert not (tmp_path / "out").exists()
