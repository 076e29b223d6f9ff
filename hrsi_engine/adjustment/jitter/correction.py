"""Adjustment without jitter: curves from its residuals, measurements corrected by them, and a new adjustment.

For linear equations the alternation converges at once; corrections change the lines, so that a second round follows.

The curves run along the lines of the block's exposures and follow from the residuals of all image points together.
Measured minus computed image points y, in standard deviations, with the cameras and points of an adjustment::

    y = B x + A a + J d + e      B x: splines of the exposures' lines (`line_splines`), prior R / s^2
                                 A a: changes of the cameras' corrections, J d: of the points' positions in metres

A point's d is eliminated with an orthonormal basis N of the null space of J' (N' J = 0), together with its other
observations: its survey, heights of a surface or of laser points are further rows, each height with its own sigma. Two
rays have one equation for a point, across the epipolar line: vibration along it, or equal in both images, has no
equation and keeps its prior. The posterior of x has the precision matrix K = B' B / n + R, with the variance n of the
noise, 1 or more. Its constant and linear part is shared with the corrections, and cancels in B x + A a. The priors
R are those of `curve_fit`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from scipy import sparse

from ...block.block import Block, Image, Measurements, Role, number_exposures
from ...block.jitter_curve import JitterCurve, JitterEstimate
from ...foundation.errors import InputError
from ...foundation.progress import Progress, stage
from ...foundation.thresholds import EQUALITY, ITERATIONS, threshold, thresholds
from ...refinement.model import estimate_priors
from ...refinement.stacked_cameras import linearise_images
from ..gauss_newton import Solution
from ..options import JITTER_CHOICES, AdjustOptions
from ..preparation.problem import Problem
from ..result import Adjustment
from .curve_fit import JITTER_PRIORS, CurveFit, EquationRows, WeightedPoints, sample_priors
from .line_splines import LineSpline
from .spectrum import collect_line_profiles, find_block_waves


@thresholds
class JITTER_CURVES:
    """Limits for the estimation of jitter curves and for its convergence."""

    knots_in_period: int = threshold(6, "knots", "knots of the spline in the shortest period: 99.7 % of a sine remain")
    least_spacing: float = threshold(8.0, "lines", "smallest distance between knots")
    most_points: int = threshold(100_000, "points", "largest number in use; of more points, an even choice")
    most_parts: int = threshold(2, "parts", "successive corrections; the second removes remaining waves")


ROBUST_STEPS = 3  # in which the robust weights of points are updated


class AdjustmentRun(Protocol):
    """Problem and last solution of an adjustment."""

    problem: Problem
    solution: Solution


AdjustOnce = Callable[[Block, AdjustOptions, Progress], tuple[Adjustment, AdjustmentRun]]


def adjust_without_jitter(
    block: Block, options: AdjustOptions, adjust_once: AdjustOnce, progress: Progress
) -> Adjustment:
    """Return the adjustment of a block whose measurements are corrected by the jitter curves of its residuals.

    Without significant jitter it is the ordinary adjustment. After the removal of strong waves, weaker ones are
    searched again. The result's measurements are the corrected ones. Jitter that all images of a point share does not
    show in tie points: the sigmas of the GCPs' measurements contain that of the curves.
    """
    result, adjuster = adjust_once(block, options, stage(progress, 0.0, 0.3))
    is_gcp = block.points.role[block.measurements.point] == Role.GCP
    xy, ids, image = block.measurements.xy, [one.id for one in block.images], block.measurements.image
    earlier: JitterEstimate | None = None
    progress_share = 0.3
    for _ in range(JITTER_CURVES.most_parts if options.jitter in JITTER_CHOICES else 1):
        spacing, period = choose_spacings(result, options.jitter)
        corrected_xy, priors = xy, None  # measurements corrected by the curves so far
        for number in range(ITERATIONS.most if spacing else 0):
            problem, done_before = adjuster.problem, progress_share
            progress_share += 0.3 * (1.0 - progress_share)
            measured = replace(block.measurements, xy=corrected_xy)
            estimate = estimate_jitter(problem, adjuster.solution, measured, spacing, period, priors)
            priors = estimate.priors
            total_estimate = estimate if earlier is None else earlier.add(estimate)
            previous_xy, xy = xy, total_estimate.displace(ids, image, block.measurements.xy, remove=True)
            if np.sqrt(np.mean((xy - previous_xy) ** 2)) < EQUALITY.camera_px and number:
                xy = previous_xy
                break
            sigma_px = total_estimate.add_sigmas(ids, image, xy, block.measurements.sigma_px, is_gcp)
            corrected = replace(block, measurements=replace(block.measurements, xy=xy, sigma_px=sigma_px))
            result, adjuster = adjust_once(
                corrected,
                replace(options, jitter_estimate=total_estimate),
                stage(progress, done_before, progress_share),
            )
        earlier = result.jitter
        if not spacing:
            break
    return result


def choose_spacings(result: Adjustment, choice: str) -> tuple[dict[int, float], float]:
    """Return the lines between knots of the curves, by the exposures' numbers, and the strongest wave's period.

    Exposures without jitter have no entry.

    choice : ``none``, ``auto`` for exposures with significant waves and those with common points, or lines for all
    """
    images = result.block.images
    exposures = number_exposures(images)
    pixel = np.array([image.camera_pixel for image in images])
    if choice not in JITTER_CHOICES:
        try:
            asked_lines = float(choice)
        except ValueError:
            asked_lines = np.nan
        if not asked_lines >= JITTER_CURVES.least_spacing:
            raise InputError(
                f"`jitter` {choice!r}: give {', '.join(JITTER_CHOICES)} or the lines between the knots of the curves, "
                f"at least {JITTER_CURVES.least_spacing:g}"
            )
        spacings = {int(one): asked_lines * float(pixel[exposures == one].min()) for one in np.unique(exposures)}
        return spacings, JITTER_CURVES.knots_in_period * min(spacings.values())
    if choice != "auto":
        return {}, np.inf
    significant = find_block_waves(collect_line_profiles(result))
    waves = [[wave for wave in group if wave.amplitude_px >= EQUALITY.camera_px] for group in significant]
    shortest = pixel * [min((wave.period_lines for wave in group), default=np.inf) for group in waves]
    if not np.isfinite(shortest).any():
        return {}, np.inf
    strongest = max(
        (
            (wave.amplitude_px * size, wave.period_lines * size)
            for group, size in zip(waves, pixel, strict=True)
            for wave in group
        )
    )[1]
    # A wave of one image also appears in those with common points, and the spectrum does not show which one has it
    rows, count = result.block.measurements, len(result.block.points)
    incidence = sparse.csr_matrix((np.ones(len(rows)), (rows.image, rows.point)), (len(images), count))
    are_connected = (incidence @ incidence.T).tocsr()
    period = np.array([shortest[are_connected[number].indices].min(initial=np.inf) for number in range(len(images))])
    finest = {int(one): float(period[exposures == one].min()) for one in np.unique(exposures)}
    spacings = {one: lines / JITTER_CURVES.knots_in_period for one, lines in finest.items() if np.isfinite(lines)}
    return spacings, strongest


@dataclass(frozen=True, eq=False)
class _Place:
    """Position of an exposure's spline among the unknowns: samples from ``start`` on, followed by the lines."""

    spline: LineSpline
    start: int

    @property
    def stop(self) -> int:
        return self.start + 2 * self.spline.size


