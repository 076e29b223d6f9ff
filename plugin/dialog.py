"""The dialog of an algorithm with many parameters: QGIS's own, its advanced parameters in groups with titles."""

from typing import Any

from processing.gui.AlgorithmDialog import AlgorithmDialog
from qgis.gui import QgsCollapsibleGroupBoxBasic
from qgis.PyQt.QtWidgets import QGroupBox, QVBoxLayout

from .parameters import ADVANCED, qgis_name
from .translation import tr


class GroupedDialog(AlgorithmDialog):
    """Shows the parameters under *Advanced* in the groups of the full help, each in a closed box."""

    def getParametersPanel(self, alg: Any, parent: Any) -> Any:
        panel = super().getParametersPanel(alg, parent)
        advanced, boxes = panel.findChild(QGroupBox, "grpAdvanced"), dict[str, QgsCollapsibleGroupBoxBasic]()
        for param in alg.declaration.params if advanced is not None else ():
            if not param.group or not alg.parameterDefinition(qgis_name(param)).flags() & ADVANCED:
                continue
            if param.group not in boxes:
                box = boxes[param.group] = QgsCollapsibleGroupBoxBasic(tr(param.group), advanced)
                box.setLayout(QVBoxLayout())
                box.setCollapsed(True)
                advanced.layout().addWidget(box)
            wrapper = panel.wrappers[qgis_name(param)]
            for widget in filter(None, (wrapper.wrappedLabel(), wrapper.wrappedWidget())):
                boxes[param.group].layout().addWidget(widget)  # and so out of the list
        return panel
