"""Check that the public API is described: parameters with shapes and units, what is returned, what is raised.

``python scripts/check_docstrings.py`` asks every room of the engine for the names on its face (``__all__``) and has
numpydoc validate the docstring of each function, each class and its public methods (NumPy's docstring standard).
It does not look at what a body raises; that is read from the source here. A method of a protocol may say "As
`HeightSurface.heights`." and no more.
"""

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import EnumMeta
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

from numpydoc.validate import validate

ROOT = Path(__file__).resolve().parents[1]
ENGINE = "hrsi.hrsi_engine"
#: What numpydoc must not find: sections missing or out of order, no or unknown parameters, no descriptions, no returns.
FAULTS = {
    "GL03", "GL06", "GL07", "GL08", "SS01", "SS02", "SS03", "SS04",
    "PR01", "PR02", "PR03", "PR04", "PR07", "PR10", "RT01", "RT03", "YD01",
}  # fmt: skip
#: How a method says that it does what another one is described to do.
AS_ANOTHER = re.compile(r"As `(\w+\.\w+)`")


def rooms() -> list[str]:
    """Return the engine and its rooms, by the names they are imported by."""
    folders = sorted(path.parent for path in (ROOT / "hrsi_engine").glob("*/__init__.py"))
    return [ENGINE, *(f"{ENGINE}.{folder.name}" for folder in folders)]


def public_api() -> dict[str, Any]:
    """Return the functions and classes that the faces show, and the classes' methods, by the names of their homes."""
    found: dict[str, Any] = {}
    for room in rooms():
        face = import_module(room)
        for value in (getattr(face, name) for name in getattr(face, "__all__", ())):
            if not isinstance(value, FunctionType | type) or not value.__module__.startswith(ENGINE):
                continue  # constants are described where they stand
            home = f"{value.__module__}.{value.__qualname__}"
            found[home] = value
            if isinstance(value, type):
                found |= {f"{home}.{name}": method for name, method in methods_of(value)}
    return found


def methods_of(owner: type) -> Iterator[tuple[str, Any]]:
    """Yield the public methods that a class itself defines; generated ones have no source."""
    for name, member in vars(owner).items():
        function = getattr(member, "__func__", member)
        if not name.startswith("_") and isinstance(function, FunctionType) and "<" not in function.__code__.co_filename:
            yield name, function


def faults_of(name: str, value: Any) -> Iterator[str]:
    """Yield what is wrong with one docstring."""
    docstring = inspect.getdoc(value) or ""
    if AS_ANOTHER.match(docstring):
        return
    made_elsewhere = isinstance(value, EnumMeta) or getattr(value, "_is_protocol", False)  # nobody calls these classes
    for code, message in validate(name)["errors"]:
        if code == "PR01":
            missing = ast.literal_eval(message[message.index("{") : message.index("}") + 1]) - told_by_options(value)
            if missing and not made_elsewhere:
                yield f"{code} {', '.join(sorted(missing))} not described"
        elif code in FAULTS:
            yield f"{code} {message}"
    if isinstance(value, FunctionType) and raises(value) and "Raises\n---" not in docstring:
        yield f"raises {', '.join(sorted(raises(value)))} and has no section Raises"


def told_by_options(value: Any) -> set[str]:
    """Return the fields of a dataclass that are options: their help stands with them."""
    return {part.name for part in fields(value) if part.metadata} if is_dataclass(value) else set()


def raises(function: FunctionType) -> set[str]:
    """Return the errors that a function's own statements raise."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    named = (node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise) and node.exc)
    return {ast.unparse(error.func if isinstance(error, ast.Call) else error) for error in named}


def main() -> int:
    """Print the faults; return the exit code."""
    api = public_api()
    found = [
        f"{inspect.getsourcefile(value)}:{inspect.getsourcelines(value)[1]}: {name.removeprefix(f'{ENGINE}.')}: {fault}"
        for name, value in sorted(api.items())
        for fault in faults_of(name, value)
    ]
    print("\n".join(line.removeprefix(f"{ROOT}/") for line in found) or f"docstrings: {len(api)} of the public API")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
