"""Reading RPCs: each format against GDAL, against other files of the same scene, and against outside points."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal
from rpc_samples import ground_grid, sample_rpc, write_image
from simulated_blocks import oblique_rpc

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rpc_files import (
    difference_px,
    read_rpc,
    rpc_for_image,
    text_formats,
    write_rpc_text,
    xml_formats,
)
from hrsi.hrsi_engine.io.rpc_files.crop import apply_ichipb
from hrsi.hrsi_engine.io.rpc_files.fields import GDAL_NAMES, SCALARS, gdal_metadata, rpc_from_entries

PHR = "PHR1B_P_201709281038393_SEN_PRG_FC_178609-001"
SKYSAT = "20191015_073816_ssc1d3_0011_basic_l1a_panchromatic_dn_RPC.TXT"
PNEO = "RPC_PNEO3_202309051055014_PAN_SEN_PWOI_000129104_1_1_F_1.XML"
#: Real file, and the names under which GDAL finds it: side file and image.
GDAL_READS = {
    "rpb": ("formats/rpb/07JAN27.RPB", "x.RPB", "x.tif"),
    "ikonos": ("formats/rpc_txt/rpc_IKONOS.txt", "x_rpc.txt", "x.tif"),
    "skysat": (f"formats/rpc_txt/{SKYSAT}", "x_RPC.TXT", "x.tif"),
    "zy3": ("zy3_stereo_gcp/zy301a_fwd_381_6138_rpc.txt", "x_rpc.txt", "x.tif"),
    "wv2 isd": ("formats/wv_isd_xml/rpc_WV2.xml", "x.XML", "x.tif"),
    "phr": (f"formats/dimap_phr/RPC_{PHR}.XML", "RPC_x.XML", "IMG_x_R1C1.TIF"),
    "spot6": ("formats/dimap_spot6/rpc_SPOT6.xml", "RPC_x.XML", "IMG_x_R1C1.TIF"),
    "pneo": (f"formats/dimap_pneo/{PNEO}", "RPC_x.XML", "IMG_x_R1C1.TIF"),
}


def gdal_rpc(path: Path) -> RPC:
    """Return the RPC that GDAL reports for an image."""
    metadata = gdal.Open(str(path)).GetMetadata("RPC")
    assert metadata, f"GDAL {gdal.__version__} finds no RPC for {path}"
    return rpc_from_entries(str(path), metadata)


def largest_difference_px(first: RPC, second: RPC) -> float:
    ground = ground_grid(first)
    return float(np.abs(first.project(ground) - second.project(ground)).max())


@pytest.mark.parametrize("name", GDAL_READS)
def test_agrees_with_gdal(name: str, real_data: Path, tmp_path: Path) -> None:
    file, side_name, image_name = GDAL_READS[name]
    write_image(tmp_path / image_name, None)
    shutil.copy(real_data / file, tmp_path / side_name)
    alone, beside = read_rpc(str(real_data / file)).rpc, read_rpc(str(tmp_path / image_name)).rpc
    assert alone == beside
    # 1e-9 px: both read the same decimal numbers; the pixel origins (DIMAP V2: -1, V3: none) are GDAL's too.
    assert largest_difference_px(alone, gdal_rpc(tmp_path / image_name)) < 1e-9


def test_pixels_of_pleiades_neo_do_not_begin_with_its_validity_domain(real_data: Path, tmp_path: Path) -> None:
    """The domain of the real PHR1B begins at -791, -27 and its image at 1; GDAL 3.6 subtracts it for Pleiades Neo."""
    text = (real_data / "formats" / "dimap_pneo" / PNEO).read_text(encoding="utf-8")
    (tmp_path / "RPC_x.XML").write_text(text.replace("<FIRST_COL>0<", "<FIRST_COL>-27<"), encoding="utf-8")
    write_image(tmp_path / "IMG_x_R1C1.TIF", None)
    found = read_rpc(str(tmp_path / "IMG_x_R1C1.TIF"))
    assert found.rpc == read_rpc(str(real_data / "formats" / "dimap_pneo" / PNEO)).rpc
    if largest_difference_px(found.rpc, gdal_rpc(tmp_path / "IMG_x_R1C1.TIF")) > 1.0:
        assert f"what GDAL {gdal.__version__} reads (" in found.summary


@pytest.mark.parametrize(("driver", "name", "is_read"), [("PNG", "x.png", False), ("ENVI", "x.img", False),
                                                         ("GTiff", "x.tif", True)])  # fmt: skip
def test_a_side_file_that_gdal_does_not_read_is_told(driver: str, name: str, is_read: bool, tmp_path: Path) -> None:
    plain = gdal.GetDriverByName("MEM").Create("", 20, 10)
    gdal.GetDriverByName(driver).CreateCopy(str(tmp_path / name), plain)
    write_rpc_text(str(tmp_path / "x_RPC.TXT"), sample_rpc())
    assert bool(gdal.Open(str(tmp_path / name)).GetMetadata("RPC")) is is_read
    assert ("which GDAL does not read" in read_rpc(str(tmp_path / name)).source) is not is_read


def test_three_formats_of_one_scene_agree(real_data: Path) -> None:
    formats = real_data / "formats"
    tag = read_rpc(str(formats / "geotiff_tag" / f"{PHR}.tif"))
    xml = read_rpc(str(formats / "dimap_phr" / f"RPC_{PHR}.XML"))
    geom = read_rpc(str(formats / "otb_geom" / f"{PHR}.geom"))
    assert "tag" in tag.source  # its geotransform 0.5, -0.5 with lines upwards is no crop origin
    assert largest_difference_px(tag.rpc, xml.rpc) < 1e-7
    assert largest_difference_px(tag.rpc, geom.rpc) < 1e-7
    assert xml.size == geom.size == (40000, 22940)


def test_scene_in_dimap_and_geom(real_data: Path) -> None:
    ventoux = real_data / "ventoux_phr_pair"
    xml = read_rpc(str(ventoux / "RPC_PHR1B_P_201308051042194_SEN_690908101-001.XML"))
    assert largest_difference_px(xml.rpc, read_rpc(str(ventoux / "left_image.geom")).rpc) < 1e-6
    assert xml.size is None  # its validity domain begins at -27, -791: no image size


@pytest.mark.parametrize("scene", ["1A", "1B"])
def test_points_computed_by_other_software(scene: str, real_data: Path) -> None:
    """18 points a scene by IGN's Xing: line, column, longitude, latitude, height, pixels counted from 1."""
    lines = (real_data / "spot7_tiepoints" / f"verif_{scene}.txt").read_text(encoding="latin-1").splitlines()
    table = np.array([line.split()[1:6] for line in lines if line.startswith("<Pt>")], dtype=float)
    image = read_rpc(str(real_data / "spot7_tiepoints" / f"RPC_{scene}.xml")).rpc.project(table[:, 2:])
    assert len(table) == 18
    np.testing.assert_allclose(image[:, ::-1] + 1.0, table[:, :2], atol=1e-6)


