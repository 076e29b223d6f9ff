"""The zip that users install: it runs in a clean profile, with nothing but what a stock QGIS brings."""

import importlib.util
import json
import zipfile
from pathlib import Path

import pytest

from hrsi.processing_algorithms import REGISTRY
from hrsi.tests.qgis.profile import REPOSITORY, qgis_process, qgis_process_program

pytestmark = pytest.mark.skipif(qgis_process_program() is None, reason="qgis_process is not installed")
#: Python runs this before anything else: its finder of packages then sees none of those that a stock QGIS lacks.
HIDE_PACKAGES = """
from importlib.machinery import PathFinder

absent = {"cv2", "numba", "llvmlite", "dask", "distributed", "rasterio"}
seen = PathFinder.find_spec
PathFinder.find_spec = lambda name, *place: None if name.split(".")[0] in absent else seen(name, *place)
"""
HOBART = REPOSITORY / "examples" / "hobart"


@pytest.fixture(scope="module")
def profile(tmp_path_factory) -> Path:
    """A clean profile with the zip's content as its only plugin."""
    folder = tmp_path_factory.mktemp("profile")
    spec = importlib.util.spec_from_file_location("make_plugin", REPOSITORY / "scripts" / "make_plugin.py")
    make_plugin = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_plugin)
    make_plugin.build(folder / "hrsi.zip", {})
    plugins = folder / "profiles" / "default" / "python" / "plugins"
    with zipfile.ZipFile(folder / "hrsi.zip") as archive:
        archive.extractall(plugins)
    assert not (plugins / "hrsi").is_symlink()
    return folder


def triangulate(profile: Path, output: Path, *options: str, **variables: str):
    images = [f"--IMAGES={HOBART / f'hobart_ikonos_{number}_RPC.TXT'}" for number in (1, 2, 3)]
    points = [f"--GCPS={HOBART / 'hobart_ground_points.csv'}", f"--IMAGE_POINTS={HOBART / 'hobart_image_points.csv'}"]
    return qgis_process(
        profile, "--json", "run", "hrsi:triangulate", *images, *points, *options, f"--OUTPUT_DIR={output}", **variables
    )


def test_zip_triangulates_in_a_clean_profile(profile: Path, tmp_path: Path):
    done = triangulate(profile, tmp_path / "result", "--TIE_POINTS=none", "--GCP_IDS=H003,H022,H058,H105")
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "result" / "report.json").read_text(encoding="utf-8"))
    assert report["check"]["points"] == 67  # 71 measured targets, 4 of them control
    assert report["check"]["rmse_height_m"] < 3.0


@pytest.mark.programs
def test_a_stock_qgis_needs_no_packages(profile: Path, tmp_path: Path):
    """Adjustment and simulation run without OpenCV, numba and Dask; matching names what it lacks."""
    (tmp_path / "sitecustomize.py").write_text(HIDE_PACKAGES)
    without = {"PYTHONPATH": str(tmp_path)}
    listed = qgis_process(profile, "--json", "list", **without)
    assert listed.returncode == 0, listed.stderr
    assert len(json.loads(listed.stdout)["providers"]["hrsi"]["algorithms"]) == len(REGISTRY) + 1  # a model
    done = triangulate(profile, tmp_path / "adjusted", "--TIE_POINTS=none", "--GCP_IDS=H003,H022,H058,H105", **without)
    assert done.returncode == 0, done.stderr
    made = qgis_process(
        profile, "--json", "run", "hrsi:simulate", "--IMAGES=2", "--SIZE=300", "--GCPS=4", "--CHECKS=4",
        "--TIES=0", f"--OUTPUT_DIR={tmp_path / 'block'}", **without,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr + made.stdout
    block = tmp_path / "block"
    images = [f"--IMAGES={image}" for image in sorted(block.glob("image_*.tif"))]
    tied = qgis_process(
        profile, "--json", "run", "hrsi:triangulate", *images, f"--GCPS={block / 'ground_points.csv'}",
        f"--IMAGE_POINTS={block / 'image_points.csv'}", f"--DEM={block / 'dem.tif'}", "--HEIGHT_DATUM=ellipsoidal",
        f"--OUTPUT_DIR={tmp_path / 'tied'}", **without,
    )  # fmt: skip
    assert tied.returncode != 0
    assert "opencv-python-headless" in tied.stderr + tied.stdout
