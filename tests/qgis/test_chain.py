"""From images to checked orthoimages without a gap: outputs that the next step takes, the model that comes with the
plugin, and the map that shows what was made."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import processing
import pytest
from qgis.core import QgsProject, QgsRasterLayer, QgsVectorLayer

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
    folders = {name: tmp_path / name for name in ("triangulate", "orthorectify", "orthocheck")}
    outputs = [f"--{step}:FOLDER={path}" for step, path in folders.items()]
    options = [f"--{name}={value}" for name, value in given.items()]
    finished = qgis_process(tmp_path / "profile", "run", MODEL, *images, *options, *outputs)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    reports = {name: json.loads((path / "report.json").read_text()) for name, path in folders.items()}
    assert reports["triangulate"]["check"]["ce90_m"] < 1.0
    made = sorted(path.name for path in folders["orthorectify"].glob("*_ortho.tif"))
    assert made == ["image_1_ortho.tif", "image_2_ortho.tif"]
    (pair,) = reports["orthocheck"]["pairs"]
    print(f"misregistration of the model's orthoimages: {pair}")


def test_model_is_the_one_that_the_script_makes(tmp_path: Path) -> None:
    script = str(REPOSITORY / "scripts" / "make_models.py")
    subprocess.run([sys.executable, script, str(tmp_path)], check=True, capture_output=True)
    (made,) = tmp_path.glob("*.model3")
    assert made.read_bytes() == (REPOSITORY / "plugin" / "models" / made.name).read_bytes()


def test_map_shows_the_result_in_its_group(hrsi_provider, qgis_new_project, block: Path, tmp_path: Path) -> None:
    """Points above footprints; orthoimages below all, in a group of their own run; refined scenes stay away."""
    given = inputs(block) | {"TIE_POINTS": "none", "OUTPUT_DIR": str(tmp_path / "result")}
    result = processing.runAndLoadResults("hrsi:triangulate", given)
    refined = result["IMAGES_MADE"]
    assert [Path(path).name for path in refined] == ["image_1.tif", "image_2.tif"]
    ortho = {"IMAGES": refined, "DEM": given["DEM"], "DEM_DATUM": "ellipsoidal", "OUTPUT_DIR": str(tmp_path / "ortho")}
    made = processing.runAndLoadResults("hrsi:orthorectify", ortho)["IMAGES_MADE"]
    assert len(made) == 2 and all(QgsRasterLayer(path).isValid() for path in made)
    root = QgsProject.instance().layerTreeRoot()
    groups = {group.name(): [node.layer() for node in group.findLayers()] for group in root.findGroups()}
    assert list(groups) == ["HRSI Orthorectify block: ortho", "HRSI Triangulate block: result"]
    residuals, points, footprints, *quick_looks = groups["HRSI Triangulate block: result"]
    assert [layer.name() for layer in (residuals, points, footprints)] == ["residuals_utm", "ground_points", "images"]
    assert all(isinstance(layer, QgsVectorLayer) for layer in (residuals, points, footprints))
    assert [layer.source() for layer in groups["HRSI Orthorectify block: ortho"]] == made[::-1]
    names = [layer.name() for layer in quick_looks]  # those after the adjustment above those before
    assert names == ["image_2_after", "image_1_after", "image_2_before", "image_1_before"]
    assert len(root.findLayers()) == 9  # no layer stands outside its group
