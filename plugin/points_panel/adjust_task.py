"""The adjustment of what the panel holds, in the background."""

from collections.abc import Callable
from typing import Any

from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession, Snapshot
from ..background_task import BackgroundTask
from ..translation import tr


class AdjustTask(BackgroundTask):
    """Adjusts what a session held when it was made (``seen``); ``adjusted`` holds the result, None without one."""

    def __init__(self, session: PointSession, model: str, save: bool, on_end: Callable[[Any], None]) -> None:
        super().__init__(tr("HRSI: adjusting the block"), on_end)
        self.seen, self.is_to_be_saved = Snapshot(session), save
        self._block, self._model, self._listed = point_session.block_of(session), model, frozenset(session.points)
        self.adjusted: Any = None

    def work(self) -> None:
        self.adjusted = point_session.adjust_block(self._block, self._model, self.progress, self._listed)
