"""The tour as a newcomer takes it: by its buttons and clicks on the image; and how it is skipped for ever."""

from pathlib import Path

import pytest
from qgis.core import QgsApplication, QgsProject, QgsSettings
from qgis.gui import QgsMapCanvas
from qgis.PyQt.QtCore import QEvent, Qt
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QPushButton

from hrsi.plugin.first_steps import SKIPPED_FOR_EVER, FirstSteps, is_tour_wanted
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.tests.qgis.panels import click_on, wait_for


@pytest.fixture
def tour(qgis_app, qgis_new_project, tmp_path: Path):
    QgsSettings().remove(SKIPPED_FOR_EVER)
    canvas = QgsMapCanvas()
    canvas.resize(300, 300)
    panel = PointsDock(None, canvas, str(tmp_path / "unsaved"))
    panel.resize(1300, 700)
    made = FirstSteps(panel, str(tmp_path / "example"), canvas)
    made.show()
    yield made
    made.close()
    panel.discard_edits()
    panel.shut_down()
    canvas.stopRendering()
    for widget in (made, panel, canvas):
        widget.deleteLater()
        QgsApplication.sendPostedEvents(widget, QEvent.Type.DeferredDelete)
    QgsSettings().remove(SKIPPED_FOR_EVER)


def press(button: QPushButton) -> None:
    assert button.isEnabled()
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def test_tour_from_nothing_to_arrows(tour: FirstSteps) -> None:
    dock = tour._dock
    assert [button.isEnabled() for button in tour.buttons] == [True, False, False, False]
    assert not tour.isModal()
    press(tour.buttons[0])
    wait_for(lambda: tour.step() == 1)
    assert dock.isVisible() and tour.missing not in dock.session.measured
    press(tour.buttons[1])
    name, image = tour.missing
    view = dock.ui.grid.find_view(dock.ui.grid.active_image())
    assert (dock.point(), view.image()) == (name, image)
    wait_for(lambda: not view.canvas.isDrawing())
    sample, line = dock.session.predict_place(name, image)
    before = dict(dock.session.measured)
    for across, down in ((0, 0), (12, 0), (-12, 0), (0, 12), (0, -12), (24, 0), (-24, 0), (0, 24), (0, -24)):
        click_on(
            view.canvas, (sample + across, -line - down)
        )  # the camera is as wrong as a vendor's: look for the disc
        if tour.step() == 2:
            break
    assert tour.step() == 2 and len(dock.session.measured) == len(before) + 1
    press(tour.buttons[2])
    wait_for(lambda: tour.step() == 3 and not dock.adjustment.is_running())
    assert "check" in dock.ui.message.text()
    press(tour.buttons[3])
    layers = {layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}
    assert {"images", "residuals_utm"} <= set(layers)
    assert layers["residuals_utm"].featureCount() > 0 and not dock.session.changed


def test_one_click_skips_it_for_ever(tour: FirstSteps) -> None:
    assert is_tour_wanted()
    press(tour.later)
    assert is_tour_wanted() and not tour.isVisible()
    tour.show()
    press(tour.skip)
    assert not is_tour_wanted() and not tour.isVisible()
