"""HRSI: block triangulation of high-resolution satellite images with RPC cameras.

Every algorithm of the command line and of the QGIS toolbox is a function here, with the same options and defaults::

    import hrsi

    result = hrsi.triangulate(["a.tif", "b.tif"], gcps="gcps.gpkg", output_dir="result")
    print(result.summary())       # what the command line prints
    result.residuals              # tables: pandas where it is installed
    result.rpcs["a"]              # the refined RPCs

Images are paths, open rasterio datasets or what `open` returned; points are files, tables of pandas or GeoPandas, dicts
of columns, arrays, or `GroundPoints` and `ImagePoints`. `project` and `localize` take arrays and return arrays.
`read_result` reads what an earlier run left in a folder. Errors are `HrsiError`.

The engine below, arrays and objects without files, is `hrsi.hrsi_engine`. The folder is also the QGIS plugin.
"""

from __future__ import annotations

import os
import signal
import sys

_words = getattr(sys, "orig_argv", ())[1:]  # as Python was started: a program, or -m and a module
_modules = {_words[k + 1] for k, word in enumerate(_words[:-1]) if word == "-m"}
_is_program = bool(_modules & {__name__, f"{__name__}.processing_algorithms.command_line.cli"}) or __name__ in [
    os.path.basename(word).split(".")[0] for word in _words[:1]
]
if _is_program and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends the process, until the command has its own handler

from typing import TYPE_CHECKING, Any  # noqa: E402

from .hrsi_engine.foundation.lazy_names import lazy_names  # noqa: E402
from .hrsi_engine.foundation.version import VERSION  # noqa: E402

if _is_program:
    from .hrsi_engine.foundation.interruption import quit_on_signals

    quit_on_signals()  # with a line that says so; the packages above a module are loaded before it runs

if TYPE_CHECKING:
    from .plugin.old_python import OldPythonPlugin
    from .plugin.plugin import HrsiPlugin

OLDEST_PYTHON = (3, 11)
__version__ = VERSION
__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "processing_algorithms.facade.calls": (
            "triangulate tie_points adjust evaluate refine write_rpc crop strip hand_over rpc_info project localize "
            "fit_rpc gcps_from_reference interest_points match measure_targets orthorectify ortho_check run simulate "
            "surface_model register init open"
        ),
        "processing_algorithms.facade.result": "Result read_result",
        "hrsi_engine": "RPC Block GroundPoints HrsiError Image ImagePoints MODELS Role read_rpc refine_rpc",
    },
)


def classFactory(iface: Any) -> HrsiPlugin | OldPythonPlugin:  # noqa: N802 - the name that QGIS calls
    """Make the QGIS plugin; qgis is imported here and not before."""
    if sys.version_info[:2] < OLDEST_PYTHON:
        from .plugin.old_python import OldPythonPlugin

        return OldPythonPlugin(iface)
    from .plugin.plugin import HrsiPlugin

    return HrsiPlugin(iface)
