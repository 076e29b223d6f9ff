"""Stand-ins for QGIS on PyQt6, so that the plugin's own code runs on Qt 6 where no QGIS for it can be had.

`install` puts a package ``qgis`` into `sys.modules`: ``qgis.PyQt`` is PyQt6 with what QGIS 4 adds to it, a few classes
of ``qgis.core`` and ``qgis.gui`` do what the panel needs of them, every other name is a class that takes anything.
Only the plugin's Python and PyQt6 are what they are in QGIS 4: what QGIS itself does is not tested with these.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

from PyQt6 import QtCore, QtGui, QtWidgets, sip

PARTS = ("QtCore", "QtGui", "QtWidgets", "QtSvg", "QtTest", "QtXml")


class AnyEnumeration(type):
    """Has every attribute: ``Class.Enumeration.Value``."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return MagicMock(name=f"{cls.__name__}.{name}")


class Anything(metaclass=AnyEnumeration):
    """A class of QGIS of which nothing is asked."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self._told = MagicMock()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "_told":
            raise AttributeError(name)
        return getattr(self._told, name)


class Stand(ModuleType):
    """A module in which every name is there: `Anything`, where no stand-in says more."""

    __path__: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        setattr(self, name, made := type(name, (Anything,), {}))
        return made


class QgsPointXY:
    def __init__(self, x: float, y: float) -> None:
        self._xy = x, y

    def x(self) -> float:
        return self._xy[0]

    def y(self) -> float:
        return self._xy[1]


class QgsRectangle:
    def __init__(self, *sides: float) -> None:
        self.sides = sides

    def toString(self, _digits: int) -> str:
        return str(self.sides)

    def width(self) -> float:
        return self.sides[2] - self.sides[0]

    def isEmpty(self) -> bool:
        return False

    def xMinimum(self) -> float:
        return self.sides[0]

    def yMinimum(self) -> float:
        return self.sides[1]

    def center(self) -> QgsPointXY:
        west, south, east, north = self.sides
        return QgsPointXY((west + east) / 2.0, (south + north) / 2.0)


class QgsMapCanvas(QtWidgets.QGraphicsView):
    """Shows an extent; a click in it goes to the map tool."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.setScene(QtWidgets.QGraphicsScene(self))
        self._extent, self._tool, self._told = QgsRectangle(-60.0, -60.0, 60.0, 60.0), None, MagicMock()

    def setExtent(self, extent: QgsRectangle) -> None:
        self._extent = extent

    def extent(self) -> QgsRectangle:
        return self._extent

    def setMapTool(self, tool: Any) -> None:
        self._tool = tool

    def mapTool(self) -> Any:
        return self._tool

    def mousePressEvent(self, event: Any) -> None:
        west, south, east, north = self._extent.sides
        share_x, share_y = event.position().x() / self.width(), event.position().y() / self.height()
        place = QgsPointXY(west + share_x * (east - west), north - share_y * (north - south))
        self._tool.canvasClicked.emit(place, event.button())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "_told":
            raise AttributeError(name)
        return getattr(self._told, name)


class QgsMapCanvasItem(QtWidgets.QGraphicsItem):
    """Is drawn over the canvas, one pixel a unit of the map around its middle."""

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__()
        self._of = canvas
        canvas.scene().addItem(self)

    def toCanvasCoordinates(self, place: QgsPointXY) -> QtCore.QPointF:
        middle = self._of.extent().center()
        return QtCore.QPointF(place.x() - middle.x() + 100.0, middle.y() - place.y() + 100.0)


class QgsMapToolEmitPoint(QtCore.QObject):
    canvasClicked = QtCore.pyqtSignal(object, object)


class QgsTask(QtCore.QObject):
    progressChanged = QtCore.pyqtSignal(float)

    class Flag:
        CanCancel = 1

    def __init__(self, title: str = "", flags: Any = None) -> None:
        super().__init__()
        self._cancelled = False

    def setProgress(self, percent: float) -> None:
        self.progressChanged.emit(percent)

    def isCanceled(self) -> bool:
        return self._cancelled

    def cancel(self) -> None:
        self._cancelled = True


class _Tasks:
    """Runs each task when the events are handled next."""

    def __init__(self) -> None:
        self._waiting: list[QgsTask] = []

    def addTask(self, task: QgsTask) -> None:
        self._waiting.append(task)  # which keeps it alive
        QtCore.QTimer.singleShot(0, lambda: self._run(task))

    def _run(self, task: QgsTask) -> None:
        task.finished(task.run())
        self._waiting.remove(task)


class QgsApplication(Anything):
    TASKS = _Tasks()
    SETTINGS = ""

    @classmethod
    def taskManager(cls) -> _Tasks:
        return cls.TASKS

    @classmethod
    def qgisSettingsDirPath(cls) -> str:
        return cls.SETTINGS

    @staticmethod
    def locale() -> str:
        return "de"


