"""Archives, folders, special files and number forms that readers must refuse, or read whole, within little time."""

import io
import os
import re
import resource
import signal
import socket
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from gdal_files import write_raster
from long_tests import mark_beyond
from osgeo import gdal
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.catalogue.deliveries import resolve_images
from hrsi.hrsi_engine.io.opening.budgets import require_gcp_rows
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text, write_vrt
from hrsi.processing_algorithms.files.opening import parse_lines

ENTRIES = 60_000
MOST_CPU_S = 10.0  # the promise of docs/protocols/robustness.md


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _make_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(ENTRIES):
            archive.writestr(f"d{number % 100}/f{number}.tif", b"II*\0xxxx")


def _make_tar(path: Path) -> None:
    with tarfile.open(path, "w") as archive:
        for number in range(ENTRIES):
            member = tarfile.TarInfo(f"d{number % 100}/f{number}.tif")
            member.size = 8
            archive.addfile(member, io.BytesIO(b"II*\0xxxx"))


def _make_folder(path: Path) -> None:
    path.mkdir()
    for number in range(ENTRIES):
        (path / f"f{number}.tif").touch()


@pytest.mark.parametrize(
    ("name", "make"), mark_beyond(1, "wrong_inputs", [("a.zip", _make_zip), ("a.tar", _make_tar), ("a", _make_folder)])
)
def test_a_delivery_of_60000_files_is_refused_at_once(tmp_path: Path, name: str, make) -> None:
    make(tmp_path / name)
    before = _cpu_seconds()
    with pytest.raises(InputError, match=rf"{name}: contains more than \d+ files .* name the images"):
        resolve_images([str(tmp_path / name)], lambda _text: None)
    assert _cpu_seconds() - before < MOST_CPU_S


@pytest.mark.large
def test_a_delivery_of_10000_images_is_read(tmp_path: Path) -> None:
    """Images may be as many as there are files, each with its XML and `_RPC.TXT`; none lists the folder anew.

    Then 10 000 images take eight times as long as 1250; while each listed the folder, 20 times, on any machine.
    """
    write_image(tmp_path / "first.tif", sample_rpc(1), size=(4, 3))
    few_s, many_s = (_read_folder_of(tmp_path, images) for images in (1250, 10_000))
    assert many_s < 13.0 * few_s


def _read_folder_of(folder: Path, images: int) -> float:
    """Return the processor time for the images of a folder, all links to the first one; every fifth has an XML."""
    many = folder / f"{images}"
    many.mkdir()
    for number in range(images):
        os.link(folder / "first.tif", many / f"i{number}.tif")
    for number in range(0, images, 5):
        (many / f"i{number}.xml").write_text("<isd/>", encoding="utf-8")
    os.utime(many, (1e9, 1e9))
    before = _cpu_seconds()
    assert len(resolve_images([str(many)], lambda _text: None)) == images
    return _cpu_seconds() - before


def test_a_file_that_comes_beside_an_image_is_seen(tmp_path: Path) -> None:
    write_image(tmp_path / "a.tif", sample_rpc(1), size=(40, 30))
    assert read_rpc(str(tmp_path / "a.tif")).source.startswith("GeoTIFF tag")
    write_rpc_text(str(tmp_path / "a_RPC.TXT"), sample_rpc(2))
    assert read_rpc(str(tmp_path / "a.tif")).rpc == sample_rpc(2)


def test_an_archive_that_unfolds_without_end_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(300):
            archive.writestr(f"f{number}.tif", b"\0" * 2**20)
    with pytest.raises(InputError, match="bytes that unfold to 314572800 are no images"):
        resolve_images([str(tmp_path / "bomb.zip")], lambda _text: None)


