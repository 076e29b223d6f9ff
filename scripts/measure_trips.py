"""Follow one parameter through the calls that it is passed on in, by the names in the sources; nothing is run.

A trip begins at a function, as ``write_results:result`` or, where the name is not unique, ``triangulate.run:options``
(module and function). The parameter, its attributes and items, and what they are assigned to, looped over or copied
to are followed, in the order in which the code is written, into every function of the product that they are passed
to, and from there on; a function is entered once for each set of its parameters. The figures of a trip:

functions
    functions entered, the first among them.
stays
    files in which the trip stays one after the other; it is back in a caller after each call.
climbs
    moves from one file to another whose room stands on a higher floor.

What names do not tell is not followed: results of calls, attributes of `self` in other methods, functions chosen as
the program runs, methods of a name that several classes have, those of Python among them (``", ".join`` is none of the
product's). So the figures are lower bounds, and compare states of the same sources.
"""

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from sqlite3 import Connection
from typing import NamedTuple

#: The parameters that travel farthest.
TRIPS = (
    "write_results:result",
    "triangulate.run:options",
    "open_images:paths",
    "find_tie_points:images",
    "adjust:block",
)
#: Calls that give back what they were given, in another form.
COPIES = {"replace", "list", "tuple", "set", "dict", "sorted", "reversed", "enumerate", "zip", "iter", "copy"}
#: Methods of texts, containers, paths and databases.
BUILT_IN_METHODS = {name for kind in (str, bytes, dict, list, set, tuple, Path, Connection) for name in dir(kind)}
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class Trip(NamedTuple):
    """What a trip comes to; see the module."""

    functions: int
    stays: int
    climbs: int


class Function(NamedTuple):
    """A function or method: its module and its names from there, ``Adjuster.run``."""

    module: str
    name: str


class Calls:
    """Functions of the product by their names in each module.

    Parameters
    ----------
    trees : dict of str to ast.Module
        The sources by module; a package has its own name.
    floors : dict of str to int
        The floor of each room, by the beginning of its modules' names.
    """

    def __init__(self, trees: dict[str, ast.Module], floors: dict[str, int]):
        self.floors = floors
        self.packages = {module.rpartition(".")[0] for module in trees}
        self.functions: dict[Function, ast.FunctionDef | ast.AsyncFunctionDef] = {}
        self.methods: dict[str, list[Function]] = defaultdict(list)
        self.names: dict[str, dict[str, str]] = {}  # of each module: name -> what it is, by its whole name
        for module, tree in trees.items():
            for node in tree.body:
                if isinstance(node, FUNCTIONS):
                    self.functions[Function(module, node.name)] = node
                elif isinstance(node, ast.ClassDef):
                    for method in (part for part in node.body if isinstance(part, FUNCTIONS)):
                        function = Function(module, f"{node.name}.{method.name}")
                        self.functions[function] = method
                        self.methods[method.name].append(function)
            self.names[module] = dict(self._names_of(module, tree))

    def _names_of(self, module: str, tree: ast.Module) -> Iterator[tuple[str, str]]:
        """Yield what a module defines, imports and, as a package's face, hands on, by names and whole names."""
        for node in tree.body:
            if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
                yield node.name, f"{module}.{node.name}"
        package = module.split(".")
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                up = node.level - (module in self.packages)
                base = package[: len(package) - up] + (node.module.split(".") if node.module else [])
                yield from ((alias.asname or alias.name, ".".join([*base, alias.name])) for alias in node.names)
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "lazy_names":
                faces = node.args[1] if len(node.args) > 1 else None
                if isinstance(faces, ast.Dict):
                    for inner, names in zip(faces.keys, faces.values, strict=True):
                        if isinstance(inner, ast.Constant) and isinstance(names, ast.Constant):
                            yield from ((name, f"{module}.{inner.value}.{name}") for name in str(names.value).split())

    def _find(self, whole: str, depth: int = 0) -> Function | None:
        """Return the function or the constructor of a whole name, through the faces of packages."""
        module, _, name = whole.rpartition(".")
        for function in (Function(module, name), Function(module, f"{name}.__init__")):
            if function in self.functions:
                return function
        further = self.names.get(module, {}).get(name, "")
        return self._find(further, depth + 1) if further and further != whole and depth < 5 else None

    def callee(self, caller: Function, call: ast.expr) -> Function | None:
        """Return the function that a call names, where its name tells."""
        names = self.names[caller.module]
        if isinstance(call, ast.Name):
            return self._find(names[call.id]) if call.id in names else None
        if not isinstance(call, ast.Attribute):
            return None
        if isinstance(call.value, ast.Name):
            if call.value.id in names and (found := self._find(f"{names[call.value.id]}.{call.attr}")):
                return found
            owner = caller.name.partition(".")[0] if call.value.id in ("self", "cls") else call.value.id
            own = Function(caller.module, f"{owner}.{call.attr}")
            if own in self.functions:
                return own
        places = [] if call.attr in BUILT_IN_METHODS else self.methods[call.attr]
        return places[0] if len(places) == 1 else None

    def follow(self, trip: str) -> Trip | None:
        """Return what the trip of a parameter comes to; None where there is no such function, or no one such."""
        name, _, parameter = trip.partition(":")
        room, _, plain = name.rpartition(".")
        starts = [
            function
            for function, node in self.functions.items()
            if function.name == plain
            and (not room or function.module.split(".")[-1] == room)
            and parameter in parameters_of(node)
        ]
        if len(starts) != 1:
            return None
        journey = _Journey(self)
        journey.enter(starts[0], frozenset({parameter}))
        moves = list(zip(journey.stays, journey.stays[1:], strict=False))
        climbs = sum(self._floor(other) > self._floor(one) for one, other in moves)
        return Trip(len({function for function, _ in journey.entered}), len(journey.stays), climbs)

    def _floor(self, module: str) -> int:
        """Return the floor of a module's room."""
        parts = module.split(".")
        return next(
            (self.floors[room] for n in (2, 1) if (room := ".".join(parts[:n])) in self.floors),
            max(self.floors.values()),
        )


