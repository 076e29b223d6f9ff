"""What the surveyed coordinates tell by themselves: decimals that were lost, check points that are control."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..block.block import Block
from ..block.points import Role, are_apart
from ..foundation.errors import list_ids
from ..foundation.large_arrays import finite_rows
from ..foundation.reasons import Level, Reason
from ..ground.geodesy import metres_per_degree, to_ecef
from .accuracy import ImageAccuracy

COARSE_DECIMALS = 5  # of a degree: 1.1 m; what is rounded to less harms no satellite image
DECIMAL_SLACK = 1e-6  # of the last decimal: what reading, writing and a turn of 360 degrees leave
LEAST_SURVEYED = 4  # from which on no survey has only round numbers by chance
HARMFUL_PX = 0.5
COPIED_SHARE = 0.5  # of the check points measured where GCPs are, from which on they are copies
TARGETS_APART_PX = 1.5  # between two measurements of one target; two targets are farther apart


def find_rounding_reasons(block: Block, accuracies: Sequence[ImageAccuracy], level: Level) -> list[Reason]:
    """Return whether longitudes and latitudes were cut to few decimals: worse than their sigmas and half a pixel.

    An error that is uniform within one step of the last decimal has a standard deviation of step / sqrt(12).
    ``level`` is that of the reason.
    """
    points = np.unique(block.measurements.point[block.known[block.measurements.point]])
    ground = block.points.ground[points]
    if len(points) < LEAST_SURVEYED or not np.isfinite(ground[:, :2]).all():
        return []
    for decimals in range(COARSE_DECIMALS + 1):
        scaled = ground[:, :2] * 10.0**decimals
        if (np.abs(scaled - np.rint(scaled)) < DECIMAL_SLACK).all():
            break
    else:
        return []
    step_m = float(metres_per_degree(ground)[:, :2].max()) * 10.0**-decimals
    sigma = step_m / np.sqrt(12.0)
    stated = float(np.median(np.nan_to_num(block.points.sigma_m[points, 0], posinf=np.inf)))
    if sigma < max(stated, HARMFUL_PX * min(accuracy.gsd_m for accuracy in accuracies)):
        return []
    ids = tuple(block.points.ids[points].tolist())
    return [
        Reason(
            "coordinates-rounded", level,
            f"longitude and latitude of all {len(ids)} ground points have {decimals} decimals: they are rounded to "
            f"{step_m:.3g} m, an error of {sigma:.2g} m (standard deviation)",
            "take them with at least 7 decimals of a degree; where there are none, give a sigma_xy that says so",
            points=ids,
        )
    ]  # fmt: skip


def find_dependent_check_points(block: Block) -> list[Reason]:
    """Return whether check points lie where GCPs lie, on the ground or on the images: they tell nothing then.

    Copies of GCPs, with a little noise or surveyed again, are measured at the same pixels of every image, most of them.
    """
    points = np.unique(block.measurements.point)
    known = points[finite_rows(block.points.ground[points])]
    role = block.points.role[known]
    gcps, checks = known[role == Role.GCP], known[role == Role.CHECK]
    if not (len(gcps) and len(checks)):
        return []
    ground = block.points.ground
    _, nearest = cKDTree(to_ecef(ground[gcps])).query(to_ecef(ground[checks]))
    same = ~are_apart(ground[checks], ground[gcps[nearest]])
    alike = _are_copies(block, checks, gcps[nearest])
    if alike.mean() > COPIED_SHARE:  # a few may stand beside a GCP by chance
        same |= alike
    if not same.any():
        return []
    ids = tuple(block.points.ids[checks[same]].tolist())
    control = block.points.ids[gcps[nearest[same]]].tolist()
    return [
        Reason(
            "check-is-control", Level.DOUBTFUL,
            f"{len(ids)} of {len(checks)} check points lie where GCPs lie ({ids[0]} at {control[0]}"
            f"{', …' if len(ids) > 1 else ''}): they tell nothing of the accuracy",
            f"name other check points, or leave these out ({list_ids(ids)})", points=ids,
        )
    ]  # fmt: skip


def _are_copies(block: Block, points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Tell of pairs of points whether they are measured at the same pixels of every image that has both."""
    rows = block.measurements
    compared = np.flatnonzero(np.isin(rows.point, np.concatenate([points, others])))  # not the ties, which are many
    at: dict[int, dict[int, int]] = {}  # of each point, by image
    for row, point, image in zip(
        compared.tolist(), rows.point[compared].tolist(), rows.image[compared].tolist(), strict=True
    ):
        at.setdefault(point, {})[image] = row
    alike = np.zeros(len(points), dtype=bool)
    for number, (one, other) in enumerate(zip(points.tolist(), others.tolist(), strict=True)):
        here, there = at[one], at[other]
        apart = [float(np.hypot(*(rows.xy[here[k]] - rows.xy[there[k]]))) for k in here.keys() & there.keys()]
        alike[number] = bool(apart) and max(apart) < TARGETS_APART_PX
    return alike