def test_rpcm_projects_the_same_points(real_data: Path, repository: Path) -> None:
    """Readers and evaluation of rpcm 1.4.10; tests/reference/rpcm_projections.py made the file."""
    reference = json.loads((repository / "tests" / "reference" / "rpcm_projections.json").read_text())
    assert len(reference) == 6
    for file, points in reference.items():
        ground = np.column_stack([points["lon"], points["lat"], points["height"]])
        image = np.column_stack([points["sample"], points["line"]])
        # 1e-9 px: the same numbers in double precision, summed in another order
        np.testing.assert_allclose(read_rpc(str(real_data / file)).rpc.project(ground), image, atol=1e-9)


def test_ichipb_is_applied(real_data: Path) -> None:
    """The two files have the same pixels; the RPC that was moved beforehand is off by exactly 1 px (README)."""
    folder = real_data / "formats" / "nitf_ichipb"
    chip = read_rpc(str(folder / "po_39928_pan_0000000_chip_700_700_withICHIPB.nitf"))
    moved = read_rpc(str(folder / "po_39928_pan_0000000_chip_700_700_noICHIPB.nitf"))
    assert "ICHIPB" in chip.source
    apart = chip.rpc.project(ground_grid(chip.rpc)) - moved.rpc.project(ground_grid(chip.rpc))
    np.testing.assert_allclose(apart, 1.0, atol=1e-6)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0, 4.0])
