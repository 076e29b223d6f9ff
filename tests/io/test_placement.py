"""Where an image's pixels lie in the image of its RPC: cut, resampled and converted images are placed or doubted."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import placement_cases
import pytest
from osgeo import gdal
from pyproj import CRS, Geod
from rpc_samples import ground_grid, sample_rpc, write_image
from simulated_blocks import oblique_rpc

import hrsi
from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.block.placement import PlacementDoubt, judge_size, rpc_range
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rasters.images import open_image, placement_doubt
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.placement import place_by_geotransform
from hrsi.hrsi_engine.io.rpc_files.xml_formats import isd_text
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main
from hrsi.tests.test_rpc import rpc_files

SIZE = (400, 300)
#: OFF and SCALE as vendors have them: Airbus and `simulate`, then SPOT 6 and WorldView-1.
HABITS = {"first to last": (0.5, 0.5), "one more": (1.0, 0.0)}


def scene_rpc() -> RPC:
    """Return the RPC of a scene of 4000 x 4000 px."""
    return oblique_rpc(0.3, -0.2)


def written(folder: Path, rpc: RPC, geotransform: tuple[float, ...] | None, size: tuple[int, int] = SIZE) -> str:
    """Write a crop with its geotransform and an RPC beside it."""
    path = folder / "crop.tif"
    write_image(path, None, geotransform=geotransform, size=size)
    write_rpc_text(str(folder / "crop_RPC.TXT"), rpc)
    return str(path)


def vendor_rpc(habit: str, size: tuple[int, int] = SIZE) -> RPC:
    off, scale = HABITS[habit]
    return replace(
        sample_rpc(2), samp_off=size[0] / 2 - off, line_off=size[1] / 2 - off,
        samp_scale=size[0] / 2 - scale, line_scale=size[1] / 2 - scale,
    )  # fmt: skip


def doubt_of(path: Path | str) -> PlacementDoubt | None:
    return placement_doubt(open_image(str(path)))


def offset_px(path: Path | str) -> float | None:
    doubt = doubt_of(path)
    return None if doubt is None else doubt.offset_px


# ---- table -----------------------------------------------------------------------------------------------------------

CASES = list(placement_cases.list_cases())


@pytest.mark.parametrize("cases", [CASES[::17], pytest.param(CASES, marks=pytest.mark.thorough)], ids=["sample", "all"])
def test_cut_resampled_and_converted_images(cases: list[placement_cases.Case], tmp_path: Path) -> None:
    """No error above 1 px is silent, and no right image is doubted; what `gdal_translate` scales is 0.7 px off."""
    for number, case in enumerate(cases):
        folder = tmp_path / str(number)
        folder.mkdir()
        found = placement_cases.examine(case, placement_cases.write_case(case, folder))
        doubted = found.says not in ("", "moved")
        assert found.after_px < 1.0 or doubted, case
        assert not doubted or found.after_px > 0.01, case
        assert found.after_px < 1e-6 or doubted or case.tool == "gdal_translate", case


# ---- geotransform without CRS ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("geotransform", "exact"),
    [
        ((1200.0, 1.0, 0.0, 2500.0, 0.0, 1.0), True),
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
    """The crop's pixels lie where GDAL's inverse of the geotransform puts them; the RPC read is not moved twice."""
    scene = scene_rpc()
    path = written(tmp_path, scene, geotransform)
    found = read_rpc(path)
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 6), np.linspace(0, SIZE[1] - 1, 5)), -1).reshape(-1, 2)
    inverse = gdal.InvGeoTransform(geotransform)  # GDAL counts from the corner
    for height in (-100.0, 200.0, 500.0):
        in_scene = scene.project(found.rpc.localize(grid, height).ground)
        in_crop = np.array([gdal.ApplyGeoTransform(inverse, s + 0.5, t + 0.5) for s, t in in_scene.tolist()]) - 0.5
        np.testing.assert_allclose(in_crop, grid, atol=1e-7 if exact else 1e-3)
    assert "moved to the crop" in found.source
    if exact:
        write_rpc_text(str(tmp_path / "crop_RPC.TXT"), found.rpc)
        assert read_rpc(path).rpc == found.rpc
    assert doubt_of(path) is None


@pytest.mark.parametrize(
    ("geotransform", "first", "pixel"),
    [((12114.5, 1, 0, 5511.5, 0, 1), (12114, 5511), (1, 1)), ((5000, 1, 0, 5162, 0, 1), (5000, 5162), (1, 1)),
     ((0.5, 1, 0, -0.5, 0, -1), (0, 0), (1, 1)), ((100.5, 1, 0, -200.5, 0, -1), (100, 200), (1, 1)),
     ((5000, 2, 0, 5162, 0, 2), (5000.5, 5162.5), (2, 2)), ((5000.5, 2, 0, -5162.5, 0, -2), (5000.5, 5162.5), (2, 2))],
)  # fmt: skip
def test_origins(geotransform, first, pixel) -> None:  # type: ignore[no-untyped-def]
    """Airbus counts from 0.5 and perhaps upwards; the first pixel of a reduced crop has its centre in the scene's."""
    place = place_by_geotransform(geotransform, has_crs=False)
    np.testing.assert_allclose(place.first, first)
    np.testing.assert_allclose(place.matrix, np.diag(pixel))
    assert place_by_geotransform(geotransform, has_crs=True) is None
    assert place_by_geotransform((5.44, 1e-5, 0.0, 43.2, 0.0, -1e-5), has_crs=False) is None


