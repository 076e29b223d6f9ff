"""The plugin on Qt 6: every module is imported, its widgets are made, clicked, typed into and drawn.

Run by ``tests/test_qt6.py`` where PyQt6 is (``make qt6`` brings it), in a process of its own: QGIS is on Qt 5 here, and
one process takes one Qt. Stand-ins take the place of QGIS (`stand_ins`).
"""

import importlib
import os
import sys
import time
from pathlib import Path

import pytest

os.environ |= {"QT_QPA_PLATFORM": "offscreen", "OPENBLAS_NUM_THREADS": "1"}

from PyQt6.QtCore import QPoint, Qt
from PyQt6.QtTest import QTest
from PyQt6.QtWidgets import QApplication, QComboBox, QDialogButtonBox, QMessageBox, QPushButton, QToolButton

from hrsi.tests.qt6 import stand_ins

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in (ROOT / "plugin").rglob("*.py")
)
HOBART = ROOT / "examples" / "hobart"


@pytest.fixture(scope="session", autouse=True)
def application(tmp_path_factory: pytest.TempPathFactory):
    stand_ins.install(str(tmp_path_factory.mktemp("profile")))
    application = QApplication(sys.argv[:1])
    application.raised = []
    sys.excepthook = lambda *raised: application.raised.append(raised)  # PyQt6 ends the process with those of slots
    return application


@pytest.fixture(autouse=True)
def no_slot_fails(application):
    application.raised.clear()
    yield
    assert application.raised == []


@pytest.fixture
def dock(application, tmp_path: Path):
    from hrsi.plugin.points_panel.dock import PointsDock

    panel = PointsDock(None, None, str(tmp_path / "unsaved"))
    panel.resize(1300, 700)
    panel.show()
    application.setActiveWindow(panel)
    yield panel
    panel.discard_edits()
    panel.shut_down()


@pytest.fixture
def hobart(dock):
    from hrsi.processing_algorithms import point_session

    dock.show_session(
        point_session.new_session(
            [str(HOBART / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)],
            str(HOBART / "hobart_ground_points.csv"), str(HOBART / "hobart_image_points.csv"),
            height_datum="ellipsoidal",
        )
    )  # fmt: skip
    return dock