def test_ichipb_of_a_reduced_chip(scale: float) -> None:
    """Pixel k of a chip reduced n times is the mean of the pixels from 100 + n k of the full image: its centre is
    their middle. ICHIPB counts from the outer corner of the first pixel."""
    rpc = oblique_rpc(0.3, -0.2)
    metadata = {}
    for axis, begin, count in (("COL", 100.0, 300), ("ROW", 40.0, 200)):
        for corner, chip in zip(("11", "12", "21", "22"), corners_of(axis, count), strict=True):
            metadata[f"ICHIP_OP_{axis}_{corner}"] = str(chip)
            metadata[f"ICHIP_FI_{axis}_{corner}"] = str(begin + scale * chip)
    chip, note = apply_ichipb("chip.ntf", rpc, metadata)
    ground = ground_grid(rpc)
    full = rpc.project(ground)  # from the centre of the first pixel
    expected = np.column_stack([(full[:, 0] + 0.5 - 100.0) / scale - 0.5, (full[:, 1] + 0.5 - 40.0) / scale - 0.5])
    np.testing.assert_allclose(chip.project(ground), expected, atol=1e-8)
    assert "ICHIPB" in note


def corners_of(axis: str, count: int) -> tuple[float, ...]:
    """Return the coordinate of a chip's corner pixels' centres along an axis, in the order 11, 12, 21, 22."""
    first, last = 0.5, count - 0.5
    return (first, last, first, last) if axis == "COL" else (first, first, last, last)


@pytest.mark.parametrize(
    ("image", "origin"),
    [("kahramanmaras_phr4/pre_event_img1", (12114, 5511)), ("kahramanmaras_phr4/pre_event_img2", (12098, 5108)),
     ("kahramanmaras_phr4/post_event_img1", (12978, 6897)), ("kahramanmaras_phr4/post_event_img2", (12815, 7219)),
     ("ventoux_phr_pair/left_image", (5000, 5000)), ("ventoux_phr_pair/right_image", (4915, 5162)),
     ("ventoux_phr_pair/lowres_color_image", (1240, 1240))],
)  # fmt: skip
def test_crop_origin_from_the_geotransform(image: str, origin: tuple[int, int], real_data: Path) -> None:
    scene = read_rpc(str(real_data / f"{image}.geom")).rpc
    crop = read_rpc(str(real_data / f"{image}.tif"))
    assert (scene.samp_off - crop.rpc.samp_off, scene.line_off - crop.rpc.line_off) == origin
    assert f"sample {origin[0]}" in crop.source


def test_crop_lies_where_it_should(real_data: Path) -> None:
    """README: near 36.9095 E 37.5847 N at 704 m; 100 m are 0.001 degrees."""
    rpc = read_rpc(str(real_data / "kahramanmaras_phr4" / "pre_event_img1.tif")).rpc
    centre = rpc.localize(np.array([[499.5, 499.5]]), 704.0).ground[0]
    np.testing.assert_allclose(centre[:2], [36.9095, 37.5847], atol=2e-3)


