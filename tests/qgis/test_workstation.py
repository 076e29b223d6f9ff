"""Working in the panel as a person does: keys, undo, the map, live residuals; and nothing measured is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from qgis.core import (
    Qgis,
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsPointXY,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
)
from qgis.gui import QgsMapCanvas, QgsMessageBar
from qgis.PyQt.QtCore import QEvent, QPoint, QPointF, Qt, QTimer
from qgis.PyQt.QtGui import QMouseEvent
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QApplication, QMessageBox, QPushButton

from hrsi.hrsi_engine.block.block import Image
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.plugin.points_panel.guards import ExitGuard, offer_unsaved
from hrsi.plugin.points_panel.new_point import NewPointDialog
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import PointSession, files
from hrsi.processing_algorithms.point_session.rows import KnownPoint, Measured

ROOT = Path(__file__).resolve().parents[2]
NAME = "G000001"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workstation") / "block"
    run("simulate", output_dir=str(folder), images=3, along="-12,0,12", size=400, gcps=7, checks=3, ties=12, seed=5)
    return folder


@pytest.fixture
def sources(simulated: Path) -> dict[str, object]:
    return {
        "images": [str(simulated / f"image_{number}.tif") for number in (1, 2, 3)],
        "gcps": str(simulated / "ground_points.csv"), "image_points": str(simulated / "image_points.csv"),
    }  # fmt: skip


@pytest.fixture
def canvas(qgis_app):
    made = QgsMapCanvas()
    made.resize(300, 300)
    yield made
    made.stopRendering()


@pytest.fixture
def dock(qgis_app, qgis_new_project, canvas, sources, tmp_path: Path):
    panel = PointsDock(None, canvas, str(tmp_path / "unsaved"))
    panel.resize(1300, 700)
    panel.show()
    panel.show_session(files.new_session(**sources))
    QApplication.setActiveWindow(panel)
    yield panel
    panel.give_up()
    close(panel)


def close(panel: PointsDock) -> None:
    panel.close_for_good()
    panel.deleteLater()
    QgsApplication.sendPostedEvents(panel, QEvent.Type.DeferredDelete)


def wait_for(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        QgsApplication.processEvents()
        time.sleep(0.005)


def press(panel: PointsDock, keys: Qt.Key, modifier: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
    """Press a key while the panel's list has the focus."""
    panel.ui.points.setFocus()
    QTest.keyClick(panel.ui.points, keys, modifier)
    QgsApplication.processEvents()


def click_on(canvas: QgsMapCanvas, place: tuple[float, float]) -> None:
    """Press and release the left button over a place in map coordinates."""
    at = canvas.getCoordinateTransform().transform(QgsPointXY(*place))
    where = QPoint(round(at.x()), round(at.y()))
    assert canvas.viewport().rect().contains(where)
    for kind, buttons in (
        (QEvent.Type.MouseButtonPress, Qt.MouseButton.LeftButton),
        (QEvent.Type.MouseButtonRelease, Qt.MouseButton.NoButton),
    ):
        event = QMouseEvent(
            kind, QPointF(where), QPointF(canvas.viewport().mapToGlobal(where)), Qt.MouseButton.LeftButton, buttons,
            Qt.KeyboardModifier.NoModifier,
        )  # fmt: skip
        QgsApplication.sendEvent(canvas.viewport(), event)


def answer(button: QMessageBox.StandardButton) -> list[str]:
    """Press a button of the next question; return the list that its text will be in."""
    asked: list[str] = []

    def press_it() -> None:
        box = QApplication.activeModalWidget()
        if isinstance(box, QMessageBox):
            asked.append(box.text())
            QTest.mouseClick(box.button(button), Qt.MouseButton.LeftButton)
        else:
            QTimer.singleShot(20, press_it)

    QTimer.singleShot(20, press_it)
    return asked


def test_keys_lead_through_the_points(dock) -> None:
    """N and P go round the points that are not measured everywhere; A takes the prediction, Del takes it away."""
    dock.session.measured.clear()
    names = [name for name in dock.session.points if any(row.is_inside for row in dock.session.measurements(name))]
    dock.choose(names[0])
    press(dock, Qt.Key.Key_N)
    assert dock.point() == names[1]
    press(dock, Qt.Key.Key_P)
    assert dock.point() == names[0]
    image = dock.ui.views[0].image()
    dock.ui.kind.setCurrentText("point")
    press(dock, Qt.Key.Key_A)
    measured = dock.session.measured[(names[0], image)]
    assert (measured.sample, measured.line) == pytest.approx(dock.session.predicted(names[0], image))
    press(dock, Qt.Key.Key_Delete)
    assert (names[0], image) not in dock.session.measured


