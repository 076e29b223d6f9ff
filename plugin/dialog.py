"""The dialog of an algorithm with many parameters: that of QGIS, with the advanced ones in groups with titles.

A module of its own: `dialog_fields` serves the panel too, which starts before QGIS has loaded Processing.
"""

from typing import Any

from processing.gui.AlgorithmDialog import AlgorithmDialog
from qgis.gui import QgsCollapsibleGroupBoxBasic
from qgis.PyQt.QtWidgets import QGroupBox, QVBoxLayout

from .parameters import ADVANCED, qgis_name
from .translation import tr


class GroupedDialog(AlgorithmDialog):
    """Shows the parameters under *Advanced* in the groups of the full help, each in a collapsed box."""

    def getParametersPanel(self, alg: Any, parent: Any) -> Any:
        panel = super().getParametersPanel(alg, parent)
        advanced, boxes = panel.findChild(QGroupBox, "grpAdvanced"), dict[str, QgsCollapsibleGroupBoxBasic]()
        groups = {qgis_name(param): tr(param.group) for param in alg.declaration.params}
        for parameter in alg.parameterDefinitions() if advanced is not None else ():
            group = groups.get(parameter.name(), tr("Fields of the GCPs"))
            if not group or not parameter.flags() & ADVANCED:
                continue
            if group not in boxes:
                box = boxes[group] = QgsCollapsibleGroupBoxBasic(group, advanced)
                box.setLayout(QVBoxLayout())
                box.setCollapsed(True)
                advanced.layout().addWidget(box)
            wrapper = panel.wrappers[parameter.name()]
            for widget in filter(None, (wrapper.wrappedLabel(), wrapper.wrappedWidget())):
                boxes[group].layout().addWidget(widget)  # which removes them from the list
        return panel
