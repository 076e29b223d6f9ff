"""Lazy import of the public names of a package: each module is imported when one of its names is first used (PEP 562).

``import hrsi.hrsi_engine.io`` therefore does not load GDAL, and the command line prints its help without loading NumPy
and SciPy.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package that imports public names from its modules.

    package : its ``__name__``
    modules : the names that each module defines, separated by blanks: ``{"errors": "HrsiError InputError"}``
    """
    module_of = {name: module for module, names in modules.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{module_of[name]}"), name)

    return get, lambda: sorted(module_of), sorted(module_of)
