"""Settings that all compiled loops share: whether numba compiles them, and with which options."""

import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

#: Options of numba: release the GIL, cache on disk, sums may be reordered, division by zero as in NumPy.
OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "error_model": "numpy",
}
Arrays = tuple[Any, ...]


def is_wanted(worth_it: bool = True) -> bool:
    """Return True if numba is installed, HRSI_COMPILED is not 0, and HRSI_COMPILED is 1 or ``worth_it`` is true."""
    setting = os.environ.get("HRSI_COMPILED")
    return setting != "0" and find_spec("numba") is not None and (setting == "1" or worth_it)


def register(*formulas: Callable[..., Any]) -> None:
    """Make functions, each written once for scalars and for arrays, callable from compiled loops; needs numba.

    The functions themselves are not changed. The cache of numba on disk checks the file of the calling loop only: after
    a change of a formula, remove the ``*.nbi`` in the ``__pycache__`` of the loops that call it.
    """
    from numba.extending import register_jitable

    for formula in formulas:
        register_jitable(**{name: OPTIONS[name] for name in ("fastmath", "error_model")})(formula)
