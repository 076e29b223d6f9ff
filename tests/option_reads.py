"""Which fields of options the product reads, found in its source by following the types of names (ast, nothing runs).

A field is read where an attribute is taken of a value whose class is known: a parameter, a local name, a field of
``self`` or what a function returns, by their annotations. A name alone would not do: ``model`` or ``path`` is read
somewhere of something in any case.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from parsed_sources import parse_source

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("hrsi_engine", "processing_algorithms")


@dataclass
class ClassSource:
    """A class: its bases, and the class that each field, property or method gives."""

    bases: list[str] = field(default_factory=list)
    members: dict[str, str | None] = field(default_factory=dict)


class OptionReads:
    """All classes of the product, and the pairs (class, field) that its functions read."""

    def __init__(self) -> None:
        trees = [parse_source(path) for part in PARTS for path in (ROOT / part).rglob("*.py")]
        self.classes: dict[str, ClassSource] = {}
        self.functions: dict[str, str | None] = {}
        for tree in trees:
            for node in ast.walk(tree):
                if isinstance(node, ast.ClassDef):
                    self._declare(node)
            for node in tree.body:
                if isinstance(node, ast.FunctionDef):
                    self.functions[node.name] = class_named(node.returns)
        self.reads: set[tuple[str, str]] = set()
        for tree in trees:
            self._words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
            self._walk(tree, {})

    def _declare(self, node: ast.ClassDef) -> None:
        found = ClassSource([base.id for base in node.bases if isinstance(base, ast.Name)])
        for part in node.body:
            if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
                found.members[part.target.id] = class_named(part.annotation)
            if isinstance(part, ast.FunctionDef):
                found.members[part.name] = class_named(part.returns)
        for part in ast.walk(node):  # self.x = x in __init__, where x is annotated
            if isinstance(part, ast.FunctionDef) and part.name == "__init__":
                given = arguments_of(part)
                for target, value in (pair for line in ast.walk(part) for pair in pairs_of(line)):
                    if isinstance(target, ast.Attribute) and isinstance(value, ast.Name) and value.id in given:
                        found.members[target.attr] = given[value.id]
        self.classes[node.name] = found

    def _walk(self, node: ast.AST, names: dict[str, str | None], owner: str | None = None) -> None:
        """Follow a function or class body; ``names`` are the classes of the names that are known there."""
        for part in ast.iter_child_nodes(node):
            if isinstance(part, ast.ClassDef):
                self._walk(part, dict(names), part.name)
            elif isinstance(part, (ast.FunctionDef, ast.Lambda)):
                own = {**names, **(arguments_of(part) if isinstance(part, ast.FunctionDef) else {})}
                if owner is not None and part.args.args:
                    own[part.args.args[0].arg] = owner
                self._walk(part, own)
            else:
                if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Load):
                    whose = self.class_of(part.value, names)
                    if whose is not None:
                        self.reads.update((name, part.attr) for name in self.lineage(whose))
                if isinstance(part, ast.Call) and isinstance(part.func, ast.Name) and part.func.id == "getattr":
                    whose = self.class_of(part.args[0], names)  # by a name that stands in the same file
                    if whose is not None:
                        self.reads.update((whose, word) for word in self._words if isinstance(word, str))
                self._walk(part, names)
                for target, value in pairs_of(part):
                    if isinstance(target, ast.Name):
                        names[target.id] = self.class_of(value, names)
                if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
                    names[part.target.id] = class_named(part.annotation)

    def class_of(self, node: ast.AST, names: dict[str, str | None]) -> str | None:
        """Return the class of an expression, None where it is not known."""
        if isinstance(node, ast.Name):
            return names.get(node.id)
        if isinstance(node, ast.Attribute):
            whose = self.class_of(node.value, names)
            return None if whose is None else self.member(whose, node.attr)
        if isinstance(node, (ast.BoolOp, ast.IfExp)):
            parts = node.values if isinstance(node, ast.BoolOp) else [node.body, node.orelse]
            return next((found for part in parts if (found := self.class_of(part, names))), None)
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Name):
                if node.func.id == "replace" and node.args:
                    return self.class_of(node.args[0], names)
                return node.func.id if node.func.id in self.classes else self.functions.get(node.func.id)
            return self.class_of(node.func, names)
        return None

    def lineage(self, name: str) -> Iterator[str]:
        """Yield a class and those that it is derived from."""
        for one in name.split("|"):
            yield one
            for base in self.classes[one].bases if one in self.classes else []:
                yield from self.lineage(base)

    def member(self, name: str, attribute: str) -> str | None:
        """Return the class of a member, its own or inherited."""
        for one in self.lineage(name):
            if one in self.classes and attribute in self.classes[one].members:
                return self.classes[one].members[attribute]
        return None


def class_named(annotation: ast.AST | None) -> str | None:
    """Return the class that an annotation names; of ``A | B`` both, of ``A | None`` A."""
    if isinstance(annotation, ast.Name):
        return annotation.id
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return class_named(ast.parse(annotation.value, mode="eval").body)
    if isinstance(annotation, ast.BinOp):
        return "|".join(filter(None, (class_named(annotation.left), class_named(annotation.right)))) or None
    return None


def arguments_of(function: ast.FunctionDef) -> dict[str, str | None]:
    """Return the classes of a function's arguments."""
    given = function.args
    return {arg.arg: class_named(arg.annotation) for arg in (*given.posonlyargs, *given.args, *given.kwonlyargs)}


def pairs_of(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield what an assignment sets, each with its value; nothing for other statements."""
    targets = node.targets if isinstance(node, ast.Assign) else []
    targets = [node.target] if isinstance(node, ast.NamedExpr) else targets
    for target in targets:
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            yield from zip(target.elts, node.value.elts, strict=False)
        else:
            yield target, node.value
