"""Background tasks of QGIS: the window remains responsive, and the user can cancel.

QGIS caches each CRS with the PROJ context of the thread that made it. When that thread ends (Qt's pool ends idle
threads after 30 s), every layer with this CRS is drawn without transformation, and disappears from the map. This is a
fault of QGIS (seen in 3.22.16 with a `QgsTask` that makes a `QgsVectorLayer`), and
``QgsCoordinateReferenceSystem.invalidateCache()`` heals a session. Therefore the plugin makes objects of QGIS that have
a CRS in the main thread only: in functions with `in_main_thread`. QGIS itself makes layers in the thread of a model:
`keep_threads` lets these threads live.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar

from qgis.core import QgsApplication, QgsTask
from qgis.PyQt.QtCore import QObject, QThreadPool, pyqtSignal

from ..hrsi_engine.foundation.errors import Cancelled, HrsiError, MissingPackageError
from ..hrsi_engine.foundation.progress import Progress
from .dependencies import missing_package_message

CallArguments = ParamSpec("CallArguments")
CallResult = TypeVar("CallResult")
PATIENCE_S, POLL_S = 0.5, 0.1
NEVER_MS = -1  # threads of Qt's pool do not end
_BEGUN: set[BackgroundTask] = set()  # QGIS keeps only the C++ half of a task: the Python half must exist as long


class _MainThread(QObject):
    """Calls functions of other threads in the thread in which this module was imported, the main thread."""

    handed_over = pyqtSignal(object, object)

    def __init__(self) -> None:
        super().__init__()
        self.handed_over.connect(self._call)

    def _call(self, work: Callable[[], Any], result: Future[Any]) -> None:
        try:
            result.set_result(work())
        except BaseException as error:  # raised where the result is waited for
            result.set_exception(error)


_MAIN = _MainThread()


def in_main_thread(function: Callable[CallArguments, CallResult]) -> Callable[CallArguments, CallResult]:
    """Return the function so that it always runs in the main thread; other threads wait for its result.

    QGIS prepares and ends the steps of a model in the model's thread.
    """

    @wraps(function)
    def call(*args: CallArguments.args, **kwargs: CallArguments.kwargs) -> CallResult:
        if threading.current_thread() is threading.main_thread():
            return function(*args, **kwargs)
        result: Future[CallResult] = Future()
        _MAIN.handed_over.emit(partial(function, *args, **kwargs), result)
        return result.result()

    return call


def keep_threads() -> None:
    """Let idle threads of Qt's pool live as long as QGIS: they may have made a CRS that layers use."""
    pool: Any = QThreadPool.globalInstance()
    pool.setExpiryTimeout(NEVER_MS)


def run_apart(work: Callable[[], Any], is_cancelled: Callable[[], bool] = lambda: False) -> Any:
    """Return the result of ``work``; if the caller is a thread of QGIS, run it in a thread made by Python.

    For a thread of QGIS, Python has a thread state during one call only. pyproj 3.7 frees its context with that state,
    and uses the freed one in the next call of that thread, which crashes QGIS (pyproj4/pyproj, issue 1622).

    Raises `Cancelled` if the work continues for `PATIENCE_S` after the user has cancelled, as while loops are compiled:
    it ends itself at its next report of progress, which must return False then.
    """
    if threading.get_ident() == threading.main_thread().ident:
        return work()
    apart, end_s = ThreadPoolExecutor(1), math.inf
    result = apart.submit(work)
    apart.shutdown(wait=False)
    while time.monotonic() < end_s:
        with suppress(TimeoutError):
            return result.result(timeout=POLL_S)
        if result.done():
            return result.result()  # work that has raised a TimeoutError
        if end_s == math.inf and is_cancelled():
            end_s = time.monotonic() + PATIENCE_S
    raise Cancelled("cancelled; nothing was written")


class BackgroundTask(QgsTask):
    """Calls ``work`` with a progress callback when it is started, and then ``on_end`` with itself in the main thread.

    ``outcome`` is the result of ``work``, None without a result; ``work`` must keep references to what it needs.
    ``failure`` is the reason of a failure, empty if the user has cancelled. A started task needs no other reference.
    To be informed of its end, give ``on_end`` instead of connecting to its signals: a function that references a task,
    and is referenced by its signals, is a cycle that Python's collector may clear, in any thread, before the call.
    """

    def __init__(self, title: str, work: Callable[[Progress], Any], on_end: Callable[[Any], None]) -> None:
        super().__init__(title, QgsTask.Flag.CanCancel)
        self.failure = ""
        self.is_done = self._is_given_up = False
        self.outcome: Any = None
        self._work, self._on_end = work, on_end

    def start(self) -> None:
        """Add the task to the task manager of QGIS."""
        _BEGUN.add(self)
        QgsApplication.taskManager().addTask(self)

    def run(self) -> bool:
        try:
            self.outcome = run_apart(lambda: self._work(self.progress), self.isCanceled)
        except Cancelled:
            self._is_given_up = True  # the work may still continue
            return False
        except (MissingPackageError, ImportError) as error:
            self.failure = missing_package_message(error) or repr(error)
        except HrsiError as error:
            self.failure = str(error)
        except Exception as error:  # in a thread of QGIS it would not be shown
            self.failure = f"{type(error).__name__}: {error}"
        return not self.failure

    def finished(self, result: bool) -> None:
        """Call ``on_end``; QGIS calls this in the main thread, also for a task that was cancelled before it began."""
        _BEGUN.discard(self)
        self.is_done = result
        self._on_end(self)

    def progress(self, fraction: float, message: str = "") -> bool:
        """Set the progress of the task; return False if the user has cancelled."""
        if self._is_given_up:  # QGIS may have deleted its half of the task
            return False
        self.setProgress(100.0 * fraction)
        return not self.isCanceled()
