"""Which cases of a parametrised test `make test` leaves to `make test-all`."""

from collections.abc import Iterable
from typing import Any

import pytest


def mark_beyond(first: int, marker: str, cases: Iterable[Any]) -> list[Any]:
    """Return the cases of a test, all but the ``first`` of them with a marker of pyproject.toml."""
    mark = getattr(pytest.mark, marker)
    rest = list(cases)
    plain, long = rest[:first], rest[first:]
    return plain + [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=mark) for case in long]
