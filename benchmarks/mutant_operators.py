"""Faults of one expression, made from the syntax tree: what a slip of the programmer would look like.

`list_faults` returns all faults of a module, `with_fault` its tree with one of them. Left out, because no number of an
output follows from them: annotations, texts of messages, what is raised, progress, and declarations outside functions.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

SWAPPED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
NEGATED = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip
#: Functions that stand for one another.
OTHER_FUNCTION = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin", "any": "all",
    "all": "any", "median": "max", "nanmedian": "nanmax", "mean": "max", "floor": "ceil", "ceil": "floor",
    "argmin": "argmax", "argmax": "argmin",
}  # fmt: skip
#: Functions whose second argument is a share: the 90th percentile becomes the median.
QUANTILES = ("percentile", "nanpercentile", "quantile", "nanquantile")
#: Calls that change no number: what they do is said, stored or waited for.
SILENT = ("progress", "warn", "report", "print", "join", "format", "InputError", "SolveError", "debug", "info")
#: Constants smaller than this guard a division or end an iteration.
LEAST_CONSTANT, LARGEST_CONSTANT = 1e-3, 1e5
SCALE = 1.02


@dataclass(frozen=True)
class Fault:
    """One fault: where it is, what kind, and the expression before and after."""

    line: int
    column: int
    kind: str
    before: str
    after: str
    order: int  # of the faults at one node, so that `with_fault` finds it again
    node: int  # of the nodes of the tree in the order of the walk


def list_faults(source: str) -> list[Fault]:
    """Return all faults of a module's source."""
    found = []
    for number, node in enumerate(_walked(ast.parse(source))):
        for order, (kind, new) in enumerate(_faults_at(node)):
            before, after = _shown(node), _shown(new)
            if before != after:
                found.append(Fault(node.lineno, node.col_offset, kind, before, after, order, number))
    return found


def with_fault(source: str, fault: Fault) -> ast.Module:
    """Return the tree of a module with one fault."""
    tree = ast.parse(source)
    for number, node in enumerate(_walked(tree)):
        if number == fault.node:
            _, new = list(_faults_at(node))[fault.order]
            for name, value in ast.iter_fields(new):
                setattr(node, name, value)
            if type(node) is not type(new):
                node.__class__ = type(new)
            break
    return ast.fix_missing_locations(tree)


