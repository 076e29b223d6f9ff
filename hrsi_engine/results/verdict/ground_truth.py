"""Surveyed points against the block: GCPs and check points against their predicted accuracy.

Standard deviations of surveys are often guesses, and in one sigma0 over thousands of tie points a dozen GCPs have no
effect. So GCPs are judged by data snooping and by leave-one-out errors, check points by their predicted errors. GCPs
that are rotated, scaled or tilted as a whole cause drifts in the images that have a common cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ...block.block import Image, Role, stack_rpcs
from ...foundation.errors import list_ids
from ...foundation.large_arrays import finite_rows
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import SAMPLES, SIGNIFICANCE
from ...ground.geodesy import ground_difference_m
from ...refinement.selection import SELECTION
from ..residuals import state_known_sigmas_px
from .evidence import CAMERA, Evidence, compute_chi_square_limit, is_significant


@dataclass(frozen=True, eq=False)
class MajorityFit:
    """Fit of points to their predicted errors, by those that are no outliers.

    is_outlier : (k,) points of a minority whose errors do not belong to the distribution of the others
    factor : RMS error of the others over the predicted one; dimensions : degrees of freedom of one point
    """

    is_outlier: np.ndarray
    factor: float
    dimensions: float

    @classmethod
    def estimate(cls, squares: np.ndarray, freedom: np.ndarray) -> MajorityFit:
        """Return the fit of points from d' C^-1 d ``(k,)`` and its degrees of freedom.

        Outliers are relative to the (lower) median, so that a minority of gross errors is not evidence against the
        majority, and too small standard deviations make no outliers.
        """
        scale = np.sort(squares / special.chdtri(freedom, 0.5))[(len(squares) - 1) // 2]
        limit = special.chdtri(freedom, SIGNIFICANCE.false_alarm / len(squares))
        is_outlier = squares > limit * max(float(scale), 1.0)
        rest = ~is_outlier
        return cls(is_outlier, float(np.sqrt(squares[rest].sum() / freedom[rest].sum())), float(freedom.max()))

    @property
    def is_misfit(self) -> bool:
        """True if the majority misfits; the errors of a block's points are correlated: they count as one point."""
        return is_significant(self.dimensions * self.factor**2, self.dimensions)

    @property
    def level(self) -> Level:
        """The level of a misfit of the majority, by its RMS Mahalanobis distance."""
        distance = np.sqrt(self.dimensions) * self.factor
        return Level.UNUSABLE if distance >= SIGNIFICANCE.extreme else Level.DOUBTFUL


AXES = {"east": ("west of", "east of"), "north": ("south of", "north of"), "height": ("below", "above")}


