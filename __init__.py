"""HRSI: block triangulation of high-resolution satellite images. The folder is a Python package and a QGIS plugin."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if f"{__name__}.processing_algorithms.interface.cli" in getattr(sys, "orig_argv", ()):
    from .hrsi_engine.foundation.interruption import quit_on_signals

    quit_on_signals()  # ``python -m`` loads all packages above a module before it runs

if TYPE_CHECKING:
    from .plugin.plugin import HrsiPlugin


def classFactory(iface: Any) -> HrsiPlugin:  # noqa: N802 - the name that QGIS calls
    """Make the QGIS plugin; qgis is imported here and not before."""
    from .plugin.plugin import HrsiPlugin

    return HrsiPlugin(iface)
