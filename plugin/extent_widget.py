"""The dialog's field for an extent: a word, or a box from the map, a layer, drawn, or typed."""

from typing import Any

from qgis.core import QgsProcessingContext
from qgis.gui import QgsAbstractProcessingParameterWidgetWrapper, QgsExtentWidget, QgsProcessingParameterWidgetContext
from qgis.PyQt.QtWidgets import QComboBox, QHBoxLayout, QWidget

from .dialog_fields import DialogField
from .layer_sources import read_box
from .translation import tr


class ExtentWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """A list of the words and "a box", beside QGIS's own field for a box; choosing a box there chooses it here.

    The state is here and not in a widget of our own: Processing wraps the created widget anew, as a plain QWidget.
    """

    _dialog: Any = None
    _box: Any = None

    def createWidget(self) -> QWidget:
        widget = self._widget = QWidget()  # kept: Qt would call a Python object that is collected
        self._words, self._box = QComboBox(widget), QgsExtentWidget(widget, QgsExtentWidget.WidgetStyle.CondensedStyle)
        for word in self.parameterDefinition().metadata().get("words", ()):
            self._words.addItem(word, word)
        self._words.addItem(tr("a box:"), "")
        self._box.setNullValueAllowed(True, tr("from the map, a layer, or drawn"))
        self._box.clear()  # which shows that text
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
        """Let the box be taken from the map, or drawn there."""
        canvas = self.widgetContext().mapCanvas()
        if canvas is not None:
            self._box.setMapCanvas(canvas)

    def _show_dialog(self, is_shown: bool) -> None:
        """Make room for drawing on the map, and come back."""
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
