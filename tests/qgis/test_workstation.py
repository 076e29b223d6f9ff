"""Working in the panel as a person does: keys, undo, the map, live residuals; and nothing measured is lost."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond
from qgis.core import (
    Qgis,
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsSettings,
    QgsVectorLayer,
)
from qgis.gui import QgsMapCanvas, QgsMessageBar
from qgis.PyQt.QtCore import QPoint, Qt, QTimer
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QApplication, QDialogButtonBox, QMessageBox, QPushButton

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.plugin.points_panel.block_files import LIBRARY_SETTING
from hrsi.plugin.points_panel.dialogs import NewBlockDialog, NewPointDialog
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.plugin.points_panel.guards import ExitGuard, RecoveryOffer
from hrsi.plugin.points_panel.image_view import marker_label
from hrsi.processing_algorithms import point_session, run
from hrsi.processing_algorithms.point_session import PointSession, files
from hrsi.processing_algorithms.point_session.rows import ImageMeasurement, SurveyPoint
from hrsi.tests.qgis.panels import click_on, close, is_at_rest, wait_for

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
    panel.discard_edits()
    close(panel)


def press(panel: PointsDock, keys: Qt.Key, modifier: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
    """Press a key while the panel's list has the focus."""
    panel.ui.points.setFocus()
    QTest.keyClick(panel.ui.points, keys, modifier)
    QgsApplication.processEvents()


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
    image = dock.ui.grid.views[0].image()
    dock.ui.kind.setCurrentText("point")
    press(dock, Qt.Key.Key_A)
    measured = dock.session.measured[(names[0], image)]
    assert (measured.sample, measured.line) == pytest.approx(dock.session.predict_place(names[0], image))
    press(dock, Qt.Key.Key_Delete)
    assert (names[0], image) not in dock.session.measured


def test_keys_undo_and_redo(dock) -> None:
    before = dict(dock.session.measured)
    dock.choose(NAME)
    dock.ui.grid.activate(dock.ui.grid.views[0])
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


def test_new_block_by_the_dialog(dock, sources) -> None:
    """*New…*, files and points filled in, *OK*: the block is there, with everything that was measured."""
    dock.show_session(PointSession())

    def fill_in() -> None:
        dialog = QApplication.activeModalWidget()
        if not isinstance(dialog, NewBlockDialog):
            QTimer.singleShot(20, fill_in)
            return
        dialog.images.setFilePath(" ".join(f'"{path}"' for path in sources["images"]))
        dialog.gcps.box.setEditText(sources["gcps"])
        dialog.image_points.box.setEditText(sources["image_points"])
        ok = dialog.findChild(QDialogButtonBox).button(QDialogButtonBox.StandardButton.Ok)
        QTest.mouseClick(ok, Qt.MouseButton.LeftButton)

    QTimer.singleShot(20, fill_in)
    dock.ui.new.trigger()
    assert list(dock.session.images) == ["image_1", "image_2", "image_3"]
    assert NAME in dock.session.points and any(name == NAME for name, _ in dock.session.measured)
    wait_for(lambda: not dock.adjustment.is_running())


def test_a_new_block_of_layers(dock, sources: dict) -> None:
    """*New…* offers the rasters and points of the project; a raster chosen twice is one image."""
    project = QgsProject.instance()
    for path in sources["images"]:
        project.addMapLayer(QgsRasterLayer(path, Path(path).stem))
    gcps = QgsVectorLayer(sources["gcps"], "my GCPs", "ogr")
    project.addMapLayer(gcps)
    dialog = NewBlockDialog(dock)
    actions = {action.text(): action for action in dialog.layers.menu().actions()}
    assert sorted(actions) == ["All", "image_1", "image_2", "image_3"]
    actions["image_2"].trigger()
    assert dialog.sources()["images"] == [sources["images"][1]]
    actions["All"].trigger()
    assert sorted(dialog.sources()["images"]) == sorted(sources["images"])
    dialog.gcps.set_value(gcps.id())
    session = point_session.new_session(**dialog.sources())
    assert sorted(session.images) == ["image_1", "image_2", "image_3"]
    assert set(session.points) == set(dock.session.points)
    project.clear()
    assert not NewBlockDialog(dock).layers.isEnabled()