def parameters_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the names of a function's parameters, those that only a keyword gives at the end."""
    given = function.args
    return [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]


class _Journey:
    """One parameter under way: the functions it has entered, and the files it has stayed in one after the other."""

    def __init__(self, calls: Calls):
        self.calls = calls
        self.entered: set[tuple[Function, frozenset[str]]] = set()
        self.stays: list[str] = []

    def enter(self, function: Function, parameters: frozenset[str]) -> None:
        """Go through a function that some of its parameters bring the traveller into."""
        if (function, parameters) in self.entered:
            return
        self.entered.add((function, parameters))
        self._stay(function.module)
        _Passage(self, function, set(parameters)).visit_body()

    def call(self, caller: Function, node: ast.Call, given: list[int | str], receives: bool) -> None:
        """Enter what a call names by the arguments ``given`` (places or keywords), or as the object it is called on."""
        callee = self.calls.callee(caller, node.func)
        if callee is None:
            return
        names = parameters_of(self.calls.functions[callee])
        is_bound = bool(names) and names[0] in ("self", "cls")
        positional = names[1:] if is_bound else names
        taken = {positional[one] for one in given if isinstance(one, int) and one < len(positional)}
        taken |= {one for one in given if isinstance(one, str) and one in names}
        if receives and is_bound:
            taken.add(names[0])
        if taken:
            self.enter(callee, frozenset(taken))
            self._stay(caller.module)

    def _stay(self, module: str) -> None:
        if not self.stays or self.stays[-1] != module:
            self.stays.append(module)


class _Passage(ast.NodeVisitor):
    """The traveller in one function: the names it goes by there, and the calls it is passed on in."""

    def __init__(self, journey: _Journey, function: Function, names: set[str]):
        self.journey, self.function, self.names = journey, function, names

    def visit_body(self) -> None:
        """Go through the function's statements."""
        for statement in self.journey.calls.functions[self.function].body:
            self.visit(statement)

    def carries(self, node: ast.expr | None) -> bool:
        """Tell whether an expression is the traveller or a part of it."""
        match node:
            case ast.Name(id=name):
                return name in self.names
            case ast.Attribute() | ast.Subscript() | ast.Starred() | ast.NamedExpr():
                return ast.unparse(node) in self.names or self.carries(node.value)
            case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.BoolOp(values=parts):
                return any(map(self.carries, parts))
            case ast.ListComp(elt=one) | ast.SetComp(elt=one) | ast.GeneratorExp(elt=one):
                return self.carries(one)
            case ast.IfExp():
                return self.carries(node.body) or self.carries(node.orelse)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=parts) if name in COPIES:
                return any(map(self.carries, parts))
        return False

    def _name(self, target: ast.expr) -> None:
        """Let the traveller go by what it is assigned to."""
        if isinstance(target, ast.Tuple | ast.List):
            for part in target.elts:
                self._name(part)
        elif isinstance(target, ast.Name | ast.Attribute):
            self.names.add(ast.unparse(target))

    def visit_Assign(self, node: ast.Assign) -> None:
        self.visit(node.value)
        if isinstance(node.value, ast.Tuple) and isinstance(node.targets[0], ast.Tuple):
            for target, value in zip(node.targets[0].elts, node.value.elts, strict=False):
                if self.carries(value):
                    self._name(target)
        elif self.carries(node.value):
            for target in node.targets:
                self._name(target)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)
            if self.carries(node.value):
                self._name(node.target)

    def visit_NamedExpr(self, node: ast.NamedExpr) -> None:
        self.visit(node.value)
        if self.carries(node.value):
            self._name(node.target)

    def visit_For(self, node: ast.For) -> None:
        if self.carries(node.iter):
            self._name(node.target)
        self.generic_visit(node)

    def _visit_comprehension(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp) -> None:
        for loop in node.generators:
            if self.carries(loop.iter):
                self._name(loop.target)
        self.generic_visit(node)

    visit_ListComp = visit_SetComp = visit_GeneratorExp = visit_DictComp = _visit_comprehension

    def visit_Call(self, node: ast.Call) -> None:
        self.generic_visit(node)  # what is called inside the arguments comes first
        given: list[int | str] = [place for place, argument in enumerate(node.args) if self.carries(argument)]
        given += [keyword.arg for keyword in node.keywords if keyword.arg and self.carries(keyword.value)]
        receives = isinstance(node.func, ast.Attribute) and self.carries(node.func.value)
        if given or receives:
            self.journey.call(self.function, node, given, receives)
