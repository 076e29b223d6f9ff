"""Fields of HRSI in the dialogs of Processing: for images, for a word or a layer or file, and for an extent."""

from collections.abc import Sequence
from typing import Any

from qgis.core import (
    Qgis,
    QgsMapLayer,
    QgsProcessingContext,
    QgsProcessingFeatureSourceDefinition,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFeatureSource,
    QgsProject,
    QgsVectorLayer,
)
from qgis.gui import (
    QgsAbstractProcessingParameterWidgetWrapper,
    QgsExtentWidget,
    QgsGui,
    QgsProcessingGui,
    QgsProcessingMultipleInputDialog,
    QgsProcessingParameterWidgetContext,
)
from qgis.PyQt.QtWidgets import QCheckBox, QComboBox, QFileDialog, QHBoxLayout, QLineEdit, QToolButton, QWidget

from .background_task import in_main_thread
from .help import as_rich_text
from .layer_sources import list_sources, read_box
from .translation import tr

DIALOGS = getattr(Qgis, "ProcessingMode", QgsProcessingGui)  # the enumeration moved in QGIS 4


class DialogField:
    """Factory of a widget wrapper for Processing: returns the one for the kind of dialog.

    In the modeler, where a value may also be the output of another step, the field of QGIS is used.
    """

    wrapper: type[QgsAbstractProcessingParameterWidgetWrapper]

    def __new__(cls, param: QgsProcessingParameterDefinition, dialog: Any, row: int = 0, col: int = 0) -> Any:
        kind = type(dialog).__name__
        if kind == "ModelerParametersDialog":
            registry = QgsGui.processingGuiRegistry()
            return registry.createModelerParameterWidget(dialog.model, dialog.childId, param, dialog.context)
        wrapper = cls.wrapper(param, DIALOGS.Batch if "Batch" in kind else DIALOGS.Standard)
        wrapper.setDialog(dialog)
        return wrapper


_SHOWN: set[QWidget] = set()


def make_container() -> QWidget:
    """Return an empty widget whose Python half lives as long as its C++ half.

    Processing wraps it again as a plain QWidget; the C++ half calls the first Python half when it is deleted, which
    crashes QGIS 3.40 if that one is gone.
    """
    widget = QWidget()
    _SHOWN.add(widget)
    widget.destroyed.connect(lambda: _SHOWN.discard(widget))
    return widget


class LayerOrFile:
    """An editable list of words and project layers, with a button to choose a file; ``widget`` contains all.

    Its value is a word, the id of a layer (or its selected features), or the typed text; empty if nothing is chosen.
    It is no widget itself: Processing wraps a given widget again as a plain QWidget, and would lose this object.
    """

    def __init__(self, words: Sequence[str] = (), layers: bool = True) -> None:
        self.widget = make_container()
        self.box = QComboBox(self.widget)
        self.box.setEditable(True)
        self.box.setMinimumContentsLength(12)
        for word in ("", *words):
            self.box.addItem(word, word)
        found = (one for one in QgsProject.instance().mapLayers().values() if isinstance(one, QgsVectorLayer))
        for layer in sorted(found, key=lambda one: one.name().lower()) if layers else ():
            self.box.addItem(layer.name(), layer.id())
        button = QToolButton(self.widget)
        button.setText("…")
        button.setToolTip(tr("Choose a file"))
        button.clicked.connect(self._browse)
        self.selected_only = QCheckBox(tr("Selected features only"), self.widget)
        self.box.editTextChanged.connect(lambda _text: self._offer_selection())
        self._offer_selection()
        layout = QHBoxLayout(self.widget)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.box, 1)
        layout.addWidget(self.selected_only)
        layout.addWidget(button)

    def value(self) -> str | QgsProcessingFeatureSourceDefinition:
        text = self._text()
        return QgsProcessingFeatureSourceDefinition(text, True) if self.selected_only.isChecked() else text

    def set_value(self, value: Any) -> None:
        """Show a layer, its id, a file or a word; a definition of a source may limit it to the selected features."""
        selected_only = False
        if isinstance(value, QgsProcessingFeatureSourceDefinition):
            value, selected_only = value.source.staticValue(), value.selectedFeaturesOnly
        text = value.id() if isinstance(value, QgsMapLayer) else "" if value is None else str(value)
        if (index := self.box.findData(text)) >= 0:
            self.box.setCurrentIndex(index)
        else:
            self.box.setEditText(text)
        self.selected_only.setChecked(selected_only and not self.selected_only.isHidden())

    @in_main_thread
    def field_names(self) -> list[str]:
        """Return the names of the fields of the layer or file."""
        layer = QgsProject.instance().mapLayer(self._text()) or QgsVectorLayer(self._text(), "", "ogr")
        return [str(name) for name in layer.fields().names()]

    def _text(self) -> str:
        """Return the id of the chosen layer, the chosen word, or the typed file."""
        text = self.box.currentText().strip()
        index = self.box.findText(text)
        return str(self.box.itemData(index)) if index >= 0 else text

    def _offer_selection(self) -> None:
        """Show the check box for selected features if the layer has any."""
        layer = QgsProject.instance().mapLayer(self._text())
        has_some = isinstance(layer, QgsVectorLayer) and layer.selectedFeatureCount() > 0
        self.selected_only.setVisible(has_some)
        if not has_some:
            self.selected_only.setChecked(False)

    def _browse(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self.box, tr("Choose a file"))
        if path:
            self.set_value(path)


class WordWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """A `LayerOrFile` as a wrapper of Processing, which keeps it: Processing wraps its widget as a plain QWidget."""

    def createWidget(self) -> QWidget:
        param = self.parameterDefinition()
        is_points = isinstance(param, QgsProcessingParameterFeatureSource)
        self._field = LayerOrFile(param.metadata().get("words", ()), layers=is_points)
        self._field.set_value(param.defaultValue())
        self._field.box.editTextChanged.connect(lambda _text: self.widgetValueHasChanged.emit(self))
        self._field.selected_only.toggled.connect(lambda _on: self.widgetValueHasChanged.emit(self))
        return self._field.widget

    def setWidgetValue(self, value: Any, context: QgsProcessingContext) -> None:
        self._field.set_value(value)

    def widgetValue(self) -> Any:
        return self._field.value()


class WordWidget(DialogField):
    """The field of a word or a file."""

    wrapper = WordWrapper


class ImagesWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """A field with the number of chosen images, and a button to choose among the project's layers and files.

    The state is in the wrapper, not in the widget: Processing wraps the created widget again as a plain QWidget.
    """

    def createWidget(self) -> QWidget:
        widget = make_container()
        self._text = QLineEdit(widget)
        self._text.setReadOnly(True)
        button = QToolButton(widget)
        button.setText("…")
        button.clicked.connect(self._choose)
        layout = QHBoxLayout(widget)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._text)
        layout.addWidget(button)
        self._select([])
        return widget

    def setWidgetValue(self, value: Any, context: QgsProcessingContext) -> None:
        self._select([str(source) for source in list_sources(value)])
        self.widgetValueHasChanged.emit(self)

    def widgetValue(self) -> list[str]:
        return list(self._selected)

    def _select(self, sources: list[str]) -> None:
        self._selected = sources
        self._text.setText(tr("1 image chosen") if len(sources) == 1 else tr("{} images chosen").format(len(sources)))
        self._text.setToolTip(as_rich_text("\n".join(sources)))

    def _choose(self) -> None:
        dialog = QgsProcessingMultipleInputDialog(self.parameterDefinition(), self._selected, [], None, self._text)
        dialog.setProject(QgsProject.instance())
        if dialog.exec():
            self._select([str(source) for source in dialog.selectedOptions()])
            self.widgetValueHasChanged.emit(self)


class ImagesWidget(DialogField):
    """The field of several images."""

    wrapper = ImagesWrapper


class ExtentWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """A list of the words and "a box", and QGIS's field for a box; choosing a box there also selects "a box".

    The state is in the wrapper, not in the widget: Processing wraps the created widget again as a plain QWidget.
    """

    _dialog: Any = None
    _box: Any = None

    def createWidget(self) -> QWidget:
        widget = make_container()
        self._words, self._box = QComboBox(widget), QgsExtentWidget(widget, QgsExtentWidget.WidgetStyle.CondensedStyle)
        for word in self.parameterDefinition().metadata().get("words", ()):
            self._words.addItem(word, word)
        self._words.addItem(tr("a box:"), "")
        self._box.setNullValueAllowed(True, tr("from the map, a layer, or drawn"))
        self._box.clear()  # this shows the text
        self._words.currentIndexChanged.connect(lambda _index: self.widgetValueHasChanged.emit(self))
        self._box.extentChanged.connect(lambda _extent: self._on_box())
        self._box.toggleDialogVisibility.connect(self._show_dialog)
        layout = QHBoxLayout(widget)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._words)
        layout.addWidget(self._box, 1)
        self._offer_map()
        return widget

    def setWidgetContext(self, context: QgsProcessingParameterWidgetContext) -> None:
        super().setWidgetContext(context)
        if self._box is not None:
            self._offer_map()

    def setDialog(self, dialog: Any) -> None:
        super().setDialog(dialog)
        self._dialog = dialog

    def setWidgetValue(self, value: Any, context: QgsProcessingContext) -> None:
        word = self._words.findData(value) if isinstance(value, str) and value else -1
        if word < 0:
            word = self._words.findData("")
            box, crs = read_box(self.parameterDefinition(), value, context)
            self._box.setOutputCrs(crs)
            if box.isNull():
                self._box.clear()
            else:
                self._box.setOutputExtentFromUser(box, crs)
        self._words.setCurrentIndex(word)

    def widgetValue(self) -> str:
        word = str(self._words.currentData())
        if word or self._box.outputExtent().isNull():
            return word
        box, crs = self._box.outputExtent(), self._box.outputCrs().authid()
        sides = (box.xMinimum(), box.xMaximum(), box.yMinimum(), box.yMaximum())
        return ",".join(map(repr, sides)) + (f" [{crs}]" if crs else "")

    def _on_box(self) -> None:
        self._words.setCurrentIndex(self._words.findData(""))
        self.widgetValueHasChanged.emit(self)

    def _offer_map(self) -> None:
        """Offer to take the box from the map, or to draw it there."""
        if (canvas := self.widgetContext().mapCanvas()) is not None:
            self._box.setMapCanvas(canvas)

    def _show_dialog(self, is_shown: bool) -> None:
        """Minimise the dialog while the user draws on the map, and show it again afterwards."""
        if self._dialog is None:
            return
        if not is_shown:
            self._dialog.showMinimized()
            return
        self._dialog.showNormal()
        self._dialog.raise_()
        self._dialog.activateWindow()


class ExtentWidget(DialogField):
    """The field of an extent."""

    wrapper = ExtentWrapper
