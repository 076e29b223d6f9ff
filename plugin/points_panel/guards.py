"""What keeps measurements when QGIS is closed, or was killed."""

from datetime import datetime

from qgis.core import Qgis
from qgis.gui import QgsApplicationExitBlockerInterface, QgsMessageBar
from qgis.PyQt.QtWidgets import QPushButton

from ...processing_algorithms import point_session
from ..translation import tr
from .dock import PointsDock


class ExitGuard(QgsApplicationExitBlockerInterface):
    """Asks what to do with unsaved measurements before QGIS closes."""

    def __init__(self, dock: PointsDock) -> None:
        super().__init__()
        self._dock = dock

    def allowExit(self) -> bool:
        if not self._dock.may_leave():
            return False
        self._dock.give_up()
        return True


def offer_recovery(dock: PointsDock, bar: QgsMessageBar) -> None:
    """Offer, above the map, what was measured in sessions that ended without saving."""
    for unsaved in dock.find_journals():
        day = datetime.fromtimestamp(unsaved.time_s).strftime("%Y-%m-%d %H:%M")
        block = unsaved.path or tr("a block that was never saved")
        text = tr("{} measurements of {} were not saved: {}").format(len(unsaved.measured), day, block)
        item = bar.createMessage(tr("HRSI Points"), text)
        for label, action in ((tr("Recover"), dock.recover), (tr("Discard"), point_session.forget)):
            button = QPushButton(label, item)
            button.clicked.connect(lambda _=False, do=action, of=unsaved, item=item: (do(of), item.dismiss()))
            item.layout().addWidget(button)
        bar.pushWidget(item, Qgis.MessageLevel.Warning)
