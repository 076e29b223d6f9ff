"""A field that takes a layer of the project, a file, or one of a few words (``auto``, ``none``)."""

from __future__ import annotations

from collections.abc import Sequence

from qgis.core import QgsMapLayer, QgsProject, QgsVectorLayer
from qgis.PyQt.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QToolButton, QWidget

from .translation import tr


class LayerOrFile:
    """An editable list of words and project layers, with a button to browse for a file, all in ``widget``.

    Its value is a word, the id of a layer, or what was typed; empty for nothing. No widget of its own: Processing wraps
    what it is given anew, as a plain QWidget, and would forget this object.
    """

    def __init__(self, words: Sequence[str] = (), layers: bool = True, file_filter: str = "") -> None:
        self.widget = QWidget()
        self._filter = file_filter
        self.box = QComboBox(self.widget)
        self.box.setEditable(True)
        self.box.setMinimumContentsLength(12)
        for word in ("", *words):
            self.box.addItem(word, word)
        for layer in _vector_layers() if layers else ():
            self.box.addItem(layer.name(), layer.id())
        button = QToolButton(self.widget)
        button.setText("…")
        button.setToolTip(tr("Choose a file"))
        button.clicked.connect(self._browse)
        layout = QHBoxLayout(self.widget)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.box, 1)
        layout.addWidget(button)

    def value(self) -> str:
        text = self.box.currentText().strip()
        index = self.box.findText(text)
        return str(self.box.itemData(index)) if index >= 0 else text

    def set_value(self, value: object) -> None:
        text = value.id() if isinstance(value, QgsMapLayer) else "" if value is None else str(value)
        index = self.box.findData(text)
        if index >= 0:
            self.box.setCurrentIndex(index)
        else:
            self.box.setEditText(text)

    def _browse(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self.widget, tr("Choose a file"), "", self._filter)
        if path:
            self.set_value(path)


def _vector_layers() -> list[QgsVectorLayer]:
    layers = QgsProject.instance().mapLayers().values()
    return sorted((one for one in layers if isinstance(one, QgsVectorLayer)), key=lambda one: one.name().lower())
