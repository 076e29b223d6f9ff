"""What an adjustment left over: residuals of points and measurements, before and after, and their summaries.

Ground residuals are survey - computed in metres east, north and up; image residuals observed - computed in px.
Where a known point was measured on two images, its computed position is the adjusted one; where on one only, it is the
point on that image's ray at the known height, and the height residual does not exist.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..adjustment import Adjustment
from ..adjustment.intersection import image_residuals, intersect
from ..adjustment.observations import subset
from ..block.block import Block, Role
from ..ground.geodesy import ground_difference_m, moved_ground
from ..refinement import MODELS

CE90_OF_RADIAL_RMSE = 1.5175  # 90 % of a circular normal distribution (NSSDA)
LE90_OF_RMSE = 1.6449  # 90 % of a normal distribution


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residual columns in the order of the block's points and measurements; NaN where they do not exist.

    ground_m : (points, 3) survey - computed
    at_known_px : (measurements, 2) observed - refined camera at the known position
    before_px : (measurements, 2) the same with the vendor's cameras
    tie_before_px : (measurements, 2) of tie points, vendor's cameras, points intersected with them
    """

    ground_m: np.ndarray
    at_known_px: np.ndarray
    before_px: np.ndarray
    tie_before_px: np.ndarray


def residuals(result: Adjustment) -> Residuals:
    """Return all residuals of an adjustment."""
    zero = np.zeros_like(result.values)
    at_known, before = _known_residuals(result, result.values), _known_residuals(result, zero)
    return Residuals(_ground_residuals(result), at_known, before, _tie_residuals_before(result))


def by_image(block: Block, chosen: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each image's index and its measurements among the ``chosen`` (mask), images without any left out."""
    rows = np.flatnonzero(chosen)
    image = block.measurements.image[rows]
    order = np.argsort(image, kind="stable")
    bounds = np.searchsorted(image[order], np.arange(len(block.images) + 1))
    for index in range(len(block.images)):
        if bounds[index] < bounds[index + 1]:
            yield index, rows[order[bounds[index] : bounds[index + 1]]]


def _known_residuals(result: Adjustment, values: np.ndarray) -> np.ndarray:
    """Return observed - projected of the known points' surveyed positions, NaN for all others."""
    block, rows = result.block, result.block.measurements
    residual = np.full((len(rows), 2), np.nan)
    usable = block.known & np.isfinite(block.points.ground).all(axis=1)
    for index, here in by_image(block, usable[rows.point]):
        ground = block.points.ground[rows.point[here]]
        residual[here] = rows.xy[here] - result.model.project(block.images[index], values[index], ground)
    return residual


def _ground_residuals(result: Adjustment) -> np.ndarray:
    block = result.block
    computed = np.where(block.known[:, None], result.ground, np.nan)
    single = block.known & (block.rays_per_point() == 1)
    computed[single] = _on_single_rays(result, single)[single]
    residual = np.full_like(computed, np.nan)
    usable = np.isfinite(computed).all(axis=1)
    residual[usable] = ground_difference_m(block.points.ground[usable], computed[usable])
    residual[single, 2] = np.nan
    known = np.flatnonzero(block.known)
    surveyed = np.isfinite(block.points.survey_covariance_m2(known).diagonal(axis1=1, axis2=2))
    residual[known] = np.where(surveyed, residual[known], np.nan)  # nothing to compare with
    return residual


def _on_single_rays(result: Adjustment, single: np.ndarray) -> np.ndarray:
    """Return where the rays of singly measured points meet their known height (one Newton step from the survey).

    The corrected camera is linear over the few pixels of a residual, so one step is exact to far below a millimetre.
    """
    block, rows = result.block, result.block.measurements
    computed = np.full((len(block.points), 3), np.nan)
    for index, here in by_image(block, single[rows.point]):
        ground = block.points.ground[rows.point[here]]
        at = result.model.equations(block.images[index], rows.xy[here])(result.values[index], ground)
        step = np.zeros_like(ground)
        miss = rows.xy[here] - at.computed
        step[:, :2] = np.linalg.solve(at.by_ground[:, :, :2], miss[:, :, None])[:, :, 0]
        computed[rows.point[here]] = moved_ground(ground, step)
    return computed


def _tie_residuals_before(result: Adjustment) -> np.ndarray:
    """Return the residuals of the used tie points, intersected with the vendor's cameras."""
    block = result.block
    residual = np.full((len(block.measurements), 2), np.nan)
    used = np.isfinite(result.residual_px).all(axis=1) & (block.points.role == Role.TIE)[block.measurements.point]
    if not used.any():
        return residual
    ties = block.with_measurements(used)
    observations = subset(ties, ties.rays_per_point() >= 2)
    vendor, no_values = MODELS["none"], np.zeros((len(block.images), 0))
    ground = intersect(observations, vendor, no_values, result.ground[observations.points])
    before = image_residuals(observations, vendor, no_values, ground)
    residual[np.flatnonzero(used)[observations.rows]] = before
    return residual


def rmse(values: np.ndarray) -> float | None:
    """Return the root mean square of the finite values, None without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else None


def radial_rmse(vectors: np.ndarray) -> float | None:
    """Return sqrt(mean(dx² + dy²)) over the finite rows ``(n, 2)``, None without any."""
    finite = vectors[np.isfinite(vectors).all(axis=1)]
    return float(np.sqrt(np.mean(np.sum(finite**2, axis=1)))) if len(finite) else None
