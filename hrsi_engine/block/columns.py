"""Tables: frozen dataclasses whose arrays are columns."""

from dataclasses import fields, replace
from typing import Any, Self

import numpy as np

from ..foundation.errors import InputError
from .names import NameColumn


class Columns:
    """A table: every array of a dataclass is a column."""

    def select(self, keep: np.ndarray) -> Self:
        """Return the chosen rows (mask or indices)."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        chosen = {name: one[keep] for name, one in columns.items() if isinstance(one, (np.ndarray, NameColumn))}
        return replace(self, **chosen)  # type: ignore[type-var]

    def __repr__(self) -> str:
        first = getattr(self, fields(self)[0].name)  # type: ignore[arg-type]
        return f"<{type(self).__name__}: {len(first)} rows>"

    def _fill(self, **columns: tuple[type, tuple[int, ...]]) -> None:
        """Make columns of one length from sequences and single values; ``columns`` has type and row shape of each.

        The first one has the number of rows. Raises `InputError` naming the column that does not fit.
        """
        rows = None
        for name, (kind, shape) in columns.items():
            value: Any = getattr(self, name)
            if kind is not str or not isinstance(value, (np.ndarray, NameColumn)) or value.dtype.kind not in "UO":
                value = np.asarray(value, dtype=kind)
            rows = len(value) if rows is None else rows
            if value.shape != (rows, *shape):
                try:
                    value = np.broadcast_to(value, (rows, *shape)).copy()
                except ValueError:
                    raise InputError(
                        f"`{name}` has the shape {value.shape} beside {rows} rows: give {(rows, *shape)}"
                    ) from None
            object.__setattr__(self, name, value)


def group_by_number(number: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the order ``(n,)`` that groups equal numbers, and the first index of each group, ``(count + 1,)``.

    ``number (n,)`` are from 0 to ``count`` - 1; the order within a group is kept.
    """
    small = number.astype(np.uint16) if count <= 1 << 16 else number  # sorted by digits: in a sixth of the time
    return np.argsort(small, kind="stable"), np.r_[0, np.cumsum(np.bincount(number, minlength=count))]
