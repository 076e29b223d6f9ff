"""Imports go one way, and only the edges know GDAL and QGIS; read from the source, nothing is imported.

plugin -> processing_algorithms -> results -> io | algorithms -> block -> surface -> camera -> ground -> foundation
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("hrsi_engine", "plugin", "processing_algorithms")

#: What a room may import besides itself, by the longest fitting prefix of a module's name: the floors of the house,
#: from the ground up.
FOUNDATION = {"hrsi_engine.foundation"}
GROUND = FOUNDATION | {"hrsi_engine.ground"}
CAMERA = GROUND | {"hrsi_engine.camera"}
SURFACE = CAMERA | {"hrsi_engine.surface"}
BLOCK = SURFACE | {"hrsi_engine.block"}
ADJUSTMENT = BLOCK | {"hrsi_engine.refinement", "hrsi_engine.adjustment"}
ALLOWED: dict[str, set[str]] = {
    "hrsi_engine.foundation": set(),
    "hrsi_engine.ground": FOUNDATION,
    "hrsi_engine.camera": GROUND,
    "hrsi_engine.surface": CAMERA,
    "hrsi_engine.block": SURFACE,
    "hrsi_engine.drawing": BLOCK,
    "hrsi_engine.refinement": BLOCK,
    "hrsi_engine.measurement": BLOCK,
    "hrsi_engine.simulation": BLOCK,
    "hrsi_engine.ortho": BLOCK | {"hrsi_engine.measurement.window_matching"},
    "hrsi_engine.adjustment": ADJUSTMENT,
    "hrsi_engine.io": BLOCK | {"hrsi_engine.drawing"},
    "hrsi_engine.results": ADJUSTMENT | {"hrsi_engine.drawing", "hrsi_engine.io"},
    "hrsi_engine": {"hrsi_engine"},  # the public names; its modules have their own rules
    "processing_algorithms": {"hrsi_engine"},
    "plugin": {"processing_algorithms", "hrsi_engine.foundation"},
}
#: Packages that only one part may import.
KEPT_TO = {"osgeo": "hrsi_engine.io", "qgis": "plugin", "processing": "plugin"}
#: Packages that nothing may import: they bring a second GDAL, or belong to the tests.
BARRED = {"rasterio", "fiona", "pyogrio", "shapely", "geopandas", "pytest"}
#: Calls that open a path; only the readers and writers may.
OPENERS = {"open", "read_text", "read_bytes", "write_text", "write_bytes"}


class Import(NamedTuple):
    """One import statement: where it stands and what it names; ``inside`` of this package or not."""

    module: str
    line: int
    target: str
    inside: bool


def module_name(path: Path) -> str:
    """Return ``hrsi_engine.io.rasters`` for that file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {path: module_name(path) for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))}
MODULES = set(SOURCES.values())


def imports(path: Path) -> list[Import]:
    """Return every import of a file, also those inside functions and under TYPE_CHECKING."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [Import(SOURCES[path], node.lineno, alias.name, False) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += from_imports(path, node)
    return found


def from_imports(path: Path, node: ast.ImportFrom) -> list[Import]:
    """Return the modules that ``from … import …`` names: ``from . import x`` means x where that is a module."""
    if not node.level:
        return [Import(SOURCES[path], node.lineno, node.module or "", False)]
    package = SOURCES[path].split(".") if path.name == "__init__.py" else SOURCES[path].split(".")[:-1]
    base = package[: len(package) - node.level + 1] + (node.module.split(".") if node.module else [])
    targets = {".".join([*base, alias.name]) for alias in node.names}
    modules = {target if target in MODULES else ".".join(base) for target in targets}
    return [Import(SOURCES[path], node.lineno, module, True) for module in sorted(modules)]


def is_below(module: str, part: str) -> bool:
    return module == part or module.startswith(f"{part}.")


def rule_of(module: str) -> str:
    """Return the longest entry of `ALLOWED` that a module falls under."""
    return max((part for part in ALLOWED if is_below(module, part)), key=len)


ALL_IMPORTS = [found for path in SOURCES for found in imports(path)]


def test_the_rules_see_the_package():
    assert {"hrsi_engine.camera.rpc", "processing_algorithms.interface.cli", "plugin.provider"} <= MODULES
    assert Import("hrsi_engine.foundation.progress", 7, "hrsi_engine.foundation.errors", True) in ALL_IMPORTS


def test_every_engine_module_has_a_rule():
    """A new module of the engine says in `ALLOWED` what it may import."""
    unruled = [module for module in MODULES if module != "hrsi_engine" and rule_of(module) == "hrsi_engine"]
    assert unruled == []


@pytest.mark.parametrize("part", ALLOWED)
def test_direction(part: str):
    wrong = [
        found
        for found in ALL_IMPORTS
        if found.inside
        and rule_of(found.module) == part
        and not any(is_below(found.target, allowed) for allowed in ALLOWED[part] | {part})
    ]
    assert wrong == []


def test_imports_inside_the_package_are_relative():
    assert [found for found in ALL_IMPORTS if not found.inside and is_below(found.target, "hrsi")] == []


@pytest.mark.parametrize("package", KEPT_TO)
def test_packages_of_the_edges(package: str):
    outside = [
        found
        for found in ALL_IMPORTS
        if not found.inside and is_below(found.target, package) and not is_below(found.module, KEPT_TO[package])
    ]
    assert outside == []


def test_barred_packages():
    assert [found for found in ALL_IMPORTS if not found.inside and found.target.partition(".")[0] in BARRED] == []


def test_only_io_opens_paths():
    opened = [
        f"{SOURCES[path]}:{node.lineno}"
        for path in SOURCES
        if is_below(SOURCES[path], "hrsi_engine") and not is_below(SOURCES[path], "hrsi_engine.io")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and called_name(node) in OPENERS
    ]
    assert opened == []


def called_name(call: ast.Call) -> str:
    return getattr(call.func, "id", "") or getattr(call.func, "attr", "")


def test_no_vague_module_names():
    vague = {"utils", "util", "common", "helpers", "helper", "manager", "misc"}
    assert [module for module in MODULES if vague & set(module.split("."))] == []
