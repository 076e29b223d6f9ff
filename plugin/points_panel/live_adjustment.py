"""Adjustment of the panel's session in the background: on request, and after each series of edits if it is quick."""

import time
from functools import partial
from typing import Any

from qgis.PyQt.QtCore import QObject, pyqtSignal

from ...hrsi_engine.foundation.progress import Progress
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from ..background_task import BackgroundTask
from ..translation import tr
from .actions import make_pause

PAUSE_MS = 300  # without a further edit, until the block is adjusted again
QUICK_S = 10.0  # CPU time up to which an adjustment is repeated after each edit; residuals follow edits in any case


class LiveAdjustment(QObject):
    """Adjusts one session at a time; ``failure`` is the reason why the last adjustment failed."""

    progressed = pyqtSignal(float)  #: per cent
    due = pyqtSignal()  #: the edits have settled: the block should be adjusted
    ended = pyqtSignal(object, bool)  #: the ended task, and whether the user has requested it

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.session = PointSession()
        self.failure = ""
        self.duration_s = 0.0  # CPU time of the last adjustment
        self._task: BackgroundTask | None = None
        self._pause = make_pause(self, PAUSE_MS, self.due)

    def watch(self, session: PointSession) -> None:
        """Adjust another session from now on; the end of a running adjustment is ignored."""
        self.cancel()
        self._pause.stop()
        self._task, self.session, self.failure = None, session, ""

    def is_running(self) -> bool:
        return self._task is not None

    def is_waiting(self) -> bool:
        """Whether an adjustment will begin when the edits have settled."""
        return self._pause.isActive()

    def start(self, model: str, is_asked: bool) -> None:
        """Adjust the present measurements, unless an adjustment is running; `ended` is emitted at the end.

        Raises `InputError` if nothing is measured.
        """
        if self._task is not None:
            return
        session = self.session
        adjust = partial(point_session.adjust_block, point_session.block_of(session), model)

        def work(progress: Progress) -> Any:
            began_s = time.thread_time()
            adjusted = adjust(progress=progress, listed=frozenset(session.points))
            self.duration_s = time.thread_time() - began_s
            return adjusted

        on_end = partial(self._on_end, point_session.Snapshot(session), is_asked)
        self._task = BackgroundTask(tr("HRSI: adjusting the block"), work, on_end)
        self._task.progressChanged.connect(self.progressed)
        self._task.start()

    def follow_edit(self) -> None:
        """Update cameras and residuals to the edited measurements; adjust the block again soon if that is quick."""
        if self.duration_s < QUICK_S:
            self._pause.start()
        if self.session.adjusted is not None:
            self.session.follow(point_session.follow(self.session))

    def is_needed(self) -> bool:
        """Whether there are measurements that no adjustment contains, and none is running."""
        return self._task is None and bool(self.session.measured) and not self.session.is_adjusted

    def cancel(self) -> None:
        """Ask a running adjustment to stop."""
        if self._task is not None:
            self._task.cancel()

    def _on_end(self, seen: Any, is_asked: bool, task: BackgroundTask) -> None:
        """Give the adjustment of the state ``seen`` at its start to the session."""
        if task is not self._task:
            return
        self._task, self.failure = None, task.failure
        if task.outcome is not None:
            self.session.accept(task.outcome, seen)
        self.ended.emit(task, is_asked)