def test_a_delivery_with_odd_names_is_read_without_them(tmp_path: Path) -> None:
    write_image(tmp_path / "a.tif", sample_rpc(1), size=(40, 30))
    os.symlink(".", tmp_path / "circle")
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.tif")).write_bytes(b"II*\0")
    assert resolve_images([str(tmp_path)], lambda _text: None) == (str(tmp_path / "a.tif"),)
    with pytest.raises(InputError, match="no UTF-8"):
        read_rpc(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.tif"))


def _make_special(kind: str, path: Path) -> None:
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        os.symlink("/dev/zero", path)
    else:
        with socket.socket(socket.AF_UNIX) as server:
            here = os.getcwd()
            os.chdir(path.parent)
            server.bind(path.name)
            os.chdir(here)


@pytest.fixture
def alarm():
    """Let a reader that waits for ever fail: the default action of the signal ends even C code."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(60)
    yield
    signal.alarm(0)


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
@pytest.mark.parametrize("side", ["_RPC.TXT", ".RPB", ".xml", ".tif.aux.xml", ".tif.ovr", ".tfw", ".IMD"])
def test_special_files_beside_an_image_are_never_waited_for(tmp_path: Path, kind: str, side: str) -> None:
    write_image(tmp_path / "a.tif", sample_rpc(1), size=(40, 30))
    _make_special(kind, tmp_path / f"a{side}")
    with pytest.raises(InputError, match=f"a{side}: is a (named )?{kind}"):
        read_rpc(str(tmp_path / "a.tif"))


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
@pytest.mark.parametrize("name", ["g.csv", "g.gpkg", "g.points", "g.gcp", "g.geojson", "g.h5", "g.shp", "g_RPC.TXT"])
def test_special_files_named_as_inputs_are_refused(tmp_path: Path, kind: str, name: str) -> None:
    _make_special(kind, tmp_path / name)
    read = read_rpc if name.endswith("TXT") else read_points
    with pytest.raises(InputError, match=f"{name}: is a (named )?{kind}"):
        read(str(tmp_path / name))


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_a_vrt_of_a_special_file_is_refused(tmp_path: Path, kind: str, nested: bool) -> None:
    write_image(tmp_path / "b.tif", None, size=(40, 30))
    write_vrt(str(tmp_path / "b.tif"), str(tmp_path / "a.vrt"), sample_rpc(1))
    if nested:
        write_vrt(str(tmp_path / "a.vrt"), str(tmp_path / "c.vrt"), sample_rpc(1))
    assert read_rpc(str(tmp_path / ("c.vrt" if nested else "a.vrt"))).rpc == sample_rpc(1)
    (tmp_path / "b.tif").unlink()
    _make_special(kind, tmp_path / "b.tif")
    with pytest.raises(InputError, match=f"b.tif: is a (named )?{kind}"):
        read_rpc(str(tmp_path / ("c.vrt" if nested else "a.vrt")))


@pytest.mark.parametrize(
    ("field", "text"), [(3, "0012,5"), (5, "+43.x215"), (12, "  nan"), (13, "1,408860E+05"), (80, "#")]
)
def test_numbers_of_a_nitf_are_read_whole_or_refused(tmp_path: Path, field: int, text: str) -> None:
    """GDAL reads what a field begins with."""
    fields = ["1", "0001.00", "0000.20", "001250", "00620", "+43.5000", "+007.1000", "+0300", "001251", "00621",
              "+00.0500", "+000.0800", "+0500"]  # fmt: skip
    fields += [
        "+1.000000E+0" if number % 20 == (0 if number // 20 % 2 else 1) else "+0.000000E+0" for number in range(80)
    ]
    assert sum(map(len, fields)) == 1041
    path = tmp_path / "a.ntf"

    def write(values: list[str]) -> None:
        raster = gdal.GetDriverByName("MEM").Create("", 40, 30)
        gdal.GetDriverByName("NITF").CreateCopy(str(path), raster, options=["TRE=RPC00B=" + "".join(values)])

    write(fields)
    assert read_rpc(str(path)).rpc.lat_off == 43.5
    width = len(fields[field])
    write([*fields[:field], text.ljust(width), *fields[field + 1 :]])
    with pytest.raises(InputError, match=rf"a.ntf: field {field + 1} of its RPC00B is"):
        read_rpc(str(path))


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("link", ["nowhere", "self", "folder"])
def test_links_that_lead_nowhere_are_passed_over(tmp_path: Path, link: str) -> None:
    write_image(tmp_path / "a.tif", sample_rpc(1), size=(40, 30))
    place = tmp_path / "a_RPC.TXT"
    place.mkdir() if link == "folder" else os.symlink(place if link == "self" else tmp_path / "none", place)
    assert read_rpc(str(tmp_path / "a.tif")).rpc.lat_off == sample_rpc(1).lat_off


REFUSED = ["43,5", "1e400", "nan", "inf", "0x10", "1_000", "４３.5", "43.5abc", "43.5 12", "43.5,5", "43..5", "--43"]
READ = {"43.5 degrees": 43.5, "+0043.5 pixels": 43.5, "43.5;": 43.5, "4.35D+01": 43.5, "43.5, degrees": 43.5}


@pytest.mark.parametrize("text", [*REFUSED, *READ])
@pytest.mark.parametrize("ending", ["_RPC.TXT", ".RPB", ".vrt"])
def test_numbers_of_rpcs_are_read_whole_or_refused(tmp_path: Path, ending: str, text: str) -> None:
    if ending == ".RPB" and text.endswith(";"):
        text = text[:-1]
    path = tmp_path / f"a{ending}"
    if ending == ".vrt":
        write_image(tmp_path / "b.tif", None, size=(40, 30))
        write_vrt(str(tmp_path / "b.tif"), str(path), sample_rpc(1))
        path.write_text(re.sub(r'(key="LAT_OFF">)[^<]*', rf"\g<1>{text}", path.read_text("utf-8")), "utf-8")
    else:
        write_rpc_text(str(path), sample_rpc(1), kind="rpb" if ending == ".RPB" else "rpc-txt")
        written = re.sub(r"(LAT_OFF: |latOffset = )[^;\n]*", rf"\g<1>{text}", path.read_text("utf-8"))
        path.write_text(written, "utf-8")
    if text in REFUSED:
        with pytest.raises(InputError, match=r"(?i)lat_?off"):
            read_rpc(str(path))
    else:
        assert read_rpc(str(path)).rpc.lat_off == 43.5


def test_coordinates_with_decimal_commas_are_refused() -> None:
    assert parse_lines(["7.5,43.5,300", "7.5 43.5 300", "7, 43, 300"], ["lon", "lat", "height"])[0][:, 0].tolist() == [
        7.5, 7.5, 7.0,
    ]  # fmt: skip
    with pytest.raises(InputError, match="decimals behind commas"):
        parse_lines(["7,5 43,5 300"], ["lon", "lat", "height"])


def test_a_text_file_of_three_million_gcps_is_refused_with_the_figure(tmp_path: Path) -> None:
    path = tmp_path / "g.csv"
    path.write_text("id,lon,lat,height\n" + "p,7.05,45.05,300\n" * 3_000_000)
    before = _cpu_seconds()
    with pytest.raises(InputError, match="has 3000001 rows"):
        require_gcp_rows(str(path))
    assert _cpu_seconds() - before < MOST_CPU_S
    path.write_text("id,lon,lat,height\n" + "p,7.05,45.05,300\n" * 500_000)
    require_gcp_rows(str(path))
    # Two million tie points, and what a block has of GCPs
    path.write_text("id,role,lon,lat,height\n" + "p,tie,7.05,45.05,300\n" * 2_000_000 + "g,gcp,7.05,45.05,300\n" * 300)
    require_gcp_rows(str(path))


@pytest.mark.parametrize("size", [(1, 120), (160, 1), (1, 1)])
def test_a_dem_of_one_column_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    dem = write_raster(tmp_path / "dem.tif", np.zeros(size[::-1]), (7.0, 1e-4, 0.0, 45.0, 0.0, -1e-4), "EPSG:4326")
    with pytest.raises(InputError, match=f"dem.tif: has {size[0]} x {size[1]} cells"):
        open_dem(dem, "ellipsoidal")
