"""Write the type stubs (``__init__.pyi``) of the packages whose names are loaded lazily, for editors and type checkers.

``python scripts/make_stubs.py`` writes them; a test compares them with what `stubs` returns. The faces of the engine's
rooms import their names from where these stand; the functions of `hrsi` itself are made from the declarations, with
types, defaults and descriptions.
"""

import ast
import inspect
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.facade import calls
from hrsi.processing_algorithms.facade.calls import (
    PROGRESS,
    describe_call,
    function_name,
    signature_of,
    sort_parameters,
)
from hrsi.processing_algorithms.interface.declare import Algorithm
from hrsi.processing_algorithms.interface.options import KINDS

ROOT = Path(__file__).resolve().parents[1]
MADE_BY = "# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.\n"
#: What the functions of arrays look like to a type checker: what comes out depends on what goes in.
ARRAY_FUNCTIONS = {
    "project": ("lon, lat, height", "sample, line", "Ground points to image coordinates."),
    "localize": ("sample, line, height", "lon, lat, height", "Image points to the ground."),
}
HEAD = '''
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, Protocol, TypeAlias, overload

import numpy as np

from .hrsi_engine import MODELS as MODELS
from .hrsi_engine import RPC as RPC
from .hrsi_engine import Block as Block
from .hrsi_engine import GroundPoints as GroundPoints
from .hrsi_engine import HrsiError as HrsiError
from .hrsi_engine import Image as Image
from .hrsi_engine import ImagePoints as ImagePoints
from .hrsi_engine import Role as Role
from .hrsi_engine import read_rpc as read_rpc
from .hrsi_engine import refine_rpc as refine_rpc
from .hrsi_engine.foundation.progress import Progress
from .hrsi_engine.io.rasters.images import ImageSource
from .hrsi_engine.io.rpc_files import FoundRpc
from .plugin.plugin import HrsiPlugin
from .processing_algorithms.facade.result import Result as Result
from .processing_algorithms.facade.result import read_result as read_result

class Table(Protocol):
    """A table with columns by name: of pandas, GeoPandas, Polars …"""

    @property
    def columns(self) -> Any: ...
    def __getitem__(self, key: Any, /) -> Any: ...

Path: TypeAlias = str | os.PathLike[str]
Images: TypeAlias = ImageSource | Image | RPC | Block | Sequence[ImageSource | Image]
RasterSource: TypeAlias = ImageSource
TableOrFile: TypeAlias = Path | Table | Mapping[str, Any] | GroundPoints | ImagePoints
Points: TypeAlias = TableOrFile | np.ndarray

def classFactory(iface: Any) -> HrsiPlugin: ...  # noqa: N802

'''
OPEN = '''
@overload
def open(
    source: ImageSource | Image | np.ndarray, rpc: RPC | FoundRpc | Image | Path | None = None, id: str | None = None
) -> Image:
    """DOCSTRING"""
    ...
@overload
def open(source: list[Any] | tuple[Any, ...], rpc: None = None, id: None = None) -> list[Image]: ...

'''


def stubs(root: Path = ROOT) -> dict[Path, str]:
    """Return the text of each stub by its path."""
    made = {root / "__init__.pyi": facade_stub()}
    rooms = [face for part in ("hrsi_engine", "processing_algorithms") for face in (root / part).rglob("__init__.py")]
    for package in sorted(rooms):
        names = lazy_table(package)
        if names:
            made[package.with_suffix(".pyi")] = face_stub(package, names)
    return formatted(made)


def facade_stub() -> str:
    """Return the stub of `hrsi`."""
    parts = [MADE_BY, HEAD, OPEN.replace("DOCSTRING", inspect.getdoc(calls.open) or "")]
    for name, algorithm in REGISTRY.items():
        made = stub_of(algorithm)
        if name in ARRAY_FUNCTIONS:
            given, found, what = ARRAY_FUNCTIONS[name]
            parts.append(array_stub(name, given, found, what))
            made = "@overload\n" + made.replace("points: Points | None = None", "points: TableOrFile")
        parts.append(made + "\n")
    return "".join(parts)


def stub_of(algorithm: Algorithm) -> str:
    """Return the function as a stub (``.pyi``) has it, with types and description."""
    parts: list[str] = []
    parameters = signature_of(algorithm).parameters
    for param in sort_parameters(algorithm):
        if parameters[param.key].kind is inspect.Parameter.KEYWORD_ONLY and "*" not in parts:
            parts.append("*")
        needed = parameters[param.key].default is inspect.Parameter.empty
        kind = (
            f"Literal[{', '.join(map(_quote_text, param.choices))}]" if param.choices else KINDS[param.kind].annotation
        )
        default = _quote_text(param.default) if isinstance(param.default, str) else repr(param.default)
        optional = f"{kind} | None = None" if param.default is None else f"{kind} = {default}"
        parts.append(f"{param.key}: {kind if needed else optional}")
    parts += ([] if "*" in parts else ["*"]) + [f"{PROGRESS}: Progress | None = None"]
    body = textwrap.indent(f'"""{describe_call(algorithm)}"""', "    ", lambda line: line.strip() != "")
    listed = "".join(f"    {part},\n" for part in parts)
    return f"def {function_name(algorithm.name)}(\n{listed}) -> Result:\n{body}\n    ...\n"


def _quote_text(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def array_stub(name: str, given: str, found: str, what: str) -> str:
    """Return the stub of a function of arrays."""
    return f'''@overload
def {function_name(name)}(
    images: Images,
    points: np.ndarray | Sequence[Sequence[float]] | Sequence[float],
    *,
    dem: RasterSource | None = None,
    dem_datum: str | None = None,
    height: float | None = None,
    height_datum: str = "layer",
) -> np.ndarray:
    """{what} Array ``(n, …)`` {given}; returns ``(n, …)`` {found}."""
    ...

'''


def lazy_table(package: Path) -> dict[str, str]:
    """Return the modules and names that a package hands to `lazy_names`; empty where it does not."""
    for node in ast.walk(ast.parse(package.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "lazy_names":
            table: dict[str, str] = ast.literal_eval(node.args[1])
            return table
    return {}


def face_stub(package: Path, names: dict[str, str]) -> str:
    """Return the stub of a package that shows names of its modules."""
    docstring = ast.get_docstring(ast.parse(package.read_text(encoding="utf-8")), clean=False)
    lines = [f"from .{module} import {name} as {name}" for module, listed in names.items() for name in listed.split()]
    return f'"""{docstring}"""\n\n{MADE_BY}\n' + "\n".join(lines) + "\n"


def formatted(texts: dict[Path, str]) -> dict[Path, str]:
    """Return stubs as the project formats its sources."""
    with tempfile.TemporaryDirectory() as folder:
        places = {path: Path(folder) / str(number) / path.name for number, path in enumerate(texts)}
        for path, place in places.items():
            place.parent.mkdir()
            place.write_text(texts[path], encoding="utf-8")
        settings = ["--quiet", "--config", str(ROOT / "pyproject.toml"), folder]
        for step in (["check", "--fix", "--exit-zero", "--select", "I"], ["format"]):
            subprocess.run([sys.executable, "-m", "ruff", *step, *settings], check=True, cwd=ROOT)
        return {path: place.read_text(encoding="utf-8") for path, place in places.items()}


if __name__ == "__main__":
    for path, content in stubs().items():
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")
            print(path.relative_to(ROOT))
