"""Every code that the source can emit has a section in docs/verdict.md, and every section a code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "verdict.md"
CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")


def codes_in(path: Path) -> Iterator[ast.expr]:
    """Yield the code of every `Reason(...)`, and of every `Slip(...)` that becomes one, as it is written in a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in (
            "Reason",
            "Slip",
        ):
            named = [word.value for word in node.keywords if word.arg == "code"]
            code = (named or node.args)[0]
            if not (isinstance(code, ast.Attribute) and code.attr == "code"):  # that of a slip
                yield code


def words_of(expression: ast.expr) -> set[str]:
    """Return the texts that an expression can be: a word, one of a dict's, or one of two."""
    if isinstance(expression, ast.Subscript):
        expression = expression.value
    parts = {ast.Dict: lambda node: node.values, ast.IfExp: lambda node: [node.body, node.orelse]}
    chosen = parts.get(type(expression), lambda node: [node])(expression)
    assert all(isinstance(part, ast.Constant) for part in chosen), (
        f"line {expression.lineno}: write the code of a Reason as a word, so that it can be found"
    )
    return {part.value for part in chosen}


def test_codes_and_sections_agree():
    emitted = {
        word for path in (ROOT / "hrsi_engine").rglob("*.py") for code in codes_in(path) for word in words_of(code)
    }
    sections = re.findall(r"^### (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert {"not-converged", "control-misfit"} <= emitted
    assert all(CODE.fullmatch(word) for word in emitted)
    assert sorted(sections) == sorted(emitted)
