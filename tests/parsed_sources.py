"""Sources parsed once a process, for the tests that look for calls in all of them."""

import ast
from functools import cache
from pathlib import Path


@cache
def parse_source(path: Path) -> ast.Module:
    """Return the syntax tree of a file, which the caller leaves as it is."""
    return ast.parse(path.read_text(encoding="utf-8"))
