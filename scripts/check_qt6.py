"""Find enumeration values without the name of their enumeration, which Qt 6 and QGIS 4 refuse: ``Qt.DisplayRole``.

``python scripts/check_qt6.py FOLDER`` reads the sources and looks the names up in the QGIS that is installed. What
flake8-qgis finds (PyQt5 imported directly, ``exec_``, …) is its affair.
"""

import ast
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

LIBRARIES = ("qgis.core", "qgis.gui", "qgis.analysis", "qgis.PyQt")


def main(folder: str) -> int:
    """Print what is found; return the exit code."""
    found = [line for path in sorted(Path(folder).rglob("*.py")) for line in unscoped(path)]
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


def unscoped(path: Path) -> Iterator[str]:
    """Yield a line for each value of an enumeration that is named without it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    classes = imported_classes(tree)
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in classes):
            continue
        enumeration = enumeration_of(classes[node.value.id], node.attr)
        if enumeration:
            name = f"{node.value.id}.{node.attr}"
            yield f"{path}:{node.lineno}: {name}: write {node.value.id}.{enumeration}.{node.attr}"


def imported_classes(tree: ast.AST) -> dict[str, Any]:
    """Return the classes of QGIS and Qt that a module imports, by the name they have there."""
    classes = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(LIBRARIES):
            module = importlib.import_module(node.module or "")
            classes |= {alias.asname or alias.name: getattr(module, alias.name, None) for alias in node.names}
    return classes


def enumeration_of(owner: Any, name: str) -> str:
    """Return the enumeration whose value ``owner.name`` is; empty where it is something else."""
    value = getattr(owner, name, None)
    enumeration = type(value).__name__
    return enumeration if not isinstance(value, type) and isinstance(getattr(owner, enumeration, None), type) else ""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
