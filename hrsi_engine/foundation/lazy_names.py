"""Faces of packages: the public names of a room, each imported when it is first asked for.

So a room can show what it offers without loading it: ``import hrsi.hrsi_engine.io`` opens no GDAL, and the command line
prints its help without the numerics (PEP 562).
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return what a package needs to show names of its modules: its ``__getattr__``, ``__dir__`` and ``__all__``.

    package : its ``__name__``
    modules : the names that each module gives, separated by blanks: ``{"errors": "HrsiError InputError"}``
    """
    where = {name: module for module, names in modules.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{where[name]}"), name)

    return get, lambda: sorted(where), sorted(where)