def test_rpc_of_the_crop_beside_it_is_not_moved_again(tmp_path: Path) -> None:
    scene = replace(sample_rpc(), samp_off=10000.0, line_off=9000.0, samp_scale=10000.0, line_scale=9000.0)
    image = tmp_path / "crop.tif"
    write_image(image, None, geotransform=(5000.0, 1.0, 0.0, 4000.0, 0.0, 1.0))
    write_rpc_text(str(tmp_path / "crop_RPC.TXT"), scene)
    crop = read_rpc(str(image))
    assert crop.rpc == scene.shift(-5000.0, -4000.0)
    write_rpc_text(str(tmp_path / "crop_RPC.TXT"), crop.rpc)
    assert read_rpc(str(image)).rpc == crop.rpc
    assert rpc_for_image(str(tmp_path / "crop_RPC.TXT"), str(image)).rpc == crop.rpc


def test_precedence_is_gdals(real_data: Path, tmp_path: Path) -> None:
    """.RPB > ISD > _RPC.TXT > .rpc > tag > .aux.xml > .geom; sources are taken away from the top."""
    tag = sample_rpc(1)
    image = tmp_path / "x.tif"
    write_image(image, tag)
    write_rpc_text(str(tmp_path / "x.RPB"), tag.shift(1.0, 0.0), kind="rpb")
    write_rpc_text(str(tmp_path / "x_RPC.TXT"), tag.shift(2.0, 0.0))
    shutil.copy(real_data / "formats" / "wv_isd_xml" / "rpc_WV2.xml", tmp_path / "x.XML")
    _write_pam(tmp_path / "x.tif.aux.xml", tag.shift(3.0, 0.0))
    shutil.copy(real_data / "formats" / "otb_geom" / f"{PHR}.geom", tmp_path / "x.geom")
    write_rpc_text(str(tmp_path / "x.rpc"), tag.shift(4.0, 0.0))
    titles = (".RPB", "ISD", "_RPC.TXT", ".rpc", "GeoTIFF tag", "PAM", "OTB")
    for place, remove in enumerate(("x.RPB", "x.XML", "x_RPC.TXT", "x.rpc", None)):
        found = read_rpc(str(image))
        assert found.source.startswith(titles[place])
        assert [text.split()[0] for text in found.ignored] == [title.split()[0] for title in titles[place + 1 :]]
        assert largest_difference_px(found.rpc, gdal_rpc(image)) < 1e-7
        if remove:
            (tmp_path / remove).unlink()
    assert "not used: PAM" in read_rpc(str(image)).summary


@pytest.mark.parametrize("beside", ["x.RPB", "x_RPC.TXT"])
@pytest.mark.parametrize("image", ["x.tif", "x.ntf", "x.img", "x.png", "x.jp2"])
@pytest.mark.parametrize("with_pam", [True, False])
def test_precedence_of_other_drivers_is_gdals(image: str, beside: str, with_pam: bool, tmp_path: Path) -> None:
    drivers = {"tif": "GTiff", "ntf": "NITF", "img": "HFA", "png": "PNG", "jp2": "JP2OpenJPEG"}
    rpc = sample_rpc(1)
    write_image(tmp_path / image, rpc, driver=drivers[image[2:]])
    auxiliary = tmp_path / f"{image}.aux.xml"
    if not with_pam and auxiliary.exists():
        auxiliary.unlink()
    kind = "rpb" if beside.endswith(".RPB") else "rpc-txt"
    write_rpc_text(str(tmp_path / beside), rpc.shift(100.0, 0.0), kind=kind)
    if not with_pam and image.endswith(("img", "png")):  # GDAL finds nothing; the file beside counts here
        assert read_rpc(str(tmp_path / image)).rpc == rpc.shift(100.0, 0.0)
    else:
        assert largest_difference_px(read_rpc(str(tmp_path / image)).rpc, gdal_rpc(tmp_path / image)) < 1e-7


def _write_pam(path: Path, rpc: RPC) -> None:
    items = "".join(f'<MDI key="{key}">{value}</MDI>' for key, value in gdal_metadata(rpc).items())
    path.write_text(f'<PAMDataset><Metadata domain="RPC">{items}</Metadata></PAMDataset>')


