"""CSV as plain as tables of millions of rows are, column by column from its bytes; `csv_text` reads all others.

Plain are ASCII texts without quotes and control characters, rows as long as the header, and decimal numbers. Whatever
is not plain makes `read_plain` give up, so that one reader decides what a file means and what is wrong with it. Numbers
are those of Python's ``float``, to the last bit: a mantissa below 2**53 times or through a power of ten up to 10**22 is
rounded once (Clinger 1990); any other number is given to ``float`` itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from ...foundation import compiled_code
from .columns import NUMBER_FIELDS

WORTH_BYTES = 1 << 20  # smaller files are read before the compiled loops are loaded
_BLOCK_BYTES = 1 << 23
_LONGEST_FIELD = 200  # characters; more is for the other reader to refuse


def is_worth_it(size: int) -> bool:
    """Return whether a file of a size in bytes is to be read by compiled loops."""
    return compiled_code.is_wanted(size >= WORTH_BYTES)


def read_plain(file: BinaryIO, separator: str, width: int, found: Mapping[str, int]) -> dict[str, np.ndarray] | None:
    """Return the columns of a file that stands behind its header, None where it is not plain.

    Parameters
    ----------
    file : opened
    separator : between fields
    width : number of fields
    found : known field -> position of its column
    """
    parts: dict[str, list[np.ndarray]] = {field: [] for field in found}
    rest = b""
    while block := file.read(_BLOCK_BYTES):
        last = len(block) < _BLOCK_BYTES
        block = rest + block + (b"\n" if last else b"")
        whole = block.rfind(b"\n") + 1
        rest = block[whole:]
        columns = _columns(block[:whole], separator, width, found)
        if columns is None:
            return None
        for field, values in columns.items():
            parts[field].append(values)
    if rest.strip() or not any(len(part) for part in next(iter(parts.values()))):
        return None
    return {field: np.concatenate(parts.pop(field)) for field in found}


def _columns(block: bytes, separator: str, width: int, found: Mapping[str, int]) -> dict[str, np.ndarray] | None:
    """Return the columns of whole lines."""
    from .compiled_csv import copy_texts, parse_numbers, split_fields

    data = np.frombuffer(block, dtype=np.uint8)
    place = np.empty((2, width, block.count(b"\n")), dtype=np.int32)
    rows = split_fields(data, ord(separator), place)
    if rows < 0:
        return None
    columns: dict[str, np.ndarray] = {}
    for field, column in found.items():
        start, end = place[:, column, :rows]
        if field in NUMBER_FIELDS:
            values, others = np.empty(rows), np.empty(rows, dtype=np.int32)
            count = parse_numbers(data, start, end, values, others)
            if count < 0:
                return None
            for row in others[:count].tolist():
                values[row] = float(block[start[row] : end[row]])
            if np.isinf(values).any():
                return None
            columns[field] = values
        else:
            longest = int((end - start).max(initial=1))
            if longest > _LONGEST_FIELD:
                return None
            texts = np.zeros((rows, max(longest, 1)), dtype=np.uint32)
            copy_texts(data, start, end, texts)
            columns[field] = texts.view(f"U{texts.shape[1]}")[:, 0]
    return columns
