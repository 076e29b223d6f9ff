"""Tables of millions of rows as CSV: numbers become text column by column, in NumPy.

Python's formatting needs a call for each value. Here each column of a chunk is an array of bytes ``(n, width)`` in
which unused places are NUL; joined they are the rows, and without NUL the text.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .safety.replacing import replacing

#: Decimals of columns in degrees, 0.01 mm on the ground; all other numbers have `DECIMALS`.
DECIMALS_BY_NAME = {"lon": 10, "lat": 10}
DECIMALS = 6
_LARGEST = 1e12  # larger numbers have no meaning in these tables, and with decimals would not fit 64 bits


def write_large_table(path: str, chunks: Iterable[Mapping[str, np.ndarray]]) -> None:
    """Write a table in one step; raise `OutputError` if it cannot be written.

    path : the file; chunks : parts of the table, columns by name, the same in each; NaN and infinity become empty
    """
    with replacing(path) as temporary, open(temporary, "wb") as file:
        for number, chunk in enumerate(chunks):
            if number == 0:
                file.write((",".join(chunk) + "\n").encode())
            file.write(format_rows(chunk))


def read_large_table(path: str) -> dict[str, np.ndarray]:
    """Return a table of `write_large_table` as columns: numbers with NaN where they are empty, else text."""
    with open(path, encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    return {name: _parse_column(texts) for name, texts in zip(names, zip(*rows, strict=True), strict=True)}


def _parse_column(texts: Sequence[str]) -> np.ndarray:
    try:
        return np.array([float(text) if text else np.nan for text in texts])
    except ValueError:
        return np.array(texts, dtype=object)


def format_rows(columns: Mapping[str, np.ndarray]) -> bytes:
    """Return rows as lines of CSV in UTF-8."""
    parts = list[np.ndarray]()
    for name, values in columns.items():
        parts += [_format_column(name, values), np.full((len(values), 1), ord(","), dtype=np.uint8)]
    parts[-1][:] = ord("\n")
    return np.hstack(parts).tobytes().translate(None, b"\0")


def _format_column(name: str, values: np.ndarray) -> np.ndarray:
    """Return a column as bytes ``(n, width)``, unused ones NUL."""
    if values.dtype.kind in "UO":
        return _format_text(values.astype(str, copy=False))
    if values.dtype.kind in "biu":
        return _format_numbers(values.astype(np.int64), 0)
    decimals = DECIMALS_BY_NAME.get(name, DECIMALS)
    finite = np.abs(values) < _LARGEST  # False for NaN
    text = _format_numbers(np.rint(np.where(finite, values, 0.0) * 10.0**decimals).astype(np.int64), decimals)
    text[~finite] = 0
    return text


def _format_numbers(values: np.ndarray, decimals: int) -> np.ndarray:
    """Return integers ``(n,)`` in units of the last decimal as decimal numbers, ``(n, width)`` bytes."""
    left = np.abs(values)
    digits = max(len(str(int(left.max(initial=0)))), decimals + 1)
    text = np.zeros((len(values), digits + 2), dtype=np.uint8)
    text[:, 0] = np.where(values < 0, ord("-"), 0)
    column = digits + 1
    for place in range(digits):
        if place == decimals and decimals:
            text[:, column] = ord(".")
            column -= 1
        tens = left // 10
        digit = (left - 10 * tens + ord("0")).astype(np.uint8)
        text[:, column] = digit if place <= decimals else np.where(left > 0, digit, 0)
        left, column = tens, column - 1
    return text


def _format_text(values: np.ndarray) -> np.ndarray:
    """Return texts as UTF-8 bytes ``(n, width)``; quoted where CSV demands it."""
    points = np.ascontiguousarray(values).view(np.uint32).reshape(len(values), -1)
    if np.isin(points, [ord(sign) for sign in ',"\r\n']).any():
        values = np.array(['"' + text.replace('"', '""') + '"' for text in values.tolist()])
        points = values.view(np.uint32).reshape(len(values), -1)
    if points.max(initial=0) < 128:  # of ASCII, each code point is its byte
        return points.astype(np.uint8)
    return np.char.encode(values, "utf-8").view(np.uint8).reshape(len(values), -1)
