"""Measure how the shipped code is laid out, and write the figures into ``docs/developing/structure.md``.

``python scripts/measure_structure.py [--write] [--names] [REVISION …]`` reads the sources, here and at revisions of the
repository, and prints one column each; nothing of them is imported. ``--write`` puts the table and the rooms between
the markers of the page, ``--names`` lists what the figures count. ``tests/test_structure.py`` holds the figures below
`LIMITS` and compares the page with the sources. The figures:

rooms
    folders: plugin, processing_algorithms and the engine's own folders; a module that lies loose in the engine is a
    room of its own, because a reader has to know it like one.
arrows
    pairs of rooms of which one imports the other, also inside functions and under ``TYPE_CHECKING``.
circles
    groups of files, in one room or across rooms, each of which imports the others in the end; what a package's
    ``__init__`` exports counts as imported where it is asked for by the package's name.
arrows up
    arrows that cannot run down, whatever floor each room is put on: an arrow of a circle of rooms.
inside a room
    its folders and its loose modules are its own rooms; its ``__init__``, which only hands names on, is none.
product lines
    lines of the ``*.py`` files as ``wc`` counts them; the laboratory (`LABORATORY`) apart where it says so.
lines of code
    without docstrings, comments and empty lines. The explanation ratio is docstring and comment lines per line of
    code. The length of a function is its lines from ``def``, without its docstring.
numeric constants
    assignments of the engine at the top level of a module whose value holds a number; fields of the classes made by
    ``@thresholds`` stand in classes and have unit, meaning and origin, so that they are not among them.
trips
    of a parameter through the calls it is passed on in, see ``measure_trips.py``.
"""

import argparse
import ast
import io
import subprocess
import sys
import tarfile
import tempfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from check_names import MOST_LISTED, fault_of, names_in
from measure_trips import TRIPS, Calls

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "developing/structure.md"
PARTS = ("hrsi_engine", "processing_algorithms", "plugin")
#: The states which the page compares with: before there were rooms, and before the rooms were put in order by topic.
BEFORE = ("54ff169", "7ae5dd3")
#: Modules and folders that make up the laboratory, today or under an earlier name; a path that has one belongs to it.
LABORATORY = {"laboratory", "simulation", "simulated_block", "simulate", "register"}
LABORATORY |= {"registration", "registration_options"}
#: Rooms of the engine whose inside is measured too.
LOOKED_INTO = ("hrsi_engine.io", "hrsi_engine.adjustment")
#: The longest that a function may be, in lines without its docstring.
LONGEST_FUNCTION = 60
#: What may not be exceeded.
LIMITS: dict[str, float] = {
    "product lines without the laboratory": 62_000,
    "lines of tests": 40_000,
    "lines of benchmarks": 11_000,
    "rooms": 20,
    "arrows up": 0,
    "circles of files": 0,
    "rooms in io": 20,
    "arrows in io": 45,
    "arrows up in io": 0,
    "arrows up in adjustment": 0,
    "functions above 60 lines": 0,
    "names that are participles, adverbs or letters, %": 100 * MOST_LISTED,
    **{
        f"trip of `{trip}`: {part}": most
        for trip, stays, climbs in (
            ("write_results:result", 80, 20),
            ("triangulate.run:options", 150, 30),
            ("open_images:paths", 30, 2),
            ("adjust:block", 35, 8),
        )
        for part, most in (("stays", stays), ("climbs", climbs))
    },
}
#: Names that a contract asks of every module of its kind: algorithms, and formats of files.
CONTRACT_NAMES = {"ALGORITHM", "ALGORITHMS", "run", "summarise", "READER", "read", "text_of", "WRITTEN_BY"}
#: … and what an algorithm calls its files and layers.
CONTRACT_NAMES |= {"LAYERS_FILE", "LAYER", "POINTS_LAYER", "TABLE_FILE", "PAGE_FILE"}
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class Import(NamedTuple):
    """One import statement: where it stands and what it names; ``inside`` of this package or not."""

    module: str
    line: int
    target: str
    inside: bool