class QgsProject(QtCore.QObject):
    readProject, cleared, writeProject = QtCore.pyqtSignal(object), QtCore.pyqtSignal(), QtCore.pyqtSignal(object)
    ONLY: Any = None

    @classmethod
    def instance(cls) -> QgsProject:
        cls.ONLY = cls.ONLY or cls()
        return cls.ONLY

    def mapLayers(self) -> dict[str, Any]:
        return {}

    def mapLayer(self, _name: str) -> None:
        return None

    def readEntry(self, _scope: str, _key: str, default: str) -> tuple[str, bool]:
        return default, True

    def writeEntry(self, *_given: str) -> bool:
        return True

    def writePath(self, path: str) -> str:
        return path


class QgsSettings:
    KEPT: dict[str, Any] = {}

    def value(self, key: str, default: Any = None, type: Any = None) -> Any:
        return self.KEPT.get(key, default)

    def setValue(self, key: str, value: Any) -> None:
        self.KEPT[key] = value


class QgsFileWidget(QtWidgets.QLineEdit):
    StorageMode = AnyEnumeration("StorageMode", (), {})

    def setStorageMode(self, _mode: Any) -> None: ...
    def setFilter(self, _files: str) -> None: ...
    def setFilePath(self, path: str) -> None:
        self.setText(path)

    def filePath(self) -> str:
        return self.text()

    @staticmethod
    def splitFilePaths(paths: str) -> list[str]:
        return [path for path in paths.split('"') if path.strip()]


class _NoCrs:
    def isValid(self) -> bool:
        return False


class QgsProjectionSelectionWidget(QtWidgets.QComboBox):
    CrsOption = AnyEnumeration("CrsOption", (), {})

    def setOptionVisible(self, *_given: Any) -> None: ...
    def crs(self) -> _NoCrs:
        return _NoCrs()


class QgsExtentWidget(QtWidgets.QLineEdit):
    WidgetStyle = AnyEnumeration("WidgetStyle", (), {})
    extentChanged, toggleDialogVisibility = QtCore.pyqtSignal(object), QtCore.pyqtSignal(bool)

    def __init__(self, parent: Any, _style: Any) -> None:
        super().__init__(parent)

    def setNullValueAllowed(self, _is_allowed: bool, text: str) -> None:
        self.setPlaceholderText(text)


class QgsAbstractProcessingParameterWidgetWrapper(QtCore.QObject):
    widgetValueHasChanged = QtCore.pyqtSignal(object)

    def __init__(self, definition: Any, _mode: Any = None) -> None:
        super().__init__()
        self._definition = definition

    def parameterDefinition(self) -> Any:
        return self._definition

    def widgetContext(self) -> Any:
        return MagicMock(mapCanvas=lambda: None)


class QgsApplicationExitBlockerInterface:
    """An interface of C++."""


class QgsVectorLayer(Anything):
    """No layer is one."""


class QgsRasterLayer(Anything):
    def __init__(self, source: str, *given: Any) -> None:
        super().__init__()
        self._source = source

    def source(self) -> str:
        return self._source

    def dataProvider(self) -> MagicMock:
        provider = MagicMock()
        provider.cumulativeCut.return_value = 0.0, 255.0
        return provider

    def bandCount(self) -> int:
        return 1


STAND_INS = {
    "core": (
        QgsPointXY, QgsRectangle, QgsTask, QgsApplication, QgsProject, QgsSettings, QgsVectorLayer, QgsRasterLayer,
    ),
    "gui": (
        QgsMapCanvas, QgsMapCanvasItem, QgsMapToolEmitPoint, QgsFileWidget, QgsProjectionSelectionWidget,
        QgsExtentWidget, QgsAbstractProcessingParameterWidgetWrapper, QgsApplicationExitBlockerInterface,
    ),
    "utils": (),
}  # fmt: skip


def install(settings: str) -> None:
    """Make ``import qgis`` give these; ``settings`` is the profile's folder."""
    QgsApplication.SETTINGS = settings
    sys.modules["qgis"] = Stand("qgis")
    for name, classes in STAND_INS.items():
        module = sys.modules[f"qgis.{name}"] = Stand(f"qgis.{name}")
        for made in classes:
            setattr(module, made.__name__, made)
    for name in ("processing", "processing.gui", "processing.gui.AlgorithmDialog"):
        sys.modules[name] = Stand(name)
    sys.modules["qgis.core"].NULL = None
    sys.modules["qgis.utils"].iface = None
    pyqt = sys.modules["qgis.PyQt"] = ModuleType("qgis.PyQt")
    pyqt.__path__ = []
    for name in PARTS:
        part = ModuleType(f"qgis.PyQt.{name}")
        part.__dict__.update({key: value for key, value in vars(importlib.import_module(f"PyQt6.{name}")).items()
                              if not key.startswith("__")})  # fmt: skip
        sys.modules[part.__name__] = part
        setattr(pyqt, name, part)
    sys.modules["qgis.PyQt.QtWidgets"].QAction = QtGui.QAction  # as QGIS 4 does
    pyqt.sip = sys.modules["qgis.PyQt.sip"] = sip