def find_check_misfit_in_images(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for check points that misfit images refined separately (without predicted ground accuracy)."""
    result, left, block = evidence.result, evidence.left, evidence.result.block
    if np.isfinite(result.ground_covariance_m2).any():
        return
    in_sigmas = left.measured_px / np.hypot(state_known_sigmas_px(result, left), evidence.camera_px)
    rows = np.flatnonzero((evidence.row_role == Role.CHECK) & ~evidence.left_out & finite_rows(in_sigmas))
    if not len(rows):
        return
    squares, names = np.sum(in_sigmas[rows] ** 2, axis=1), block.points.ids[block.measurements.point[rows]]
    fit, length_px = MajorityFit.estimate(squares, np.full(len(rows), 2.0)), np.hypot(*left.measured_px[rows].T)
    if fit.is_outlier.any():
        yield _make_outlier_reason(names[fit.is_outlier], f"{length_px[fit.is_outlier].max():.2g} px")
    if fit.is_misfit:
        ids = tuple(dict.fromkeys(names[squares > compute_chi_square_limit(2.0)].tolist()))
        yield Reason(
            "check-misfit",
            fit.level,
            "the check points do not fit the refined RPCs: their RMS residual is "
            f"{np.sqrt(np.mean(length_px[~fit.is_outlier] ** 2)):.2g} px, {fit.factor:.2g} times the expected one; "
            f"significant are {list_ids(ids)}",
            "compare coordinates, heights, datum and ids of these points with their source, and give realistic sigmas",
            images=tuple(block.images[index].id for index in np.unique(block.measurements.image[rows])),
            points=ids,
        )


def _make_outlier_reason(names: np.ndarray, largest: str) -> Reason:
    ids = tuple(dict.fromkeys(names.tolist()))
    return Reason(
        "check-misfit",
        Level.DOUBTFUL,
        f"check point {list_ids(ids)} has a gross error of up to {largest}, and the majority agrees without it",
        "compare these points with their source and their measurements in the images",
        points=ids,
    )


def find_control_outliers(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for GCPs found wrong by data snooping, with a limit that accounts for the number of tests."""
    result = evidence.result
    rows = evidence.row_role == Role.GCP
    surveyed = int((result.block.points.role == Role.GCP).sum())
    candidates = surveyed + int(rows.sum())
    limit = np.sqrt(
        -2.0 * np.log(SIGNIFICANCE.false_alarm * 10.0 / max(candidates, 1))
    )  # equivalent sigmas in two dimensions
    found = [finding for finding in result.findings if finding.statistic > limit]
    out = tuple(dict.fromkeys(finding.id for finding in found if finding.left_out))
    kept = [finding for finding in found if not finding.left_out]
    if out:
        yield Reason(
            "control-outliers",
            Level.DOUBTFUL,
            f"{len(out)} of {surveyed} GCPs {'is' if len(out) == 1 else 'are'} not used because of contradictions "
            f"to the other observations: {list_ids(out)}",
            "compare these points with their source, and correct or remove them",
            points=out,
        )
    if kept:
        worst = max(finding.statistic for finding in kept)
        concerned = tuple(dict.fromkeys(name for finding in kept for name in finding.concerned))
        yield Reason(
            "control-misfit",
            Level.UNUSABLE if worst > SIGNIFICANCE.extreme else Level.DOUBTFUL,
            f"GCPs contradict each other by {worst:.1f} sigma: {list_ids(concerned)}; the observations do not show "
            "which one is wrong, so all are used",
            "compare these points with their source, or measure more GCPs",
            points=concerned,
        )


def find_check_point_errors(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for check points with errors beyond their predicted covariance: single ones, or the majority."""
    result, points = evidence.result, evidence.result.block.points
    check = np.flatnonzero(points.role == Role.CHECK)
    error = evidence.left.ground_m[check]
    block_part = result.covariance_to_surveys_m2(check)
    survey_covariance = result.survey_covariance_m2(check)
    cofactors = _compute_ray_cofactors(evidence)
    covariance = block_part + survey_covariance + evidence.camera_px**2 * cofactors
    usable = np.flatnonzero(finite_rows(error[:, :2]) & np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2)))
    if not len(usable):
        return
    fit = MajorityFit.estimate(*_compute_chi_squares(error[usable], covariance[usable]))
    if fit.is_outlier.any():
        outlying = usable[fit.is_outlier]
        largest = error[outlying[np.argmax(np.nansum(error[outlying] ** 2, axis=1))]]
        yield _make_outlier_reason(points.ids[check[outlying]], f"{_format_metres(largest)} m (east, north, height)")
    rest = usable[~fit.is_outlier]
    axes = _find_mean_errors(evidence, error[rest], block_part[rest], survey_covariance[rest], cofactors[rest])
    if axes or fit.is_misfit:
        predicted = np.sqrt(np.nanmean(covariance[rest].diagonal(axis1=1, axis2=2), axis=0))
        yield Reason(
            "check-misfit",
            fit.level,
            f"the errors of {len(rest)} check points are {fit.factor:.2g} times the predicted ones: RMSE "
            f"{_format_metres(np.sqrt(np.nanmean(error[rest] ** 2, axis=0)))} m, predicted "
            f"{_format_metres(predicted)} m (east, north, height)" + "".join(f"; {axis}" for axis in axes),
            "compare the datum and heights of check points and GCPs; in the report, residual arrows in one "
            "direction indicate a wrong datum, a pattern over the block a correction model with too few "
            "parameters, and single large arrows wrong points",
            points=tuple(points.ids[check[rest]].tolist()),
        )


def _find_mean_errors(
    evidence: Evidence, error: np.ndarray, block_part: np.ndarray, of_survey: np.ndarray, cofactors: np.ndarray
) -> list[str]:
    """Return texts on significant means of the errors ``(k, 3)`` of points along single axes.

    The variance of an axis's mean is that of the block, which all points share, and that of k surveys and measurements
    over k; at most `SAMPLES.redundant` of the cameras' unmodelled errors are independent. So a common error is detected
    that no single point shows. ``block_part``, ``of_survey`` are covariances ``(k, 3, 3)`` by the adjustment and of the
    surveys, ``cofactors`` those of rays.
    """
    ray, stated = (one.diagonal(axis1=1, axis2=2) for one in (cofactors, of_survey))
    pixel = evidence.result.unit_sigma * float(np.median(evidence.result.sigma_px))
    shared = np.maximum(block_part.diagonal(axis1=1, axis2=2) - pixel**2 * ray, 0.0)
    single = shared + stated + (pixel**2 + evidence.camera_px**2) * ray
    told = []
    for axis, (name, sides) in enumerate(AXES.items()):
        used = np.isfinite(error[:, axis]) & np.isfinite(single[:, axis])
        count = int(used.sum())
        if count < SAMPLES.plane:
            continue
        mean, sigma = float(error[used, axis].mean()), float(np.sqrt(single[used, axis].mean()))
        of_cameras = evidence.camera_px**2 * ray[used, axis] / min(count, SAMPLES.redundant)
        by_points = (stated[used, axis] + pixel**2 * ray[used, axis]) / count
        of_mean = float(np.sqrt((shared[used, axis] + of_cameras + by_points).mean()))
        if is_significant((mean / of_mean) ** 2, 1.0, SIGNIFICANCE.false_alarm / 3.0) and abs(mean) > sigma:
            told.append(
                f"their mean difference in {name} is {abs(mean):.2g} m ({sides[mean > 0.0]} the block), "
                f"{abs(mean) / of_mean:.0f} times its standard deviation ({of_mean:.2g} m)"
            )
    return told


def find_leave_one_out_errors(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for GCPs with leave-one-out errors larger than predicted (only without check points).

    Their errors are correlated and tested like those of check points: `find_check_point_errors`. If two or three GCPs
    disagree, the wrong one cannot be identified.
    """
    for one in (part.apart for part in evidence.result.parts if part.apart is not None):
        yield Reason(
            "control-misfit",
            Level.DOUBTFUL,
            f"GCPs {one.ids[0]} and {one.ids[1]} disagree by {one.metres:.2g} m on the ground of {one.image}, "
            f"{one.sigmas:.0f} times the standard deviation from survey, measurement and drift; with so few GCPs "
            "the wrong one is not identified, and the predicted accuracy includes the difference",
            "compare the points with their source, or measure more GCPs: with four the wrong one can be identified",
            images=(one.image,),
            points=one.ids,
        )
    parts = [part for part in evidence.result.parts if part.gcps and part.ce90_m is not None and part.apart is None]
    part = max(parts, key=lambda one: one.leave_one_out, default=None)
    if part is None or part.ce90_m is None or not is_significant(3.0 * part.leave_one_out**2, 3.0):
        return
    factor = part.leave_one_out
    yield Reason(
        "control-misfit",
        Level.DOUBTFUL,
        f"leave-one-out errors of the {part.gcps} GCPs are {factor:.2g} times the predicted ones; the predicted "
        f"CE90 was raised from {part.ce90_m / factor:.2g} m to {part.ce90_m:.2g} m",
        "compare the GCPs with their source, and give realistic sigmas; use some of them as check points "
        "(`check_ids`) for an independent accuracy",
        images=part.images,
    )


def do_check_points_agree(evidence: Evidence) -> bool:
    """Return True if most of several check points agree on the ground and in the images, by the stated sigmas of both.

    The block's predicted errors are not used for it: they grow with its contradictions.
    """
    block = evidence.result.block
    check = np.flatnonzero(block.points.role == Role.CHECK)
    pixel = np.hypot(np.median(block.measurements.sigma_px), CAMERA.unmodelled_px)
    covariance = block.points.survey_covariance_m2(check) + pixel**2 * _compute_ray_cofactors(evidence)
    error = evidence.left.ground_m[check]
    usable = finite_rows(error[:, :2]) & np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2))
    if not usable.any():
        return False
    on_ground = MajorityFit.estimate(*_compute_chi_squares(error[usable], covariance[usable]))
    confirming = check[usable][~on_ground.is_outlier]
    if len(confirming) < SAMPLES.plane or on_ground.factor >= SELECTION.expected_error:
        return False
    rows, by_ground = evidence.check_rays
    point, residual_px = block.measurements.point[rows], evidence.left.at_known_px[rows]
    used = np.isin(point, confirming) & finite_rows(residual_px)
    survey = block.points.survey_covariance_m2(point[used])
    expected = pixel**2 * np.eye(2) + by_ground[used] @ survey @ by_ground[used].swapaxes(1, 2)
    in_images = _compute_chi_squares(residual_px[used], expected)[0]
    return not len(in_images) or float(np.sqrt(in_images.mean() / 2.0)) < SELECTION.expected_error