@dataclass(frozen=True)
class Source:
    """A file of the product: its module's name, ``hrsi_engine.io.rasters.images``, and its text."""

    module: str
    text: str
    is_package: bool

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All of the tree, in the order of `ast.walk`, which takes longer than what is counted."""
        return list(ast.walk(self.tree))

    @cached_property
    def lines(self) -> Counter[str]:
        """Return how many lines hold code, docstrings, and comments alone."""
        docstrings = {
            line for node in docstrings_of(self.nodes) for line in range(node.lineno, (node.end_lineno or 0) + 1)
        }
        code: set[int] = set()
        comments: set[int] = set()
        for token in tokenize.generate_tokens(io.StringIO(self.text).readline):
            if token.type == tokenize.COMMENT:
                comments.add(token.start[0])
            elif token.string.strip() and token.type != tokenize.ENDMARKER:
                code.update(range(token.start[0], token.end[0] + 1))
        filled = {number for number, line in enumerate(self.text.splitlines(), 1) if line.strip()}
        code -= docstrings
        return Counter(code=len(code & filled), docstrings=len(docstrings & filled), comments=len(comments - code))


def docstrings_of(nodes: Iterable[ast.AST]) -> Iterator[ast.Constant]:
    """Yield the docstrings of a module, its classes and functions, and strings that describe an attribute."""
    for node in nodes:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value


class Product:
    """The shipped sources below a folder, and what can be counted in them."""

    def __init__(self, root: Path):
        self.sources = {}
        self.lines_beside = {
            part: sum(path.read_text(encoding="utf-8").count("\n") for path in (root / part).rglob("*.py"))
            for part in ("tests", "benchmarks", "scripts")
        }
        for path in [root / "__init__.py", *(path for part in PARTS for path in sorted((root / part).rglob("*.py")))]:
            parts = path.relative_to(root).with_suffix("").parts
            module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            self.sources[module] = Source(module, path.read_text(encoding="utf-8"), path.name == "__init__.py")

    def rooms(self) -> set[str]:
        """Return the rooms' names."""
        return {self.room_of(module) for module in self.sources if module and module != "hrsi_engine"}

    def room_of(self, module: str) -> str:
        """Return the room a module lies in."""
        first, *others = module.split(".")
        return ".".join([first, *others[:1]]) if first == "hrsi_engine" else first

    @cached_property
    def imports(self) -> list[Import]:
        """Every import, also those inside functions and under ``TYPE_CHECKING``."""
        found = []
        for source in self.sources.values():
            for node in source.nodes:
                if isinstance(node, ast.Import):
                    found += [Import(source.module, node.lineno, alias.name, False) for alias in node.names]
                elif isinstance(node, ast.ImportFrom):
                    found += self._from_imports(source, node)
        return found

    def _from_imports(self, source: Source, node: ast.ImportFrom) -> list[Import]:
        """Return the modules that ``from … import …`` names: ``from . import x`` means x where that is a module."""
        if not node.level:
            return [Import(source.module, node.lineno, node.module or "", False)]
        package = source.module.split(".") if source.module else []
        base = package[: len(package) - node.level + (1 if source.is_package else 0)]
        base += node.module.split(".") if node.module else []
        targets = {".".join([*base, alias.name]) for alias in node.names}
        modules = {target if target in self.sources else ".".join(base) for target in targets}
        return [Import(source.module, node.lineno, module, True) for module in sorted(modules)]

    def arrows(self) -> set[tuple[str, str]]:
        """Return the pairs of rooms of which the first imports the second."""
        pairs = {(self.room_of(found.module), self.room_of(found.target)) for found in self.imports if found.inside}
        return {
            (one, other) for one, other in pairs if one != other and "" not in (one, other) and one != "hrsi_engine"
        }

    def inside(self, room: str) -> tuple[set[str], set[tuple[str, str]]]:
        """Return the folders and loose modules of a room, and the pairs of them of which one imports the other."""

        def part_of(module: str) -> str:
            first, dot, others = module.partition(f"{room}.")
            return others.partition(".")[0] if dot and not first else ""

        parts = {part_of(module) for module in self.sources} - {""}
        pairs = {(part_of(found.module), part_of(found.target)) for found in self.imports if found.inside}
        return parts, {(one, other) for one, other in pairs if one != other and "" not in (one, other)}

    def circles(self) -> list[list[str]]:
        """Return the groups of files that import one another in a circle."""
        return circles_of({(found.module, found.target) for found in self.imports if found.inside})

    def numeric_constants(self) -> list[str]:
        """Return the names that the engine's modules give, at their top level, a value with a number in it."""
        return [
            f"{source.module}:{value.lineno} {name.id}"
            for source in self.sources.values()
            if source.module.startswith("hrsi_engine")
            for target, value in assignments_of(source.tree)
            if any(isinstance(part, ast.Constant) and type(part.value) in (int, float) for part in ast.walk(value))
            for name in ast.walk(target)
            if isinstance(name, ast.Name)
        ]

    def compiled_modules(self) -> set[str]:
        """Return the modules that are made of compiled loops: they import numba at their top level."""
        return {
            source.module
            for source in self.sources.values()
            for node in source.tree.body
            if isinstance(node, ast.ImportFrom) and node.module == "numba"
        }

    def listed_names(self) -> tuple[list[str], int]:
        """Return the functions and classes whose names `check_names` lists, and how many there are in all."""
        names = [name for source in self.sources.values() for name in names_in(source.tree, source.module)]
        return [f"{name.place} {name.name}" for name in names if fault_of(name)], len(names)

    def long_functions(self) -> list[str]:
        """Return the functions that are longer than `LONGEST_FUNCTION` without their docstrings."""
        return [
            f"{source.module}:{node.lineno} {node.name}: {length}"
            for source, node in self.functions()
            if (length := length_of(node)) > LONGEST_FUNCTION
        ]

    def names_with_several_places(self) -> dict[str, list[str]]:
        """Return the public names that several modules define at their top level, and those modules."""
        places = defaultdict(set)
        for source in self.sources.values():
            for name in defined_names(source.tree.body):
                if not name.startswith("_") and name not in CONTRACT_NAMES:
                    places[name].add(source.module)
        return {name: sorted(modules) for name, modules in sorted(places.items()) if len(modules) > 1}

    def functions(self) -> list[tuple[Source, ast.FunctionDef | ast.AsyncFunctionDef]]:
        """Return every function and method."""
        return [
            (source, node) for source in self.sources.values() for node in source.nodes if isinstance(node, FUNCTIONS)
        ]

    def figures(self) -> dict[str, float]:
        """Return the figures of the table."""
        lines = sum((source.lines for source in self.sources.values()), Counter())
        used = {source.module: Counter(names_used(source.nodes)) for source in self.sources.values()}
        functions = self.functions()
        several = self.names_with_several_places()
        constants = sum(name.isupper() for name in several)
        private = [
            (source.module, node.name)
            for source, node in functions
            if node.name.startswith("_") and not node.name.endswith("__")
        ]
        compiled = self.compiled_modules()
        texts = {source.module: source.text.count("\n") for source in self.sources.values()}
        listed, names = self.listed_names()
        figures: dict[str, float] = {
            "product lines": sum(texts.values()),
            "product lines without the laboratory": sum(
                lines for module, lines in texts.items() if not LABORATORY & set(module.split("."))
            ),
            **{f"lines of {part}": lines for part, lines in self.lines_beside.items()},
            "rooms": len(self.rooms()),
            "arrows between rooms": len(self.arrows()),
            "arrows up": len(arrows_up(self.arrows())),
            "circles of files": len(self.circles()),
        }
        for room in LOOKED_INTO:
            parts, arrows = self.inside(room)
            name = room.rpartition(".")[2]
            figures |= {f"rooms in {name}": len(parts), f"arrows in {name}": len(arrows)}
            figures |= {f"arrows up in {name}": len(arrows_up(arrows))}
        calls = Calls({source.module: source.tree for source in self.sources.values()}, self.floors())
        trips = {f"trip of `{trip}`": calls.follow(trip) for trip in TRIPS}
        return (
            figures
            | {
                "files": len(self.sources),
                "files above 400 lines": sum(source.text.count("\n") > 400 for source in self.sources.values()),
                "lines of code": lines["code"],
                "statements": sum(isinstance(node, ast.stmt) for part in self.sources.values() for node in part.nodes),
                "docstring lines": lines["docstrings"],
                "comment lines": lines["comments"],
                "explanation: docstring and comment lines per line of code": round(
                    (lines["docstrings"] + lines["comments"]) / lines["code"], 3
                ),
                "imports inside functions": sum(inner_imports(node) for _, node in functions),
                "functions and classes of one name in several modules": len(several) - constants,
                "constants of one name in several modules": constants,
                "functions": len(functions),
                "functions above 60 lines": len(self.long_functions()),
                "names that are participles, adverbs or letters, %": round(100 * len(listed) / names, 1),
                "numeric constants of the engine's modules": len(self.numeric_constants()),
                "private functions": len(private),
                "private functions used once": sum(used[module][name] == 1 for module, name in private),
                "options read from a dict by a string": sum(
                    string_options(source.nodes) for source in self.sources.values()
                ),
                "functions with a Parameters section": sum(
                    "Parameters\n" in (ast.get_docstring(node) or "") for _, node in functions
                ),
                "lines of code of compiled loops": sum(
                    source.lines["code"] for source in self.sources.values() if source.module in compiled
                ),
            }
            | {
                f"{name}: {part}": figure
                for name, trip in trips.items()
                if trip
                for part, figure in trip._asdict().items()
            }
        )

    def floors(self) -> dict[str, int]:
        """Return each room's floor: one above the highest room that it imports; arrows up do not count."""
        arrows = self.arrows() - arrows_up(self.arrows())
        below = {room: {other for one, other in arrows if one == room} for room in self.rooms()}
        floors: dict[str, int] = {}
        while len(floors) < len(below):
            free = {room for room in below if room not in floors and below[room] <= set(floors)}
            floors |= {room: max((floors[other] + 1 for other in below[room]), default=0) for room in free}
        return floors


