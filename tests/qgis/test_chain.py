"""From images to checked orthoimages without a gap: outputs that the next step takes, the model that comes with the
plugin, and the map that shows what was made."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import processing
import pytest
from qgis.core import QgsGeometry, QgsProcessingFeedback, QgsProject, QgsRasterLayer, QgsVectorLayer

from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.processing_algorithms import run
from hrsi.tests.qgis.profile import REPOSITORY, qgis_process, qgis_process_program

MODEL = "hrsi:triangulatetoorthoimages"


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("chain") / "block"
    run("simulate", output_dir=str(folder), size=300, gcps=6, checks=4, ties=10, seed=3, relief=20)
    return folder


def inputs(block: Path) -> dict[str, object]:
    return {
        "IMAGES": [str(block / f"image_{number}.tif") for number in (1, 2)],
        "GCPS": str(block / "ground_points.csv"), "IMAGE_POINTS": str(block / "image_points.csv"),
        "DEM": str(block / "dem.tif"), "DEM_DATUM": "ellipsoidal",
    }  # fmt: skip


@pytest.mark.programs
def test_model_runs_in_qgis_process(block: Path, tmp_path: Path) -> None:
    """The whole chain by one command: the orthoimages fit one another better than with the vendor's RPCs."""
    if qgis_process_program() is None:
        pytest.skip("qgis_process is not installed")
    given = inputs(block)
    images = [f"--IMAGES={image}" for image in given.pop("IMAGES")]
    folders = {name: tmp_path / name for name in ("triangulate", "surfacemodel", "orthorectify", "orthocheck")}
    outputs = [f"--{step}:FOLDER={path}" for step, path in folders.items()]
    options = [f"--{name}={value}" for name, value in given.items()]
    finished = qgis_process(tmp_path / "profile", "run", MODEL, *images, *options, *outputs)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    reports = {name: json.loads((path / "report.json").read_text()) for name, path in folders.items()}
    assert reports["triangulate"]["check"]["ce90_m"] < 1.0
    made = sorted(path.name for path in folders["orthorectify"].glob("*_ortho.tif"))
    assert made == ["image_1_ortho.tif", "image_2_ortho.tif"]
    ortho = reports["orthorectify"]
    assert Path(ortho["settings"]["dem"]).parent == folders["surfacemodel"] and ortho["settings"]["visibility"]
    assert Path(ortho["mosaic"]["output"]).exists() and Path(ortho["mosaic"]["seamlines"]).exists()
    assert len(reports["orthocheck"]["pairs"]) == 1


def test_model_is_the_one_that_the_script_makes(tmp_path: Path) -> None:
    script = str(REPOSITORY / "scripts" / "make_models.py")
    subprocess.run([sys.executable, script, str(tmp_path)], check=True, capture_output=True)
    (made,) = tmp_path.glob("*.model3")
    assert made.read_bytes() == (REPOSITORY / "plugin" / "models" / made.name).read_bytes()


def test_map_shows_the_result_in_its_group(hrsi_provider, qgis_new_project, block: Path, tmp_path: Path) -> None:
    """Points above footprints; orthoimages and mosaic below all, in a group of their run; refined scenes stay away."""
    given = inputs(block) | {"TIE_POINTS": "none", "OUTPUT_DIR": str(tmp_path / "result")}
    result = processing.runAndLoadResults("hrsi:triangulate", given)
    refined = result["IMAGES_MADE"]
    assert [Path(path).name for path in refined] == ["image_1.tif", "image_2.tif"]
    ortho = {"IMAGES": refined, "DEM": given["DEM"], "DEM_DATUM": "ellipsoidal", "OUTPUT_DIR": str(tmp_path / "ortho"),
             "MOSAIC": True}  # fmt: skip
    made = processing.runAndLoadResults("hrsi:orthorectify", ortho)["IMAGES_MADE"]
    assert len(made) == 2 and all(QgsRasterLayer(path).isValid() for path in made)
    root = QgsProject.instance().layerTreeRoot()
    groups = {group.name(): [node.layer() for node in group.findLayers()] for group in root.findGroups()}
    assert list(groups) == ["HRSI Orthorectify block: ortho", "HRSI Triangulate block: result"]
    residuals, points, footprints, *quick_looks = groups["HRSI Triangulate block: result"]
    assert [layer.name() for layer in (residuals, points, footprints)] == ["residuals_utm", "ground_points", "images"]
    assert all(isinstance(layer, QgsVectorLayer) for layer in (residuals, points, footprints))
    seamlines, *rasters = groups["HRSI Orthorectify block: ortho"]  # the mosaic is below the orthoimages
    assert seamlines.name() == "seamlines" and {one["id"] for one in seamlines.getFeatures()} == {"image_1", "image_2"}
    assert [layer.source() for layer in rasters] == [*made[::-1], str(tmp_path / "ortho" / "mosaic.tif")]
    names = [layer.name() for layer in quick_looks]  # those after the adjustment above those before
    assert names == ["image_2_after", "image_1_after", "image_2_before", "image_1_before"]
    assert len(root.findLayers()) == 11  # no layer stands outside its group


@pytest.mark.parametrize("stated", [True, False], ids=["decided", "with a question"])
def test_a_new_block_is_on_the_map_before_it_is_adjusted(
    hrsi_provider, qgis_new_project, block: Path, tmp_path: Path, stated: bool
) -> None:
    """Footprints, quick-looks, points and DEM where the given RPCs put them; the table of all files is in the log."""
    folder = tmp_path / "delivery"
    folder.mkdir()
    names = ["image_1.tif", "ground_points.csv", "image_points.csv", *(["image_2.tif", "dem.tif"] if stated else [])]
    for name in names:
        shutil.copy(block / name, folder)
    feedback = QgsProcessingFeedback(False)
    processing.runAndLoadResults("hrsi:init", {"FOLDER": str(folder)}, feedback=feedback)
    for line in ("image_1.tif\xa0", "ground points with roles: 6 GCPs, 4 check points", "image measurements"):
        assert line in feedback.textLog()
    assert ("question:" in feedback.textLog()) != stated and (folder / "project.toml").exists()
    (group,) = QgsProject.instance().layerTreeRoot().findGroups()
    layers = [node.layer() for node in group.findLayers()]
    assert group.name() == "HRSI New block from a folder: delivery" and all(layer.isValid() for layer in layers)
    points, footprints, *rasters = layers
    assert [layer.name() for layer in layers[:2]] == ["ground_points", "images"]
    assert [layer.name() for layer in rasters] == (["image_2", "image_1", "dem"] if stated else ["image_1"])
    truth = read_points(str(block / "ground_points.csv"), height_datum="ellipsoidal").ground
    shown = {one["id"]: one.geometry().asPoint() for one in points.getFeatures()}
    assert truth is not None and shown.keys() == set(truth.ids)
    for name, (lon, lat, _) in zip(truth.ids, truth.ground, strict=True):
        assert (shown[name].x(), shown[name].y()) == pytest.approx((lon, lat), abs=1e-9)
    for raster, outline in zip(rasters[: 1 + stated][::-1], footprints.getFeatures(), strict=True):
        assert raster.extent().intersects(outline.geometry().boundingBox())
        assert outline.geometry().contains(QgsGeometry.fromPointXY(raster.extent().center()))
