"""The dialog's field for images: it keeps RPC files without pixels, which QGIS's own drops when values are set.

QGIS's own field (for several layers) loads what it is given, from the history or from a script, and forgets what is
no raster. In the modeler, where a value may also be the output of another step, QGIS's own field is used.
"""

from __future__ import annotations

from typing import Any

from qgis.core import Qgis, QgsProcessingContext, QgsProcessingParameterDefinition, QgsProject
from qgis.gui import (
    QgsAbstractProcessingParameterWidgetWrapper,
    QgsGui,
    QgsProcessingGui,
    QgsProcessingMultipleInputDialog,
)
from qgis.PyQt.QtWidgets import QHBoxLayout, QLineEdit, QToolButton, QWidget

from .layer_sources import listed

_DIALOGS = getattr(Qgis, "ProcessingMode", QgsProcessingGui)  # the enumeration moved in QGIS 4


class ImagesWidget:
    """What Processing calls for a widget wrapper: gives the one that fits the kind of dialog."""

    def __new__(cls, param: QgsProcessingParameterDefinition, dialog: Any, row: int = 0, col: int = 0) -> Any:
        kind = type(dialog).__name__
        if kind == "ModelerParametersDialog":
            registry = QgsGui.processingGuiRegistry()
            return registry.createModelerParameterWidget(dialog.model, dialog.childId, param, dialog.context)
        wrapper = ImagesWrapper(param, _DIALOGS.Batch if "Batch" in kind else _DIALOGS.Standard)
        wrapper.setDialog(dialog)
        return wrapper


class ImagesWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """How many images are chosen, and a button to choose among the project's layers and files.

    The state is here and not in a widget of our own: Processing wraps the created widget anew, as a plain QWidget.
    """

    def createWidget(self) -> QWidget:
        widget = QWidget()
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
        self._select([str(source) for source in listed(value)])
        self.widgetValueHasChanged.emit(self)

    def widgetValue(self) -> list[str]:
        return list(self._selected)

    def _select(self, sources: list[str]) -> None:
        self._selected = sources
        self._text.setText(f"{len(sources)} image{'' if len(sources) == 1 else 's'} chosen")
        self._text.setToolTip("\n".join(sources))

    def _choose(self) -> None:
        dialog = QgsProcessingMultipleInputDialog(self.parameterDefinition(), self._selected, [], None, self._text)
        dialog.setProject(QgsProject.instance())
        if dialog.exec():
            self._select([str(source) for source in dialog.selectedOptions()])
            self.widgetValueHasChanged.emit(self)