def test_a_new_block_whose_fields_have_other_names(dock, sources: dict, tmp_path: Path) -> None:
    """The fields of the layer or file are offered; what is chosen is read."""
    table = Path(sources["gcps"]).read_text(encoding="utf-8")
    assert table.startswith("id,")
    (tmp_path / "survey.csv").write_text(table.replace("id,", "Punkt,", 1), encoding="utf-8")
    dialog = NewBlockDialog(dock)
    box = dialog.fields["id"]
    assert box.count() == 0
    dialog.images.setFilePath(" ".join(f'"{path}"' for path in sources["images"]))
    opened, list_names = [], dialog.gcps.field_names
    dialog.gcps.field_names = lambda: opened.append(dialog.gcps.value()) or list_names()
    dialog.gcps.box.setEditText(str(tmp_path / "survey.cs"))
    QTest.keyClicks(dialog.gcps.box.lineEdit(), "v ")
    wait_for(lambda: box.count() > 1)
    assert opened == [str(tmp_path / "survey.csv")], "the layer is opened at each letter"
    assert [box.itemText(k) for k in range(4)] == [
        "",
        *table.partition("\n")[0].replace("id,", "Punkt,", 1).split(",")[:3],
    ]
    with pytest.raises(InputError, match=r"has no field 'id'; its fields are Punkt"):
        point_session.new_session(**dialog.sources())
    box.setCurrentText("Punkt")
    assert dialog.sources()["gcps"] == f"{tmp_path / 'survey.csv'}|columns=id=Punkt"
    session = point_session.new_session(**dialog.sources())
    assert set(session.points) == set(dock.session.points)
    dialog.gcps.box.setEditText("")
    assert dialog.sources()["gcps"] == "" and box.currentText() == ""


def test_views_are_as_many_as_wanted(dock) -> None:
    """Each shows another image; there are no views without an image."""
    dock.choose(NAME)
    for number in (4, 1, 3):
        dock.ui.number.setCurrentText(str(number))
        shown = [view.image() for view in dock.ui.grid.list_views()]
        assert len(set(shown)) == len(shown) == min(number, 3) and "" not in shown


def test_whole_image_and_back(dock) -> None:
    dock.choose(NAME)
    view = dock.ui.grid.views[0]
    QTest.mouseClick(view.whole, Qt.MouseButton.LeftButton)
    assert min(view.canvas.extent().width(), view.canvas.extent().height()) >= 399.0
    dock.choose(next(name for name in dock.session.points if name != NAME))
    dock.choose(NAME)
    sample, line = dock.session.measured[(NAME, view.image())].sample, dock.session.measured[(NAME, view.image())].line
    assert view.canvas.mapUnitsPerPixel() * min(view.canvas.width(), view.canvas.height()) < 130.0
    assert view.canvas.extent().center().x() == pytest.approx(sample, abs=0.01)
    assert view.canvas.extent().center().y() == pytest.approx(-line, abs=0.01)


#: Actions that go to another point, place or block; the others leave all views as they are.
NAVIGATION = {"New…", "Open…", "Add points…", "Remove", "Previous", "Next", "Transfer", "Accept all"}
ASKING = {"Save as…", "Chip library…"}  # actions with a dialog of files, which are called with a path below


def places_under_pixels(dock) -> list[object]:
    """Return for each view its image, its place and size on the screen, and the image positions under two pixels."""
    seen = []
    for view in dock.ui.grid.list_views():
        canvas, corner = view.canvas, view.canvas.mapTo(dock.ui, QPoint(0, 0))
        to_image = canvas.getCoordinateTransform().toMapCoordinates
        places = [to_image(*pixel) for pixel in ((20, 30), (110, 90))]
        seen.append((view.image(), corner.x(), corner.y(), canvas.width(), canvas.height(),
                     *(round(part, 6) for place in places for part in (place.x(), place.y()))))  # fmt: skip
    return seen