def test_pam_alone(tmp_path: Path) -> None:
    rpc = sample_rpc(2, err_bias=1.5)
    write_image(tmp_path / "x.tif", None)
    _write_pam(tmp_path / "x.tif.aux.xml", rpc)
    assert read_rpc(str(tmp_path / "x.tif")).rpc == rpc


def test_vrt_takes_its_own_rpc_first(tmp_path: Path) -> None:
    rpc = sample_rpc(3)
    write_image(tmp_path / "y.tif", rpc)
    gdal.Translate(str(tmp_path / "x.vrt"), str(tmp_path / "y.tif"))
    write_rpc_text(str(tmp_path / "x.RPB"), rpc.shift(1.0, 1.0), kind="rpb")
    assert largest_difference_px(rpc, read_rpc(str(tmp_path / "x.vrt")).rpc) < 1e-7  # GDAL rounds to 15 digits
    assert largest_difference_px(rpc, gdal_rpc(tmp_path / "x.vrt")) < 1e-7


def test_tag_gives_the_doubles_themselves(tmp_path: Path) -> None:
    rpc = sample_rpc(4)
    for options in ((), ("BIGTIFF=YES",), ("ENDIANNESS=BIG",), ("COMPRESS=LZW", "TILED=YES")):
        write_image(tmp_path / "x.tif", rpc, options)
        assert read_rpc(str(tmp_path / "x.tif")).rpc == rpc


def test_tiles_of_an_airbus_product(real_data: Path, tmp_path: Path) -> None:
    xml = real_data / "formats" / "dimap_spot6" / "rpc_SPOT6.xml"
    shutil.copy(xml, tmp_path / "RPC_x.XML")
    write_image(tmp_path / "IMG_x_R2C3.TIF", None)
    with pytest.raises(InputError, match=r"dim_x\.xml"):
        read_rpc(str(tmp_path / "IMG_x_R2C3.TIF"))
    (tmp_path / "DIM_x.XML").write_text('<Dimap_Document><NTILES_SIZE nrows="4096" ncols="8192"/></Dimap_Document>')
    tile, scene = read_rpc(str(tmp_path / "IMG_x_R2C3.TIF")).rpc, read_rpc(str(xml)).rpc
    assert (scene.samp_off - tile.samp_off, scene.line_off - tile.line_off) == (2 * 8192, 4096)


