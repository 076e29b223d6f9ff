"""`.adjust` files of ASP: the RPC they move, by VisionWorkbench's formula on GDAL's RPC and PROJ's ellipsoid."""

import shutil
from pathlib import Path

import numpy as np
import pyproj
import pytest
from osgeo import gdal

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.exact_cameras import read_adjusted_camera
from hrsi.hrsi_engine.io.rpc_files import read_rpc
from hrsi.processing_algorithms import run
from hrsi.tests.conftest import TEST_DATA
from hrsi.tests.io.test_exact_cameras import write_csm

HOBART = TEST_DATA / "thesis" / "hobart_ikonos_1_RPC.TXT"
ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
TRANSLATION = np.array([1.25, -2.5, 0.75])
AXIS, ANGLE = np.array([2.0, -1.0, 2.0]) / 3.0, 1.3e-5  # of some 1.3 m at the camera's centre 100 km up
QUATERNION = np.r_[np.cos(ANGLE / 2.0), np.sin(ANGLE / 2.0) * AXIS]


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    shutil.copy(HOBART, tmp_path / "img_RPC.TXT")
    return tmp_path / "img_RPC.TXT"


def write_adjustment(path: Path, *more: str) -> str:
    """As `write_adjustments` prints it: precision 17, x y z, then w x y z with a blank behind."""
    lines = [
        " ".join(f"{value:.17g}" for value in TRANSLATION),
        " ".join(f"{value:.17g}" for value in QUATERNION) + " ",
    ]
    path.write_text("\n".join([*lines, *more]) + "\n")
    return str(path)