@pytest.mark.parametrize("number", ["2", "3"])
def test_nothing_moves_under_the_pointer(dock, number: str, tmp_path: Path) -> None:
    """What lies under a pixel of the screen stays there through every action that goes nowhere, such as a click."""
    dock.session.measured.clear()  # the first click brings the first chip, proposals and a verdict
    dock.ui.number.setCurrentText(number)
    dock.ui.kind.setCurrentText("point")
    dock.choose(NAME)
    first, second = (view.image() for view in dock.ui.grid.list_views()[:2])
    roles, sigmas = (dock.points_model.titles.index(title) for title in ("role", "sigma h m"))
    row = dock.points_model.row_of(NAME)
    steps = {
        "click": lambda: dock.measure(first, *dock.session.predict_place(NAME, first)),
        "other click": lambda: dock.measure(second, *dock.session.predict_place(NAME, second)),
        "refused": lambda: (dock.ui.kind.setCurrentText("corner"), dock.measure(first, 1e5, 1e5)),
        "role": lambda: dock.points_model.setData(dock.points_model.index(row, roles), "check"),
        "sigma": lambda: dock.points_model.setData(dock.points_model.index(row, sigmas), "0.5"),
        "long text": lambda: dock.tell("a long reason of a doubtful verdict " * 40),
        "progress": lambda: dock.ui.show_progress(50.0),
        "save as": lambda: dock.files.save_as(str(tmp_path / "block")),
        "library": lambda: dock.files.choose_library(str(tmp_path / "chips.gpkg")),
    }
    steps |= {f"tab {tab}": lambda tab=tab: dock.ui.tabs.setCurrentIndex(tab) for tab in (1, 2, 0)}
    actions = [one for bar in (dock.ui.bar, dock.ui.second_bar) for one in bar.actions() if one.text()]
    steps |= {one.text(): one.trigger for one in actions if one.text() not in NAVIGATION | ASKING | {"North up"}}
    steps |= {"again adjusted": dock.adjust, "undo": dock.undo, "undo more": dock.undo, "redo": lambda: dock.undo(True)}
    QgsApplication.processEvents()
    wait_for(lambda: is_at_rest(dock))
    before = places_under_pixels(dock)
    for name, act in steps.items():
        act()
        wait_for(lambda: is_at_rest(dock))
        assert places_under_pixels(dock) == before, name
    assert len(steps) > 25 and Path(dock.session.path).name == "block.gpkg"
    dock.ui.kind.setCurrentText("point")
    dock.ui.tie.setChecked(True)
    view = dock.ui.grid.find_view(second)
    click_on(view.canvas, (view.canvas.extent().center().x() + 5.0, view.canvas.extent().center().y()))
    wait_for(lambda: is_at_rest(dock))
    assert dock.session.points[dock.point()].role == "tie"
    assert places_under_pixels(dock)[1] == before[1]  # where the tie point was clicked
    middles = [view.canvas.extent().center() for view in dock.ui.grid.list_views()]
    dock.ui.north.trigger()
    assert all(
        (view.canvas.extent().center().x(), view.canvas.extent().center().y())
        == pytest.approx((at.x(), at.y()), abs=1e-6)
        for view, at in zip(dock.ui.grid.list_views(), middles, strict=True)
    )
    QgsSettings().remove(LIBRARY_SETTING)


@pytest.mark.parametrize("number", range(1, 10))
def test_views_fill_the_space(dock, number: int) -> None:
    """One to nine views have equal heights, equal widths in a row, and leave no cell empty."""
    (first, *_), points = dock.session.images.values(), dock.session.points.values()
    dock.show_session(PointSession([replace(first, id=f"copy_{k}") for k in range(9)], list(points)))
    dock.ui.number.setCurrentText(str(number))
    for _ in range(3):
        QgsApplication.processEvents()
    views, grid = dock.ui.grid.list_views(), dock.ui.grid
    assert len(views) == number
    assert sum(view.width() * view.height() for view in views) > 0.95 * grid.width() * grid.height() - 8e3 * number
    assert max(view.height() for view in views) - min(view.height() for view in views) <= 2
    rows: dict[int, list[int]] = {}
    for view in views:
        rows.setdefault(view.y(), []).append(view.width())
    assert all(max(widths) - min(widths) <= 2 for widths in rows.values()), rows


