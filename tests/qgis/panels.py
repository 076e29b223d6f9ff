"""What tests share: to wait, to close the panel, to run an algorithm as its dialog does, and a guard of threads."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from qgis import core
from qgis.core import (
    QgsApplication,
    QgsPointXY,
    QgsProcessingAlgorithm,
    QgsProcessingAlgRunnerTask,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProject,
)
from qgis.gui import QgsMapCanvas
from qgis.PyQt.QtCore import QEvent, QPoint, Qt
from qgis.PyQt.QtTest import QTest

from hrsi.plugin.points_panel.dock import PointsDock

#: Classes whose objects, or what their functions return, have a CRS.
WITH_CRS = (
    "QgsVectorLayer", "QgsRasterLayer", "QgsCoordinateReferenceSystem", "QgsCoordinateTransform", "QgsVectorFileWriter",
    "QgsProcessingParameters", "QgsReferencedRectangle", "QgsFeatureSource",
)  # fmt: skip


def wait_for(condition: Callable[[], bool], seconds: float = 240.0) -> None:
    """Let QGIS work until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        QgsApplication.processEvents()
        time.sleep(0.005)


def is_at_rest(panel: PointsDock) -> bool:
    """Whether nothing is looked for, drawn or adjusted any more."""
    drawing = any(view.canvas.isDrawing() for view in panel.ui.grid.list_views())
    return not (panel.search.is_running() or panel.adjustment.is_waiting() or panel.adjustment.is_running() or drawing)


def click_on(canvas: QgsMapCanvas, place: tuple[float, float]) -> None:
    """Click over a place in map coordinates as a mouse does; it must be in view."""
    at = canvas.getCoordinateTransform().transform(QgsPointXY(*place))
    where = QPoint(round(at.x()), round(at.y()))
    assert canvas.viewport().rect().contains(where), "what is to be clicked is out of view"
    QTest.mouseClick(canvas.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, where)


def click_in_image(panel: PointsDock, image: str, place: tuple[float, float]) -> None:
    """Click over a place (sample, line) of an image that the panel shows."""
    click_on(panel.ui.grid.find_view(image).canvas, (float(place[0]), -float(place[1])))


def close(panel: PointsDock) -> None:
    """Delete the panel, as when QGIS ends."""
    panel.shut_down()
    panel.deleteLater()
    QgsApplication.sendPostedEvents(panel, QEvent.Type.DeferredDelete)


def run_in_background(
    algorithm: QgsProcessingAlgorithm, parameters: dict[str, Any], feedback: QgsProcessingFeedback | None = None,
    context: QgsProcessingContext | None = None,
) -> tuple[bool, dict[str, Any]]:  # fmt: skip
    """Run an algorithm in a task of the task manager while the event loop turns; return success and results."""
    if context is None:
        context = QgsProcessingContext()
        context.setProject(QgsProject.instance())
    feedback = feedback or QgsProcessingFeedback()  # the task does not own it
    task = QgsProcessingAlgRunnerTask(algorithm, parameters, context, feedback)
    ended: list[tuple[bool, dict[str, Any]]] = []
    task.executed.connect(lambda successful, results: ended.append((successful, results)))
    QgsApplication.taskManager().addTask(task)
    wait_for(lambda: bool(ended), 300.0)
    return ended[0]


class _Guarded(type):
    """A class of QGIS that raises where it is used in another thread than the main one."""

    def _allow(cls) -> None:
        thread = threading.current_thread()
        assert thread is threading.main_thread(), f"{cls.__name__} is used in {thread.name}"

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        cls._allow()
        return cls.real(*args, **kwargs)

    def __instancecheck__(cls, instance: object) -> bool:
        return isinstance(instance, cls.real)

    def __getattr__(cls, name: str) -> Any:
        if callable(found := getattr(cls.real, name)):
            cls._allow()
        return found


@contextmanager
def guarded_threads() -> Iterator[None]:
    """Let the plugin's modules raise where one of them uses a class of `WITH_CRS` outside the main thread."""
    modules = [module for name, module in sys.modules.items() if name.startswith("hrsi.plugin")]
    patches = [
        patch.object(module, name, _Guarded(name, (), {"real": getattr(core, name)}))
        for module in modules for name in WITH_CRS if name in vars(module)
    ]  # fmt: skip
    for one in patches:
        one.start()
    try:
        yield
    finally:
        for one in patches:
            one.stop()
