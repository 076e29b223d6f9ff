"""Residuals of an adjustment: of points and measurements, before and after, and their summaries.

Ground residuals are survey - computed in metres east, north and up; image residuals observed - computed in px. The
computed position of a known point, GCP or check point, is the intersection of its rays with the final cameras, without
its survey. (The adjusted position of a GCP depends on its survey; the difference from it would mostly show the survey's
sigma.) For a point measured on one image only, it is the point on that image's ray at the known height, and there is no
height residual.

Every residual has the standard deviation by which it is tested (`results.outliers`). For adjusted points, tie points
and GCPs, it is the sigma of the observations themselves (of a GCP's survey and image points together), although their
residuals have smaller ones. Check points are not adjusted, so that the sigma of their residual is that of the
prediction and of the survey together. All are multiplied by a sigma0 above 1. Residuals are those of the final cameras;
the effect of an estimated drift that these do not contain is part of the sigma.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..adjustment.observations import Observations, select_points
from ..adjustment.result import Adjustment, Decision
from ..adjustment.starting_values.intersection import (
    compute_intersection_cofactors,
    compute_intersection_residuals,
    intersect_points,
)
from ..block.block import Block, Role
from ..block.columns import group_by_number
from ..foundation.large_arrays import any_of_rows, finite_rows, square_lengths
from ..foundation.thresholds import MEMORY
from ..ground.geodesy import ground_difference_m, move_ground
from ..refinement.model import RefinementModel
from ..refinement.models import MODELS
from ..refinement.stacked_cameras import linearise_images, project_to_images


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residual columns in the order of the block's points and measurements; NaN where they do not exist.

    Parameters
    ----------
    ground_m, ground_sigma_m : (points, 3) ndarray
        Survey - computed (east, north, up), and its standard deviation.
    measured_px, measured_sigma_px : (measurements, 2) ndarray
        The residual that is reported and tested, and its standard deviation: for known points ``at_known_px``, for all
        others at the adjusted position.
    at_known_px : (measurements, 2) ndarray
        Observed - projected by the refined camera, at the known position.
    before_px : (measurements, 2) ndarray
        The same with the vendor's cameras.
    tie_before_px : (measurements, 2) ndarray
        Residuals of tie points intersected with the vendor's cameras.
    """

    ground_m: np.ndarray
    ground_sigma_m: np.ndarray
    measured_px: np.ndarray
    measured_sigma_px: np.ndarray
    at_known_px: np.ndarray
    before_px: np.ndarray
    tie_before_px: np.ndarray

    @cached_property
    def statistic(self) -> np.ndarray:
        """The statistic of each measurement, ``(measurements,)``; see `compute_statistic`."""
        return compute_statistic(self.measured_px, self.measured_sigma_px)

    def __repr__(self) -> str:
        return f"<Residuals of {len(self.ground_m)} points and {len(self.measured_px)} measurements>"