def test_fits_disappear_with_their_measurements(dock) -> None:
    """The chip of a fit goes when the measurement is undone, deleted or replaced."""
    dock.session.measured.clear()
    dock.ui.kind.setCurrentText("point")
    dock.choose(NAME)
    view = dock.ui.grid.list_views()[0]
    for take_back in (dock.undo, dock.forget_measurement):
        dock.measure(view.image(), *dock.session.predict_place(NAME, view.image()))
        assert view.chip.isVisible()
        take_back()
        assert not view.chip.isVisible()


def test_one_gcp_is_no_check(dock) -> None:
    """With one GCP the verdict is not ok, in the message and in the tab; with all points it is one of the three."""
    everything = dict(dock.session.measured)
    for key in list(dock.session.measured):
        if key[0] != NAME:
            del dock.session.measured[key]
    page = dock.ui.tabs.indexOf(dock.ui.verdict)
    for measured, expected in ((dict(dock.session.measured), True), (everything, False)):
        dock.session.restore(dock.session.points, measured)
        dock.adjust()
        wait_for(lambda: dock.session.is_adjusted and is_at_rest(dock))
        text = "1 GCP: no check possible"
        assert (text in dock.ui.message.text()) is expected
        assert (dock.ui.verdict.item(0).text() == text) is expected
        assert dock.ui.tabs.tabText(page) != "Verdict: ok" or not expected
    dock.session.note_save("")


def test_role_off_takes_a_point_out(dock) -> None:
    """Its residuals tell nothing, its marker fades, it is passed over."""
    model = dock.points_model
    row = model.row_of(NAME)
    assert model.setData(model.index(row, model.titles.index("role")), "off")
    assert dock.session.points[NAME].role == "off"
    shown = {marker.name: marker for view in dock.ui.grid.list_views() for marker in view.markers.markers}
    assert shown[NAME].is_off
    dock.adjust()
    wait_for(lambda: not dock.adjustment.is_running())
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
    for view in dock.ui.grid.list_views():
        middle = view.canvas.extent().center()
        sample, line = dock.session.predict_place(NAME, view.image())
        assert abs(middle.x() - sample) < 40.0 and abs(-middle.y() - line) < 40.0  # the middle height, not the point's
    dock.ui.go_to.trigger()
    assert canvas.mapTool() is None or type(canvas.mapTool()).__name__ != "QgsMapToolEmitPoint"


def test_residuals_are_live(dock) -> None:
    """With "Live" a click is followed by its residuals before anything else happens; the tests of all come later."""
    assert dock.ui.live.isChecked()
    dock.refresh()
    dock.adjust(is_asked=False)
    wait_for(lambda: dock.session.is_adjusted and not dock.adjustment.is_running())
    dock.ui.kind.setCurrentText("point")
    dock.choose(NAME)
    view = dock.ui.grid.views[0]
    made = dock.session.measured[(NAME, view.image())]
    click_on(view.canvas, (made.sample + 3.0, -made.line))
    shown = dock.session.measurement(NAME, view.image()).residual_px
    assert not dock.session.is_adjusted and shown[0] > 1.0
    assert f"{shown[0]:+.2f}" in marker_label(next(one for one in view.markers.markers if one.name == NAME))
    wait_for(lambda: dock.session.is_adjusted and not dock.adjustment.is_running())
    assert dock.session.measurement(NAME, view.image()).residual_px[0] > 1.0
    assert dock.session.changed


