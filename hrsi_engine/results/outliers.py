"""Detection of outliers among residuals: one rule for the report, the layers, the drawings and the panel.

The statistic of a residual is its length with every coordinate in units of its own sigma; beyond `ROBUST.rejected` it
is an outlier. Residuals and sigmas are those of `results.residuals`; the layers have both, and their ratio is the
statistic.
"""

from typing import Any

import numpy as np

from ..adjustment.result import Adjustment, Decision
from ..block.block import Role
from ..foundation.robust_scale import ROBUST
from ..foundation.thresholds import LISTS
from .residuals import Residuals, compute_statistic


def is_outlier(statistics: np.ndarray) -> np.ndarray:
    """Return True for statistics of outliers; False for those that are not known (NaN)."""
    return np.nan_to_num(statistics) > ROBUST.rejected


#: Flags of measurements; ``rejected`` is a tie measurement.
FLAGS = np.array(["ok", "rejected", "outlier", "unused"])


def classify_measurements(result: Adjustment, left: Residuals) -> np.ndarray:
    """Return the flag of each image measurement ``(n,)`` as index into `FLAGS`."""
    role = result.block.points.role[result.block.measurements.point]
    unused = ~result.has_residual
    outlier = is_outlier(left.statistic)
    return np.select([unused & (role == Role.TIE), outlier, unused], [1, 2, 3], 0).astype(np.int8)


def ground_flags(left: Residuals) -> np.ndarray:
    """Return ``ok`` or ``outlier`` for the ground residual of each point."""
    return np.where(is_outlier(compute_statistic(left.ground_m, left.ground_sigma_m)), "outlier", "ok")


def find_outliers(result: Adjustment, left: Residuals) -> tuple[np.ndarray, np.ndarray]:
    """Return the statistic of each measurement ``(n,)``, and True for outliers and for those that were rejected.

    The statistic of a measurement rejected by data snooping is that of the test that it failed.
    """
    statistic = left.statistic
    rejected = np.isnan(statistic) & (result.decision != int(Decision.KEPT))
    statistic = np.where(rejected, result.statistic, statistic)
    return statistic, is_outlier(statistic) | rejected


def outlier_entries(result: Adjustment, left: Residuals) -> dict[str, Any]:
    """Return the report's list of outliers, the worst first, and their total number."""
    statistic, _ = find_outliers(result, left)
    outliers = np.flatnonzero(is_outlier(statistic))
    worst = outliers[np.argsort(-statistic[outliers], kind="stable")]
    return {
        "outliers": [
            name_measurement(result, row) | {"statistic": float(statistic[row])} for row in worst[: LISTS.rows].tolist()
        ],
        "outlier_count": len(worst),
    }


def name_measurement(result: Adjustment, row: int) -> dict[str, str]:
    """Return id, image and role of a measurement, as reports name it."""
    points, rows = result.block.points, result.block.measurements
    return {
        "id": str(points.ids[rows.point[row]]),
        "image": result.block.images[rows.image[row]].id,
        "role": Role(points.role[rows.point[row]]).label,
    }
