"""A field that takes a layer of the project, a file, or one of a few words (``auto``, ``none``)."""

from collections.abc import Sequence
from typing import Any

from qgis.core import QgsMapLayer, QgsProcessingFeatureSourceDefinition, QgsProject, QgsVectorLayer
from qgis.PyQt.QtWidgets import QCheckBox, QComboBox, QFileDialog, QHBoxLayout, QToolButton, QWidget

from .translation import tr


class LayerOrFile:
    """An editable list of words and project layers, with a button to browse for a file, all in ``widget``.

    Its value is a word, the id of a layer (or its selected features), or what was typed; empty for nothing. It is no
    widget itself: Processing wraps what it is given anew, as a plain QWidget, and would forget this object.
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
        selected_only = False
        if isinstance(value, QgsProcessingFeatureSourceDefinition):
            value, selected_only = value.source.staticValue(), value.selectedFeaturesOnly
        text = value.id() if isinstance(value, QgsMapLayer) else "" if value is None else str(value)
        index = self.box.findData(text)
        if index >= 0:
            self.box.setCurrentIndex(index)
        else:
            self.box.setEditText(text)
        self.selected_only.setChecked(selected_only and not self.selected_only.isHidden())

    def _text(self) -> str:
        text = self.box.currentText().strip()
        index = self.box.findText(text)
        return str(self.box.itemData(index)) if index >= 0 else text

    def _offer_selection(self) -> None:
        """Offer the selected features of a layer that has some."""
        layer = QgsProject.instance().mapLayer(self._text())
        has_some = isinstance(layer, QgsVectorLayer) and layer.selectedFeatureCount() > 0
        self.selected_only.setVisible(has_some)
        if not has_some:
            self.selected_only.setChecked(False)

    def _browse(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self.box, tr("Choose a file"), "", self._filter)
        if path:
            self.set_value(path)


def _vector_layers() -> list[QgsVectorLayer]:
    layers = QgsProject.instance().mapLayers().values()
    return sorted((one for one in layers if isinstance(one, QgsVectorLayer)), key=lambda one: one.name().lower())