def circles_of(arrows: set[tuple[str, str]]) -> list[list[str]]:
    """Return the groups that reach one another by arrows (strongly connected; Tarjan 1972)."""
    graph = defaultdict(set)
    for one, other in arrows:
        if one != other:
            graph[one].add(other)
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    circles = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for target in sorted(graph[node]):
            if target not in order:
                visit(target)
            if target in stack:
                low[node] = min(low[node], low[target])
        if low[node] == order[node]:
            circle = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(circle) > 1:
                circles.append(sorted(circle))

    for node in sorted(graph):
        if node not in order:
            visit(node)
    return circles


def arrows_up(arrows: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return arrows without which the others all run down: the fewest found by taking them out one by one."""
    up: set[tuple[str, str]] = set()
    while circles := circles_of(arrows - up):
        inside = sorted((one, other) for one, other in arrows - up if any({one, other} <= set(c) for c in circles))
        up.add(min(inside, key=lambda arrow: sum(map(len, circles_of(arrows - up - {arrow})))))
    return up


def length_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function from ``def``, without its docstring."""
    docstring = function.body[0] if ast.get_docstring(function, clean=False) is not None else None
    told = (docstring.end_lineno or 0) - docstring.lineno + 1 if docstring else 0
    return (function.end_lineno or 0) - function.lineno + 1 - told


def defined_names(body: list[ast.stmt]) -> Iterator[str]:
    """Yield the functions, classes and constants that a module defines, not those it imports."""
    for node in body:
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.Assign):
            names = (name for target in node.targets for name in ast.walk(target))
            yield from (name.id for name in names if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def assignments_of(tree: ast.Module) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield what a module assigns at its top level, name and value; ``a, b = 1, 2`` are two."""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and node.value:
            yield node.target, node.value
        elif isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                yield from zip(target.elts, value.elts, strict=True)
            else:
                yield target, value


def names_used(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield every name and attribute that is read."""
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr


def inner_imports(function: ast.AST) -> int:
    """Return how many import statements stand in a function itself, not in one inside it."""
    count, nodes = 0, list(ast.iter_child_nodes(function))
    while nodes:
        node = nodes.pop()
        count += isinstance(node, ast.Import | ast.ImportFrom)
        if not isinstance(node, FUNCTIONS):
            nodes += ast.iter_child_nodes(node)
    return count


def string_options(nodes: Iterable[ast.AST]) -> int:
    """Return how often an option is fetched by its name as a string: ``options["sigma_image"]``."""
    count = 0
    for node in nodes:
        if isinstance(node, ast.Subscript):
            owner, key = node.value, node.slice
        elif (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr == "get"
            and node.args
        ):
            owner, key = node.func.value, node.args[0]
        else:
            continue
        name = getattr(owner, "id", getattr(owner, "attr", ""))
        count += (
            name in {"options", "values", "params"} and isinstance(key, ast.Constant) and isinstance(key.value, str)
        )
    return count


def product_at(revision: str) -> Product:
    """Return the product as it was at a revision of the repository."""
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, check=True, capture_output=True).stdout
    with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(folder)  # our own archive
        return Product(Path(folder))


