"""Checks of the surveyed coordinates alone: rounded coordinates, and check points that are copies of GCPs."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..block.block import Block
from ..block.points import Role, are_apart
from ..foundation.errors import list_ids
from ..foundation.large_arrays import finite_rows
from ..foundation.reasons import Level, Reason
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import metres_per_degree, to_ecef
from .accuracy import ImageAccuracy


@thresholds
class SURVEY:
    """When surveyed coordinates were rounded, or check points are copies of GCPs."""

    coarse_decimals: int = threshold(5, "decimals", "of a degree: more harm no image", "theory: 1e-5 degrees are 1.1 m")
    decimal_slack: float = threshold(1e-6, "", "of the last decimal: what reading, writing and a turn of 360° leave")
    fewest_points: int = threshold(4, "points", "from which on not all coordinates are round by chance")
    harmful_px: float = threshold(0.5, "px", "standard deviation of the rounding that is reported")
    copied_share: float = threshold(0.5, "", "share of check points measured where GCPs are that makes them copies")
    same_target_px: float = threshold(1.5, "px", "measurements nearer than this may be of one target")


def find_rounding_reasons(block: Block, accuracies: Sequence[ImageAccuracy], level: Level) -> list[Reason]:
    """Return the reason for longitudes and latitudes rounded more coarsely than their sigmas and half a pixel.

    A rounding error is uniform over one step of the last decimal: its standard deviation is step / sqrt(12).
    ``level`` is that of the reason.
    """
    points = np.unique(block.measurements.point[block.known[block.measurements.point]])
    ground = block.points.ground[points]
    if len(points) < SURVEY.fewest_points or not np.isfinite(ground[:, :2]).all():
        return []
    for decimals in range(SURVEY.coarse_decimals + 1):
        scaled = ground[:, :2] * 10.0**decimals
        if (np.abs(scaled - np.rint(scaled)) < SURVEY.decimal_slack).all():
            break
    else:
        return []
    step_m = float(metres_per_degree(ground)[:, :2].max()) * 10.0**-decimals
    sigma = step_m / np.sqrt(12.0)
    stated = float(np.median(np.nan_to_num(block.points.sigma_m[points, 0], posinf=np.inf)))
    if sigma < max(stated, SURVEY.harmful_px * min(accuracy.gsd_m for accuracy in accuracies)):
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
    """Return the reason for check points at the places of GCPs, on the ground or in the images: they check nothing.

    Copies of GCPs, with a little noise or surveyed again, are mostly measured at the same pixels of every image.
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
    if alike.mean() > SURVEY.copied_share:  # a few may stand beside a GCP by chance
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
    """Return which pairs of points are measured at the same pixels of every image that has both, ``(k,)`` bool."""
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
        alike[number] = bool(apart) and max(apart) < SURVEY.same_target_px
    return alike
