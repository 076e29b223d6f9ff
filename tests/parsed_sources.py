"""Sources parsed once a process, for the tests that look for calls in all of them."""

import ast
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("hrsi_engine", "processing_algorithms", "plugin")


@cache
def parse_source(path: Path) -> ast.Module:
    """Return the syntax tree of a file, which the caller leaves as it is."""
    return ast.parse(path.read_text(encoding="utf-8"))


def walk_sources(words: Collection[str], parts: Collection[str] = PARTS) -> Iterator[tuple[Path, ast.AST]]:
    """Yield every node of the shipped files whose text has one of the words; the others need no parsing."""
    for part in parts:
        for path in sorted((ROOT / part).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if any(word in text for word in words):
                for node in ast.walk(parse_source(path)):
                    yield path, node
