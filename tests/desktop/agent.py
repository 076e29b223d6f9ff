"""What answers the tests inside QGIS: it looks at widgets and tells where they are; it presses nothing itself.

QGIS runs this file at its start (``--code``). It listens at the local socket `SOCKET_VARIABLE`; a request is a line of
JSON with ``code``, an expression or statements that leave ``result``; the answer is a line with ``value``, ``error``
(a traceback) and ``uncaught``, the tracebacks of exceptions that nobody has caught since the last answer: what QGIS
shows its user as a Python error.
"""

import ctypes
import faulthandler
import gc
import json
import os
import signal
import sys
import time
import traceback
from functools import partial
from typing import Any

import numpy as np
from qgis.core import Qgis, QgsApplication, QgsPointXY, QgsProject
from qgis.PyQt.QtCore import QAbstractNativeEventFilter, QEventLoop, QPoint, QTimer
from qgis.PyQt.QtNetwork import QLocalServer
from qgis.PyQt.QtWidgets import QAbstractButton, QApplication, QDockWidget, QLabel, QTextBrowser, QToolBar, QWidget  # noqa: F401
from qgis.utils import iface, plugins

SOCKET_VARIABLE = "HRSI_DESKTOP_SOCKET"
COLLECT_EVERY_S = 0.5  # the tests ask every 0.05 s while they wait
UNCAUGHT: list[str] = []
CRITICAL: list[str] = []  # messages of this level in QGIS's log
DOCKS: list[QDockWidget] = []  # those of the main window when layers were drawn first
EXTENTS: dict[str, Any] = {}  # of layers on the map when they were drawn first, by id


def install(zip_file: str) -> None:
    """Begin to install the plugin as *Plugins, Install from ZIP* does."""
    import pyplugin_installer

    later(lambda: pyplugin_installer.instance().installFromZipFile(zip_file))


def failures() -> str:
    """Return the text of the error that QGIS shows in a dialog, empty without."""
    dialog = QApplication.activeModalWidget()
    texts = [one.toPlainText() for one in dialog.findChildren(QTextBrowser)] if dialog is not None else []
    return "\n".join(texts)


def panel() -> Any:
    """Return the panel of the installed plugin."""
    return plugins["hrsi"].dock


def middle_of(widget: QWidget) -> list[int]:
    """Return where on the screen a widget's middle is; raise ValueError for one that nobody sees."""
    if not widget.isVisible() or widget.visibleRegion().isEmpty():
        raise ValueError(f"{type(widget).__name__} {_text(widget)!r} is not to be seen")
    place = widget.mapToGlobal(widget.visibleRegion().boundingRect().center())
    return [place.x(), place.y()]


def button_of(action: Any) -> list[int]:
    """Return where the tool button of an action is."""
    buttons = [bar.widgetForAction(action) for bar in action.associatedWidgets() if isinstance(bar, QToolBar)]
    return middle_of(next(button for button in buttons if button is not None))


def button_named(text: str) -> list[int]:
    """Return where a button of any window is, by its text without the mark of its key."""
    found = [one for one in QApplication.allWidgets() if isinstance(one, QAbstractButton) and _text(one) == text]
    return middle_of(next((one for one in found if one.isVisible()), *found[:1]))


def cell_of(table: Any, row: int, column: int) -> list[int]:
    """Return where a cell of a table is, scrolled into view."""
    index = table.model().index(row, column)
    table.scrollTo(index)
    place = table.viewport().mapToGlobal(table.visualRect(index).center())
    return [place.x(), place.y()]


def view_of(image: str) -> Any:
    """Return the panel's view of an image."""
    return next(view for view in panel().ui.grid.list_views() if view.image() == image)


def place_in(view: Any, sample: float, line: float) -> list[int]:
    """Return where on the screen a place of an image is; raise ValueError where its view shows another place."""
    at = view.canvas.getCoordinateTransform().transform(QgsPointXY(sample, -line))
    where = QPoint(round(at.x()), round(at.y()))
    if not view.canvas.viewport().rect().contains(where):
        raise ValueError(f"sample {sample}, line {line} of {view.image()} is out of view")
    place = view.canvas.viewport().mapToGlobal(where)
    return [place.x(), place.y()]


def save(path: str) -> None:
    """Save the panel's block under a name, as *Save as…* does after its dialog."""
    panel().files.save_as(path)


def later(action: Any) -> None:
    """Call something that may open a dialog once this request is answered."""
    QTimer.singleShot(0, action)


def windows() -> list[str]:
    """Return the titles of the windows and dialogs that are open."""
    return [one.windowTitle() for one in QApplication.topLevelWidgets() if one.isVisible() and one.windowTitle()]


def screenshot(path: str) -> bool:
    """Write a picture of the whole screen."""
    QApplication.processEvents()
    return bool(QApplication.primaryScreen().grabWindow(0).save(path))


