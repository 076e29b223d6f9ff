"""How a parameter's own field is given to the dialogs of Processing."""

from typing import Any

from qgis.core import Qgis, QgsProcessingParameterDefinition
from qgis.gui import QgsAbstractProcessingParameterWidgetWrapper, QgsGui, QgsProcessingGui

DIALOGS = getattr(Qgis, "ProcessingMode", QgsProcessingGui)  # the enumeration moved in QGIS 4


class DialogField:
    """What Processing calls for a widget wrapper: gives the one that fits the kind of dialog.

    In the modeler, where a value may also be the output of another step, QGIS's own field is used.
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