def are_other_gcps_consistent(evidence: Evidence, suspects: Sequence[str]) -> bool:
    """Return True if no suspected point (id) is a used GCP, and the other GCPs are enough and more than the rejected.

    Otherwise the few GCPs that agree could be the wrong ones, and the rejected majority the correct ones.
    """
    points = evidence.result.block.points
    rejected = {finding.id for finding in evidence.result.findings if finding.left_out}
    gcps = set(points.ids[points.role == Role.GCP].tolist())
    concerned, remaining = gcps & set(suspects), gcps - rejected
    return concerned <= rejected and len(remaining) >= max(SAMPLES.plane, len(gcps & rejected) + 1)


def _compute_ray_cofactors(evidence: Evidence) -> np.ndarray:
    """Return the cofactors ``(k, 3, 3)`` m²/px² of check points from independent images, with sigmas of 1 px."""
    points = evidence.result.block.points
    rows, by_ground = evidence.check_rays
    normal = np.zeros((len(points), 3, 3))
    np.add.at(normal, evidence.result.block.measurements.point[rows], by_ground.swapaxes(1, 2) @ by_ground)
    normal = normal[points.role == Role.CHECK]
    solvable = np.linalg.matrix_rank(normal, hermitian=True) == 3  # one ray determines no position
    cofactors = np.full_like(normal, np.nan)
    cofactors[solvable] = np.linalg.inv(normal[solvable])
    return cofactors


