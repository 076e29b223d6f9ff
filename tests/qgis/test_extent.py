"""An extent is one of QGIS's own: from the map, a layer, drawn, typed; and the words of the engine beside it."""

from pathlib import Path

import numpy as np
import pytest
from gdal_files import write_raster
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessingContext,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsReferencedRectangle,
)
from qgis.gui import QgsExtentWidget, QgsMapCanvas, QgsProcessingParameterWidgetContext
from qgis.PyQt import sip
from qgis.PyQt.QtCore import QPoint, Qt, QTimer
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QApplication, QComboBox, QDialog, QMenu, QToolButton

from hrsi.plugin.provider import PluginAlgorithm
from hrsi.tests.qgis.tiny import TINY

BOX = QgsRectangle(147.1, -43.2, 147.5, -42.9)
WGS84 = QgsCoordinateReferenceSystem("EPSG:4326")
TEXT = "147.1,-43.2,147.5,-42.9"


@pytest.fixture
def layer(qgis_new_project, tmp_path: Path) -> QgsRasterLayer:
    """A map of 40 x 30 pixels of 0.01 degrees, in the project."""
    path = write_raster(tmp_path / "map.tif", np.zeros((30, 40)), (147.1, 0.01, 0.0, -42.9, 0.0, -0.01), "EPSG:4326")
    made = QgsRasterLayer(path, "a map")
    QgsProject.instance().addMapLayer(made)
    return made


@pytest.fixture
def field(qgis_processing, layer):
    """The field as a dialog of the toolbox makes it, over a map: wrapper, widget, canvas."""
    from processing.gui.wrappers import WidgetWrapperFactory

    class Dialog(QDialog):
        """Stands for the dialog of an algorithm."""

    algorithm, dialog, canvas = PluginAlgorithm(TINY).create(), Dialog(), QgsMapCanvas()
    canvas.resize(200, 200)
    canvas.setDestinationCrs(WGS84)
    canvas.setExtent(BOX)
    wrapper = WidgetWrapperFactory.create_wrapper(algorithm.parameterDefinition("EXTENT"), dialog)
    context = QgsProcessingParameterWidgetContext()
    context.setProject(QgsProject.instance())
    context.setMapCanvas(canvas)
    wrapper.setWidgetContext(context)
    widget = wrapper.createWrappedWidget(QgsProcessingContext())
    widget.setParent(dialog)
    dialog.resize(500, 60)
    dialog.show()
    yield wrapper, widget, canvas, algorithm
    canvas.stopRendering()
    sip.delete(dialog)  # the field with it, before the map


@pytest.mark.parametrize(
    ("given", "engine"),
    [
        ("union", "union"),
        ("147.1,147.5,-43.2,-42.9 [EPSG:4326]", f"{TEXT} [EPSG:4326]"),  # as QGIS writes boxes
        ("147.1,147.5,-43.2,-42.9", TEXT),  # in the CRS of the result
        (BOX, TEXT),
        (QgsReferencedRectangle(BOX, WGS84), f"{TEXT} [EPSG:4326]"),
        ("nonsense", "nonsense"),  # the engine says what is wrong with it
    ],
)
def test_every_form_reaches_the_engine(run_tiny, given, engine: str) -> None:
    assert run_tiny(EXTENT=given).get("extent", "each") == engine


def test_box_of_a_layer(run_tiny, layer) -> None:
    west, south, east, north = map(float, run_tiny(EXTENT=layer.id())["extent"].partition(" [")[0].split(","))
    assert (west, south, east, north) == pytest.approx((147.1, -43.2, 147.5, -42.9))


def test_words_are_chosen_in_the_list(field) -> None:
    wrapper, widget, _canvas, _algorithm = field
    assert wrapper.parameterValue() == "each"
    words = widget.findChild(QComboBox)
    words.setFocus()
    QTest.keyClick(words, Qt.Key.Key_Down)
    assert wrapper.parameterValue() == "union"


def test_the_map_gives_a_box_by_its_menu(field) -> None:
    """A click on the arrow, one on "Use Current Map Canvas Extent": the box is there, and chosen."""
    wrapper, widget, canvas, algorithm = field
    button = widget.findChild(QgsExtentWidget).findChild(QToolButton)

    def choose() -> None:
        menu = QApplication.activePopupWidget()
        if not isinstance(menu, QMenu):
            QTimer.singleShot(20, choose)
            return
        action = next(one for one in menu.actions() if "Canvas Extent" in one.text())
        QTest.mouseClick(menu, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier,
                         menu.actionGeometry(action).center())  # fmt: skip

    QTimer.singleShot(20, choose)
    QTest.mouseClick(button, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(4, 4))
    text, _, crs = wrapper.parameterValue().partition(" ")
    west, east, south, north = map(float, text.split(","))
    shown = canvas.extent()
    assert (west, south, east, north) == pytest.approx(
        (shown.xMinimum(), shown.yMinimum(), shown.xMaximum(), shown.yMaximum()), abs=1e-4
    )
    assert crs == "[EPSG:4326]"
    assert algorithm.checkParameterValues(
        {"IMAGES": ["a"], "OUTPUT_DIR": "/tmp", "EXTENT": wrapper.parameterValue()}, QgsProcessingContext()
    )[0]


def test_values_of_the_history_come_back(field) -> None:
    wrapper, _widget, _canvas, _algorithm = field
    for value in ("147.1,147.5,-43.2,-42.9 [EPSG:4326]", "union", "524380.0,524600.0,5255600.0,5255800.0 [EPSG:32755]"):
        wrapper.setParameterValue(value, QgsProcessingContext())
        assert wrapper.parameterValue() == value