def table_of(columns: dict[str, dict[str, float]]) -> list[str]:
    """Return the figures as a table in Markdown."""
    names = list(dict.fromkeys(name for figures in columns.values() for name in figures))
    rows = [["", *columns], ["---", *["---:"] * len(columns)]]
    rows += [
        [name, *(f"{figures[name]:g}" if name in figures else "" for figures in columns.values())] for name in names
    ]
    return [f"| {' | '.join(row)} |" for row in rows]


def rooms_of(product: Product) -> list[str]:
    """Return a table of the rooms, from the ground up: what each is and what it imports."""
    arrows = product.arrows()
    below = {room: sorted(other for one, other in arrows if one == room) for room in product.rooms()}
    depth = product.floors()
    rows = ["| floor | room | is | files | lines of code | imports |", "|---:|---|---|---:|---:|---|"]
    for room in sorted(below, key=lambda room: (-depth[room], room)):
        inside = [source for module, source in product.sources.items() if product.room_of(module) == room]
        purpose = (ast.get_docstring(product.sources[room].tree) or "").split("\n\n")[0].replace("\n", " ")
        imported = ", ".join(other.removeprefix("hrsi_engine.") for other in below[room])
        lines = sum(source.lines["code"] for source in inside)
        rows.append(
            f"| {depth[room]} | `{room.replace('.', '/')}` | {purpose} | {len(inside)} | {lines} | {imported} |"
        )
    return rows


