"""Columns as a compiled loop takes them: 8 bytes a row, the number itself or the place of its bytes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .layer_words import Column, StackedColumn, Words

NUMBER_CELL, INTEGER_CELL, TEXT_CELL, BYTES_CELL = range(4)
_NO_BYTES = -1  # length of what is not there


class Cells:
    """Columns as the compiled loop takes them.

    kinds : (c,) which of `NUMBER_CELL`, `INTEGER_CELL`, `TEXT_CELL`, `BYTES_CELL`
    words : (c, n) 8 bytes each: the number, or the place of the bytes in ``content``
    lengths : (c, n) of the bytes, negative where there is nothing; content : (b,) all bytes
    """

    def __init__(self, columns: Sequence[Column], texts: Texts) -> None:
        rows, begin, parts = len(columns[0]), 0, [np.empty(0, dtype=np.uint8)]
        self.kinds = np.empty(len(columns), dtype=np.int8)
        self.words = np.empty((len(columns), rows), dtype=np.int64)
        self.lengths = np.zeros((len(columns), rows), dtype=np.int32)
        for number, given in enumerate(columns):
            column = np.asarray(given) if isinstance(given, StackedColumn) else given
            kind, words, lengths = column.dtype.kind, self.words[number], self.lengths[number]
            if kind == "f":
                self.kinds[number] = NUMBER_CELL
                words.view(np.float64)[:] = column
                continue
            if kind in "biu":
                self.kinds[number] = INTEGER_CELL
                words[:] = column
                continue
            if isinstance(column, Words):
                self.kinds[number] = TEXT_CELL
                content, long = texts.encode(column.values)
                words[:], lengths[:] = column.index, long[column.index]
                words *= content.itemsize
            elif kind == "U":
                self.kinds[number] = TEXT_CELL
                content, lengths[:] = _utf8(column)
                words[:] = content.itemsize * np.arange(rows)
            elif kind == "V":
                self.kinds[number] = BYTES_CELL
                content, lengths[:] = np.ascontiguousarray(column), column.itemsize
                words[:] = column.itemsize * np.arange(rows)
            else:  # objects: bytes or nothing
                self.kinds[number] = BYTES_CELL
                lengths[:] = [_NO_BYTES if value is None else len(value) for value in column.tolist()]
                content = np.frombuffer(b"".join(one for one in column.tolist() if one is not None), dtype=np.uint8)
                words[:] = np.cumsum(np.maximum(lengths, 0)) - lengths
            words += begin
            parts.append(content.view(np.uint8))
            begin += content.nbytes
        self.content = np.concatenate(parts)


class Texts:
    """Cache of text columns encoded as UTF-8, by the array of their distinct values."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def encode(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return words as bytes (dtype ``S``), and their lengths."""
        if id(values) not in self._known:
            self._known[id(values)] = (values, *_utf8(values))  # kept, so that no other array gets its address
        return self._known[id(values)][1:]


def _utf8(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return texts as UTF-8 bytes, dtype ``S``, and their lengths."""
    if not len(values) or not values.itemsize:
        return np.zeros(len(values), dtype="S1"), np.zeros(len(values), dtype=np.int32)
    points = np.ascontiguousarray(values).view(np.uint32).reshape(len(values), -1)
    ascii_only = points.max() < 128
    content = points.astype("u1").view(f"S{points.shape[1]}")[:, 0] if ascii_only else np.char.encode(values, "utf-8")
    return content, np.char.str_len(content).astype(np.int32)