def press(button) -> None:
    QTest.mouseClick(button, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(8, button.height() // 2))


def key(panel, keys: Qt.Key, modifier: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
    panel.ui.points.setFocus()
    QTest.keyClick(panel.ui.points, keys, modifier)
    QApplication.processEvents()


def wait_for(condition) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        QApplication.processEvents()


@pytest.mark.parametrize("name", MODULES)
def test_modules_are_imported(name: str) -> None:
    importlib.import_module(f"hrsi.{name}")


def test_no_other_qt_is_there() -> None:
    assert not [name for name in sys.modules if name.startswith("PyQt5")]


def test_keys_undo_roles_and_residuals_of_the_panel(hobart) -> None:
    dock, session = hobart, hobart.session
    assert dock.points_model.rowCount() == len(session.points) > 50
    first = dock.point()
    name, image = next(found for found in session.measured if found[0] == first)
    before = dict(session.measured)
    dock.frame_image(image)
    key(dock, Qt.Key.Key_Delete)
    assert (name, image) not in session.measured and dock.windowTitle().endswith("*")
    key(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert session.measured == before
    key(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    assert (name, image) not in session.measured
    key(dock, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    dock.ui.model.setCurrentText("shift")
    press(dock.ui.bar.widgetForAction(dock.ui.adjust))
    wait_for(lambda: session.is_adjusted)
    column = dock.points_model.titles.index("dE m")
    assert float(dock.points_model.index(0, column).data())
    dock.ui.number.setCurrentText("4")
    assert len(dock.ui.list_views()) == 4
    assert not dock.grab().isNull()


def test_cells_are_edited_with_their_choices(hobart) -> None:
    """A double click opens the list of roles; what is chosen there is in the session, and drawn."""
    dock = hobart
    index = dock.points_model.index(0, dock.points_model.titles.index("role"))
    dock.ui.points.edit(index)
    box = dock.ui.points.viewport().findChild(QComboBox)
    box.setCurrentText("off")
    QTest.keyClick(box, Qt.Key.Key_Tab)
    assert dock.session.points[dock.points_model.rows[0].point.id].role == "off"
    sigma = dock.points_model.index(0, dock.points_model.titles.index("sigma xy m"))
    assert not dock.points_model.setData(sigma, "a lot")
    assert "a lot" in dock.ui.message.text()


def test_tour_by_its_buttons_and_a_click_on_the_image(dock, tmp_path: Path) -> None:
    """Images with pixels: a click is measured, its chip and the markers are drawn, the block is adjusted in a task."""
    from hrsi.plugin.first_steps import FirstSteps
    from hrsi.plugin.points_panel.image_view import render_chip

    tour = FirstSteps(dock, str(tmp_path / "example"))
    tour.show()
    press(tour.buttons[0])
    wait_for(lambda: tour.step() == 1)
    press(tour.buttons[1])
    view = dock._active
    middle = QPoint(view.canvas.viewport().width() // 2, view.canvas.viewport().height() // 2)
    QTest.mouseClick(view.canvas.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, middle)
    if tour.missing not in dock.session.measured:  # the RPC is off by pixels: the place itself
        dock.ui.kind.setCurrentText("point")
        QTest.mouseClick(view.canvas.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, middle)
    assert tour.missing in dock.session.measured
    press(tour.buttons[2])
    wait_for(lambda: tour.step() == 3)
    assert not dock.grab().isNull() and not tour.grab().isNull()
    fit = dock.session.fit(view.image(), dock.session.predict_place(*tour.missing), "center")
    assert render_chip(fit.chip_svg).width() == 96
    for marker in view.markers.markers:  # every way to draw one
        view.markers.show_markers([marker])
        assert not view.canvas.grab().isNull()


def test_proposed_markers_are_drawn(dock) -> None:
    from hrsi.plugin.points_panel.image_view import PROPOSED, Marker

    view = dock.ui.views[0]
    view.markers.show_markers([Marker("T1", (0.0, 0.0), (1.0, 1.0), (2.0, -1.0), True, proposed=(3.0, -4.0))])
    view.canvas.resize(200, 200)
    view.canvas.setSceneRect(0.0, 0.0, 200.0, 200.0)
    drawn = view.canvas.grab().toImage()
    colours = {drawn.pixelColor(x, y).name() for x in range(drawn.width()) for y in range(drawn.height())}
    assert PROPOSED.name() in colours


def test_dialogs_and_fields(application) -> None:
    from unittest.mock import MagicMock

    from hrsi.plugin.dialog_fields import ExtentWrapper, ImagesWrapper, WordWrapper
    from hrsi.plugin.points_panel.dialogs import NewBlockDialog, NewPointDialog

    block = NewBlockDialog()
    block.images.setFilePath('"a.tif" "b.tif"')
    block.gcps.box.setEditText("")
    block.show()
    press(block.findChild(QDialogButtonBox).button(QDialogButtonBox.StandardButton.Ok))
    assert block.result() == 1 and block.sources()["images"] == ["a.tif", "b.tif"]
    point = NewPointDialog((147.3, -42.9), "P1", 12.5)
    assert (point.point().id, point.point().height) == ("P1", 12.5)
    definition = MagicMock()
    definition.metadata.return_value = {"words": ["auto", "none"]}
    definition.defaultValue.return_value = "auto"
    word, extent, images = (made(definition) for made in (WordWrapper, ExtentWrapper, ImagesWrapper))
    fields = [wrapper.createWidget() for wrapper in (word, extent, images)]
    assert (word.widgetValue(), extent.widgetValue(), images.widgetValue()) == ("auto", "auto", [])
    assert all(not field.grab().isNull() and field.findChildren((QComboBox, QToolButton)) for field in fields)


def test_unsaved_measurements_are_asked_for(hobart, monkeypatch) -> None:
    dock = hobart
    dock.session.remove_measurement(*next(iter(dock.session.measured)))
    buttons = QMessageBox.StandardButton
    for said, may in ((buttons.Cancel, False), (buttons.Discard, True)):
        monkeypatch.setattr(QMessageBox, "question", lambda *_given, said=said: said)
        assert dock.may_leave() is may


def test_texts_are_german_where_qgis_is(application) -> None:
    from hrsi.plugin.first_steps import FirstSteps
    from hrsi.plugin.points_panel.dock import PointsDock
    from hrsi.plugin.translation import install_translator

    translator = install_translator()
    try:
        tour = FirstSteps(PointsDock(None, None, ""), "")
        assert "Beispiel laden" in [button.text() for button in tour.findChildren(QPushButton)]
    finally:
        application.removeTranslator(translator)