def pixels() -> int:
    """Draw the map anew, and return how many of its pixels are not background."""
    canvas, loop = iface.mapCanvas(), QEventLoop()
    canvas.mapCanvasRefreshed.connect(loop.quit)
    QTimer.singleShot(20_000, loop.quit)
    canvas.refreshAllLayers()
    loop.exec()
    shown = canvas.grab().toImage().convertToFormat(4)
    bits = shown.bits()
    bits.setsize(shown.byteCount())
    colours = np.frombuffer(bits, np.uint32).reshape(shown.height(), -1)[4:-4, 4:-4] & 0xFFFFFF
    return int(np.sum(colours != 0xFFFFFF))


def seen(layers: dict[str, Any]) -> dict[str, int]:
    """Return how many pixels each layer draws alone, in a map of its extent.

    The canvas has the same size each time: docks that QGIS has opened since the first time are closed.
    """
    canvas, found = iface.mapCanvas(), {}
    docks = [dock for dock in iface.mainWindow().findChildren(QDockWidget) if dock.isVisible()]
    DOCKS.extend(docks if not DOCKS else ())
    for dock in docks:
        dock.setVisible(dock in DOCKS or dock.isFloating())
    for name, layer in layers.items():
        for node in QgsProject.instance().layerTreeRoot().findLayers():
            node.setItemVisibilityCheckedParentRecursive(True) if node.layer() is layer else None
            node.setItemVisibilityChecked(node.layer() is layer)
        QApplication.processEvents()
        canvas.setExtent(
            EXTENTS.setdefault(layer.id(), canvas.mapSettings().layerExtentToOutputExtent(layer, layer.extent()))
        )
        found[name] = pixels()
    return found


def _text(widget: Any) -> str:
    return widget.text().replace("&", "") if hasattr(widget, "text") else widget.objectName()


class Agent:
    """Answers one request after another, in the main thread of QGIS, also while a dialog is open."""

    def __init__(self, path: str) -> None:
        self.names, self.collected_s = dict(globals()), -COLLECT_EVERY_S
        # A function that refers to a connection and is called by its signal is a cycle that the collector may clear
        self.connections: list[tuple[Any, Any]] = []
        self.server = QLocalServer()
        self.server.newConnection.connect(self._on_connection)
        if not self.server.listen(path):
            raise OSError(self.server.errorString())

    def _on_connection(self) -> None:
        connection = self.server.nextPendingConnection()
        answer = partial(self._on_data, connection)
        connection.readyRead.connect(answer)
        self.connections.append((connection, answer))

    def _on_data(self, connection: Any) -> None:
        while connection.canReadLine():
            answer = self._answer(json.loads(bytes(connection.readLine())))
            connection.write(json.dumps(answer).encode() + b"\n")
            connection.flush()

    def _answer(self, request: dict[str, str]) -> dict[str, Any]:
        if time.monotonic() - self.collected_s > COLLECT_EVERY_S:
            gc.collect()  # what only Python held is gone, as after long use
            self.collected_s = time.monotonic()
        value, error = None, ""
        try:
            try:
                program = compile(request["code"], "<test>", "eval")
            except SyntaxError:
                exec(compile(request["code"], "<test>", "exec"), self.names)
                value = self.names.pop("result", None)
            else:
                value = eval(program, self.names)
            json.dumps(value)
        except TypeError:
            value, error = repr(value), traceback.format_exc() if value is None else ""
        except Exception:
            error = traceback.format_exc()
        uncaught, UNCAUGHT[:] = list(UNCAUGHT), []
        return {"value": value, "error": error, "uncaught": uncaught}


class Releases(QAbstractNativeEventFilter):
    """Counts the buttons and keys that the X server has told to be released: Qt passes them on before it goes on."""

    CORE, EXTENDED, KINDS = {3, 5}, 35, {3, 5}  # KeyRelease and ButtonRelease, of the core and of XInput 2

    def __init__(self) -> None:
        super().__init__()
        self.number = 0

    def nativeEventFilter(self, _kind: Any, message: Any) -> tuple[bool, int]:  # noqa: N802 (of Qt)
        start = ctypes.string_at(int(message), 10)
        code = start[0] & 0x7F
        self.number += code in self.CORE or (code == self.EXTENDED and start[8] in self.KINDS)
        return False, 0


def watch_exceptions() -> None:
    """Note every exception that reaches QGIS."""
    before = sys.excepthook

    def note(kind: Any, error: Any, trace: Any) -> None:
        UNCAUGHT.append("".join(traceback.format_exception(kind, error, trace)))
        before(kind, error, trace)

    sys.excepthook = note


def note_message(text: str, tag: str, level: int) -> None:
    """Note a critical message of QGIS's log."""
    if level == Qgis.MessageLevel.Critical:
        CRITICAL.append(f"{tag}: {text}")


if SOCKET_VARIABLE in os.environ:
    QgsApplication.messageLog().messageReceived.connect(note_message)
    iface.mainWindow().setGeometry(0, 0, *map(int, os.environ["HRSI_DESKTOP_SIZE"].split("x")))
    watch_exceptions()
    faulthandler.enable()  # what every thread does, into the log: at a crash, and when it is asked for
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    RELEASES = Releases()
    QApplication.instance().installNativeEventFilter(RELEASES)
    AGENT = Agent(os.environ[SOCKET_VARIABLE])
