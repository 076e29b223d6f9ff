"""The offer to install packages for faster matching: the command is shown, and one click runs it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qgis.core import Qgis
from qgis.gui import QgsMessageBar
from qgis.PyQt.QtCore import QProcess, Qt
from qgis.PyQt.QtWidgets import QMessageBox, QPushButton, QWidget

from ..hrsi_engine.foundation.errors import InputError
from .background_task import BackgroundTask
from .dependencies import can_install, install_command, missing_fast_packages, quote_command
from .translation import tr

TOLD_LINES = 3  # last lines of the output of pip


class PackageOffer:
    """A dialog with the command for QGIS's Python; the message bar shows the result of the installation."""

    def __init__(self, bar: QgsMessageBar, parent: QWidget | None = None) -> None:
        self._bar, self._parent = bar, parent

    def show(self) -> None:
        """Offer the missing packages; show a message if none is missing."""
        missing = missing_fast_packages()
        if not missing:
            self._bar.pushMessage("HRSI", tr("Matching is fast: numba and OpenCV are there."), Qgis.MessageLevel.Info)
            return
        command = install_command(missing)
        box = QMessageBox(self._parent)
        box.setWindowTitle(tr("HRSI: packages for speed"))
        box.setText(tr("Matching is two to three times as fast with {}.").format(", ".join(missing)))
        box.setInformativeText(f"{tr('The command for the Python of this QGIS is')}\n\n{quote_command(command)}")
        box.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        close: Any = box.addButton(QMessageBox.StandardButton.Close)
        box.setDefaultButton(close)
        if can_install():
            run: QPushButton = box.addButton(tr("Install"), QMessageBox.ButtonRole.AcceptRole)
            run.clicked.connect(lambda _checked=False: self.install(command))
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.open()

    def install(self, command: Sequence[str]) -> None:
        """Run the command in the background."""
        self._bar.pushMessage("HRSI", tr("installing packages …"), Qgis.MessageLevel.Info)
        BackgroundTask(tr("HRSI: installing packages"), lambda _progress: run_installer(command), self._on_end).start()

    def _on_end(self, task: BackgroundTask) -> None:
        self._bar.clearWidgets()
        if task.is_done:
            self._bar.pushMessage("HRSI", tr("Installed. Restart QGIS to use the packages."), Qgis.MessageLevel.Success)
        elif task.failure:
            self._bar.pushMessage("HRSI", task.failure, Qgis.MessageLevel.Warning)


def run_installer(command: Sequence[str]) -> None:
    """Run a command; raise `InputError` with the last lines of its output if it fails."""
    process = QProcess()
    process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
    process.start(command[0], list(command[1:]))
    is_run = process.waitForStarted() and process.waitForFinished(-1)
    if not is_run or process.exitCode() != 0:
        said = bytes(process.readAll()).decode(errors="replace").strip().splitlines()[-TOLD_LINES:]
        told = " ".join(said) or process.errorString()
        raise InputError(f"the packages are not installed: {told}; run in a terminal  {quote_command(command)}")
