"""Protection of measurements when QGIS is closed, and after a crash."""

from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from qgis.core import Qgis
from qgis.gui import QgsApplicationExitBlockerInterface, QgsMessageBar, QgsMessageBarItem
from qgis.PyQt import sip
from qgis.PyQt.QtWidgets import QPushButton

from ...processing_algorithms import point_session
from ..translation import tr
from .dock import PointsDock


class ExitGuard(QgsApplicationExitBlockerInterface):
    """Asks whether unsaved measurements are saved or discarded before QGIS closes."""

    def __init__(self, dock: PointsDock) -> None:
        super().__init__()
        self._dock = dock

    def allowExit(self) -> bool:
        if not self._dock.files.may_leave():
            return False
        self._dock.discard_edits()
        return True


class RecoveryOffer:
    """Offers unsaved sessions above the map; keeps references for its buttons, which gc would delete otherwise."""

    def __init__(self, dock: PointsDock, bar: QgsMessageBar) -> None:
        self._dock, self._bar = dock, bar
        self._items: dict[Path, QgsMessageBarItem] = {}  # by the folder of the journal

    def show(self, is_asked: bool = False) -> None:
        """Show the unsaved sessions; if the user has asked, also that there are none."""
        journals = self._dock.files.find_journals()
        for unsaved in journals:
            day = datetime.fromtimestamp(unsaved.time_s).strftime("%Y-%m-%d %H:%M")
            block = unsaved.path or tr("a block that was never saved")
            text = tr("{} measurements of {} were not saved: {}").format(len(unsaved.measured), day, block)
            item = self._bar.createMessage(tr("HRSI Points"), text)
            for label, action in ((tr("Recover"), self._dock.files.recover), (tr("Discard"), point_session.forget)):
                button = QPushButton(label, item)
                button.clicked.connect(partial(self._answer, unsaved, action))
                item.layout().addWidget(button)
            self._end(unsaved.folder)  # each is shown once
            self._items[unsaved.folder] = item
            self._bar.pushWidget(item, Qgis.MessageLevel.Warning)
        if is_asked and not journals:
            self._bar.pushMessage(tr("HRSI Points"), tr("There are no unsaved measurements"))

    def _answer(self, unsaved: Any, action: Callable[[Any], Any], _checked: bool = False) -> None:
        action(unsaved)
        self._end(unsaved.folder)

    def _end(self, folder: Path) -> None:
        item = self._items.pop(folder, None)
        if item is not None and not sip.isdeleted(item):
            self._bar.popWidget(item)
