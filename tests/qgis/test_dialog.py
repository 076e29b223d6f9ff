"""The widgets of the dialog: images are chosen from the project or added as files, also RPC files without pixels."""

from pathlib import Path

from osgeo import gdal
from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProject, QgsRasterLayer, QgsVectorLayer
from qgis.gui import (
    QgsGui,
    QgsProcessingContextGenerator,
    QgsProcessingGui,
    QgsProcessingMultipleInputPanelWidget,
    QgsProcessingParameterWidgetContext,
)
from qgis.PyQt.QtCore import QPoint, Qt
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QCheckBox, QComboBox, QDialog, QFileDialog, QLineEdit, QToolButton

from hrsi.plugin.layer_sources import point_source
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.tests.qgis.tiny import TINY


class Generator(QgsProcessingContextGenerator):
    """Gives the widgets a context of the current project."""

    def __init__(self) -> None:
        super().__init__()
        self.context = QgsProcessingContext()
        self.context.setProject(QgsProject.instance())

    def processingContext(self) -> QgsProcessingContext:
        return self.context


def wrapper_of(name: str, generator: Generator):
    """Return the dialog's wrapper, its widget and the algorithm that must outlive both."""
    algorithm = PluginAlgorithm(TINY).create()
    registry = QgsGui.processingGuiRegistry()
    wrapper = registry.createParameterWidgetWrapper(algorithm.parameterDefinition(name), QgsProcessingGui.Standard)
    widget_context = QgsProcessingParameterWidgetContext()
    widget_context.setProject(QgsProject.instance())
    wrapper.setWidgetContext(widget_context)
    wrapper.registerProcessingContextGenerator(generator)
    return wrapper, wrapper.createWrappedWidget(generator.context), algorithm


def test_images_dialog_takes_layers_and_files(qgis_processing, qgis_new_project, tmp_path: Path) -> None:
    path = str(tmp_path / "image.tif")
    gdal.GetDriverByName("GTiff").Create(path, 4, 4).SetGeoTransform((0.0, 1.0, 0.0, 0.0, 0.0, -1.0))
    layer = QgsRasterLayer(path, "an image")
    QgsProject.instance().addMapLayer(layer)
    algorithm = PluginAlgorithm(TINY).create()
    images = algorithm.parameterDefinition("IMAGES")
    chosen = [layer.id(), str(tmp_path / "a_RPC.TXT")]
    panel = QgsProcessingMultipleInputPanelWidget(images, chosen, [])
    panel.setProject(QgsProject.instance())
    assert sorted(panel.selectedOptions()) == sorted(chosen)
    ok, message = algorithm.checkParameterValues(
        {"IMAGES": chosen, "OUTPUT_DIR": str(tmp_path)}, Generator().processingContext()
    )
    assert ok, message
    assert "_RPC.TXT" in images.createFileFilter()


class Dialog(QDialog):
    """Stands for the dialog of an algorithm."""


def test_images_widget_keeps_preset_values(qgis_processing, qgis_new_project) -> None:
    """As from the history: layers, and files that QGIS cannot load."""
    from processing.gui.wrappers import WidgetWrapperFactory

    algorithm, generator, dialog = PluginAlgorithm(TINY).create(), Generator(), Dialog()
    wrapper = WidgetWrapperFactory.create_wrapper(algorithm.parameterDefinition("IMAGES"), dialog)
    widget = wrapper.createWrappedWidget(generator.context)
    assert wrapper.parameterValue() == []
    wrapper.setParameterValue(["layer_id", "/data/a_RPC.TXT"], generator.context)
    assert wrapper.parameterValue() == ["layer_id", "/data/a_RPC.TXT"]
    assert widget.findChild(QLineEdit).text() == "2 images chosen"


def test_whole_dialog_gives_its_parameters(tiny_provider, qgis_new_project, monkeypatch) -> None:
    """The dialog of the toolbox, filled as by a run from the history, hands on what it was given."""
    from processing.gui import ParametersPanel
    from processing.gui.AlgorithmDialog import AlgorithmDialog

    monkeypatch.setattr(ParametersPanel, "iface", None)  # the mock has no browser model
    given = {"IMAGES": ["/data/a_RPC.TXT", "/data/b.tif"], "GCPS": "/data/gcps.csv", "TIE_POINTS": "none", "WAIT": 1.5}
    dialog = AlgorithmDialog(tiny_provider.algorithms()[0].create())
    dialog.setParameters(given)
    parameters = dialog.createProcessingParameters()
    dialog.deleteLater()
    assert {name: parameters[name] for name in given} == given


def test_points_widget_keeps_a_file(qgis_processing, qgis_new_project, tmp_path: Path) -> None:
    generator = Generator()
    for source in (f"{tmp_path}/gcps.csv", f"{tmp_path}/gcps.gpkg|layername=gcps"):
        wrapper, _widget, _algorithm = wrapper_of("GCPS", generator)
        wrapper.setParameterValue(source, generator.context)
        assert wrapper.parameterValue() == source


def test_selected_features_of_a_layer_in_a_field_of_words(
    qgis_processing, qgis_new_project, tmp_path: Path, monkeypatch
) -> None:
    """The box to tick is there for a layer with selected features, and only then; the history keeps it."""
    path = tmp_path / "ties.csv"
    path.write_text("id,image,sample,line\nA,a,1,2\nB,a,3,4\n", encoding="utf-8")
    layer = QgsVectorLayer(str(path), "ties", "ogr")
    QgsProject.instance().addMapLayer(layer)
    layer.selectByIds([2])
    from processing.gui.wrappers import WidgetWrapperFactory

    algorithm, generator, dialog = PluginAlgorithm(TINY).create(), Generator(), Dialog()
    wrapper = WidgetWrapperFactory.create_wrapper(algorithm.parameterDefinition("TIE_POINTS"), dialog)
    widget = wrapper.createWrappedWidget(generator.context)
    tick, words = widget.findChild(QCheckBox), widget.findChild(QComboBox)
    assert wrapper.parameterValue() == "auto" and not tick.isVisibleTo(widget)
    words.setCurrentIndex(words.findText("ties"))
    assert wrapper.parameterValue() == layer.id() and tick.isVisibleTo(widget)
    widget.show()
    QTest.mouseClick(tick, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, QPoint(8, tick.height() // 2))
    chosen = wrapper.parameterValue()
    assert chosen.selectedFeaturesOnly and chosen.source.staticValue() == layer.id()
    source = point_source(chosen, "tie_points", generator.context, QgsProcessingFeedback())
    assert [feature["id"] for feature in QgsVectorLayer(source, "", "ogr").getFeatures()] == ["B"]
    words.setCurrentIndex(words.findText("none"))
    assert wrapper.parameterValue() == "none" and not tick.isVisibleTo(widget)
    wrapper.setParameterValue(chosen, generator.context)
    assert wrapper.parameterValue().selectedFeaturesOnly
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_given: ("/data/other.csv", ""))
    QTest.mouseClick(widget.findChild(QToolButton), Qt.MouseButton.LeftButton)
    assert wrapper.parameterValue() == "/data/other.csv"
