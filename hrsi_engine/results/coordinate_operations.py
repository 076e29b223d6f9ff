"""What a report says of the coordinate operations that brought its inputs to WGS84, and of their errors."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..adjustment.statistics.precision import errors_90
from ..block.points import Role
from ..ground.operation_uses import OperationUse


def operation_entries(uses: Iterable[OperationUse]) -> list[dict[str, Any]]:
    """Return the report's ``crs_operations``: one row a source and operation, ready for JSON."""
    return [use.entry() for use in uses]


def find_untested_accuracy(result: Adjustment) -> dict[str, float | None] | None:
    """Return what check points cannot test: ``ce90_m`` and ``le90_m`` of the operations that they share with the GCPs.

    None without check points or such errors.
    """
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    if result.shared_shifts_m is None or not len(check):
        return None
    own_m = result.block.points.operation_shifts_m(check)
    shifts_m = result.shared_shifts_m[check][:, :, : own_m.shape[2]]
    hidden = np.sum(shifts_m**2 - (shifts_m - own_m) ** 2, axis=2)
    east, north, height = np.sqrt(np.maximum(np.nanmean(hidden, axis=0), 0.0)).tolist()
    return errors_90(east, north, height) if max(east, north, height) > 0.0 else None


def add_untested_error(measured: float | None, untested: Mapping[str, float | None] | None, key: str) -> float | None:
    """Return a figure of check points (``ce90_m`` or ``le90_m``, the key) with what they cannot test.

    None where it was not measured.
    """
    if measured is None or untested is None:
        return measured
    return float(np.hypot(measured, untested[key] or 0.0))
