"""Imports go one way, and only the edges know GDAL and QGIS; read from the source, nothing is imported.

plugin -> processing_algorithms -> results -> io | algorithms -> block -> surface -> camera -> ground -> foundation
"""

import ast
from pathlib import Path

import pytest
from measure_structure import Import, Product

#: What a room may import besides itself, by the longest fitting prefix of a module's name: the floors of the house,
#: from the ground up.
FOUNDATION = {"hrsi_engine.foundation"}
GROUND = FOUNDATION | {"hrsi_engine.ground"}
CAMERA = GROUND | {"hrsi_engine.camera"}
SURFACE = CAMERA | {"hrsi_engine.surface"}
BLOCK = SURFACE | {"hrsi_engine.block"}
ADJUSTMENT = (BLOCK - {"hrsi_engine.camera"}) | {"hrsi_engine.refinement", "hrsi_engine.adjustment"}
PRODUCTION = ADJUSTMENT | {
    f"hrsi_engine.{room}"
    for room in ("camera", "dense", "drawing", "io", "measurement", "ortho", "plausibility", "results")
}
ALLOWED: dict[str, set[str]] = {
    "hrsi_engine.foundation": set(),
    "hrsi_engine.ground": FOUNDATION,
    "hrsi_engine.camera": GROUND,
    "hrsi_engine.surface": CAMERA,
    "hrsi_engine.block": SURFACE,
    "hrsi_engine.drawing": BLOCK,
    "hrsi_engine.refinement": BLOCK | {"hrsi_engine.plausibility"},
    "hrsi_engine.measurement": BLOCK,
    "hrsi_engine.plausibility": BLOCK,
    "hrsi_engine.laboratory": BLOCK | {"hrsi_engine.io", "hrsi_engine.measurement"},
    "hrsi_engine.laboratory.direct_methods": BLOCK | {"hrsi_engine.refinement"},
    "hrsi_engine.laboratory.simulation": BLOCK,
    "hrsi_engine.dense": BLOCK | {"hrsi_engine.ortho"},
    "hrsi_engine.ortho": BLOCK | {"hrsi_engine.measurement.window_matching"},
    "hrsi_engine.adjustment": ADJUSTMENT,
    "hrsi_engine.io": BLOCK | {"hrsi_engine.drawing"},
    "hrsi_engine.results": ADJUSTMENT | {"hrsi_engine.drawing", "hrsi_engine.io"},
    "hrsi_engine": PRODUCTION,  # the public names; its modules have their own rules
    "processing_algorithms": PRODUCTION,
    "processing_algorithms.laboratory": {"processing_algorithms", "hrsi_engine"},
    "plugin": {"processing_algorithms", "hrsi_engine.foundation"},
}
#: Packages that only one part may import.
FILES = ("hrsi_engine.io", "hrsi_engine.laboratory.simulated_files")
KEPT_TO = {"osgeo": FILES, "rasterio": ("hrsi_engine.camera.rpc",), "qgis": ("plugin",), "processing": ("plugin",)}
#: Packages that nothing may import: they bring a second GDAL, or belong to the tests.
BARRED = {"fiona", "pyogrio", "geopandas", "pytest"}
#: Calls that open a path; only the readers and writers may.
OPENERS = {"open", "read_text", "read_bytes", "write_text", "write_bytes"}


@pytest.fixture(scope="module")
def modules(product: Product) -> set[str]:
    """All but the root, which is a plugin folder's ``__init__``, QGIS's affair."""
    return set(product.sources) - {""}


@pytest.fixture(scope="module")
def all_imports(product: Product) -> list[Import]:
    return [found for found in product.imports if found.module]


def is_below(module: str, part: str) -> bool:
    return module == part or module.startswith(f"{part}.")


def rule_of(module: str) -> str:
    """Return the longest entry of `ALLOWED` that a module falls under."""
    return max((part for part in ALLOWED if is_below(module, part)), key=len)