def test_values_of_rpcm_json(real_data: Path) -> None:
    """Values as printed in the file; there is no second reader for this format here."""
    found = read_rpc(str(real_data / "formats" / "rpcm_json" / "JAX_068_001_RGB.json"))
    assert found.size == (746, 815)
    assert (found.rpc.samp_off, found.rpc.line_off) == (371.692595898949, 405.51806724276)
    assert found.rpc.line_num[1] == 1.515268776621
    centre = found.rpc.localize(np.array([[372.5, 407.0]]), 0.0).ground[0]
    np.testing.assert_allclose(centre[:2], [-81.66377836684407, 30.3487524532743], atol=2e-4)  # its "center"; 20 m


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_text_with_a_byte_order_mark(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "scene_RPC.TXT"
    write_rpc_text(str(path), sample_rpc(5))
    path.write_text(path.read_text(), encoding=encoding)
    assert read_rpc(str(path)).rpc == sample_rpc(5)


def test_units_and_missing_accuracies(tmp_path: Path) -> None:
    file = tmp_path / "x_rpc.txt"
    rpc = sample_rpc(5)
    write_rpc_text(str(file), rpc)
    text = file.read_text()
    units = {"OFF": "pixels", "SCALE": "pixels", "LAT_OFF": "degrees", "HEIGHT_OFF": "meters"}
    lines = [f"{line} {units.get(line.split(':')[0].split('_', 1)[-1], '')}" for line in text.splitlines()]
    file.write_text("\r\n".join(lines))
    assert read_rpc(str(file)).rpc == rpc
    assert read_rpc(str(file)).rpc.err_bias is None
    file.write_text(text + "ERR_BIAS: 0003.31 meters\nERR_RAND: -1\n")
    assert (read_rpc(str(file)).rpc.err_bias, read_rpc(str(file)).rpc.err_rand) == (3.31, None)


@pytest.mark.parametrize(
    ("file", "names"),
    [("rpb/07JAN27.RPB", text_formats.RPB_NAMES), (f"dimap_phr/RPC_{PHR}.XML", xml_formats.DIMAP_NAMES),
     ("wv_isd_xml/rpc_WV2.xml", xml_formats.ISD_NAMES),
     (f"otb_geom/{PHR}.geom", text_formats.GEOM_NAMES), ("rpcm_json/JAX_068_001_RGB.json", text_formats.RPCM_NAMES),
     ("rpc_txt/rpc_IKONOS.txt", GDAL_NAMES)],
)  # fmt: skip
def test_damage_is_named_by_file_and_field(file: str, names: dict[str, str], real_data: Path, tmp_path: Path) -> None:
    """Every number of the camera in turn is spoilt: the message names the file and the field."""
    content = (real_data / "formats" / file).read_text()
    damaged = tmp_path / Path(file).name
    for field in SCALARS:
        spoilt = _with_bad_value(content, names[field])
        assert spoilt != content
        damaged.write_text(spoilt)
        with pytest.raises(InputError) as error:
            read_rpc(str(damaged))
        assert names[field] in str(error.value)
        assert damaged.name in str(error.value)
        assert "\n" not in str(error.value)


def _with_bad_value(content: str, name: str) -> str:
    """Return the content with the number behind a name replaced by a text (in JSON, by a string)."""
    bad = r'\1"?"' if content.startswith("{") else r"\1?"
    return re.sub(rf"(\b{name}\b\W{{1,5}}?\s*)[-+]?\d[\d.]*", bad, content, count=1)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [("missing.tif", None, "no such file"), ("x.tif", b"not a tiff", "neither an image nor an RPC file"),
     ("x_RPC.TXT", b"", "LINE_OFF is missing"), ("x.RPB", b"BEGIN_GROUP", "lineOffset is missing"),
     ("RPC_x.XML", b"<Dimap_Document><!-- cut", "not well-formed"),
     ("x.json", b'{"rpc": {"row_offset": ', "is no JSON"),
     ("RPC_x.XML", b'<!DOCTYPE a [<!ENTITY b "c">]><Dimap_Document>Rational_Function_Model</Dimap_Document>',
      "DOCTYPE"),
     ("x.tif", b"II*\0\xff\xff\xff\xff", "damaged|neither")],
)  # fmt: skip
def test_other_files(name: str, content: bytes | None, message: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        read_rpc(str(tmp_path / name))
    assert name in str(error.value)


def test_image_without_rpc_says_what_to_do(tmp_path: Path) -> None:
    write_image(tmp_path / "x.tif", None)
    with pytest.raises(InputError, match=r"has no RPC.*_RPC.TXT"):
        read_rpc(str(tmp_path / "x.tif"))


def test_damaged_sidecar_that_would_win_is_an_error(tmp_path: Path) -> None:
    write_image(tmp_path / "x.tif", sample_rpc())
    (tmp_path / "x_RPC.TXT").write_text("LINE_OFF: 12\n")
    with pytest.raises(InputError, match="SAMP_OFF is missing"):
        read_rpc(str(tmp_path / "x.tif"))


def test_difference_of_shifted_cameras_is_the_shift() -> None:
    rpc = sample_rpc(6)
    assert difference_px(rpc, rpc) == 0.0
    assert difference_px(rpc, rpc.shift(3.0, 4.0)) == pytest.approx(5.0, abs=1e-9)
