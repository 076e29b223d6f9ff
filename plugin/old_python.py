"""The plugin in a QGIS whose Python is too old: a message. This file must not need a newer Python."""

from __future__ import annotations

import sys
from typing import Any

from qgis.core import Qgis, QgsMessageLog


def old_python_message() -> str:
    """Return a message on the version of Python that is needed, and the versions of QGIS that have it."""
    version = ".".join(map(str, sys.version_info[:3]))
    return (
        f"HRSI needs Python 3.11 or later, and this QGIS ({Qgis.QGIS_VERSION}) runs on Python {version}. "
        "QGIS for Windows brings Python 3.12 since 3.34.6; on Linux it is the Python of the system, "
        "3.11 or later from Debian 12 and Ubuntu 24.04 on."
    )


class OldPythonPlugin:
    """Shows the message in the log, and on the desktop above the map; ``iface`` is None in ``qgis_process``."""

    def __init__(self, iface: Any) -> None:
        self.iface = iface

    def initProcessing(self) -> None:
        QgsMessageLog.logMessage(old_python_message(), "HRSI", Qgis.MessageLevel.Critical)

    def initGui(self) -> None:
        self.initProcessing()
        self.iface.messageBar().pushMessage("HRSI", old_python_message(), Qgis.MessageLevel.Critical, 0)

    def unload(self) -> None:
        """Nothing to remove."""
