"""Every declared algorithm in QGIS: its icon, its dialog, a run; and in a model, in a batch, cancelled."""

import csv
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from long_tests import mark_beyond
from osgeo import gdal
from qgis.core import (
    QgsApplication,
    QgsProcessingAlgRunnerTask,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingModelAlgorithm,
    QgsProcessingModelChildAlgorithm,
    QgsProcessingModelChildDependency,
    QgsProcessingModelChildParameterSource,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QEvent, QTimer

from hrsi.plugin.icons import icon_path
from hrsi.plugin.parameters import NO_THREADING
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.interface.declare import Kind
from hrsi.tests.qgis.panels import guarded_threads, run_in_background
from hrsi.tests.qgis.profile import REPOSITORY

CANCEL_S = 1.0
AT_THE_END_S = 0.05  # from the renaming of results to the end of the task
HOBART = REPOSITORY / "examples" / "hobart"
RPCS = [str(HOBART / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)]
GROUND, MEASURED = str(HOBART / "hobart_ground_points.csv"), str(HOBART / "hobart_image_points.csv")


def identifier(name: str) -> str:
    return f"hrsi:{name.replace('-', '')}"


@pytest.fixture(scope="module")
def pixels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small simulated block, for the algorithms that need pixels."""
    folder = tmp_path_factory.mktemp("pixels") / "block"
    run("simulate", output_dir=str(folder), size=256, gcps=6, checks=2, ties=8, ortho=True, seed=3)
    return folder


def images(pixels: Path) -> list[str]:
    return [str(pixels / f"image_{number}.tif") for number in (1, 2)]


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Correspondences of ground and image, from the Hobart RPC, for the fit of an RPC."""
    from hrsi.hrsi_engine.io.rasters.images import open_image

    image = open_image(RPCS[0])
    path = tmp_path_factory.mktemp("grid") / "grid.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["id", "sample", "line", "lon", "lat", "height"])
        for height in (0.0, 200.0, 400.0):
            xy = image.grid_px(8, 8)
            for number, (place, ground) in enumerate(zip(xy, image.rpc.localize(xy, height).ground, strict=True)):
                writer.writerow([f"{number}_{height:.0f}", *place, *ground])
    return str(path)


def cut_parts(pixels: Path) -> list[str]:
    """Return two parts of a simulated image that overlap, with their RPCs."""
    source = images(pixels)[0]
    size = gdal.Open(source).RasterXSize
    for number in (0, 1):
        window = [0, number * size // 3, size, size // 2]
        gdal.Translate(str(pixels / f"part_{number}.tif"), source, srcWin=window)
    return [str(pixels / f"part_{number}.tif") for number in (0, 1)]


def adjust_images(pixels: Path) -> str:
    """Return the result folder of an adjustment of the simulated images."""
    points = {"gcps": str(pixels / "ground_points.csv"), "image_points": str(pixels / "image_points.csv")}
    folder = str(pixels / "adjusted")
    run(
        "adjust", images=images(pixels), **points, height_datum="ellipsoidal", report=False, output_dir=folder,
        overwrite=True,
    )  # fmt: skip
    return folder


FILLED = {
    Kind.IMAGES: RPCS, Kind.POINTS: GROUND, Kind.RASTER: RPCS[0], Kind.FILE: GROUND,
    Kind.RESULT: str(HOBART), Kind.PROJECT: str(HOBART / "project.toml"), Kind.OUTPUT_DIR: "TEMPORARY_OUTPUT",
}  # fmt: skip
BLOCK = {"GCPS": GROUND, "IMAGE_POINTS": MEASURED, "GCP_IDS": "H003,H022,H024,H035,H048,H058"}
#: Parameters of a short run of each algorithm, beside OUTPUT_DIR: on the Hobart block, else on a simulated one.
RUNS: dict[str, Callable[[Path, str], dict[str, Any]]] = {
    "triangulate": lambda pixels, grid: {"IMAGES": RPCS, "TIE_POINTS": "none", **BLOCK},
    "adjust": lambda pixels, grid: {"IMAGES": RPCS, **BLOCK},
    "evaluate": lambda pixels, grid: {
        "IMAGES": RPCS, "TRACKS": "none", "RPCS": f"same={HOBART}", "GCPS": GROUND, "IMAGE_POINTS": MEASURED,
    },
    "refine-rpc": lambda pixels, grid: {"IMAGES": RPCS, "GCPS": GROUND, "IMAGE_POINTS": MEASURED},
    "rpc-info": lambda pixels, grid: {"IMAGES": RPCS},
    "project": lambda pixels, grid: {"IMAGES": RPCS[:1], "POINTS": GROUND},
    "localize": lambda pixels, grid: {"IMAGES": RPCS, "POINTS": MEASURED, "HEIGHT": 100.0},
    "write-rpc": lambda pixels, grid: {"IMAGES": RPCS[:1]},
    "crop": lambda pixels, grid: {"IMAGES": images(pixels)[:1], "FACTOR": 0.5},
    "strip": lambda pixels, grid: {"IMAGES": cut_parts(pixels)},
    "hand-over": lambda pixels, grid: {"RESULT": adjust_images(pixels), "TO": "cars"},
    "surface-model": lambda pixels, grid: {"RESULT": adjust_images(pixels)},
    "fit-rpc": lambda pixels, grid: {"POINTS": grid},
    "simulate": lambda pixels, grid: {"SIZE": 128, "GCPS": 2, "CHECKS": 1, "TIES": 2, "PIXELS": False},
    "interest-points": lambda pixels, grid: {"IMAGES": images(pixels)[:1]},
    "measure-targets": lambda pixels, grid: {
        "IMAGES": images(pixels), "POINTS": str(pixels / "ground_points.csv"), "KIND": "center",
    },
    "register": lambda pixels, grid: {"IMAGES": images(pixels), "IMAGE_POINTS": str(pixels / "image_points.csv")},
    "tie-points": lambda pixels, grid: {"IMAGES": images(pixels), "CELLS": 3},
    "match": lambda pixels, grid: {"IMAGES": images(pixels)},
    "gcps-from-reference": lambda pixels, grid: {
        "IMAGES": images(pixels)[:1], "REFERENCE": str(pixels / "orthophoto.tif"), "DEM": str(pixels / "dem.tif"),
    },
    "orthorectify": lambda pixels, grid: {"IMAGES": images(pixels)[:1], "DEM": str(pixels / "dem.tif")},
    "init": lambda pixels, grid: {"FOLDER": str(pixels), "OUTPUT": str(pixels.parent / "init.toml"), "OVERWRITE": True},
    "run": lambda pixels, grid: {"PROJECT": str(HOBART / "project.toml")},
}  # fmt: skip


@pytest.mark.parametrize("name", REGISTRY)
def test_icon_of_its_own(name: str) -> None:
    assert icon_path(name).stem == name


@pytest.mark.parametrize("name", REGISTRY)
def test_dialog(hrsi_provider, qgis_new_project, monkeypatch, name: str) -> None:
    """The dialog opens, and gives the declared defaults back."""
    from processing.gui import ParametersPanel
    from processing.gui.AlgorithmDialog import AlgorithmDialog

    monkeypatch.setattr(ParametersPanel, "iface", None)  # the mock has no browser model
    algorithm = QgsApplication.processingRegistry().createAlgorithmById(identifier(name))
    dialog = AlgorithmDialog(algorithm)
    dialog.setParameters(
        {param.key.upper(): FILLED[param.kind] for param in REGISTRY[name].params if param.kind in FILLED}
    )
    parameters = dialog.createProcessingParameters()
    for param in REGISTRY[name].params:
        if param.default is not None and param.kind in (Kind.CHOICE, Kind.NUMBER, Kind.FLAG):
            given = parameters.get(param.key.upper(), param.default)
            assert given == param.default, param.name
    dialog.deleteLater()
    QgsApplication.sendPostedEvents(dialog, QEvent.Type.DeferredDelete)  # before its algorithm goes


@pytest.mark.parametrize("name", mark_beyond(len(RUNS) - 1, "thorough", sorted(RUNS, key="tie-points".__eq__)))
def test_run(hrsi_provider, qgis_new_project, pixels: Path, grid: str, tmp_path: Path, name: str) -> None:
    """A run in its task leaves a report, and what it declares to show is on the map with a style or a default one."""
    folder = tmp_path / "out"
    from processing.gui.Postprocessing import handleAlgorithmResults

    given, context, feedback = RUNS[name](pixels, grid), QgsProcessingContext(), QgsProcessingFeedback()
    context.setProject(QgsProject.instance())
    known = {param.key.upper() for param in REGISTRY[name].params}
    assert set(given) <= known
    algorithm = QgsApplication.processingRegistry().createAlgorithmById(identifier(name))
    with guarded_threads():
        _, result = run_in_background(algorithm, given | {"OUTPUT_DIR": str(folder)}, feedback, context)
    assert result, feedback.textLog()
    assert handleAlgorithmResults(algorithm, context, feedback)
    report = json.loads(Path(result["REPORT"]).read_text(encoding="utf-8"))
    assert report["algorithm"] == name
    on_map = {layer.source() for layer in QgsProject.instance().mapLayers().values()}
    for layer in REGISTRY[name].layers:
        source = f"{folder}/{layer}"
        assert source in on_map or not QgsVectorLayer(source, "", "ogr").isValid()


def test_in_a_model(hrsi_provider, qgis_new_project, tmp_path: Path) -> None:
    """A model hands a layer of one step to the next: the points that were adjusted are projected into an image."""
    model = QgsProcessingModelAlgorithm("chain", "tests")
    model.initAlgorithm()
    first = QgsProcessingModelChildAlgorithm(identifier("adjust"))
    first.setChildId("adjusted")
    values = {"IMAGES": RPCS, **BLOCK, "OUTPUT_DIR": str(tmp_path / "adjusted")}
    for key, value in values.items():
        first.addParameterSources(key, [QgsProcessingModelChildParameterSource.fromStaticValue(value)])
    model.addChildAlgorithm(first)
    second = QgsProcessingModelChildAlgorithm(identifier("project"))
    second.setChildId("projected")
    second.setDependencies([QgsProcessingModelChildDependency("adjusted")])
    sources = {
        "IMAGES": QgsProcessingModelChildParameterSource.fromStaticValue(RPCS[:1]),
        "POINTS": QgsProcessingModelChildParameterSource.fromChildOutput("adjusted", "GROUND_POINTS"),
        "OUTPUT_DIR": QgsProcessingModelChildParameterSource.fromStaticValue(str(tmp_path / "projected")),
    }
    for key, source in sources.items():
        second.addParameterSources(key, [source])
    model.addChildAlgorithm(second)
    feedback = QgsProcessingFeedback()
    model.flags = lambda: QgsProcessingModelAlgorithm.flags(model) & ~NO_THREADING  # as the plugin's own
    with guarded_threads():
        successful, _results = run_in_background(model, {}, feedback)
    assert successful, feedback.textLog()
    layer = QgsVectorLayer(f"{tmp_path}/projected/points.gpkg|layername=image_points", "", "ogr")
    assert layer.featureCount() > 50


CANCELLED: dict[str, Callable[[Path], dict[str, Any]]] = {
    "simulate": lambda pixels: {"SIZE": 6000, "TIES": 5000},
    "tie-points": lambda pixels: {"IMAGES": images(pixels)},
    "interest-points": lambda pixels: {"IMAGES": images(pixels)[:1]},
}


@pytest.mark.parametrize("name", CANCELLED)
def test_cancel_within_a_second(hrsi_provider, pixels: Path, tmp_path: Path, name: str) -> None:
    """Cancelled as by the dialog's button, in its background task; nothing is left behind.

    Not at the first use: loops are compiled then, once after the installation, which cannot be cancelled.
    """
    if name == "tie-points":
        run(name, images=images(pixels), output_dir=str(tmp_path / "before"))
    feedback, cancelled_at, ended = QgsProcessingFeedback(), [], []
    feedback.canceled.connect(lambda: cancelled_at.append((time.monotonic(), time.process_time())))
    algorithm = QgsApplication.processingRegistry().createAlgorithmById(identifier(name))
    context = QgsProcessingContext()
    folder = tmp_path / "out"
    task = QgsProcessingAlgRunnerTask(
        algorithm, CANCELLED[name](pixels) | {"OUTPUT_DIR": str(folder)}, context, feedback
    )
    task.executed.connect(lambda successful, results: ended.append((successful, time.monotonic(), time.process_time())))
    feedback.progressChanged.connect(lambda _percent: None if cancelled_at else QTimer.singleShot(50, feedback.cancel))
    QgsApplication.taskManager().addTask(task)
    while not ended:
        QgsApplication.processEvents()
        time.sleep(0.005)
    successful, ended_at, cpu_at_end = ended[0]
    if successful:
        pytest.skip(f"{name} was done before it could be cancelled")
    seconds, busy = ended_at - cancelled_at[0][0], cpu_at_end - cancelled_at[0][1]
    assert min(seconds, busy) < CANCEL_S  # other programs may keep the processors busy
    left = [path for path in folder.rglob("*.*") if not path.name.startswith(".")] if folder.exists() else []
    if seconds < AT_THE_END_S and folder / "report.json" in left:  # QGIS calls that unsuccessful, too
        pytest.skip(f"{name} had put its results in place when it was cancelled")
    assert not [path for path in left if path.name in ("report.json", "report.html") or path.suffix == ".gpkg"]
