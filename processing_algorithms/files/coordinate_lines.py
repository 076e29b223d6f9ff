"""Coordinates as lines of text, in the format of `gdaltransform`."""

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.opening.files import has_decimal_commas, parse_finite


def standard_input(example: str) -> Iterable[str]:
    """Return the piped lines; if there is no pipe, raise `InputError` instead of waiting for keyboard input."""
    if sys.stdin is None or sys.stdin.closed or sys.stdin.isatty():
        raise InputError(f"no points are given: name a file with `points`, or pipe lines {example!r} into the command")
    return sys.stdin


def parse_lines(lines: Iterable[str], names: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """Return the numbers of lines ``(n, len(names))`` and the rest of each line.

    Numbers are separated by blanks, tabs or commas; the last may be missing (NaN). Empty lines are skipped. Raises
    `InputError` with the number of the line.
    """
    numbers, rest = [], []
    for count, line in enumerate(lines, start=1):
        if has_decimal_commas(line):
            raise InputError(f"line {count}: {line.strip()[:60]!r} has decimals behind commas: write them with a point")
        words = line.replace(",", " ").split()
        if not words:
            continue
        values: list[float] = []
        for word in words[: len(names)]:
            if (value := parse_finite(word)) is None:
                break
            values.append(value)
        if len(values) < len(names) - 1:
            raise InputError(f"line {count}: {line.strip()[:60]!r} does not begin with {' '.join(names)}: correct it")
        rest.append(" ".join(words[len(values) :]))
        numbers.append(values + [math.nan] * (len(names) - len(values)))
    return np.array(numbers, dtype=np.float64).reshape(-1, len(names)), rest


def make_point_rows(columns: Mapping[str, np.ndarray], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return some columns as rows for a report; the coordinates of points with a non-finite one are NaN."""
    numbers = [name for name in names if columns[name].dtype.kind == "f"]
    lost = ~np.all([np.isfinite(columns[name]) for name in numbers], axis=0)
    values = [np.where(lost, np.nan, columns[name]) if name in numbers else columns[name] for name in names]
    return [dict(zip(names, row, strict=True)) for row in zip(*(one.tolist() for one in values), strict=True)]


def format_lines(rows: Iterable[Iterable[float | str | None]], separator: str = " ") -> str:
    """Return rows as text with 15 significant digits, and ``nan`` for a missing value."""
    texts = (
        ["nan" if cell is None else cell if isinstance(cell, str) else f"{cell:.15g}" for cell in row if cell != ""]
        for row in rows
    )
    return "\n".join(map(separator.join, texts))
