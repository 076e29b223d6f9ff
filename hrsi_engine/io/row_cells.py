"""Columns as a compiled loop takes them: 8 bytes a row, the number itself or the address of its bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .layer_words import Column, Words

NUMBER_CELL, INTEGER_CELL, TEXT_CELL, BLOB_CELL = range(4)


class Cells:
    """A column as the compiled loop takes it.

    Parameters
    ----------
    kind : which of `NUMBER_CELL`, `INTEGER_CELL`, `TEXT_CELL`, `BLOB_CELL`
    words : (n,) 8 bytes each: the number, or the address of the bytes
    lengths : (n,) of the bytes
    kept : what the addresses lead to
    """

    def __init__(self, kind: int, words: np.ndarray, lengths: np.ndarray | None = None, kept: Any = None) -> None:
        self.kind, self.words, self.kept = kind, words, kept
        self.lengths = np.zeros(len(words), dtype=np.int32) if lengths is None else lengths

    @classmethod
    def of(cls, column: Column) -> Cells:
        if isinstance(column, Words):
            used, index = np.unique(column.index, return_inverse=True) if _is_sparse(column) else (None, column.index)
            return cls._texts(column.values if used is None else column.values[used], index)
        if column.dtype.kind == "U":
            return cls._texts(column, np.arange(len(column)))
        if column.dtype.kind == "V":
            content = np.ascontiguousarray(column)
            lengths = np.full(len(column), column.itemsize, dtype=np.int32)
            return cls(BLOB_CELL, content.ctypes.data + column.itemsize * np.arange(len(column)), lengths, content)
        if column.dtype.kind == "f":
            return cls(NUMBER_CELL, np.ascontiguousarray(column, dtype=np.float64).view(np.int64))
        return cls(INTEGER_CELL, column.astype(np.int64))

    @classmethod
    def _texts(cls, values: np.ndarray, index: np.ndarray) -> Cells:
        content = _utf8(np.ascontiguousarray(values))
        lengths = np.char.str_len(content).astype(np.int32)
        return cls(TEXT_CELL, content.ctypes.data + content.itemsize * index.astype(np.int64), lengths[index], content)


def _is_sparse(column: Words) -> bool:
    """Return whether rows are few beside the words, so that only theirs need to be looked at."""
    return len(column.values) > len(column.index)


def _utf8(values: np.ndarray) -> np.ndarray:
    """Return texts as UTF-8 bytes, dtype ``S``."""
    if not len(values) or not values.itemsize:
        return np.zeros(len(values), dtype="S1")
    points = values.view(np.uint32).reshape(len(values), -1)
    if points.max() < 128:  # ASCII
        return points.astype(np.uint8).view(f"S{points.shape[1]}")[:, 0]
    return np.char.encode(values, "utf-8")