def write_page(parts: dict[str, list[str]]) -> None:
    """Put each part between its markers on the page."""
    text = PAGE.read_text(encoding="utf-8")
    for name, lines in parts.items():
        begin, end = f"<!-- {name}: made by scripts/measure_structure.py -->", f"<!-- end of {name} -->"
        head, _, rest = text.partition(begin)
        text = "\n".join([f"{head}{begin}", "", *lines, "", f"{end}{rest.partition(end)[2]}"])
    PAGE.write_text(text, encoding="utf-8")


def main(words: list[str]) -> int:
    """Print the tables and, if wanted, write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs="*", default=BEFORE, help="revisions to compare with")
    parser.add_argument("--now", action="store_true", help="only the sources as they are")
    parser.add_argument("--write", action="store_true", help="write the tables into docs/developing/structure.md")
    parser.add_argument("--names", action="store_true", help="list what the figures count")
    arguments = parser.parse_args(words)
    now = Product(ROOT)
    revisions = () if arguments.now else arguments.revisions
    columns = {f"at {revision}": product_at(revision).figures() for revision in revisions} | {"now": now.figures()}
    columns["limit"] = LIMITS
    parts = {"figures": table_of(columns), "rooms": rooms_of(now)}
    print("\n\n".join("\n".join(lines) for lines in parts.values()))
    if arguments.names:
        several = now.names_with_several_places().items()
        lists = {
            "circles": now.circles(),
            "arrows up": arrows_up(now.arrows()),
            **{f"arrows up in {room}": arrows_up(now.inside(room)[1]) for room in LOOKED_INTO},
            "several places": [f"{name}: {', '.join(places)}" for name, places in several],
            "names listed": now.listed_names()[0],
            "functions above 60 lines": now.long_functions(),
            "numeric constants": now.numeric_constants(),
        }
        for title, found in lists.items():
            print(f"\n{title}: {len(found)}", *found, sep="\n  ")
    if arguments.write:
        write_page(parts)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