def test_opened_result_shows_residuals_and_predicts_with_refined_cameras(dock, sources, tmp_path: Path) -> None:
    """The block.gpkg of a finished run: residuals stand there, circles lie on the targets, the model stays."""
    run("adjust", **sources, model="shift-drift", output_dir=str(tmp_path / "result"), write="none")
    path = tmp_path / "result" / "block.gpkg"
    stamp = path.stat().st_mtime_ns
    dock.files.open(str(path))
    wait_for(lambda: not dock.adjustment.is_running())
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
    panel.session.set_measurement(*key, ImageMeasurement(123.25, 45.5, 0.2, "center", 0.9))
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
    dock.files.save_as(str(tmp_path / "mine.gpkg"))
    wait_for(lambda: not dock.adjustment.is_running())
    project = QgsProject.instance()
    project.writeEntry("hrsi", "/points/path", str(tmp_path / "other.gpkg"))
    project.write(str(tmp_path / "other.qgs"))
    key = measure_one(dock)
    asked = answer(getattr(QMessageBox.StandardButton, choice))
    assert project.read(str(tmp_path / "other.qgs"))
    assert len(asked) == 1 and "Save the measurements" in asked[0]
    wait_for(lambda: not dock.adjustment.is_running())
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
from hrsi.processing_algorithms.point_session.rows import ImageMeasurement
root, ground, points, *images = sys.argv[1:]
panel = PointsDock(None, None, root)
panel.show_session(files.new_session(images, ground, points))
key = next(key for key in panel.session.measured if key[0] in panel.session.points)
panel.session.set_measurement(*key, ImageMeasurement(123.25, 45.5, 0.2, "center", 0.9))
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
    assert dock.files.find_journals() == []  # it lives
    process.send_signal(signal.SIGKILL)
    process.wait()
    bar = QgsMessageBar()
    offer = RecoveryOffer(dock, bar)
    offer.show()
    item = bar.currentItem()
    assert item.level() == Qgis.MessageLevel.Warning and "were not saved" in item.text()
    buttons = {button.text(): button for button in item.findChildren(QPushButton)}
    QTest.mouseClick(buttons["Recover"], Qt.MouseButton.LeftButton)
    assert dock.session.measured[(words[1], words[2])] == ImageMeasurement(123.25, 45.5, 0.2, "center", 0.9)
    assert dock.session.changed
    assert dock.files.find_journals() == []  # this program keeps it now
    wait_for(lambda: not dock.adjustment.is_running())
    dock.files.save_as(str(tmp_path / "block.gpkg"))
    assert list(Path(root).glob("*/*.jsonl")) == []


@pytest.fixture
def large(simulated: Path) -> PointSession:
    """50 images, each from a direction of its own, and 500 points measured on all of them; 8 are control."""
    base = files.new_session([str(simulated / "image_2.tif")]).images["image_2"]
    rng = np.random.default_rng(7)
    images = []
    for k in range(50):
        sample, line = base.rpc.samp_num.copy(), base.rpc.line_num.copy()
        sample[3] += rng.normal(0.0, 3e-3)  # the term of the height: a view from another side
        line[3] += rng.normal(0.0, 3e-3)
        rpc = replace(base.rpc, samp_num=sample, line_num=line)
        images.append(Image(f"copy_{k}", rpc, base.size, base.path, base.raster))
    xy = rng.uniform(60.0, 340.0, (500, 2))
    ground, _ = base.rpc.localize(xy, base.middle_height_m + rng.uniform(-30.0, 30.0, 500))
    points = [SurveyPoint(f"P{k}", *place, "gcp" if k < 8 else "check") for k, place in enumerate(ground.tolist())]
    measured = {}
    for image in images:
        seen = image.rpc.project(ground) + rng.normal(0.0, 3.0, 2) + rng.normal(0.0, 0.2, (500, 2))
        measured |= {(f"P{k}", image.id): ImageMeasurement(*place) for k, place in enumerate(seen.tolist())}
    return PointSession(images, points, measured)