def compute_statistic(residual: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return the length of residuals in sigmas ``(n,)``, over the coordinates that exist; NaN without any.

    residual, sigma : (n, k) in the same unit; NaN for coordinates that were not measured or have no sigma
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = (residual / sigma) ** 2
    total = np.einsum("ij->i", np.where(np.isnan(squares), 0.0, squares))
    return np.where(any_of_rows(np.isfinite(squares)), np.sqrt(total), np.nan)


def compute_residuals(result: Adjustment) -> Residuals:
    """Return all residuals of an adjustment.

    Parameters
    ----------
    result : Adjustment
        The adjustment.

    Returns
    -------
    Residuals
        Residuals of measurements in pixels, and of ground points in metres.
    """
    block, rows = result.block, result.block.measurements
    is_used = (result.decision == int(Decision.KEPT)) | (block.points.role != Role.GCP)[rows.point]
    kept_block = block.with_measurements(is_used & block.known[rows.point])
    at_known = survey_residuals_px(block, result.model, result.values)
    # Points with completely surveyed positions are tested there, all others at their adjusted positions.
    known_points = np.flatnonzero(block.known)
    surveyed = np.zeros(len(block.points), dtype=bool)
    surveyed[known_points] = np.isfinite(block.points.survey_covariance_m2(known_points)).all(axis=(1, 2))
    at_survey = surveyed[rows.point] & finite_rows(at_known)
    drift = result.residual_px - result.tested_residual_px
    sigma_px = np.hypot(result.unit_sigma * result.sigma_px[:, None], np.nan_to_num(drift))
    # Sigmas of survey - computed of points measured on two images or more, else NaN
    several = known_points[kept_block.rays_per_point()[known_points] >= 2]
    ground_covariance = np.full((len(block.points), 3, 3), np.nan)
    ground_covariance[several] = result.survey_covariance_m2(several)
    check = several[block.points.role[several] == Role.CHECK]
    ground_covariance[check] += result.covariance_to_surveys_m2(check)
    control = _select_control(kept_block, result.ground)
    if control is not None:
        cofactors = compute_intersection_cofactors(control, result.model, result.values, result.ground[control.points])
        ground_covariance[control.points] += result.unit_sigma**2 * cofactors
    sigma_m = np.sqrt(ground_covariance.diagonal(axis1=1, axis2=2))
    sigma_m[np.isinf(sigma_m)] = np.nan  # not surveyed
    single = block.rays_per_point() == 1
    for rows_here, covariance, by_ground in _survey_covariances(result, at_known, at_survey):
        sigma_px[rows_here] = np.sqrt(covariance.diagonal(axis1=1, axis2=2))
        is_single = single[rows.point[rows_here]]  # on one ray: the same error, converted to the ground
        outwards = np.linalg.inv(by_ground[is_single, :, :2])
        on_ground = outwards @ covariance[is_single] @ outwards.swapaxes(1, 2)
        sigma_m[rows.point[rows_here[is_single]], :2] = np.sqrt(on_ground.diagonal(axis1=1, axis2=2))
    return Residuals(
        ground_m=ground_residuals_m(kept_block, result.model, result.values, result.ground),
        ground_sigma_m=sigma_m,
        measured_px=np.where(at_survey[:, None], at_known, result.residual_px),
        measured_sigma_px=sigma_px,
        at_known_px=at_known,
        before_px=survey_residuals_px(block, result.model, np.zeros_like(result.values)),
        tie_before_px=_tie_residuals_before(result),
    )


def state_known_sigmas_px(result: Adjustment, left: Residuals) -> np.ndarray:
    """Return the sigmas ``(n, 2)`` of residuals at known positions from stated sigmas; all others as for the tests."""
    as_stated = replace(result, estimated_sigma_px=None, survey_factors=(1.0, 1.0, 1.0), sigma0=1.0)
    sigma = left.measured_sigma_px / result.unit_sigma
    at_known = finite_rows(left.at_known_px) & (left.measured_px == left.at_known_px).all(axis=1)
    for rows_here, covariance, _ in _survey_covariances(as_stated, left.at_known_px, at_known):
        sigma[rows_here] = np.sqrt(covariance.diagonal(axis1=1, axis2=2))
    return sigma


def by_image(block: Block, selected: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each image's index and its measurements among the ``selected`` (mask); images without any are skipped."""
    rows = np.flatnonzero(selected)
    order, bounds = group_by_number(block.measurements.image[rows], len(block.images))
    for index in range(len(block.images)):
        if bounds[index] < bounds[index + 1]:
            yield index, rows[order[bounds[index] : bounds[index + 1]]]


def survey_residuals_px(block: Block, model: RefinementModel, values: np.ndarray) -> np.ndarray:
    """Return observed - projected ``(measurements, 2)`` at the surveyed positions of known points; NaN for others."""
    return residuals_at_px(block, model, values, np.where(block.known[:, None], block.points.ground, np.nan))


def compute_given_residuals(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals of known points by the cameras as given, ``(measurements, 2)`` px and ``(points, 3)`` m."""
    as_given, no_values = MODELS["none"], np.zeros((len(block.images), 0))
    role = np.where(block.known, Role.GCP, block.points.role)  # all of them are intersected
    start = np.where((block.rays_per_point() > 0)[:, None], block.points.ground, np.nan)
    control = replace(block, points=replace(block.points, role=role))
    return survey_residuals_px(block, as_given, no_values), ground_residuals_m(control, as_given, no_values, start)


def residuals_at_px(block: Block, model: RefinementModel, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return observed - projected ``(measurements, 2)`` of points at given positions; NaN for points without position.

    values : (images, p) parameters of the model; ground : (points, 3) positions; NaN for those without
    """
    rows = block.measurements
    residual = np.full((len(rows), 2), np.nan)
    for index, rows_here in by_image(block, finite_rows(ground)[rows.point]):
        positions = ground[rows.point[rows_here]]
        residual[rows_here] = rows.xy[rows_here] - model.project(block.images[index], values[index], positions)
    return residual


def ground_residuals_m(block: Block, model: RefinementModel, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return survey - computed of the known points, ``(points, 3)`` east, north, up; NaN for all others.

    values : (images, p) parameters of the model
    ground : (points, 3) adjusted positions; those of GCPs are the start of their intersection
    """
    computed = np.where(block.known[:, None], ground, np.nan)
    control = _select_control(block, ground)
    if control is not None:
        computed[control.points] = intersect_points(control, model, values, ground[control.points])
    single = block.known & (block.rays_per_point() == 1)
    # Rays of points on one image are intersected with the known height by one Newton step from the survey: the
    # corrected camera is linear over the few pixels of a residual: the error is far below a millimetre
    rows = block.measurements
    for index, rows_here in by_image(block, single[rows.point]):
        survey = block.points.ground[rows.point[rows_here]]
        linearised = model.equations(block.images[index], rows.xy[rows_here])(values[index], survey)
        step = np.zeros_like(survey)
        miss = rows.xy[rows_here] - linearised.computed
        step[:, :2] = np.linalg.solve(linearised.by_ground[:, :, :2], miss[:, :, None])[:, :, 0]
        computed[rows.point[rows_here]] = move_ground(survey, step)
    residual = np.full_like(computed, np.nan)
    usable = finite_rows(computed)
    residual[usable] = ground_difference_m(block.points.ground[usable], computed[usable])
    residual[single, 2] = np.nan
    known_points = np.flatnonzero(block.known)
    surveyed = np.isfinite(block.points.survey_covariance_m2(known_points).diagonal(axis1=1, axis2=2))
    residual[known_points] = np.where(surveyed, residual[known_points], np.nan)  # no survey to compare with
    return residual


def _survey_covariances(
    result: Adjustment, at_known: np.ndarray, selected: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield covariances of the ``selected`` residuals at known positions, for some measurements at a time.

    Each item has rows ``(k,)``, covariances ``(k, 2, 2)`` px² and the derivatives B ``(k, 2, 3)`` by the ground. With
    the derivatives A by the image's parameters, the covariances are::

        s0² (s² I + B S B')  +  A Q A' of check points  +  d d'

    with the survey's covariance S, the parameters' Q, and the estimated drift d that the final camera does not contain.
    """
    block, rows, cameras = result.block, result.block.measurements, result.cameras
    sigma, check = result.unit_sigma * result.sigma_px, block.points.role == Role.CHECK
    by_images = np.flatnonzero(selected)
    by_images = by_images[np.argsort(rows.image[by_images], kind="stable")]
    for first in range(0, len(by_images), MEMORY.rows):
        rows_here = by_images[first : first + MEMORY.rows]
        points = rows.point[rows_here]
        images_here, image_index = np.unique(rows.image[rows_here], return_inverse=True)
        images, ground = [block.images[index] for index in images_here.tolist()], block.points.ground[points]
        linearised = linearise_images(
            cameras.model, images, image_index, rows.xy[rows_here], cameras.values[images_here], ground
        )
        projected = project_to_images(cameras.model, images, image_index, cameras.values[images_here], ground)
        drift = rows.xy[rows_here] - projected - at_known[rows_here]
        covariance = sigma[rows_here, None, None] ** 2 * np.eye(2) + drift[:, :, None] * drift[:, None, :]
        covariance += linearised.by_ground @ result.survey_covariance_m2(points) @ linearised.by_ground.swapaxes(1, 2)
        predicted = (
            linearised.by_values @ cameras.covariance[rows.image[rows_here]] @ linearised.by_values.swapaxes(1, 2)
        )
        covariance += np.where(check[points, None, None], predicted, 0.0)
        yield rows_here, covariance, linearised.by_ground


def _select_control(block: Block, ground: np.ndarray) -> Observations | None:
    """Return the image points of the GCPs that were measured on two images or more; None without any."""
    several = (block.points.role == Role.GCP) & (block.rays_per_point() >= 2) & finite_rows(ground)
    return select_points(block, several) if several.any() else None


def _tie_residuals_before(result: Adjustment) -> np.ndarray:
    """Return the residuals of the used tie points, intersected with the vendor's cameras."""
    block = result.block
    residual = np.full((len(block.measurements), 2), np.nan)
    if not result.is_used_tie.any():
        return residual
    ties = block.with_measurements(result.is_used_tie)
    observations = select_points(ties, ties.rays_per_point() >= 2)
    vendor, no_values = MODELS["none"], np.zeros((len(block.images), 0))
    start = result.ground[observations.points]
    residual[np.flatnonzero(result.is_used_tie)[observations.rows]] = compute_intersection_residuals(
        observations, vendor, no_values, start
    )
    return residual


def group_rmse(vectors: np.ndarray, group: np.ndarray, count: int) -> list[float | None]:
    """Return `radial_rmse` of the rows ``(n, 2)`` of each of ``count`` groups, by the number of each row's group."""
    square = square_lengths(vectors)
    finite = np.isfinite(square)
    rows, total = np.bincount(group[finite], minlength=count), np.bincount(group[finite], square[finite], count)
    return [float(np.sqrt(one / number)) if number else None for one, number in zip(total, rows, strict=True)]


def rmse(values: np.ndarray) -> float | None:
    """Return the root mean square of the finite values, None without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else None


def radial_rmse(vectors: np.ndarray) -> float | None:
    """Return sqrt(mean(dx² + dy²)) over the finite rows ``(n, 2)``, None without any."""
    square = square_lengths(vectors)
    finite = square[np.isfinite(square)]
    return float(np.sqrt(np.mean(finite))) if len(finite) else None
