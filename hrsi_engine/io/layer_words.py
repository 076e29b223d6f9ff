"""Columns of words that many rows share: each word stands there once, and every row has its number."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Words:
    """A column of text; to compare it, and as an array (``np.asarray``), it is that of its rows.

    Parameters
    ----------
    values : (k,) ndarray
        The words.
    index : (n,) ndarray
        The word of each row.
    """

    values: np.ndarray
    index: np.ndarray

    @property
    def dtype(self) -> np.dtype:
        """That of the words."""
        return self.values.dtype

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, rows: Any) -> Any:
        """Return a column of some rows (slice, mask or indices), or the word of one."""
        index = self.index[rows]
        return Words(self.values, index) if np.ndim(index) else self.values[index]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.values[self.index], dtype=dtype)

    def __eq__(self, word: object) -> np.ndarray:  # type: ignore[override]
        return (self.values == word)[self.index]

    def __ne__(self, word: object) -> np.ndarray:  # type: ignore[override]
        return (self.values != word)[self.index]

    def tolist(self) -> list[str]:
        """Return the rows' words; those that are equal are one object."""
        return self.values.astype(object)[self.index].tolist()

    def then(self, other: Words) -> Words:
        """Return the rows of this column and of another behind them."""
        values = np.concatenate([self.values, other.values])
        return Words(values, np.concatenate([self.index, other.index.astype(np.int32) + np.int32(len(self.values))]))


Column = np.ndarray | Words


def shared_word(word: str, count: int) -> Words:
    """Return a column of ``count`` rows that all hold one word."""
    return Words(np.array([word]), np.zeros(count, dtype=np.int32))


def is_any(column: Column, words: Iterable[str]) -> np.ndarray:
    """Return which rows of a column of text hold one of some words, ``(n,)``."""
    if isinstance(column, Words):
        return np.isin(column.values, list(words))[column.index]
    return np.isin(column, list(words))