def _compute_chi_squares(error: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return d' C^-1 d ``(k,)`` of errors ``(k, 2 or 3)``, and its degrees of freedom: 3, or 2 without a height."""
    flat = ~(np.isfinite(error[:, -1]) & np.isfinite(covariance[:, -1, -1])) | (error.shape[1] == 2)
    squares = np.empty(len(error))
    for rows, axes in ((flat, slice(0, 2)), (~flat, slice(0, 3))):
        if rows.any():
            difference = error[rows, axes]
            solved = np.linalg.solve(covariance[rows, axes, axes], difference[:, :, None])[:, :, 0]
            squares[rows] = np.einsum("ki,ki->k", difference, solved)
    return squares, np.where(flat, 2.0, 3.0)


def _format_metres(values: np.ndarray) -> str:
    return " / ".join("-" if np.isnan(value) else f"{value:.2f}" for value in values)


_DRIFTS = ("sample_s", "sample_l", "line_s", "line_l")


def find_deformed_survey(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for GCPs that rotate, scale or tilt the ground by more than the predicted accuracy.

    Drifts of images come from their own orbits and attitudes: the twelve drifts of three images do not agree with the
    six parameters of one linear deformation of the ground (two shears and two scales in plan, a tilt along two axes),
    unless the survey is deformed. It has to exceed what the sensors drift by themselves.
    """
    result = evidence.result
    estimated = result.cameras
    gcps = result.block.points.ground[result.block.points.role == Role.GCP]  # without GCPs of an earlier block
    if len(gcps) < SAMPLES.plane or not set(_DRIFTS) <= set(estimated.model.parameters):
        return
    columns = [estimated.model.parameters.index(name) for name in _DRIFTS]
    number = {image.id: index for index, image in enumerate(result.block.images)}
    for part in result.parts:
        rows = [number[name] for name in part.images]
        if part.gcps < SAMPLES.plane or len(rows) < 2 or part.ce90_m is None or part.le90_m is None:
            continue
        images = [result.block.images[row] for row in rows]
        drifts = np.ix_(rows, columns)
        gradient, excess, likeness = fit_deformation(images, estimated.values[drifts], evidence.value_sigmas[drifts])
        rim = np.stack([gcps.min(axis=0), gcps.max(axis=0)])
        half_m = float(np.linalg.norm(ground_difference_m(rim[1:], rim[:1])[0, :2])) / 2.0
        plan_m = half_m * float(np.linalg.norm(gradient[:2], 2))
        height_m = half_m * float(np.linalg.norm(gradient[2]))
        if (
            max(excess, likeness) < SIGNIFICANCE.false_alarm
            and max(plan_m / part.ce90_m, height_m / part.le90_m) > SELECTION.expected_error
        ):
            yield Reason(
                "survey-deformed",
                Level.DOUBTFUL,
                f"the GCPs rotate or scale the block by {1e6 * plan_m / half_m:.0f} mm/km and tilt it by "
                f"{1e6 * height_m / half_m:.0f} mm/km: {plan_m:.2g} m in plan and {height_m:.2g} m in height at its "
                f"edge; all {len(images)} images show this deformation, although their attitude drifts are "
                "independent",
                "check projection (map distances instead of ground distances), orientation and height datum of the "
                "survey",
                images=tuple(part.images),
            )


def fit_deformation(images: Sequence[Image], drifts: np.ndarray, sigmas: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Return the linear deformation of the ground that best explains the drifts of the images.

    images : two or more
    drifts : (n, 4) of sample by sample, sample by line, line by sample, line by line, px/px; ``sigmas`` of them
    Result: error in east, north and height per metre east and north ``(3, 2)``; the probability of such drifts by the
    sensors alone (chi² test of what the deformation explains), and of such agreement of independent drifts (F test).
    """
    weight = 1.0 / sigmas.ravel()
    # Derivatives (4 n, 6) of each image's drifts by the elements of a deformation of the ground
    stack, owner = stack_rpcs(images), np.arange(len(images))
    centres = np.array([image.centre_px for image in images])
    middle = stack.localize(owner, centres, np.array([image.rpc.height_off for image in images]))
    by_ground = stack.project_with_metric_jacobian(owner, middle)[1]  # (n, 2, 3), px/m
    by_pixel = np.linalg.inv(by_ground[:, :, :2])  # along the ground at one height, m/px
    design = -np.einsum("nia,nbj->nijab", by_ground, by_pixel).reshape(-1, 6) * weight[:, None]
    observed = drifts.ravel() * weight
    coefficients, *_ = np.linalg.lstsq(design, observed, rcond=None)
    explained = float(np.sum((design @ coefficients) ** 2))
    parameters, freedom = design.shape[1], len(design) - design.shape[1]
    residual_variance = float(np.sum((observed - design @ coefficients) ** 2)) / freedom
    likeness = float(special.fdtrc(parameters, freedom, explained / parameters / max(residual_variance, 1e-30)))
    return coefficients.reshape(3, 2), float(special.chdtrc(parameters, explained)), likeness
