"""The main job in QGIS on the Hobart block: same report as the command line, and residual layers that QGIS draws.

The expected numbers of features are counted in the input tables.
"""

import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import processing
import pytest
from qgis.core import QgsProject, QgsSymbol, QgsVectorLayer

from hrsi.processing_algorithms import REGISTRY
from hrsi.tests.qgis.profile import REPOSITORY, qgis_process, qgis_process_program

HOBART = REPOSITORY / "examples" / "hobart"
IMAGES = [str(HOBART / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)]
OPTIONS = {
    "gcps": str(HOBART / "hobart_ground_points.csv"),
    "image-points": str(HOBART / "hobart_image_points.csv"),
    "tie-points": "none",
    "gcp-ids": "H003,H022,H024,H035,H048,H058,H077,H098,H103,H105",
    "model": "shift",
}
LAYERS = ("residuals_wgs84", "residuals_utm")


def processing_options(folder: Path) -> dict[str, Any]:
    """Return the options under their names in QGIS."""
    named = {name.replace("-", "_").upper(): value for name, value in OPTIONS.items()}
    return {"IMAGES": IMAGES, **named, "OUTPUT_DIR": str(folder)}


@pytest.fixture(scope="module")
def command_line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Output folder of the command line."""
    folder = tmp_path_factory.mktemp("cli") / "out"
    program = [
        sys.executable,
        "-c",
        "import sys; from hrsi.processing_algorithms.command_line.cli import main; sys.exit(main())",
    ]
    options = [word for name, value in OPTIONS.items() for word in (f"--{name}", value)]
    arguments = ["triangulate", *IMAGES, *options, "--output-dir", str(folder)]
    finished = subprocess.run([*program, *arguments], capture_output=True, text=True, check=False, timeout=300)
    assert finished.returncode == 0, finished.stderr
    return folder


@pytest.fixture(scope="module")
def in_qgis_process(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Output folder of ``qgis_process`` with a fresh profile."""
    if qgis_process_program() is None:
        pytest.skip("qgis_process is not installed")
    profile, folder = tmp_path_factory.mktemp("profile"), tmp_path_factory.mktemp("qgis") / "out"
    given = processing_options(folder)
    images = [f"--IMAGES={image}" for image in given.pop("IMAGES")]
    options = [f"--{name}={value}" for name, value in given.items()]
    finished = qgis_process(profile, "run", "hrsi:triangulate", *images, *options)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return folder


def comparable(folder: Path) -> dict[str, Any]:
    """Return a report without its times, its own folder's name, and the command, which has the options' own order."""
    text = (folder / "report.json").read_text(encoding="utf-8").replace(str(folder), "OUTPUT_DIR")
    report = json.loads(text)
    for name in ("seconds", "date", "command"):
        del report[name]
    return report


def rows(name: str) -> list[dict[str, str]]:
    with (HOBART / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def expected_levels() -> dict[str, int]:
    """Count the measurements and the measured points."""
    measured = rows("hobart_image_points.csv")
    known = {row["id"] for row in rows("hobart_ground_points.csv")}
    return {"ground": len({row["id"] for row in measured} & known), "image": len(measured)}


def levels(layer: QgsVectorLayer) -> dict[str, int]:
    found = [feature["level"] for feature in layer.getFeatures()]
    return {level: found.count(level) for level in set(found)}


def symbols(layer: QgsVectorLayer) -> Iterator[QgsSymbol]:
    """Give the symbols of a rule-based renderer, which belong to its rules."""
    for rule in layer.renderer().rootRule().descendants():
        if rule.symbol() is not None:
            yield rule.symbol()


def assert_drawn_as_arrows(layer: QgsVectorLayer) -> None:
    assert layer.renderer().type() == "RuleRenderer"
    shapes = {layer.properties()["name"] for symbol in symbols(layer) for layer in symbol.symbolLayers()}
    assert {"line", "filled_arrowhead"} <= shapes


def test_same_report_as_the_command_line(command_line: Path, in_qgis_process: Path) -> None:
    in_qgis, ours = comparable(in_qgis_process), comparable(command_line)
    assert list_leaves(in_qgis).keys() == list_leaves(ours).keys()
    for place, value in list_leaves(ours).items():
        # BLAS adds in an order that depends on where arrays lie in memory: last digits differ between processes
        same = pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float) else value
        assert list_leaves(in_qgis)[place] == same, place


def list_leaves(value: Any, place: tuple[str | int, ...] = ()) -> dict[tuple[str | int, ...], Any]:
    """Return the values of nested dicts and lists by their keys and positions; an empty one is a value."""
    if not isinstance(value, dict | list) or not value:
        return {place: value}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {leaf: found for key, inner in items for leaf, found in list_leaves(inner, (*place, key)).items()}


def test_layers_are_loaded_to_the_project(hrsi_provider, qgis_new_project, command_line: Path, tmp_path: Path) -> None:
    """Through Processing in this process, with the points from layers of the project."""
    ground = QgsVectorLayer(str(HOBART / "hobart_ground_points.csv"), "ground points", "ogr")
    QgsProject.instance().addMapLayer(ground)
    given = processing_options(tmp_path / "out") | {"GCPS": ground.id()}
    result = processing.runAndLoadResults("hrsi:triangulate", given)
    assert comparable(tmp_path / "out") == comparable(command_line)
    assert Path(result["REPORT"]) == tmp_path / "out" / "report.json"
    loaded = {layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}
    declared = {layer.partition("|layername=")[2] for layer in REGISTRY["triangulate"].layers}
    assert declared <= set(loaded)
    for name in declared & set(LAYERS):
        assert levels(loaded[name]) == expected_levels()
        assert_drawn_as_arrows(loaded[name])


def test_image_without_rpc_is_a_one_line_error(tmp_path: Path) -> None:
    """The message reaches the terminal, the exit code is not 0, nothing is written."""
    image = tmp_path / "no_RPC.TXT"
    image.write_text("nothing\n", encoding="utf-8")
    folder = tmp_path / "out"
    finished = qgis_process(tmp_path, "run", "hrsi:triangulate", f"--IMAGES={image}", f"--OUTPUT_DIR={folder}")
    assert finished.returncode != 0
    assert "no_RPC.TXT" in finished.stdout + finished.stderr
    assert "Traceback" not in finished.stdout + finished.stderr
    assert not list(folder.glob("*"))
