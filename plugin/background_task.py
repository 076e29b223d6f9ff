"""Work in a background task of QGIS: the desktop stays alive, and the user can cancel."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from qgis.core import QgsApplication, QgsTask

from ..hrsi_engine.foundation.errors import Cancelled, HrsiError
from ..hrsi_engine.foundation.progress import Progress
from .dependencies import missing_package_message

_BEGUN: set[BackgroundTask] = set()  # QGIS holds the C++ half of a task only: the Python half must outlive it


def run_apart(work: Callable[[], Any]) -> Any:
    """Return what ``work`` returns; where a thread of QGIS calls, it runs in a thread that Python has made.

    Python has a state for a thread of QGIS during one call only. pyproj 3.7 frees its context with that state, and
    finds the freed one again in the next call of that thread, which ends QGIS (pyproj4/pyproj, issue 1622).
    """
    if threading.get_ident() == threading.main_thread().ident:
        return work()
    with ThreadPoolExecutor(1) as apart:
        return apart.submit(work).result()


class BackgroundTask(QgsTask):
    """Calls ``work`` with its progress once it is started, and then, in the main thread, ``on_end`` with itself.

    ``outcome`` is what ``work`` has returned, None without; what it needs it has to hold itself.
    ``failure`` says why it has come to nothing, empty where the user has cancelled. Nobody needs to hold one that has
    begun. Who waits for its end gives ``on_end`` instead of connecting to its signals: a function that holds a task and
    is held by its signals is a cycle that Python's collector may clear, in any thread, before the signal calls it.
    """

    def __init__(self, title: str, work: Callable[[Progress], Any], on_end: Callable[[Any], None]) -> None:
        super().__init__(title, QgsTask.Flag.CanCancel)
        self.failure = ""
        self.is_done = False
        self.outcome: Any = None
        self._work, self._on_end = work, on_end

    def start(self) -> None:
        """Hand it to the task manager of QGIS."""
        _BEGUN.add(self)
        QgsApplication.taskManager().addTask(self)

    def run(self) -> bool:
        try:
            self.outcome = run_apart(lambda: self._work(self.progress))
        except Cancelled:
            return False
        except HrsiError as error:
            self.failure = str(error)
        except ImportError as error:
            self.failure = missing_package_message(error) or repr(error)
        except Exception as error:  # in a thread of QGIS it would vanish
            self.failure = f"{type(error).__name__}: {error}"
        return not self.failure

    def finished(self, result: bool) -> None:
        """Tell who waits; called by QGIS in the main thread, also for a task that was cancelled before it began."""
        _BEGUN.discard(self)
        self.is_done = result
        self._on_end(self)

    def progress(self, fraction: float, message: str = "") -> bool:
        """Show how far it is; return False once the user has cancelled."""
        self.setProgress(100.0 * fraction)
        return not self.isCanceled()
