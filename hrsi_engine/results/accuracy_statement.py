"""Accuracy statements of standards, from the errors of check points.

* NSSDA (FGDC-STD-007.3-1998, appendix 3-A), at 95 % confidence: 2.4477 · (RMSE_east + RMSE_north) / 2, defined where
  the smaller of the two is at least 0.6 of the larger; 1.9600 · RMSE_height; 20 check points are asked for.
* ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (version 2, 2024). The standard adds the
  survey error of the check points to the errors found at them, and asks for 30 check points::

      RMSE_H = sqrt(RMSE_H1² + RMSE_H2²)      RMSE_H1 = sqrt(RMSE_east² + RMSE_north²)      RMSE_H2: of the survey
      RMSE_V = sqrt(RMSE_V1² + RMSE_V2²)      RMSE_3D = sqrt(RMSE_H² + RMSE_V²)
"""

from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import Role
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import threshold, thresholds
from .residuals import Residuals, rmse

NSSDA_PLAN, NSSDA_HEIGHT = 2.4477, 1.9600  # 95 % of a circle and of a line, in standard deviations


@thresholds
class ACCURACY_STATEMENT:
    """What the standards ask of check points."""

    asprs_points: int = threshold(30, "points", "check points that a test needs", "ASPRS 2024, edition 2")
    nssda_points: int = threshold(20, "points", "check points that a test needs", "FGDC-STD-007.3-1998")
    nssda_ratio: float = threshold(
        0.6, "", "smaller over larger RMSE in plan, from which the circular error is defined", "FGDC-STD-007.3-1998"
    )


def state_accuracy_by_standards(result: Adjustment, left: Residuals) -> dict[str, Any] | None:
    """Return mean errors of the check points and the statements of NSSDA and ASPRS, m; None without check points.

    A figure is None where its coordinates were not surveyed. Means are survey - computed.
    """
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    error = left.ground_m[check]
    plan = finite_rows(error[:, :2])
    if not plan.any() and not np.isfinite(error[:, 2]).any():
        return None
    variance = result.block.points.survey_covariance_m2(check).diagonal(axis1=1, axis2=2)
    survey = np.sqrt(np.where(np.isfinite(error), variance, np.nan))
    east, north, height = (rmse(error[:, axis]) for axis in range(3))
    of_survey = [rmse(survey[:, axis]) for axis in range(3)]
    plan_m, survey_plan_m = _join(east, north), _join(*of_survey[:2])
    total_h, total_v = _join(plan_m, survey_plan_m), _join(height, of_survey[2])
    points = int(max(plan.sum(), np.isfinite(error[:, 2]).sum()))
    return {
        "points_in_plan": int(plan.sum()), "points_in_height": int(np.isfinite(error[:, 2]).sum()),
        **{f"mean_{name}_m": _mean(error[:, axis]) for axis, name in enumerate(("east", "north", "height"))},
        "asprs": {
            "rmse_h_m": total_h, "rmse_v_m": total_v, "rmse_3d_m": _join(total_h, total_v),
            "found_rmse_h_m": plan_m, "found_rmse_v_m": height,
            "survey_rmse_h_m": survey_plan_m, "survey_rmse_v_m": of_survey[2],
            "points_required": ACCURACY_STATEMENT.asprs_points,
            "enough_points": points >= ACCURACY_STATEMENT.asprs_points,
        },
        "nssda": {
            "horizontal_m": _nssda_plan(east, north), "vertical_m": None if height is None else NSSDA_HEIGHT * height,
            "points_required": ACCURACY_STATEMENT.nssda_points,
            "enough_points": points >= ACCURACY_STATEMENT.nssda_points,
        },
    }  # fmt: skip


def _nssda_plan(east_m: float | None, north_m: float | None) -> float | None:
    if (
        east_m is None
        or north_m is None
        or min(east_m, north_m) < ACCURACY_STATEMENT.nssda_ratio * max(east_m, north_m)
    ):
        return None
    return NSSDA_PLAN * 0.5 * (east_m + north_m)


def _join(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else float(np.hypot(first, second))


def _mean(values: np.ndarray) -> float | None:
    return float(np.nanmean(values)) if np.isfinite(values).any() else None