@pytest.mark.parametrize("live", mark_beyond(1, "large", [False, True]))
def test_many_images_and_points_answer_at_once(dock, large: PointSession, live: bool) -> None:
    """50 images x 500 points: from a click to redrawn markers and tables, with live residuals too, in 0.2 s."""
    dock.ui.number.setCurrentText("4")
    dock.ui.kind.setCurrentText("point")
    dock.show_session(large)
    if live:
        dock.session.accept(point_session.adjust_block(point_session.block_of(large), "shift"))
        dock.adjustment.duration_s = 60.0  # as if it had taken long: the tests of all points wait for "Adjust"
        dock.ui.live.setChecked(True)
    dock.choose("P7")
    QgsApplication.processEvents()
    view = dock.ui.grid.views[0]
    wait_for(lambda: not view.canvas.isDrawing())
    key = ("P7", view.image())
    place = large.measured[key]
    took = []
    for step in range(5):
        start = time.process_time()
        click_on(view.canvas, (place.sample + step, -place.line))
        QgsApplication.processEvents()
        took.append(time.process_time() - start)
        assert large.measured[key].sample == pytest.approx(place.sample + step, abs=0.6)
        if live:
            assert large.measurement(*key).residual_px[0] == pytest.approx(step, abs=1.0 + 0.1 * step)
    assert min(took) < 0.4  # 0.2 s is the aim; a machine whose processors others use takes twice the CPU seconds
    large.note_save("")


# ---- tie points by hand


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images with texture, and points that are where the files say."""
    folder = tmp_path_factory.mktemp("ties") / "block"
    run("simulate", output_dir=str(folder), images=3, along="-12,0,12", size=400, gcps=6, checks=0, ties=12, seed=23,
        noise_image=0.0)  # fmt: skip
    return folder


def test_tie_points_are_clicked_once_and_found_in_the_other_images(dock, rendered: Path) -> None:
    """T and a click: the other views go where matching finds the point; Y takes it, X refuses it; undo takes back."""
    images = [str(rendered / f"image_{number}.tif") for number in (1, 2, 3)]
    dock.show_session(
        files.new_session(images, str(rendered / "ground_points.csv"), str(rendered / "image_points.csv"))
    )
    rows = dock.session.ties
    truth = {
        (name, image): tuple(xy) for name, image, xy in zip(rows.ids, rows.image_ids, rows.xy.tolist(), strict=True)
    }
    dock.ui.number.setCurrentText("3")
    dock.ui.kind.setCurrentText("point")
    dock.choose(next(iter(dock.session.points)))
    views = {view.image(): view for view in dock.ui.grid.list_views()}
    off = []
    for number, name in enumerate([name for name in dict.fromkeys(rows.ids.tolist())][:6]):
        if any((name, image) not in truth for image in views):
            continue
        sample, line = truth[(name, "image_2")]
        views["image_2"].show_place((sample, line))
        press(dock, Qt.Key.Key_T)
        click_on(views["image_2"].canvas, (sample, -line))
        tie = dock.point()
        assert dock.session.points[tie].role == "tie" and not dock.ui.tie.isChecked()
        assert abs(dock.session.measured[(tie, "image_2")].sample - sample) < 0.6  # a pixel of the screen
        wait_for(lambda: not dock.search.is_running())
        if len(dock.search.proposals) < 2:
            continue
        proposed = dict(dock.search.proposals)
        for image, one in proposed.items():
            assert views[image].is_in_view(one.xy)
            assert any(marker.proposed for marker in views[image].markers.markers)
        if number % 2 == 0:
            press(dock, Qt.Key.Key_Y, Qt.KeyboardModifier.ShiftModifier)
        else:
            first = dock.ui.grid.activate_proposal()
            press(dock, Qt.Key.Key_X)
            assert first not in dock.search.proposals and (tie, first) not in dock.session.measured
            press(dock, Qt.Key.Key_Y)
            del proposed[first]
        clicked = dock.session.measured[(tie, "image_2")]
        for image in proposed:
            made = dock.session.measured[(tie, image)]
            wanted = np.array(truth[(name, image)]) + (clicked.sample - sample, clicked.line - line)
            off.append(float(np.hypot(made.sample - wanted[0], made.line - wanted[1])))
            assert made.kind == "transfer"
    assert len(off) >= 5 and max(off) < 0.5
    known = dict(dock.session.measured)
    press(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert len(dock.session.measured) < len(known)
    press(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    assert dock.session.measured == known
    dock.session.note_save("")
