"""Distribution of residuals and coverage of the images by points: figures that characterise the quality of a block.

A normalised residual is v / (sigma sqrt(r)) with the observation's redundancy number r (Baarda 1968): a standard normal
variable if sigmas and model are correct.
"""

from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import Role
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import GRIDS, LISTS, REDUNDANCY
from .residuals import Residuals

IMAGE_AXES = ("sample", "line")


def normalise_residuals(result: Adjustment) -> dict[str, np.ndarray]:
    """Return the normalised residuals of the used GCP and tie measurements, by axis, ``(n,)`` each.

    Those of check points and held-out tie points are excluded: these are only intersected, without effect on the
    cameras. Without redundancy numbers (images refined one by one) they are residuals over their sigmas.
    """
    redundancy = np.where(np.isfinite(result.redundancy_numbers), result.redundancy_numbers, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        normalised = result.tested_residual_px / (result.sigma_px[:, None] * np.sqrt(redundancy))
    is_adjusted = ~np.isin(result.block.points.role[result.block.measurements.point], [Role.CHECK, Role.HELD_OUT])
    usable = np.isfinite(normalised) & (redundancy > REDUNDANCY.tested) & is_adjusted[:, None]
    return {axis: normalised[usable[:, column], column] for column, axis in enumerate(IMAGE_AXES)}


def summarise_distribution(values: np.ndarray) -> dict[str, Any]:
    """Return number, mean, standard deviation and the share beyond 3; the share is 0.0027 for a normal variable."""
    if not len(values):
        return {"count": 0, "mean": None, "std": None, "beyond_3": None}
    return {
        "count": len(values),
        "mean": float(values.mean()),
        "std": float(values.std()),
        "beyond_3": float(np.mean(np.abs(values) > 3.0)),
    }


def tie_coverage(result: Adjustment) -> dict[str, np.ndarray]:
    """Return the number of used tie points in each cell of each image, ``(cells, cells)``, lines first."""
    block = result.block
    rows = block.measurements
    used_rows = np.flatnonzero(result.is_used_tie)
    side, image = GRIDS.coarse, rows.image[used_rows]
    centre, half = (np.array([getattr(one, name) for one in block.images]) for name in ("centre_px", "half_size_px"))
    share = (rows.xy[used_rows] - centre[image]) / (2.0 * half + 1.0)[image] + 0.5
    column, line = np.clip((share * side).astype(np.int64), 0, side - 1).T
    counts = np.bincount((image * side + line) * side + column, minlength=len(block.images) * side**2)
    return dict(zip([one.id for one in block.images], counts.reshape(-1, side, side), strict=True))


def rank_survey_points(result: Adjustment, left: Residuals, role: Role) -> np.ndarray:
    """Return the indices of a role's points with the largest ground residuals, the worst first; at most 200."""
    points_here = np.flatnonzero((result.block.points.role == role) & finite_rows(left.ground_m[:, :2]))
    return points_here[np.argsort(-np.nansum(left.ground_m[points_here] ** 2, axis=1), kind="stable")][: LISTS.rows]


def survey_point_rows(result: Adjustment, left: Residuals, role: Role) -> list[dict[str, Any]]:
    """Return the points of a role with survey - computed and its standard deviation, the worst first."""
    points = result.block.points
    names = ("east_m", "north_m", "height_m")
    return [
        {"id": str(points.ids[row])}
        | {name: _number_or_none(left.ground_m[row, axis]) for axis, name in enumerate(names)}
        | {f"sigma_{name}": _number_or_none(left.ground_sigma_m[row, axis]) for axis, name in enumerate(names)}
        for row in rank_survey_points(result, left, role).tolist()
    ]


def statistic_entries(result: Adjustment, left: Residuals) -> dict[str, Any]:
    """Return the report's entries of these statistics."""
    return {
        "normalised_residuals": {
            axis: summarise_distribution(values) for axis, values in normalise_residuals(result).items()
        },
        "tie_coverage": {name: float(np.mean(counts > 0)) for name, counts in tie_coverage(result).items()},
        "control_points": survey_point_rows(result, left, Role.GCP),
        "check_points": survey_point_rows(result, left, Role.CHECK),
    }


def _number_or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