def _shown(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 90 else text[:87] + "..."


def _walked(tree: ast.AST) -> Iterator[ast.AST]:
    """Return the nodes inside functions from which numbers follow, in the order of the source."""

    def visit(node: ast.AST, inside: bool) -> Iterator[ast.AST]:
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
            return
        if isinstance(node, ast.Call) and _called(node) in SILENT:
            return
        if isinstance(node, ast.FunctionDef):
            if node.name.startswith("__") and node.name not in ("__call__", "__post_init__"):
                return
            for child in node.body:
                yield from visit(child, True)
            return
        if isinstance(node, ast.If) and all(isinstance(child, ast.Raise) for child in node.body):
            for child in node.orelse:
                yield from visit(child, inside)
            return
        if isinstance(node, ast.AnnAssign):
            if inside and node.value is not None:
                yield from visit(node.value, inside)
            return
        if inside:
            yield node
        for child in ast.iter_child_nodes(node):
            yield from visit(child, inside)

    yield from visit(tree, False)


def _called(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def _is_text(node: ast.AST) -> bool:
    return any(
        isinstance(part, ast.JoinedStr | ast.List | ast.Tuple | ast.Set | ast.Dict | ast.ListComp)
        or (isinstance(part, ast.Constant) and isinstance(part.value, str | bytes))
        for part in (getattr(node, "left", node), getattr(node, "right", node))
    )


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _changed(node: ast.AST, **fields: object) -> ast.AST:
    new = copy.copy(node)
    for name, value in fields.items():
        setattr(new, name, value)
    return new


def _scaled(node: ast.Constant) -> ast.Constant:
    return ast.copy_location(ast.Constant(node.value * SCALE), node)


def _faults_at(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Return kinds and changed nodes; the order is always the same."""
    if isinstance(node, ast.BinOp) and not _is_text(node):
        yield from _faults_of_operation(node)
    elif isinstance(node, ast.AugAssign) and type(node.op) in SWAPPED and not _is_text(node.value):
        yield "operator", _changed(node, op=SWAPPED[type(node.op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not _is_number(node.operand):
        yield "sign", node.operand
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Invert):
        yield "selection", node.operand
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in NEGATED:
        texts = any(isinstance(part, ast.Constant) and part.value is None for part in node.comparators)
        if not texts:
            yield "comparison", _changed(node, ops=[NEGATED[type(node.ops[0])]()])
    elif isinstance(node, ast.BoolOp):
        yield "and/or", _changed(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.Subscript):
        yield from _faults_of_index(node)
    elif isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple) and len(node.value.elts) > 1:
        first, second, *rest = node.value.elts
        yield "order returned", _changed(node, value=_changed(node.value, elts=[second, first, *rest]))
    elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple) and len(node.targets[0].elts) == 2:
        first, second = node.targets[0].elts
        if isinstance(first, ast.Name) and isinstance(second, ast.Name) and "_" not in (first.id, second.id):
            target = _changed(node.targets[0], elts=[second, first])
            yield "order unpacked", _changed(node, targets=[target])
    elif isinstance(node, ast.Call):
        yield from _faults_of_call(node)


def _faults_of_operation(node: ast.BinOp) -> Iterator[tuple[str, ast.AST]]:
    if type(node.op) in SWAPPED:
        yield "operator", _changed(node, op=SWAPPED[type(node.op)]())
    if isinstance(node.op, ast.Add | ast.Sub):
        yield "dropped term", node.left
    if isinstance(node.op, ast.Mult) and not _is_number(node.left):
        yield "dropped factor", node.left
    for side in ("left", "right"):
        part = getattr(node, side)
        of_size = isinstance(part, ast.Constant) and isinstance(part.value, float)
        if of_size and LEAST_CONSTANT <= abs(part.value) <= LARGEST_CONSTANT:
            yield "constant x 1.02", _changed(node, **{side: _scaled(part)})


def _faults_of_index(node: ast.Subscript) -> Iterator[tuple[str, ast.AST]]:
    """`[0]` becomes `[1]` and the other way round, `[2]` becomes `[0]`; in the last place of several."""

    def other(part: ast.AST) -> ast.AST | None:
        if isinstance(part, ast.Constant) and type(part.value) is int and part.value in (0, 1, 2):
            return ast.copy_location(ast.Constant({0: 1, 1: 0, 2: 0}[part.value]), part)
        return None

    if isinstance(node.slice, ast.Tuple):
        last = other(node.slice.elts[-1])
        if last is not None:
            yield "index", _changed(node, slice=_changed(node.slice, elts=[*node.slice.elts[:-1], last]))
    elif (new := other(node.slice)) is not None:
        yield "index", _changed(node, slice=new)


def _faults_of_call(node: ast.Call) -> Iterator[tuple[str, ast.AST]]:
    name, arguments = _called(node), node.args
    if name in QUANTILES and len(arguments) > 1 and _is_number(arguments[1]):
        middle = 0.5 if "quantile" in name else 50
        yield "percentile", _changed(node, args=[arguments[0], ast.Constant(middle), *arguments[2:]])
    if name == "arctan2":
        yield "arguments", _changed(node, args=arguments[::-1])
    if name in OTHER_FUNCTION:
        if isinstance(node.func, ast.Attribute):
            yield "function", _changed(node, func=_changed(node.func, attr=OTHER_FUNCTION[name]))
        else:
            yield "function", _changed(node, func=_changed(node.func, id=OTHER_FUNCTION[name]))
    if name == "sqrt" and len(arguments) == 1:
        yield "function", _changed(node, func=ast.Name("float" if _is_module(node, "math") else "abs", ast.Load()))
    if name in ("column_stack", "stack", "array") and arguments and isinstance(arguments[0], ast.List | ast.Tuple):
        parts = arguments[0].elts
        if len(parts) > 1 and not any(_is_number(part) for part in parts):
            swapped = _changed(arguments[0], elts=[parts[1], parts[0], *parts[2:]])
            yield "order of columns", _changed(node, args=[swapped, *arguments[1:]])


def _is_module(node: ast.Call, name: str) -> bool:
    return isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") == name
