"""The dialog's field for images: it keeps RPC files without pixels, which QGIS's own drops when values are set.

QGIS's own field (for several layers) loads what it is given, from the history or from a script, and forgets what is
no raster.
"""

from typing import Any

from qgis.core import QgsProcessingContext, QgsProject
from qgis.gui import QgsAbstractProcessingParameterWidgetWrapper, QgsProcessingMultipleInputDialog
from qgis.PyQt.QtWidgets import QHBoxLayout, QLineEdit, QToolButton, QWidget

from .dialog_fields import DialogField
from .help_text import as_rich_text
from .layer_sources import list_sources
from .translation import tr


class ImagesWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """How many images are chosen, and a button to choose among the project's layers and files.

    The state is here and not in a widget of our own: Processing wraps the created widget anew, as a plain QWidget.
    """

    def createWidget(self) -> QWidget:
        widget = self._widget = QWidget()  # kept: Qt would call a Python object that is collected
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
