"""Tables as frozen dataclasses whose arrays are columns; names are stored as distinct names and an index per row.

Ten million measurements are of a thousand different images and of three million points. As texts these columns would
need more memory than all numbers, and finding the distinct names would take longer than a step of the adjustment.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, Self

import numpy as np

from ..foundation.errors import InputError


class NameColumn:
    """A column of texts as distinct names and indices; NumPy functions accept it like the array of texts.

    names : (k,) distinct names, which may include unused ones; number : (n,) index of the name of each row
    """

    dtype = np.dtype(str)
    ndim = 1

    def __init__(self, names: np.ndarray, number: np.ndarray) -> None:
        self.names, self.number = names, number

    @property
    def shape(self) -> tuple[int]:
        return (len(self.number),)

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, rows: Any) -> Any:
        number = self.number[rows]
        return NameColumn(self.names, number) if isinstance(number, np.ndarray) else self.names[number]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        texts = self.names[self.number]
        return texts if dtype is None else texts.astype(dtype)

    def __eq__(self, other: object) -> Any:
        return (self.names == other)[self.number] if isinstance(other, str) else np.asarray(self) == other

    def __ne__(self, second: object) -> Any:
        return ~(self == second)

    __hash__ = None  # type: ignore[assignment]  # not hashable, like an array

    def tolist(self) -> list[str]:
        """Return the texts of all rows; equal texts are the same object."""
        names = self.names.tolist()
        return [names[number] for number in self.number.tolist()]


def find_unique_ids(ids: np.ndarray | NameColumn) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct ids, sorted, and the index of each row's id; fast if equal ids are adjacent."""
    if isinstance(ids, NameColumn):
        occurs = np.zeros(len(ids.names), dtype=bool)
        occurs[ids.number] = True
        distinct, place = np.unique(ids.names[occurs], return_inverse=True)
        new = np.zeros(len(occurs), dtype=np.int64)
        new[occurs] = place
        return distinct, new[ids.number]
    if not len(ids):
        return ids, np.zeros(0, dtype=np.int64)
    head = np.r_[True, ids[1:] != ids[:-1]]
    distinct, inverse = np.unique(ids[head], return_inverse=True)
    return distinct, inverse.astype(np.int64)[np.cumsum(head) - 1]


def isin(ids: np.ndarray | NameColumn, requested: Sequence[str] | np.ndarray) -> np.ndarray:
    """Return which rows have one of the ``requested`` names, ``(n,)`` bool."""
    if isinstance(ids, NameColumn):
        return np.isin(ids.names, requested)[ids.number]
    return np.isin(ids, requested)


def match_names(requested: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each ``requested`` name a row of ``valid`` with this name, and whether there is one (else any row)."""
    order = np.argsort(valid)
    row = order[np.minimum(np.searchsorted(valid, requested, sorter=order), len(order) - 1)]
    return row, np.asarray(valid[row] == requested)


def join_names(columns: Sequence[np.ndarray | NameColumn]) -> Any:
    """Return the columns concatenated; as a `NameColumn` if any of them is one."""
    if not any(isinstance(column, NameColumn) for column in columns):
        return np.concatenate(columns)
    parts = [find_unique_ids(column) for column in columns]
    names, place = np.unique(np.concatenate([distinct for distinct, _ in parts]), return_inverse=True)
    ends = np.cumsum([len(distinct) for distinct, _ in parts])
    number = [place[end - len(distinct) : end][inverse] for end, (distinct, inverse) in zip(ends, parts, strict=True)]
    return NameColumn(names, np.concatenate(number))


class Columns:
    """A table: every array of a dataclass is a column."""

    def select(self, keep: np.ndarray) -> Self:
        """Return the selected rows (mask or indices)."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        columns_selected = {
            name: one[keep] for name, one in columns.items() if isinstance(one, (np.ndarray, NameColumn))
        }
        return replace(self, **columns_selected)  # type: ignore[type-var]

    def __repr__(self) -> str:
        first = getattr(self, fields(self)[0].name)  # type: ignore[arg-type]
        return f"<{type(self).__name__}: {len(first)} rows>"

    def _fill(self, **columns: tuple[type, tuple[int, ...]]) -> None:
        """Convert sequences and single values to columns of one length; ``columns`` has type and row shape of each.

        The first column defines the number of rows; an array with as many values as the column, but another shape, is
        reshaped. Raises `InputError` with the name of a column that does not fit.
        """
        rows = None
        for name, (kind, shape) in columns.items():
            value: Any = getattr(self, name)
            if kind is not str or not isinstance(value, (np.ndarray, NameColumn)) or value.dtype.kind not in "UO":
                value = np.asarray(value, dtype=kind)
            rows = len(value) if rows is None else rows
            if value.shape != (rows, *shape):
                try:
                    value = value.reshape(rows, *shape) if value.size == rows * np.prod(shape) else value
                    value = np.broadcast_to(value, (rows, *shape)).copy()
                except ValueError:
                    raise InputError(
                        f"`{name}` has the shape {value.shape}, but there are {rows} rows: give {(rows, *shape)}"
                    ) from None
            object.__setattr__(self, name, value)


def rank_in_groups(number: np.ndarray) -> np.ndarray:
    """Return the rank ``(n,)`` of each row among those with equal numbers, from 0; equal numbers must be adjacent."""
    start = np.flatnonzero(np.r_[True, number[1:] != number[:-1]]) if len(number) else np.empty(0, np.int64)
    return np.arange(len(number)) - np.repeat(start, np.diff(np.r_[start, len(number)]))


def group_by_number(number: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the order ``(n,)`` that sorts by number, and the first index of each group, ``(count + 1,)``.

    ``number (n,)`` are from 0 to ``count`` - 1; the sort is stable.
    """
    small = number.astype(np.uint16) if count <= 1 << 16 else number  # radix sort of uint16: six times as fast
    return np.argsort(small, kind="stable"), np.r_[0, np.cumsum(np.bincount(number, minlength=count))]
