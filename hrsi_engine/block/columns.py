"""Tables: frozen dataclasses whose arrays are columns."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Self

import numpy as np


class Columns:
    """A table: every array of a dataclass is a column."""

    def select(self, keep: np.ndarray) -> Self:
        """Return the chosen rows (mask or indices)."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        chosen = {name: column[keep] for name, column in columns.items() if isinstance(column, np.ndarray)}
        return replace(self, **chosen)  # type: ignore[type-var]
