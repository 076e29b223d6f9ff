"""The packages that matching needs: one click installs them into the user's profile, and their loops are compiled."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qgis.core import Qgis, QgsApplication, QgsSettings
from qgis.gui import QgsMessageBar
from qgis.PyQt.QtCore import QProcess, Qt, QTimer
from qgis.PyQt.QtWidgets import QApplication, QMessageBox, QPushButton, QWidget
from qgis.utils import iface

from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.version import VERSION
from .background_task import BackgroundTask, in_main_thread
from .dependencies import (
    can_install,
    install_command,
    list_missing_packages,
    package_folder,
    python_executable,
    quote_command,
    use_packages,
)
from .translation import tr

SHOWN_LINES = 3  # last lines of the output of pip
COMPILED_FOR = "hrsi/compiled_for"  #: setting: the version of HRSI whose loops have been compiled
OFFER_AFTER_MS = 1000  # QGIS shows "Task failed" above earlier messages


@in_main_thread
def offer_packages() -> None:
    """Offer the packages that matching needs, if some are missing and there is a desktop.

    This is a message above the map, or a dialog over the panel or the tour, which may cover the map.
    """
    window = QApplication.activeWindow()
    if iface is None or not list_missing_packages():
        return
    if hasattr(window, "tell"):
        PackageOffer(iface.messageBar(), window).show()
    else:
        offer = PackageOffer(iface.messageBar(), iface.mainWindow())
        QTimer.singleShot(OFFER_AFTER_MS, lambda: offer.push())  # the function keeps the offer alive


def compile_in_background(parent: QWidget) -> QProcess | None:
    """Start the process that compiles the loops of matching, once for each version; None: nothing is to be compiled.

    It ends with ``parent``, the main window, and then begins again at the next start.
    """
    if list_missing_packages() or QgsSettings().value(COMPILED_FOR) == VERSION:
        return None
    process = QProcess(parent)

    def note_end(code: int) -> None:
        if code == 0:
            QgsSettings().setValue(COMPILED_FOR, VERSION)

    process.finished.connect(note_end)
    process.setStandardOutputFile(QProcess.nullDevice())
    process.setStandardErrorFile(QProcess.nullDevice())
    process.setWorkingDirectory(str(Path(__file__).parents[2]))  # Python finds HRSI there
    packages = package_folder(QgsApplication.qgisSettingsDirPath())
    process.start(python_executable(), ["-m", f"{__package__}.compile_loops", str(packages)])
    return process


class PackageOffer:
    """Offers the missing packages in a dialog or in the message bar, which also shows the result.

    ``parent`` is the main window, or the panel or tour in front of it, which show the result too.
    """

    def __init__(self, bar: QgsMessageBar, parent: QWidget | None = None) -> None:
        self._bar, self._parent = bar, parent
        self.folder = package_folder(QgsApplication.qgisSettingsDirPath())
        self._missing = list_missing_packages()
        self._command = install_command(self._missing, self.folder)
        names = ", ".join(self._missing)
        self._text = tr("Matching and measuring in images need {}, which this QGIS lacks.").format(names)

    def push(self) -> None:
        """Offer the packages in the message bar, by one button."""
        item = self._bar.createMessage("HRSI", self._text)
        button = QPushButton(tr("Install") if can_install() else tr("Show the command"), item)
        button.setToolTip(quote_command(self._command))
        button.clicked.connect(lambda _checked=False: self.install() if can_install() else self.show())
        item.layout().addWidget(button)
        self._bar.pushWidget(item, Qgis.MessageLevel.Warning)

    def show(self) -> None:
        """Offer the packages in a dialog with the command; show a message if none is missing."""
        if not self._missing:
            self._tell(tr("All packages that matching needs are there."), Qgis.MessageLevel.Info)
            return
        box = QMessageBox(self._parent)
        box.setWindowTitle(tr("HRSI: packages for matching"))
        box.setText(self._text)
        box.setInformativeText(f"{tr('The command for the Python of this QGIS is')}\n\n{quote_command(self._command)}")
        box.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        close: Any = box.addButton(QMessageBox.StandardButton.Close)
        box.setDefaultButton(close)
        if can_install():
            run: QPushButton = box.addButton(tr("Install"), QMessageBox.ButtonRole.AcceptRole)
            run.clicked.connect(lambda _checked=False: self.install())
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.open()

    def install(self) -> None:
        """Run the command in the background."""
        self._tell(f"{tr('installing packages …')}  {quote_command(self._command)}", Qgis.MessageLevel.Info, 0)
        BackgroundTask(
            tr("HRSI: installing packages"), lambda _progress: run_installer(self._command), self._on_end
        ).start()

    def _on_end(self, task: BackgroundTask) -> None:
        if task.is_done:
            use_packages(self.folder)
            self._tell(tr("Installed. Matching works now."), Qgis.MessageLevel.Success)
            if iface is not None:
                compile_in_background(iface.mainWindow())
        else:
            self._tell(task.failure or tr("cancelled"), Qgis.MessageLevel.Warning)

    def _tell(self, text: str, level: Qgis.MessageLevel, *duration_s: int) -> None:
        """Show a message instead of the present one."""
        self._bar.clearWidgets()
        self._bar.pushMessage("HRSI", text, level, *duration_s)
        if (show := getattr(self._parent, "tell", None)) is not None:
            show(text)


def run_installer(command: Sequence[str]) -> None:
    """Run a command; raise `InputError` with the last lines of its output if it fails."""
    process = QProcess()
    process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
    process.start(command[0], list(command[1:]))
    is_run = process.waitForStarted() and process.waitForFinished(-1)
    if not is_run or process.exitCode() != 0:
        lines = bytes(process.readAll()).decode(errors="replace").strip().splitlines()[-SHOWN_LINES:]
        reason = " ".join(lines) or process.errorString()
        raise InputError(f"the packages are not installed: {reason}; run in a terminal  {quote_command(command)}")
