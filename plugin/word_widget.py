"""The dialog's field for a parameter that takes a word or a file; for points also a layer of the project."""

from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingParameterFeatureSource
from qgis.gui import QgsAbstractProcessingParameterWidgetWrapper
from qgis.PyQt.QtWidgets import QWidget

from .dialog_fields import DialogField
from .layer_or_file import LayerOrFile


class WordWrapper(QgsAbstractProcessingParameterWidgetWrapper):
    """A `LayerOrFile` as Processing wants it; kept here, as Processing wraps the widget anew, as a plain QWidget."""

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