def test_the_rules_see_the_package(all_imports: list[Import], modules: set[str]):
    assert {"hrsi_engine.camera.rpc", "processing_algorithms.command_line.cli", "plugin.provider"} <= modules
    assert Import("hrsi_engine.foundation.progress", 5, "hrsi_engine.foundation.errors", True) in all_imports


def test_every_engine_module_has_a_rule(modules: set[str]):
    """A new module of the engine says in `ALLOWED` what it may import."""
    unruled = [module for module in modules if module != "hrsi_engine" and rule_of(module) == "hrsi_engine"]
    assert unruled == []


@pytest.mark.parametrize("part", ALLOWED)
def test_direction(part: str, all_imports: list[Import]):
    wrong = [
        found
        for found in all_imports
        if found.inside
        and rule_of(found.module) == part
        and not any(is_below(found.target, allowed) for allowed in ALLOWED[part] | {part})
    ]
    assert wrong == []


def test_the_laboratory_is_apart(all_imports: list[Import]):
    """Only the list of algorithms knows it, and `refine-rpc`, which offers its direct methods beside the models."""
    rooms = ("hrsi_engine.laboratory", "processing_algorithms.laboratory")

    def is_inside(module: str) -> bool:
        return any(is_below(module, room) for room in rooms)

    doors = {found.module for found in all_imports if is_inside(found.target) and not is_inside(found.module)}
    assert doors == {"processing_algorithms", "processing_algorithms.refine_rpc"}


def test_imports_inside_the_package_are_relative(all_imports: list[Import]):
    assert [found for found in all_imports if not found.inside and is_below(found.target, "hrsi")] == []


@pytest.mark.parametrize("package", KEPT_TO)
def test_packages_of_the_edges(package: str, all_imports: list[Import]):
    outside = [
        found
        for found in all_imports
        if not found.inside
        and is_below(found.target, package)
        and not any(is_below(found.module, door) for door in KEPT_TO[package])
    ]
    assert outside == []


def test_barred_packages(all_imports: list[Import]):
    assert [found for found in all_imports if not found.inside and found.target.partition(".")[0] in BARRED] == []


def test_only_io_opens_paths(product: Product):
    opened = [
        f"{module}:{node.lineno}"
        for module, source in product.sources.items()
        if is_below(module, "hrsi_engine") and not any(is_below(module, door) for door in FILES)
        for node in ast.walk(source.tree)
        if isinstance(node, ast.Call) and called_name(node) in OPENERS
    ]
    assert opened == []


def called_name(call: ast.Call) -> str:
    return getattr(call.func, "id", "") or getattr(call.func, "attr", "")


def test_no_vague_module_names(modules: set[str]):
    vague = {"utils", "util", "common", "helpers", "helper", "manager", "misc"}
    assert [module for module in modules if vague & set(module.split("."))] == []


def test_few_rooms_and_arrows(product: Product):
    """A newcomer can hold the house in the head."""
    assert len(product.rooms()) <= 20
    assert len(product.arrows()) <= 79  # with dense matching, which stands on foundation, block and ortho


def test_no_circle_of_files(product: Product):
    """Nowhere, not inside a room, and not for types only."""
    assert product.circles() == []


def test_a_circle_is_found(tmp_path: Path):
    """… also through a package's face, an import inside a function, and one for types only."""
    files = {
        "__init__.py": "",
        "hrsi_engine/__init__.py": "",
        "hrsi_engine/room/__init__.py": "from .one import A",
        "hrsi_engine/room/one.py": "def f():\n    from .two import B",
        "hrsi_engine/room/two.py": "if TYPE_CHECKING:\n    from . import A",
        "hrsi_engine/room/three.py": "from .one import f",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    room = "hrsi_engine.room"
    assert Product(tmp_path).circles() == [[room, f"{room}.one", f"{room}.two"]]


def test_public_names_mean_one_thing(product: Product):
    """No two modules define the same public name, but for those that every algorithm or format has."""
    assert product.names_with_several_places() == {}