def estimate_jitter(
    problem: Problem,
    solution: Solution,
    measured: Measurements,
    spacing: Mapping[int, float],
    period: float,
    priors: np.ndarray | None = None,
) -> JitterEstimate:
    """Return the jitter curves of some exposures.

    problem, solution : the adjustment, whose measurements may contain earlier corrections
    measured : the block's measurements, without the corrections to be estimated
    spacing : lines between knots by the number of the exposure (`number_exposures`), in pixels of its scene
    period : lines of the strongest wave
    priors : those of an earlier estimate (`JitterEstimate`); by default the most likely ones
    Raises `InputError` if no exposure has measurements over the lines between two knots.
    """
    places, unknowns = _place_splines(problem, spacing)
    if not places:
        raise InputError(
            f"`jitter` {min(spacing.values()):g}: no image has measurements over so many lines: name fewer, or auto"
        )
    weighted = WeightedPoints(
        _form_rows(problem, solution, measured, places, unknowns),
        [place.spline for place in places.values() for _ in "xy"],
    )
    start = np.array([2.0 * np.pi / period, 1.0, JITTER_PRIORS.start_px] * 2) if priors is None else priors[0]
    for _ in range(ROBUST_STEPS):
        weighted.reweigh(CurveFit(weighted, start))
    if priors is None:
        priors = sample_priors(weighted, period)
    mean = CurveFit(weighted, priors[0]).solved
    errors = [CurveFit(weighted, prior).draw(number) - mean for number, prior in enumerate(priors[1:])]
    solved = np.empty((unknowns, 1 + len(errors)))
    solved[weighted.order] = np.column_stack([mean, *errors])
    curves: dict[str, JitterCurve] = {}
    samples: list[dict[str, JitterCurve]] = [{} for _ in errors]
    images = problem.observations.images
    for image, exposure in zip(images, number_exposures(images).tolist(), strict=True):
        if (place := places.get(exposure)) is None:
            continue
        first, last = int(np.floor(image.domain_px[2])), int(np.ceil(image.domain_px[3]))
        matrix = place.spline.make_matrix(_scene_lines(image, np.arange(first, last + 1))) / image.camera_pixel
        axes = np.split(solved[place.start : place.stop], 2)
        # Mean and errors of both axes ``(1 + samples, lines, 2)``
        shift, *sampled = np.stack([(matrix @ axis).T for axis in axes], axis=2)
        sigma = np.sqrt(np.mean(np.square(sampled), axis=0))
        curves[image.id] = JitterCurve(first, shift, sigma)
        for sample, error in zip(samples, sampled, strict=True):
            sample[image.id] = JitterCurve(first, error, sigma)
    return JitterEstimate(curves, tuple(samples), priors)


