"""Work in a background task of QGIS: the desktop stays alive, and the user can cancel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qgis.core import QgsApplication, QgsTask

from ..hrsi_engine.foundation.errors import Cancelled, HrsiError
from ..processing_algorithms import point_session
from ..processing_algorithms.point_session import PointSession, Snapshot
from .dependencies import missing_package_message
from .translation import tr

_BEGUN: set[BackgroundTask] = set()  # QGIS holds the C++ half of a task only: the Python half must outlive it


class BackgroundTask(QgsTask):
    """Runs `work` once it is started, and then, in the main thread, calls ``on_end`` with itself.

    ``failure`` says why it has come to nothing, empty where the user has cancelled. Nobody needs to hold one that has
    begun. Who waits for its end gives ``on_end`` instead of connecting to its signals: a function that holds a task and
    is held by its signals is a cycle that Python's collector may clear, in any thread, before the signal calls it.
    """

    def __init__(self, title: str, on_end: Callable[[Any], None]) -> None:
        super().__init__(title, QgsTask.Flag.CanCancel)
        self.failure = ""
        self.is_done = False
        self._on_end = on_end

    def start(self) -> None:
        """Hand it to the task manager of QGIS."""
        _BEGUN.add(self)
        QgsApplication.taskManager().addTask(self)

    def work(self) -> None:
        """Do it, with `progress` where it is to be cancelled."""
        raise NotImplementedError

    def run(self) -> bool:
        try:
            self.work()
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


class AdjustTask(BackgroundTask):
    """Adjusts what a session held when it was made (``seen``); ``adjusted`` holds the result, None without one."""

    def __init__(self, session: PointSession, model: str, save: bool, on_end: Callable[[Any], None]) -> None:
        super().__init__(tr("HRSI: adjusting the block"), on_end)
        self.seen, self.is_to_be_saved = Snapshot(session), save
        self._block, self._model, self._listed = point_session.block_of(session), model, frozenset(session.points)
        self.adjusted: Any = None

    def work(self) -> None:
        self.adjusted = point_session.adjust_block(self._block, self._model, self.progress, self._listed)
