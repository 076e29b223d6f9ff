"""Every code that the source can emit has a section in docs/verdict.md, and every section a code."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "verdict.md"
CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
CARRIERS = ("Reason", "Mistake")  # classes whose first argument is a code; a slip becomes a reason


def codes_in(path: Path) -> set[str]:
    """Return the codes of every `Reason(...)` and `Mistake(...)` in a file, as words."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and name_of(node.func) in CARRIERS]
    codes = [
        next((word.value for word in call.keywords if word.arg == "code"), (call.args or [None])[0]) for call in calls
    ]
    return {word for code in codes for word in words_of(code, tree, path)}


def name_of(expression: ast.expr) -> str:
    return getattr(expression, "id", getattr(expression, "attr", ""))


def words_of(code: ast.expr, tree: ast.Module, path: Path) -> set[str]:
    """Return the texts that an expression can be: a word, one of a dict's, or those of a table."""
    if isinstance(code, ast.Attribute) and code.attr == "code":
        return set()  # that of a slip, which is found itself
    if isinstance(code, ast.Subscript):
        code = code.value
    if isinstance(code, ast.Dict):
        parts = code.values
    elif isinstance(code, ast.Name):
        parts = [
            row.elts[[name_of(item) for item in loop.target.elts].index(code.id)]
            for loop in ast.walk(tree)
            if isinstance(loop, ast.For) and isinstance(loop.target, ast.Tuple) and isinstance(loop.iter, ast.Tuple)
            and code.id in [name_of(item) for item in loop.target.elts]
            for row in loop.iter.elts
        ]  # fmt: skip
    else:
        parts = [code]
    words = {part.value for part in parts if isinstance(part, ast.Constant)}
    assert words and len(words) == len({ast.dump(part) for part in parts}), (
        f"{path.name}, line {code.lineno}: write the code as a word, so that it can be found"
    )
    return words


def test_codes_and_sections_agree():
    parts = ("hrsi_engine", "processing_algorithms")
    emitted = {word for part in parts for path in (ROOT / part).rglob("*.py") for word in codes_in(path)}
    sections = re.findall(r"^### (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert {"not-converged", "control-misfit", "image-axes", "lon-lat-sign"} <= emitted
    assert all(CODE.fullmatch(word) for word in emitted)
    assert sorted(sections) == sorted(emitted)