def _scene_lines(image: Image, line: np.ndarray | float) -> np.ndarray:
    first = 0.0 if image.tile is None else image.tile.first[1]
    return np.asarray(first + image.camera_pixel * np.asarray(line))


def _place_splines(problem: Problem, spacing: Mapping[int, float]) -> tuple[dict[int, _Place], int]:
    """Return the splines of the exposures over the lines with measurements, and the number of all unknowns."""
    observations, places, start = problem.observations, dict[int, _Place](), 0
    exposures = number_exposures(observations.images)
    for exposure, lines in spacing.items():
        measured = [
            _scene_lines(image, observations.xy[rows, 1])
            for image, exposure_of_image, rows in zip(
                observations.images, exposures.tolist(), observations.by_image, strict=True
            )
            if exposure_of_image == exposure
        ]
        reach = np.concatenate(measured)
        if len(reach) < 2 or np.ptp(reach) < lines:
            continue
        first, last = float(reach.min()), float(reach.max())
        intervals = max(int(np.ceil((last - first) / lines)), 4)
        places[exposure] = _Place(LineSpline(first, (last - first) / intervals, intervals), start)
        start = places[exposure].stop
    return places, start + problem.observations.cameras * len(problem.camera.parameters)


class _PointTerms(NamedTuple):
    """Image points and their derivatives in units of their standard deviations, from a block's adjustment.

    right, by_ground, by_values : residuals (n, 2), derivatives (n, 2, 3) and (n, 2, p) by ground and cameras' values
    start, splines : (n, 2) first unknown and (n, 4) values of the splines, zero without a curve
    """

    right: np.ndarray
    by_ground: np.ndarray
    by_values: np.ndarray
    start: np.ndarray
    splines: np.ndarray


def _linearise_points(
    problem: Problem, solution: Solution, measured: Measurements, places: Mapping[int, _Place]
) -> _PointTerms:
    """Return residuals and derivatives of image points ``measured``, with an adjustment's cameras and points."""
    observations, camera = problem.observations, problem.camera
    values, ground = solution.state
    images, weight = observations.images, 1.0 / measured.sigma_px[observations.rows]
    at = linearise_images(
        camera,
        images,
        observations.image,
        observations.xy,
        values[observations.camera_of_image],
        ground[observations.point],
    )
    start, splines = np.zeros((observations.count, 2), dtype=np.int64), np.zeros((observations.count, 4))
    for image, exposure, rows in zip(images, number_exposures(images).tolist(), observations.by_image, strict=True):
        if (place := places.get(exposure)) is not None:
            cell, factors = place.spline.evaluate(_scene_lines(image, observations.xy[rows, 1]))
            start[rows] = (place.start + cell)[:, None] + [0, place.spline.size]
            splines[rows] = factors * weight[rows, None] / image.camera_pixel
    return _PointTerms(
        weight[:, None] * (measured.xy[observations.rows] - at.computed),
        weight[:, None, None] * at.by_ground,
        weight[:, None, None] * at.by_values,
        start,
        splines,
    )