def test_keys_undo_and_redo(dock) -> None:
    before = dict(dock.session.measured)
    dock.choose(NAME)
    dock.activate(dock.ui.views[0])
    press(dock, Qt.Key.Key_Delete)
    after = dict(dock.session.measured)
    assert len(after) == len(before) - 1
    assert dock.windowTitle().endswith("*")
    press(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert dock.session.measured == before
    assert not dock.windowTitle().endswith("*")
    press(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    assert dock.session.measured == after
    dock.remove_point()
    assert NAME not in dock.session.points
    dock.ui.undo.trigger()
    assert list(dock.session.points)[0:1] == list(files.new_session(**dock.session.sources).points)[0:1]
    assert NAME in dock.session.points


def test_views_are_as_many_as_wanted(dock) -> None:
    """Each shows another image; where there are more views than images, the rest stays empty."""
    dock.choose(NAME)
    for number in ("4", "1", "3"):
        dock.ui.number.setCurrentText(number)
        shown = [view.image() for view in dock.ui.shown_views()]
        assert len(shown) == int(number)
        assert sorted(filter(None, shown)) == [f"image_{k}" for k in range(1, min(int(number), 3) + 1)] or number == "1"


def test_whole_image_and_back(dock) -> None:
    dock.choose(NAME)
    view = dock.ui.views[0]
    QTest.mouseClick(view.whole, Qt.MouseButton.LeftButton)
    assert min(view.canvas.extent().width(), view.canvas.extent().height()) >= 399.0
    dock.choose(next(name for name in dock.session.points if name != NAME))
    dock.choose(NAME)
    sample, line = dock.session.measured[(NAME, view.image())].sample, dock.session.measured[(NAME, view.image())].line
    assert min(view.canvas.extent().width(), view.canvas.extent().height()) < 130.0
    assert view.canvas.extent().center().x() == pytest.approx(sample, abs=0.01)
    assert view.canvas.extent().center().y() == pytest.approx(-line, abs=0.01)


def test_role_off_takes_a_point_out(dock) -> None:
    """Its residuals tell nothing, its marker fades, it is passed over."""
    model = dock.points_model
    row = model.row_of(NAME)
    assert model.setData(model.index(row, model.titles.index("role")), "off")
    assert dock.session.points[NAME].role == "off"
    shown = {marker.name: marker for view in dock.ui.shown_views() for marker in view.markers.markers}
    assert shown[NAME].is_off
    dock.adjust()
    wait_for(lambda: not dock.is_adjusting())
    assert NAME not in dock.session.adjusted.residual_m


def test_point_from_the_map_with_the_height_of_a_dem(dock, canvas, simulated: Path, monkeypatch) -> None:
    """A click in the map, in the map's own CRS, becomes a ground point at the DEM's height there."""
    known = dock.session.points[NAME]
    dem = QgsRasterLayer(str(simulated / "dem.tif"), "dem")
    QgsProject.instance().addMapLayer(dem)
    canvas.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:4326"))
    canvas.setExtent(QgsRectangle(known.lon - 1e-3, known.lat - 1e-3, known.lon + 1e-3, known.lat + 1e-3))
    canvas.show()
    asked: list[NewPointDialog] = []

    def fill_in(dialog: NewPointDialog) -> int:
        dialog.dem.setCurrentIndex(dialog.dem.findText("dem"))
        dialog.datum.setCurrentText("ellipsoidal")
        dialog.sigma_xy.setValue(2.5)
        asked.append(dialog)
        return 1

    monkeypatch.setattr(NewPointDialog, "exec", fill_in)
    dock.ui.pick.trigger()
    click_on(canvas, (known.lon, known.lat))
    assert len(asked) == 1
    new = dock.session.points["P1"]
    assert (new.lon, new.lat) == pytest.approx((known.lon, known.lat), abs=1e-5)
    assert new.height == pytest.approx(known.height, abs=3.0)  # GCPs stand on the simulated ground
    assert new.sigma_xy == 2.5 and np.isnan(new.sigma_h)
    assert dock.point() == "P1"
    dock.undo()
    assert "P1" not in dock.session.points


def test_images_follow_the_map(dock, canvas) -> None:
    known = dock.session.points[NAME]
    dock.choose(next(name for name in dock.session.points if name != NAME))
    canvas.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:4326"))
    canvas.setExtent(QgsRectangle(known.lon - 1e-3, known.lat - 1e-3, known.lon + 1e-3, known.lat + 1e-3))
    canvas.show()
    dock.ui.go_to.trigger()
    click_on(canvas, (known.lon, known.lat))
    for view in dock.ui.shown_views():
        middle = view.canvas.extent().center()
        sample, line = dock.session.predicted(NAME, view.image())
        assert abs(middle.x() - sample) < 40.0 and abs(-middle.y() - line) < 40.0  # the middle height, not the point's
    dock.ui.go_to.trigger()
    assert canvas.mapTool() is None or type(canvas.mapTool()).__name__ != "QgsMapToolEmitPoint"


def test_residuals_are_live(dock) -> None:
    """With "Live" an edit is followed by its residuals, and the file is left as it is."""
    dock.ui.live.trigger()
    wait_for(lambda: dock.session.is_adjusted and not dock.is_adjusting())
    name = next(name for name, image in dock.session.measured if name in dock.session.points)
    image = dock.ui.views[0].image()
    made = dock.session.measured[(name, image)]
    dock.session.set_measurement(name, image, Measured(made.sample + 3.0, made.line))
    dock._on_edit()
    assert np.isnan(dock.session.measurement(name, image).residual_px[0])
    wait_for(lambda: dock.session.is_adjusted and not dock.is_adjusting())
    assert dock.session.measurement(name, image).residual_px[0] > 1.0
    assert dock.session.changed


def test_opened_result_shows_residuals_and_predicts_with_refined_cameras(dock, sources, tmp_path: Path) -> None:
    """The block.gpkg of a finished run: residuals stand there, circles lie on the targets, the model stays."""
    run("adjust", **sources, model="shift-drift", output_dir=str(tmp_path / "result"), write="none")
    path = tmp_path / "result" / "block.gpkg"
    stamp = path.stat().st_mtime_ns
    dock.open(str(path))
    wait_for(lambda: not dock.is_adjusting())
    assert dock.ui.model.currentText() == "shift-drift"
    assert dock.session.is_adjusted and not dock.session.changed
    assert path.stat().st_mtime_ns == stamp  # looking at a result does not change it
    off = [
        np.hypot(*(np.array([row.measured.sample, row.measured.line]) - row.predicted))
        for name in dock.session.points
        for row in dock.session.measurements(name)
        if row.measured
    ]
    assert max(off) < 3.0
    assert all(np.isfinite(row.residual_m).all() for row in dock.points_model.rows if row.images)


# ---- nothing that is measured is lost


def measure_one(panel: PointsDock) -> tuple[str, str]:
    """Move one measurement, as a click does; return which."""
    key = next(key for key in panel.session.measured if key[0] in panel.session.points)
    panel.session.set_measurement(*key, Measured(123.25, 45.5, 0.2, "center", 0.9))
    panel.refresh()
    return key


def test_new_project_keeps_unsaved_measurements(dock) -> None:
    key = measure_one(dock)
    QgsProject.instance().clear()
    assert dock.session.measured[key].sample == 123.25
    assert "not saved yet" in dock.ui.message.text()


@pytest.mark.parametrize("choice", ["Save", "Discard", "Cancel"])
def test_other_project_asks_first(dock, sources, tmp_path: Path, choice: str) -> None:
    """A project that names another block: saved, given up by a clear answer, or kept."""
    other = files.new_session(**sources)
    files.save(other, str(tmp_path / "other.gpkg"))
    dock.save_as(str(tmp_path / "mine.gpkg"))
    wait_for(lambda: not dock.is_adjusting())
    project = QgsProject.instance()
    project.writeEntry("hrsi", "/points/path", str(tmp_path / "other.gpkg"))
    project.write(str(tmp_path / "other.qgs"))
    key = measure_one(dock)
    asked = answer(getattr(QMessageBox.StandardButton, choice))
    assert project.read(str(tmp_path / "other.qgs"))
    assert len(asked) == 1 and "Save the measurements" in asked[0]
    wait_for(lambda: not dock.is_adjusting())
    expected = "mine.gpkg" if choice == "Cancel" else "other.gpkg"
    assert Path(dock.session.path).name == expected
    assert dock.session.changed == (choice == "Cancel")
    saved = files.open_block(str(tmp_path / "mine.gpkg")).measured[key].sample
    assert (saved == 123.25) == (choice == "Save")


@pytest.mark.parametrize(("choice", "may"), [("Discard", True), ("Cancel", False)])
def test_closing_qgis_asks_first(dock, choice: str, may: bool) -> None:
    guard = ExitGuard(dock)
    assert guard.allowExit()  # nothing is unsaved
    measure_one(dock)
    asked = answer(getattr(QMessageBox.StandardButton, choice))
    assert guard.allowExit() is may
    assert len(asked) == 1
    assert bool(list(Path(dock.unsaved_root).glob("*/*.jsonl"))) is not may


KILLED = """
import sys
from qgis.core import QgsApplication
app = QgsApplication([], True); app.initQgis()
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.processing_algorithms.point_session import files
from hrsi.processing_algorithms.point_session.rows import Measured
root, ground, points, *images = sys.argv[1:]
panel = PointsDock(None, None, root)
panel.show_session(files.new_session(images, ground, points))
key = next(key for key in panel.session.measured if key[0] in panel.session.points)
panel.session.set_measurement(*key, Measured(123.25, 45.5, 0.2, "center", 0.9))
print("measured", *key, flush=True)
sys.stdin.read()
"""


def test_killed_program_loses_nothing(dock, sources, tmp_path: Path) -> None:
    """QGIS is killed with a measurement that no file holds; the next start offers it, one click brings it back."""
    root = str(tmp_path / "unsaved")
    given = [root, sources["gcps"], sources["image_points"], *sources["images"]]
    environment = os.environ | {"QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-c", KILLED, *given]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, env=environment, cwd=ROOT, **pipes)
    words: list[str] = []
    while not words or words[0] != "measured":
        line = process.stdout.readline()
        assert line, "the other program has not measured"
        words = line.split()
    assert dock.find_unsaved() == []  # it lives
    process.send_signal(signal.SIGKILL)
    process.wait()
    bar = QgsMessageBar()
    offer_unsaved(dock, bar)
    item = bar.currentItem()
    assert item.level() == Qgis.MessageLevel.Warning and "were not saved" in item.text()
    buttons = {button.text(): button for button in item.findChildren(QPushButton)}
    QTest.mouseClick(buttons["Recover"], Qt.MouseButton.LeftButton)
    assert dock.session.measured[(words[1], words[2])] == Measured(123.25, 45.5, 0.2, "center", 0.9)
    assert dock.session.changed
    assert dock.find_unsaved() == []  # this program keeps it now
    wait_for(lambda: not dock.is_adjusting())
    dock.save_as(str(tmp_path / "block.gpkg"))
    assert list(Path(root).glob("*/*.jsonl")) == []


def test_many_images_and_points_answer_at_once(dock, simulated: Path) -> None:
    """50 images x 500 points: from a click to redrawn markers and tables in less than 0.2 s."""
    image = next(iter(dock.session.images.values()))
    images = [Image(f"copy_{k}", image.rpc, image.size, image.path, image.raster) for k in range(50)]
    rng = np.random.default_rng(7)
    xy = rng.uniform(60.0, 340.0, (500, 2))
    ground, _ = image.rpc.localize(xy, np.full(500, image.middle_height_m))
    points = [KnownPoint(f"P{k}", *place) for k, place in enumerate(ground.tolist())]
    measured = {(f"P{k}", one.id): Measured(*place) for k, place in enumerate(xy.tolist()) for one in images}
    dock.ui.number.setCurrentText("4")
    dock.ui.kind.setCurrentText("point")
    dock.show_session(PointSession(images, points, measured))
    dock.choose("P7")
    QgsApplication.processEvents()
    view = dock.ui.views[0]
    wait_for(lambda: not view.canvas.isDrawing())
    took = []
    for step in range(5):
        start = time.process_time()
        click_on(view.canvas, (xy[7, 0] + step, -xy[7, 1]))
        QgsApplication.processEvents()
        took.append(time.process_time() - start)
        assert dock.session.measured[("P7", view.image())].sample == pytest.approx(xy[7, 0] + step, abs=0.6)
    middle = sorted(took)[len(took) // 2]
    print(f"a click with 50 images x 500 points: {middle:.3f} s CPU to the redrawn panel (middle of {len(took)})")
    assert middle < 0.2
    dock.session.mark_saved("")
