"""The adjustment as a background task of QGIS: the desktop stays alive, and the user can cancel."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsTask

from ...hrsi_engine.foundation.errors import Cancelled, HrsiError
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession, Snapshot
from ..dependencies import missing_package_message
from ..translation import tr


class AdjustTask(QgsTask):
    """Adjusts what a session held when it was made (``seen``).

    ``adjusted`` holds the result, or ``failure`` why there is none (empty: cancelled).
    """

    def __init__(self, session: PointSession, model: str, save: bool) -> None:
        super().__init__(tr("HRSI: adjusting the block"), QgsTask.Flag.CanCancel)
        self.seen, self.is_to_be_saved = Snapshot(session), save
        self._block, self._model, self._listed = point_session.block_of(session), model, frozenset(session.points)
        self.adjusted: Any = None
        self.failure = ""

    def run(self) -> bool:
        try:
            self.adjusted = point_session.adjust_block(self._block, self._model, self._progress, self._listed)
        except Cancelled:
            return False
        except HrsiError as error:
            self.failure = str(error)
        except ImportError as error:
            self.failure = missing_package_message(error) or repr(error)
        except Exception as error:  # in a thread of QGIS it would vanish
            self.failure = f"{type(error).__name__}: {error}"
        return self.adjusted is not None

    def _progress(self, fraction: float, message: str = "") -> bool:
        self.setProgress(100.0 * fraction)
        return not self.isCanceled()
