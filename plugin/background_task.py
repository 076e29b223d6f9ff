"""Work in a background task of QGIS: the desktop stays alive, and the user can cancel."""

from __future__ import annotations

from qgis.core import QgsTask

from ..hrsi_engine.foundation.errors import Cancelled, HrsiError
from .dependencies import missing_package_message


class BackgroundTask(QgsTask):
    """Runs `work`; ``failure`` says why it has come to nothing, empty where the user has cancelled."""

    def __init__(self, title: str) -> None:
        super().__init__(title, QgsTask.Flag.CanCancel)
        self.failure = ""

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

    def progress(self, fraction: float, message: str = "") -> bool:
        """Show how far it is; return False once the user has cancelled."""
        self.setProgress(100.0 * fraction)
        return not self.isCanceled()
