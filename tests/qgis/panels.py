"""What tests of the measuring panel share: to wait for it, and to close it for good."""

from __future__ import annotations

import time
from collections.abc import Callable

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QEvent

from hrsi.plugin.points_panel.dock import PointsDock


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    """Let QGIS work until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        QgsApplication.processEvents()
        time.sleep(0.005)


def close(panel: PointsDock) -> None:
    """Delete the panel, as when QGIS ends."""
    panel.shut_down()
    panel.deleteLater()
    QgsApplication.sendPostedEvents(panel, QEvent.Type.DeferredDelete)
