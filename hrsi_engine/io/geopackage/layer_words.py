"""Columns that take less memory than an array of their rows: of shared values, or in parts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin


@dataclass(frozen=True, eq=False)
class PickedColumn:
    """Rows that share values: each of them, (k,) or (k, d), stands there once; ``index`` (n,) is that of each row."""

    values: np.ndarray
    index: np.ndarray

    @property
    def dtype(self) -> np.dtype:
        """That of the values."""
        return self.values.dtype

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, rows: Any) -> Any:
        """Return a column of some rows (slice, mask or indices), or the value of one."""
        index = self.index[rows]
        return type(self)(self.values, index) if np.ndim(index) else self.values[index]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.values[self.index], dtype=dtype)


class Words(PickedColumn):
    """A column of text; to compare it, and as an array (``np.asarray``), it is that of its rows."""

    def __eq__(self, word: object) -> np.ndarray:  # type: ignore[override]
        return (self.values == word)[self.index]

    def __ne__(self, word: object) -> np.ndarray:  # type: ignore[override]
        return (self.values != word)[self.index]

    def tolist(self) -> list[str]:
        """Return the rows' words; those that are equal are one object."""
        return self.values.astype(object)[self.index].tolist()

    def concatenate(self, other: Words) -> Words:
        """Return the rows of this column and of another behind them."""
        if other.values is self.values:
            return Words(self.values, np.concatenate([self.index, other.index]).astype(np.int32))
        values = np.concatenate([self.values, other.values])
        return Words(values, np.concatenate([self.index, other.index.astype(np.int32) + np.int32(len(self.values))]))


@dataclass(frozen=True, eq=False)
class StackedColumn(NDArrayOperatorsMixin):
    """The rows of some columns of numbers, one column behind the other; only what is asked for is put together.

    In arithmetic and in NumPy's functions it is the array of its rows.
    """

    parts: tuple[Any, ...]

    @property
    def dtype(self) -> np.dtype:
        """That of all rows."""
        return np.result_type(*(part.dtype for part in self.parts))

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __getitem__(self, rows: Any) -> Any:
        """Return some rows (slice, mask or indices); of a slice with no more work than it has rows."""
        if not isinstance(rows, slice):
            return np.asarray(self)[rows]
        start, stop, _ = rows.indices(len(self))
        found, begin = list[Any](), 0
        for part in self.parts:
            found.append(part[max(start - begin, 0) : max(stop - begin, 0)])
            begin += len(part)
        found = [part for part in found if len(part)] or found[:1]
        return found[0] if len(found) == 1 else np.concatenate(found)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.concatenate(self.parts).astype(dtype or self.dtype, copy=False)

    def __array_ufunc__(self, ufunc: Any, method: Any, *inputs: Any, **kwargs: Any) -> Any:
        arrays = (np.asarray(value) if isinstance(value, StackedColumn) else value for value in inputs)
        return getattr(ufunc, method)(*arrays, **kwargs)

    def tolist(self) -> list[Any]:
        """Return the rows' values."""
        return np.asarray(self).tolist()


Column = np.ndarray | Words | StackedColumn


def make_shared_words(word: str, count: int) -> Words:
    """Return a column of ``count`` rows that all hold one word."""
    return Words(np.array([word]), np.zeros(count, dtype=np.int32))


def is_any(column: Column, words: Iterable[str]) -> np.ndarray:
    """Return which rows of a column of text hold one of some words, ``(n,)``."""
    if isinstance(column, Words):
        return np.isin(column.values, list(words))[column.index]
    return np.isin(column, list(words))