def turn(vectors: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' formula about AXIS."""
    across = np.cross(AXIS, vectors)
    return vectors * np.cos(angle) + across * np.sin(angle) + np.outer(vectors @ AXIS, AXIS) * (1.0 - np.cos(angle))


def image_of(ground: np.ndarray, rpc: Path) -> np.ndarray:
    """Return `point_to_pixel` of the adjusted camera at lon, lat, height: the point is moved back, then projected."""
    image = gdal.GetDriverByName("MEM").Create("", 10, 10)
    words = {
        line.split(":")[0].strip(): line.split(":")[1].split()[0]
        for line in rpc.read_text().splitlines()
        if ":" in line
    }
    polynomials = {
        name: " ".join(words[f"{name}_{number}"] for number in range(1, 21))
        for name in ("LINE_NUM_COEFF", "LINE_DEN_COEFF", "SAMP_NUM_COEFF", "SAMP_DEN_COEFF")
    }
    image.SetMetadata({key: value for key, value in words.items() if "COEFF" not in key} | polynomials, "RPC")

    def pixel(points: np.ndarray) -> np.ndarray:
        found = gdal.Transformer(image, None, ["METHOD=RPC"]).TransformPoints(1, points.tolist())[0]
        return np.array(found)[:, :2] - 0.5  # GDAL counts from the corner

    def on_ground(height: float) -> np.ndarray:
        options = ["METHOD=RPC", f"RPC_HEIGHT={height}", "RPC_PIXEL_ERROR_THRESHOLD=1e-7"]
        lon, lat, _ = gdal.Transformer(image, None, options).TransformPoint(0, 0.5, 0.5)[1]
        return np.array(ECEF.transform(lon, lat, height))

    off, half = float(words["HEIGHT_OFF"]), min(0.9 * float(words["HEIGHT_SCALE"]), 50.0)
    up, down = on_ground(off + half), on_ground(off - half)
    centre = up - (down - up) / np.linalg.norm(down - up) * 100_000.0
    there = np.column_stack(ECEF.transform(*ground.T))
    back = turn(there - centre - TRANSLATION, -ANGLE) + centre
    return pixel(np.column_stack(ECEF.transform(*back.T, direction="INVERSE")))


def sample_ground(rpc_file: Path) -> np.ndarray:
    rpc, rng = read_rpc(str(rpc_file)).rpc, np.random.default_rng(4)
    unit = rng.uniform(-0.9, 0.9, (200, 3))
    off = np.array([rpc.long_off, rpc.lat_off, rpc.height_off])
    return off + unit * [rpc.long_scale, rpc.lat_scale, rpc.height_scale]


def test_the_fitted_rpc_is_the_adjusted_camera(camera, tmp_path):
    """To the stated error of the fit, and both to 1e-3 px; the adjustment moves the image by some pixels."""
    path = write_adjustment(tmp_path / "run-img.adjust")
    report = run("fit-rpc", points=f"{path}|camera={camera}", output_dir=str(tmp_path / "fitted"))
    assert Path(report["output"]).name == "run-img_RPC.TXT"
    found, ground = read_rpc(report["output"]).rpc, sample_ground(camera)
    np.testing.assert_allclose(found.project(ground), image_of(ground, camera), atol=1e-3)
    assert report["max_px"] < 1e-3 and report["check"]["max_px"] < 1e-3
    assert np.hypot(*(found.project(ground) - read_rpc(str(camera)).rpc.project(ground)).T).min() > 0.5


def test_offset_and_scale_of_a_crop(camera, tmp_path):
    """Pixels of the crop, times the scale and plus the offset, are those of the RPC."""
    path = write_adjustment(tmp_path / "run-img.adjust", "1000 500", "2")
    adjusted = read_adjusted_camera(f"{path}|camera={camera}")
    ground, image = adjusted.sample_correspondences(*adjusted.heights_m)
    np.testing.assert_allclose(image_of(ground, camera), image * 2.0 + [1000.0, 500.0], atol=1e-4)


def test_its_name_does_not_matter_where_a_camera_is_named(camera, tmp_path):
    files = [write_adjustment(tmp_path / name) for name in ("run-img.adjust", "renamed.txt")]
    by_name, renamed = (read_adjusted_camera(f"{path}|camera={camera}").sample_correspondences(0.0, 100.0)
                        for path in files)  # fmt: skip
    np.testing.assert_array_equal(by_name[1], renamed[1])
    with pytest.raises(InputError, match="no translation and unit quaternion"):
        read_adjusted_camera(f"{camera}|camera={camera}")


@pytest.mark.parametrize(("name", "log", "session", "answer"), [
    ("run-img.adjust", "", "", "warning"),
    ("run-img.adjust", "", "|session=rpc", "taken"),
    ("run-img.adjust", "", "|session=dg", "refused"),
    ("run-img.adjust", "/opt/asp/libexec/bundle_adjust --threads 2 -t rpc img.tif img.xml -o run", "", "taken"),
    ("run-img.adjust", "/opt/asp/bundle_adjust --session-type DG img.tif -o run", "", "refused"),
    ("ba/run-img.adjust", "bundle_adjust -t dgmaprpc img.tif -o ba/run", "", "refused"),
    ("other-img.adjust", "bundle_adjust -t dg img.tif -o run", "", "warning"),
])  # fmt: skip
def test_the_session_decides_which_camera_moved(camera, tmp_path, name, log, session, answer):
    """A linescan session of which only the RPC is there is refused; without any evidence a warning states the rule."""
    (tmp_path / "ba").mkdir()
    path = Path(write_adjustment(tmp_path / name))
    if log:
        (path.parent / "run-log-bundle_adjust-11-28-1040-77.txt").write_text(f"ASP 3.4.0\n\n{log}\n\nuname -a\n")
    spec = f"{path}|camera={camera}{session}"
    if answer == "refused":
        with pytest.raises(InputError, match=r"moves the exact camera.*\|session=rpc"):
            read_adjusted_camera(spec)
        return
    warnings = run("fit-rpc", points=spec, output_dir=str(tmp_path / "fitted"))["warnings"]
    assert any("after -t dg name the XML" in text for text in warnings) is (answer == "warning")


def test_what_is_no_adjustment_of_an_rpc_gets_an_answer(camera, tmp_path):
    path = Path(write_adjustment(tmp_path / "run-img.adjust"))
    with pytest.raises(InputError, match=r"name it, .*run-img\.adjust\|camera=IMAGE"):
        read_adjusted_camera(str(path))
    write_csm(tmp_path / "run-img.adjusted_state.json")
    with pytest.raises(
        InputError, match=r"is a CSM state, .* only be applied to an RPC: name the adjusted_state\.json"
    ):
        read_adjusted_camera(f"{path}|camera={tmp_path / 'run-img.adjusted_state.json'}")
    image = gdal.GetDriverByName("GTiff").Create(str(tmp_path / "plain.tif"), 10, 10)
    image = None
    assert image is None
    with pytest.raises(InputError, match="has no RPC"):
        read_adjusted_camera(f"{path}|camera={tmp_path / 'plain.tif'}")
    assert read_adjusted_camera(str(camera)) is None
    content = path.read_text()
    for wrong in (
        "",
        content.split("\n")[0],
        content.replace("0.99", "0.89"),
        content.replace("1.25", "nan"),
        "1 2 3 4",
    ):
        path.write_text(wrong)
        with pytest.raises(InputError, match="no translation and unit quaternion"):
            read_adjusted_camera(f"{path}|camera={camera}")
    with pytest.raises(InputError, match="no translation and unit quaternion"):
        run("fit-rpc", points=f"{path}|camera={camera}", output_dir=str(tmp_path / "none"))
