"""What all compiled loops have in common: whether numba compiles them, and how."""

import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

#: How loops are compiled: without the interpreter's lock, kept on disk, sums in any order, divisions as in NumPy.
OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "error_model": "numpy",
}
Arrays = tuple[Any, ...]


def is_wanted(worth_it: bool = True) -> bool:
    """Tell whether to use compiled loops: numba is there, HRSI_COMPILED is not 0, and is 1 or the work is worth it."""
    setting = os.environ.get("HRSI_COMPILED")
    return setting != "0" and find_spec("numba") is not None and (setting == "1" or worth_it)


def register(*formulas: Callable[..., Any]) -> None:
    """Let compiled loops call functions that are written once for numbers and for arrays; needs numba.

    The functions themselves stay as they are: NumPy's users need no numba. numba's cache on disk looks at the file of a
    loop alone: whoever changes a formula removes the ``*.nbi`` in the ``__pycache__`` of the loops that call it.
    """
    from numba.extending import register_jitable

    for formula in formulas:
        register_jitable(**{name: OPTIONS[name] for name in ("fastmath", "error_model")})(formula)