@pytest.mark.parametrize(
    "geotransform",
    [
        (5.44, 1e-5, 0.0, 43.2, 0.0, -1e-5),
        (698053.0, 0.5, 0.0, 4792984.0, 0.0, -0.5),
        (9000.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        # the upper left tenth at half the resolution: an RPC from 0 to 4000 may be the scene's, or moved from 8000
        (0.0, 2.0, 0.0, 0.0, 0.0, 2.0),
    ],
)
def test_a_part_of_a_scene_without_a_place(tmp_path: Path, geotransform: tuple[float, ...]) -> None:
    """It is read as it is, with a warning in pixels and metres; its RPC is not written anywhere."""
    path = written(tmp_path, scene_rpc(), geotransform)
    doubt = doubt_of(path)
    assert doubt is not None and doubt.contradictory and " px (" in doubt.message and " m)" in doubt.message
    with pytest.raises(InputError, match=r"crop\.tif"):
        run("write-rpc", images=[path], write="copy", output_dir=str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("how", ["copy", "vrt", "sidecar"])
def test_a_pan_rpc_is_not_written_into_an_ms_image(tmp_path: Path, how: str) -> None:
    write_image(tmp_path / "pan.tif", vendor_rpc("first to last", (1600, 1200)), size=(1600, 1200))
    write_image(tmp_path / "ms.tif", None)
    given = {"write": how, "output_dir": str(tmp_path / "out"), "rpc": str(tmp_path / "pan.tif")}
    with pytest.raises(InputError, match=r"ms\.tif: .*, 4 times as long and wide: .* px \("):
        run("write-rpc", images=[str(tmp_path / "ms.tif")], **given)


def test_a_tag_that_gdal_moved_places_the_rpc_of_the_scene(tmp_path: Path) -> None:
    """The scene's RPC was copied beside a crop whose tag GDAL has moved: the tag shows the place."""
    scene = vendor_rpc("first to last")
    write_image(tmp_path / "scene.tif", scene, size=SIZE)
    gdal.Translate(str(tmp_path / "crop.tif"), str(tmp_path / "scene.tif"), srcWin=[150, 90, 200, 150])
    write_rpc_text(str(tmp_path / "crop_RPC.TXT"), scene)
    found, ground = read_rpc(str(tmp_path / "crop.tif")), ground_grid(scene)
    np.testing.assert_allclose(found.rpc.project(ground), scene.project(ground) - [150, 90], atol=1e-7)
    assert "moved to the crop at sample 150, line 90" in found.source
    assert doubt_of(tmp_path / "crop.tif") is None


def test_a_half_resolution_copy_of_a_real_crop(tmp_path: Path, real_data: Path) -> None:
    """Pleiades: the ground under the middle of a crop is that under the middle of its half-size copy."""
    folder = real_data / "kahramanmaras_phr4"
    whole = str(folder / "pre_event_img1.tif")
    gdal.Translate(str(tmp_path / "half.tif"), whole, width=500, height=500)
    (tmp_path / "half.geom").write_bytes((folder / "pre_event_img1.geom").read_bytes())
    full = read_rpc(whole).rpc.localize(np.array([[499.5, 499.5], [20.5, 900.5]]), 704.0).ground
    half = read_rpc(str(tmp_path / "half.tif")).rpc.localize(np.array([[249.5, 249.5], [10.0, 450.0]]), 704.0).ground
    np.testing.assert_allclose(half, full, atol=1e-9)  # degrees: 0.1 mm


# ---- map coordinates -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "cut_m", "told"),
    [("product", 20.0, False), ("product", 35.0, True), ("WV03_product", 5.0, False), ("WV03_product", 9.0, True),
     ("product", 0.0, None)],
)  # fmt: skip
def test_a_thin_cut_of_a_map_product(tmp_path: Path, name: str, cut_m: float, told: bool | None) -> None:
    """Told from 4 sigma of the sensor's pointing (7 m, WorldView-3: 3.5 m CE90), also if ERR_BIAS is that of a refined
    RPC; below, `rpc-info` says how far map and RPC differ. Both positions are those of the geotransform and of pyproj.
    """
    _, lon, lat, height = np.eye(20)[:4]  # seen from above, so that no height explains a displacement
    rpc = replace(placement_cases.scene_rpc("map"), samp_num=lon, line_num=-lat + 1e-6 * height, err_bias=0.2)
    degrees = rpc.long_scale / rpc.samp_scale, rpc.lat_scale / rpc.line_scale
    west, north = (rpc.long_off - (rpc.samp_off + 0.5) * degrees[0], rpc.lat_off + (rpc.line_off + 0.5) * degrees[1])
    pixel_m = Geod(ellps="WGS84").inv(west, rpc.lat_off, west + degrees[0], rpc.lat_off)[2]
    size, cut = placement_cases.SIZE, round(cut_m / pixel_m)
    path, left = tmp_path / f"{name}.tif", west + cut * degrees[0]
    geotransform = (left, degrees[0], 0.0, north, 0.0, -degrees[1])
    write_image(path, rpc, geotransform=geotransform, size=(size[0] - cut, size[1]))
    product = gdal.Open(str(path), gdal.GA_Update)
    product.SetProjection(CRS.from_epsg(4326).to_wkt())
    del product
    found = run("rpc-info", images=[str(path)], height=rpc.height_off)
    text, doubt = found["images"][name]["map_evidence"], doubt_of(path)
    assert (doubt is not None) is bool(told)
    assert bool(text) is (told is False)
    if told is None:
        return
    positions = re.findall(r"lon (-?[0-9.]+), lat (-?[0-9.]+)", doubt.message if doubt else text)
    by_map, by_rpc = np.array(positions, dtype=float)
    middle = left + (size[0] - cut) / 2 * degrees[0], north - size[1] / 2 * degrees[1]
    np.testing.assert_allclose(by_map, middle, atol=1e-6)
    assert Geod(ellps="WGS84").inv(*by_map, *by_rpc)[2] == pytest.approx(cut * pixel_m, abs=0.5)


# ---- sizes -----------------------------------------------------------------------------------------------------------


def test_vendors_rpcs_are_those_of_their_scenes(real_data: Path) -> None:
    """Every file of the pack is sound but two tiny chips with the RPC of a scene, whose origin nothing tells.

    The size of a scene whose file does not state it is that of its sensor, for SkySat 3199 x 1349 px.
    """
    doubtful = {path.name for path, _, size in rpc_files(real_data) if doubt_of(path)}
    assert doubtful == {"PHR1B_P_201709281038393_SEN_PRG_FC_178609-001.tif", "wv3_20.NTF"}
    frames = sorted(real_data.glob("skysat*/*.rpc"))
    assert len(frames) == 15
    assert not any(judge_size(read_rpc(str(path)).rpc, (3199, 1349)) for path in frames)
    scenes = [path for path, _, _ in rpc_files(real_data) if path.suffix.lower() in (".xml", ".geom", ".json")]
    stated = [found for path in scenes if (found := read_rpc(str(path))).size]
    assert len(stated) > 12
    assert not any(judge_size(found.rpc, found.size) for found in stated if found.size)
    # An edge of 3 % is noticed where the RPC begins with its image, as those of Airbus and of WorldView-1 do
    begins = {id(found): np.abs(rpc_range(found.rpc)[0]).max() for found in stated}
    exact = [found for found in stated if begins[id(found)] <= 1.0]
    assert len(exact) >= 6
    assert all(judge_size(found.rpc, (int(0.97 * found.size[0]), found.size[1])) for found in exact if found.size)


@pytest.mark.parametrize("name", ["wv_isd_xml/rpc_WV2.xml", "rpb/07JAN27.RPB", "rpc_txt/20191015_0"])
def test_a_chip_beside_the_file_of_its_scene(real_data: Path, tmp_path: Path, name: str) -> None:
    """1000 x 800 px of a scene, at a place that nothing tells; of WorldView-2 the ISD states 28244 x 20289 px."""
    file = next((real_data / "formats").glob(f"{name}*"))
    size = (300, 200) if "2019" in name else (1000, 800)
    suffix = "_RPC.TXT" if file.suffix.lower() == ".txt" else file.suffix
    write_image(tmp_path / "chip.tif", None, size=size)
    shutil.copy(file, tmp_path / f"chip{suffix}")
    doubt = doubt_of(tmp_path / "chip.tif")
    assert doubt is not None and doubt.contradictory == (file.suffix == ".xml")
    assert "28244 x 20289 px (as its file states)" in doubt.message or not doubt.contradictory
    warnings = run("rpc-info", images=[str(tmp_path / "chip.tif")], height=97.0)["warnings"]
    assert f"chip: {doubt}" in warnings


def test_tiles_cut_by_gdal_are_not_doubted(tmp_path: Path) -> None:
    for habit in HABITS:
        write_image(tmp_path / "scene.tif", vendor_rpc(habit), size=SIZE)
        for row, column in ((1, 1), (1, 2), (2, 1), (2, 2)):
            tile = tmp_path / f"scene_R{row}C{column}.tif"
            gdal.Translate(
                str(tile), str(tmp_path / "scene.tif"), srcWin=[200 * (column - 1), 150 * (row - 1), 200, 150]
            )
            assert doubt_of(tile) is None


@pytest.mark.parametrize("factor", [0.37, 1 / 3, 0.5, 1.5])
@pytest.mark.parametrize("habit", HABITS)
def test_gdals_half_pixel_is_found(habit: str, factor: float, tmp_path: Path) -> None:
    """What GDAL's RPC is off is measured here with GDAL's own transformer, at the middle of the picture."""
    write_image(tmp_path / "a.tif", vendor_rpc(habit), size=SIZE)
    size = {"width": round(factor * 400), "height": round(factor * 300)}
    for name in ("b.tif", "b.vrt"):
        gdal.Translate(
            str(tmp_path / name), str(tmp_path / "a.tif"), format="VRT" if "vrt" in name else "GTiff", **size
        )
    seen = []
    for name in ("a.tif", "b.tif"):
        dataset = gdal.Open(str(tmp_path / name))
        transformer = gdal.Transformer(dataset, None, ["METHOD=RPC"])
        point = [(vendor_rpc(habit).long_off, vendor_rpc(habit).lat_off, vendor_rpc(habit).height_off)]
        corner = np.array(transformer.TransformPoints(True, point)[0])[0, :2]
        seen.append(corner / [dataset.RasterXSize, dataset.RasterYSize])
    truth = np.abs((seen[1] - seen[0]) * [*size.values()]).max()
    told = habit == "first to last" or (2.0 * factor) % 1.0  # halved, the second habit looks like the first one
    assert offset_px(tmp_path / "b.vrt") == pytest.approx(truth, abs=1e-4)
    assert offset_px(tmp_path / "b.tif") == (pytest.approx(truth, abs=1e-4) if told else None)


@pytest.mark.parametrize("habit", HABITS)
def test_images_made_by_crop_are_not_doubted(habit: str, tmp_path: Path) -> None:
    """As delivered, and as cut and resampled by `crop`, also where a refinement shifted the RPC."""
    for shift in (0.0, 3.37):
        write_image(tmp_path / "a.tif", vendor_rpc(habit).shift(shift, -shift), size=SIZE)
        assert offset_px(tmp_path / "a.tif") is None
        for factor in (0.37, 0.5, 2.0):
            for format in ("gtiff", "vrt"):
                given = {"images": [str(tmp_path / "a.tif")], "output_dir": str(tmp_path / "out"), "overwrite": True}
                (entry,) = run("crop", factor=factor, format=format, **given)["images"].values()
                assert offset_px(Path(entry["output"])) is None


def test_an_rpc_of_twice_the_size(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Inside the image; in a product whose file states the size, whatever its centre is."""
    full = vendor_rpc("first to last")
    write_image(tmp_path / "half.tif", full, size=(200, 150))
    assert offset_px(tmp_path / "half.tif") == pytest.approx(199.0)  # pixel 199 of 200 is 398.5 of 400
    write_image(tmp_path / "product.tif", None, size=(200, 150))
    size = "<IMD><NUMCOLUMNS>400</NUMCOLUMNS><NUMROWS>301</NUMROWS></IMD>"
    (tmp_path / "product.XML").write_text(isd_text(full.shift(-18.0, -36.0)).replace("<isd>", f"<isd>{size}"))
    assert offset_px(tmp_path / "product.tif") == pytest.approx(199.0)
    with caplog.at_level("WARNING", logger="hrsi"):
        hrsi.open(str(tmp_path / "half.tif"))
    assert "2 times as long and wide" in caplog.text and "up to 199 px" in caplog.text


@pytest.mark.parametrize("size", [(60000, 60000), (500, 500)])
def test_an_image_without_file_is_judged_by_its_size(size: tuple[int, int]) -> None:
    assert placement_doubt(Image("scene", scene_rpc(), size)) is not None
    assert placement_doubt(Image("scene", scene_rpc(), (4000, 4000))) is None


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
    copied = gdal.Open(shutil.copy(half, wrong), gdal.GA_Update)
    copied.SetMetadata(gdal.Open(first).GetMetadata("RPC"), "RPC")
    copied = None
    for image, doubted in ((wrong, True), (half, False)):
        points = ["--gcps", str(block / "ground_points.csv"), "--image-points", str(block / "image_points.csv")]
        words = ["adjust", image, second, *points, "--height-datum", "ellipsoidal", "--dry-run", "--json"]
        capsys.readouterr()
        main([*words, "--output-dir", str(tmp_path / "out")])
        out, told = capsys.readouterr()
        codes = [reason["code"] for reason in json.loads(out)["verdict"]["reasons"]]
        assert ("rpc-placement" in codes) is doubted
        assert ("up to 149 px" if doubted else "up to 0.25 px") in told


def _of_whole_source(text: str) -> str:
    return text.replace('xSize="200" ySize="200"', 'xSize="100" ySize="100"')


@pytest.mark.parametrize(
    ("change", "expected"), [(str, np.hypot(199.0, 149.0)), (_of_whole_source, np.hypot(100.0, 50.0))]
)
def test_a_vrt_with_the_rpc_of_its_source(tmp_path: Path, change: Callable[[str], str], expected: float) -> None:
    """Of a window of it, resampled or not, in another folder."""
    write_image(tmp_path / "a.tif", vendor_rpc("first to last"), size=SIZE)
    path = tmp_path / "b.vrt"
    gdal.Translate(str(path), str(tmp_path / "a.tif"), srcWin=[100, 50, 200, 200], width=100, height=100, format="VRT")
    virtual = gdal.Open(str(path), gdal.GA_Update)
    virtual.SetMetadata(gdal.Open(str(tmp_path / "a.tif")).GetMetadata("RPC"), "RPC")
    del virtual
    path.write_text(change(path.read_text()))
    (tmp_path / "moved").mkdir()
    for name in ("a.tif", "b.vrt"):
        shutil.move(tmp_path / name, tmp_path / "moved" / name)
    assert offset_px(tmp_path / "moved" / "b.vrt") == pytest.approx(expected, rel=0.1)