def _form_rows(
    problem: Problem, solution: Solution, measured: Measurements, places: Mapping[int, _Place], unknowns: int
) -> EquationRows:
    """Return the equations of the points that are used; of very many points an even choice."""
    observations, ground, p = problem.observations, solution.state.ground, len(problem.camera.parameters)
    first_camera = unknowns - observations.cameras * p
    right, by_ground, by_values, start, splines = _linearise_points(problem, solution, measured, places)
    # Points measured on an exposure with a curve; their priors as square roots of the weight matrices
    usable = observations.contributing_points & np.isfinite(ground).all(axis=1)
    usable &= np.logical_and.reduceat(np.isfinite(right).all(axis=1), observations.first[:-1])
    usable &= np.logical_or.reduceat(splines.any(axis=1), observations.first[:-1])
    # Surveys as stated: their sigmas and rejections, estimated without these curves, are consequences of the jitter
    weighting, heights = solution.weighting, problem.height_observations
    priors = problem.survey_weighting(weighting.image, observations.survey_weight, weighting.points).points
    if heights is not None:  # jitter displaces the points, so that most heights deviate
        priors = heights.add_to_priors(priors, ground, solution.normals.inverse, by_cell=True)
    selected = np.flatnonzero(usable & ((np.diff(observations.first) > 1) | priors.held))
    selected = selected[:: max(-(-len(selected) // JITTER_CURVES.most_points), 1)]
    matrices, rights, points = [sparse.csr_matrix((0, unknowns))], [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    lengths = np.diff(observations.first)[selected]
    squares, vectors = np.linalg.eigh(priors.build_weight_matrices(selected, observed=True))
    roots = np.sqrt(np.maximum(squares, 0.0))[:, :, None] * vectors.swapaxes(1, 2)
    ranks = (squares > 1e-9 * np.maximum(squares[:, 2:], 1e-300)).sum(axis=1)  # observed coordinates come last
    misses = priors.compute_misclosures_m(ground[selected], selected)
    for k in np.unique(lengths).tolist():
        for rank in range(4):
            rows_of_kind = np.flatnonzero((lengths == k) & (ranks == rank))
            points_of_kind = selected[rows_of_kind]
            rows = observations.first[points_of_kind][:, None] + np.arange(k)
            of_prior = roots[rows_of_kind, 3 - rank :]
            jacobian = np.concatenate([by_ground[rows].reshape(len(points_of_kind), 2 * k, 3), of_prior], axis=1)
            observed = np.einsum("mij,mj->mi", of_prior, misses[rows_of_kind])
            y = np.concatenate([right[rows].reshape(len(points_of_kind), 2 * k), observed], axis=1)
            if not len(points_of_kind) or jacobian.shape[1] <= 3:
                continue
            basis = np.linalg.qr(jacobian, mode="complete")[0][:, :, 3:]
            count = basis.shape[2]
            of_rays = basis[:, : 2 * k].reshape(len(points_of_kind), k, 2, count)
            by_spline = np.einsum("mkar,mkj->mrkaj", of_rays, splines[rows])
            by_camera = np.einsum("mkar,mkap->mrkp", of_rays, by_values[rows])
            columns = np.broadcast_to(start[rows][:, None, :, :, None] + np.arange(4), by_spline.shape)
            cameras = first_camera + p * observations.camera[rows][:, None, :, None] + np.arange(p)
            data = np.concatenate([by_spline.reshape(-1, 8 * k), by_camera.reshape(-1, k * p)], axis=1)
            column_indices = np.concatenate(
                [columns.reshape(-1, 8 * k), np.broadcast_to(cameras, by_camera.shape).reshape(-1, k * p)], axis=1
            )
            pointers = np.arange(0, data.size + 1, data.shape[1])
            matrices.append(sparse.csr_matrix((data.ravel(), column_indices.ravel(), pointers), (len(data), unknowns)))
            rights.append(np.einsum("mir,mi->mr", basis, y).ravel())
            points.append(np.repeat(points_of_kind, count))
    drifts = _form_drift_rows(problem, solution, first_camera, unknowns)
    return EquationRows(
        sparse.vstack([*matrices, drifts.matrix]).tocsr(),
        np.concatenate([*rights, drifts.right]),
        np.concatenate([*points, drifts.point]),
    )


def _form_drift_rows(problem: Problem, solution: Solution, first_camera: int, unknowns: int) -> EquationRows:
    """Return the a priori drift of each camera as equations, each with a number below 0 instead of a point.

    Curves could explain all residuals of the GCPs on their lines: without it, they would leave the drifts free.
    """
    observations, camera = problem.observations, problem.camera
    _, image = np.unique(observations.camera_of_image, return_index=True)
    images = [observations.images[index] for index in image.tolist()]
    sigma = np.array([camera.prior_sigmas(one, estimate_priors(one)) for one in images])
    column = np.flatnonzero(np.broadcast_to(camera.drifts, sigma.shape))
    weight = 1.0 / sigma.ravel()[column]
    matrix = sparse.csr_matrix((weight, (np.arange(len(column)), first_camera + column)), (len(column), unknowns))
    return EquationRows(matrix, -weight * solution.state.values.ravel()[column], -1 - np.arange(len(column)))
