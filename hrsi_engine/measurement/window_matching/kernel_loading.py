"""Loading of the compiled loops at their first use: the other modules work without numba."""

from importlib import import_module
from typing import Any

from ...foundation.packages import require_package


def load_kernels() -> Any:
    """Return the module `lsm_kernels`; raise `MissingPackageError` without numba."""
    require_package("numba")
    return import_module(".lsm_kernels", __package__)
