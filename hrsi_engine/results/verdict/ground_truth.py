"""Known ground against the block: GCPs, check points, laser points and DEM against their predicted accuracy.

Standard deviations of surveys are often guesses, and in one sigma0 over thousands of tie points a dozen GCPs have no
effect. So GCPs have a separate test: their residuals at the surveyed positions, normalised by the standard deviations
of survey and measurement.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import special

from ...adjustment.external.laser_heights import MISFIT
from ...adjustment.result import HeightAgreement, SourceGroup
from ...block.block import Role
from ...foundation.errors import list_ids
from ...foundation.large_arrays import finite_rows
from ...foundation.reasons import Level, Reason
from ...foundation.robust_scale import robust_sigma
from ...foundation.statistical_limits import SIGNIFICANCE
from ...foundation.thresholds import threshold, thresholds
from ..residuals import by_image, state_known_sigmas_px
from .evidence import CAMERA, Evidence
from .significance import EFFECT, SOUND_BLOCKS, compute_chi_square_limit, is_significant


@thresholds
class GroundTruthThresholds:
    """Limits for GCPs, check points and heights that contradict the block."""

    few_laser: int = threshold(
        10, "points", "number below which laser points that alone determine the height are reported", SOUND_BLOCKS
    )
    few_laser_share: float = threshold(0.1, "", "… if also less than this share of their file", SOUND_BLOCKS)
    outvoted_share: float = threshold(0.5, "", "share of GCPs that contradict other heights: block unusable")
    doubtful_parts: float = threshold(0.1, "", "smallest reported share of a source in contradicting parts")
    canopy_m: float = threshold(3.0, "m", "height difference of laser points on the ground from canopy", SOUND_BLOCKS)
    largest_condition: float = threshold(1e12, "", "largest condition number of normals of intersecting rays")
    most_independent: int = threshold(5, "points", "largest number of independent camera errors", SOUND_BLOCKS)


GROUND_TRUTH = GroundTruthThresholds()
AXES = {"east": ("west of", "east of"), "north": ("south of", "north of"), "height": ("below", "above")}


def find_control_misfit(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for GCPs whose residuals exceed their expected standard deviations, singly or together."""
    misfits = list(_find_misfit(evidence, Role.GCP))
    yield from misfits
    result, points = evidence.result, evidence.result.block.points
    rejected = [finding.id for finding in result.findings if finding.left_out]
    gcps = np.flatnonzero((points.role == Role.GCP) & ~np.isin(points.ids, rejected))
    survey_covariance, cofactors = result.survey_covariance_m2(gcps), _compute_ray_cofactors(evidence, gcps)
    axes = _find_axis_errors(
        evidence,
        evidence.left.ground_m[gcps],
        np.zeros_like(survey_covariance),
        survey_covariance,
        cofactors,
        means=True,
    )
    if axes and not misfits:
        yield Reason(
            "control-misfit", Level.DOUBTFUL, f"the {len(gcps)} GCPs disagree with the adjusted block: "
                                              f"{'; '.join(axes)}",
            "compare the GCPs with the other constraints of the block (DEM, laser points, reference, RPCs), and "
            "correct the wrong one",
            points=tuple(points.ids[gcps].tolist()),
        )  # fmt: skip


def find_check_misfit_in_images(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for check points that misfit images refined separately (without predicted ground accuracy)."""
    if not np.isfinite(evidence.result.ground_covariance_m2).any():
        yield from _find_misfit(evidence, Role.CHECK)


def _find_misfit(evidence: Evidence, role: Role) -> Iterator[Reason]:
    result, left, block = evidence.result, evidence.left, evidence.result.block
    in_sigmas = left.measured_px / np.hypot(state_known_sigmas_px(result, left), evidence.camera_px)
    rejected = [finding.id for finding in result.findings if finding.left_out]
    takes_part = (
        (evidence.row_role == role)
        & ~evidence.left_out
        & ~np.isin(block.points.ids, rejected)[block.measurements.point]
    )
    rows = np.flatnonzero(takes_part & finite_rows(in_sigmas))
    if not len(rows):
        return
    squares = np.sum(in_sigmas[rows] ** 2, axis=1)
    factor = float(np.sqrt(squares.sum() / (2.0 * len(rows))))
    if factor < EFFECT.doubtful_factor or not is_significant(float(squares.sum()), 2.0 * len(rows)):
        return
    misfitting = np.unique(block.measurements.point[rows[squares > compute_chi_square_limit(2.0)]])
    ids = tuple(str(name) for name in block.points.ids[misfitting])
    length = float(np.sqrt(np.mean(np.sum(left.measured_px[rows] ** 2, axis=1))))
    subject = {Role.GCP: "the GCPs do", Role.CHECK: "the check points do"}[role]
    yield Reason(
        {Role.GCP: "control-misfit", Role.CHECK: "check-misfit"}[role],
        Level.UNUSABLE if factor >= EFFECT.unusable_factor else Level.DOUBTFUL,
        f"{subject} not fit the refined RPCs: their RMS residual is {length:.2g} px, {factor:.2g} times the expected "
        f"one; significant are {list_ids(ids)}",
        "compare coordinates, heights, datum and ids of these points with their source, and give realistic sigmas",
        images=tuple(block.images[index].id for index in np.unique(block.measurements.image[rows])),
        points=ids,
    )  # fmt: skip


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
            Level.UNUSABLE if worst > EFFECT.unusable_factor else Level.DOUBTFUL,
            f"GCPs contradict each other by {worst:.1f} sigma: {list_ids(concerned)}; the observations do not show "
            "which one is wrong, so all are used",
            "compare these points with their source, or measure more GCPs",
            points=concerned,
        )


def find_check_point_errors(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for check points with errors beyond their predicted covariance: all together, or single ones."""
    result, points = evidence.result, evidence.result.block.points
    check = np.flatnonzero(points.role == Role.CHECK)
    error = evidence.left.ground_m[check]
    block_part = result.covariance_to_surveys_m2(check)
    survey_covariance = result.survey_covariance_m2(check)
    cofactors = _compute_ray_cofactors(evidence, check)
    covariance = block_part + survey_covariance + evidence.camera_px**2 * cofactors
    usable = finite_rows(error[:, :2]) & np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2))
    check, error, covariance = check[usable], error[usable], covariance[usable]
    if not len(check):
        return
    squares, freedom = _compute_chi_squares(error, covariance)
    factor = float(np.sqrt(squares.sum() / freedom.sum()))
    axes = _find_axis_errors(evidence, error, block_part[usable], survey_covariance[usable], cofactors[usable])
    # The errors of a block's points are correlated: their sum is tested with the degrees of freedom of one point.
    if axes or is_significant(3.0 * factor**2, 3.0):
        predicted = np.sqrt(np.nanmean(covariance.diagonal(axis1=1, axis2=2), axis=0))
        rms_error = np.sqrt(np.nanmean(error**2, axis=0))
        ratio = float(np.nanmax(rms_error / predicted))
        yield Reason(
            "check-misfit",
            Level.UNUSABLE if max(factor, ratio) >= EFFECT.unusable_factor else Level.DOUBTFUL,
            f"the errors of {len(check)} check points are {factor:.2g} times the predicted ones: RMSE "
            f"{_format_metres(rms_error)} m, predicted {_format_metres(predicted)} m (east, north, height)"
            + "".join(f"; {axis}" for axis in axes),
            "compare the datum and heights of check points and GCPs; in the report, residual arrows in one "
            "direction indicate a wrong datum, a pattern over the block a correction model with too few "
            "parameters, and single large arrows wrong points",
            points=tuple(str(name) for name in points.ids[check]),
        )
        return
    # Single points are compared with the scatter of the others: standard deviations that are too small reject none.
    middle = np.median(squares / special.chdtri(freedom, 0.5))
    limit = np.array([compute_chi_square_limit(value, SIGNIFICANCE.false_alarm / len(check)) for value in freedom])
    is_outlier = squares > limit * max(middle, 1.0) * (EFFECT.doubtful_factor / 2.0) ** 2
    if is_outlier.any():
        worst = int(np.argmax(squares))
        ids = tuple(str(name) for name in points.ids[check[is_outlier]])
        yield Reason(
            "check-misfit", Level.DOUBTFUL,
            f"check point {list_ids(ids)} has a gross error, and the other check points agree: the error of "
            f"{points.ids[check[worst]]} is {_format_metres(error[worst])} m (east, north, height)",
            "compare these points with their source and their measurements in the images",
            points=ids,
        )  # fmt: skip


def _find_axis_errors(
    evidence: Evidence, error: np.ndarray, block_part: np.ndarray, own: np.ndarray, cofactors: np.ndarray,
    means: bool = False,
) -> list[str]:  # fmt: skip
    """Return texts on significant means or scatter of the errors ``(k, 3)`` of points along single axes.

    The variance of an axis's mean is that of the block, which all points share, and that of k surveys and measurements
    over k; at most `most_independent` of the cameras' unmodelled errors are independent. So a common error is detected
    that no single point shows. ``block_part``, ``own`` are covariances ``(k, 3, 3)`` by the adjustment and of the
    surveys, ``cofactors`` those of rays; ``means`` omits the test of the scatter, which drifts also cause.
    """
    ray, stated = (one.diagonal(axis1=1, axis2=2) for one in (cofactors, own))
    pixel = evidence.result.unit_sigma * float(np.median(evidence.result.sigma_px))
    shared = np.maximum(block_part.diagonal(axis1=1, axis2=2) - pixel**2 * ray, 0.0)
    single = shared + stated + (pixel**2 + evidence.camera_px**2) * ray
    told = []
    for axis, (name, sides) in enumerate(AXES.items()):
        used = np.isfinite(error[:, axis]) & np.isfinite(single[:, axis])
        count = int(used.sum())
        if count < EFFECT.fewest_points:
            continue
        mean, sigma = float(error[used, axis].mean()), float(np.sqrt(single[used, axis].mean()))
        of_cameras = evidence.camera_px**2 * ray[used, axis] / min(count, GROUND_TRUTH.most_independent)
        by_points = (stated[used, axis] + pixel**2 * ray[used, axis]) / count
        of_mean = float(np.sqrt((shared[used, axis] + of_cameras + by_points).mean()))
        scatter = float(robust_sigma(error[used, axis] - np.median(error[used, axis]))) / sigma
        if is_significant((mean / of_mean) ** 2, 1.0, SIGNIFICANCE.false_alarm / 3.0) and abs(mean) > sigma:
            told.append(
                f"their mean difference in {name} is {abs(mean):.2g} m ({sides[mean > 0.0]} the block), "
                f"{abs(mean) / of_mean:.0f} times its standard deviation ({of_mean:.2g} m)"
            )
        elif not means and scatter > max(
            EFFECT.doubtful_factor, np.sqrt(compute_chi_square_limit(count - 1.0) / (count - 1.0))
        ):
            told.append(f"their scatter in {name} is {scatter:.1f} times the predicted one ({sigma:.2g} m)")
    return told


def find_leave_one_out_errors(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for GCPs with leave-one-out errors larger than predicted (only without check points).

    Their errors are correlated and tested like those of check points: `find_check_point_errors`. If two or three GCPs
    disagree, the wrong one cannot be identified.
    """
    for one in (part.apart for part in evidence.result.parts if part.apart is not None):
        yield Reason(
            "control-misfit", Level.DOUBTFUL,
            f"GCPs {one.ids[0]} and {one.ids[1]} disagree by {one.metres:.2g} m on the ground of {one.image}, "
            f"{one.sigmas:.0f} times the standard deviation from survey, measurement and drift; with so few GCPs "
            "the wrong one is not identified, and the predicted accuracy includes the difference",
            "compare the points with their source, or measure more GCPs: with four the wrong one can be identified",
            images=(one.image,), points=one.ids,
        )  # fmt: skip
    parts = [part for part in evidence.result.parts if part.gcps and part.ce90_m is not None and part.apart is None]
    part = max(parts, key=lambda one: one.leave_one_out, default=None)
    if part is None or part.ce90_m is None or not is_significant(3.0 * part.leave_one_out**2, 3.0):
        return
    factor = part.leave_one_out
    yield Reason(
        "control-misfit", Level.DOUBTFUL,
        f"leave-one-out errors of the {part.gcps} GCPs are {factor:.2g} times the predicted ones; the predicted "
        f"CE90 was raised from {part.ce90_m / factor:.2g} m to {part.ce90_m:.2g} m",
        "compare the GCPs with their source, and give realistic sigmas; use some of them as check points "
        "(`check_ids`) for an independent accuracy",
        images=part.images,
    )  # fmt: skip


def do_check_points_agree(evidence: Evidence) -> bool:
    """Return True if several check points agree on the ground and in the images, by the stated sigmas of both.

    The block's predicted errors are not used for it: they grow with its contradictions.
    """
    block = evidence.result.block
    check = np.flatnonzero(block.points.role == Role.CHECK)
    pixel = np.hypot(np.median(block.measurements.sigma_px), CAMERA.unmodelled_px)
    covariance = block.points.survey_covariance_m2(check) + pixel**2 * _compute_ray_cofactors(evidence, check)
    error = evidence.left.ground_m[check]
    usable = finite_rows(error[:, :2]) & np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2))
    if usable.sum() < EFFECT.fewest_points:
        return False
    squares, freedom = _compute_chi_squares(error[usable], covariance[usable])
    in_images = [0.0]
    rows = block.measurements
    for index, image_rows in by_image(
        block, np.isin(rows.point, check[usable]) & finite_rows(evidence.left.at_known_px)
    ):
        _, by_ground = block.images[index].rpc.project_with_metric_jacobian(block.points.ground[rows.point[image_rows]])
        survey = block.points.survey_covariance_m2(rows.point[image_rows])
        expected = pixel**2 * np.eye(2) + by_ground @ survey @ by_ground.swapaxes(1, 2)
        miss = evidence.left.at_known_px[image_rows]
        in_images += (np.einsum("ki,kij,kj->k", miss, np.linalg.inv(expected), miss) / 2.0).tolist()
    factor = np.sqrt(max(squares.sum() / freedom.sum(), np.sum(in_images) / max(len(in_images) - 1, 1)))
    return float(factor) < EFFECT.agreeing_factor


def are_other_gcps_consistent(evidence: Evidence, suspects: Sequence[str]) -> bool:
    """Return True if the ``suspects`` points (ids) were rejected, and the other GCPs are enough and more than these.

    Otherwise the few GCPs that agree could be the wrong ones, and the rejected majority the correct ones.
    """
    points = evidence.result.block.points
    rejected = {finding.id for finding in evidence.result.findings if finding.left_out}
    gcps = set(points.ids[points.role == Role.GCP].tolist())
    concerned, remaining = gcps & set(suspects), gcps - rejected
    return (
        bool(concerned)
        and concerned <= rejected
        and len(remaining) >= max(EFFECT.fewest_points, len(gcps & rejected) + 1)
    )


def _compute_ray_cofactors(evidence: Evidence, points_selected: np.ndarray) -> np.ndarray:
    """Return the cofactors ``(k, 3, 3)`` m²/px² of points intersected from independent images, with sigmas of 1 px."""
    block, rows = evidence.result.block, evidence.result.block.measurements
    normal = np.zeros((len(block.points), 3, 3))
    for index, image_rows in by_image(block, np.isin(rows.point, points_selected)):
        points = rows.point[image_rows]
        _, by_ground = block.images[index].rpc.project_with_metric_jacobian(block.points.ground[points])
        np.add.at(normal, points, by_ground.swapaxes(1, 2) @ by_ground)
    normal = normal[points_selected]
    solvable = np.linalg.cond(normal) < GROUND_TRUTH.largest_condition
    cofactors = np.full_like(normal, np.nan)
    cofactors[solvable] = np.linalg.inv(normal[solvable])
    return cofactors


def _compute_chi_squares(error: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return d' C^-1 d ``(k,)`` and its degrees of freedom: 3, or 2 without a height."""
    flat = ~np.isfinite(error[:, 2]) | ~np.isfinite(covariance[:, 2, 2])
    squares = np.empty(len(error))
    for rows, axes in ((flat, slice(0, 2)), (~flat, slice(0, 3))):
        if rows.any():
            difference = error[rows, axes]
            solved = np.linalg.solve(covariance[rows, axes, axes], difference[:, :, None])[:, :, 0]
            squares[rows] = np.einsum("ki,ki->k", difference, solved)
    return squares, np.where(flat, 2.0, 3.0)


def _format_metres(values: np.ndarray) -> str:
    return " / ".join("-" if np.isnan(value) else f"{value:.2f}" for value in values)


def find_conflicting_heights(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for laser points or a DEM that contradict one another, or the GCPs, in the block's height.

    GCPs that agree decide, and so do most parts of a DEM; otherwise it is ambiguous which height is correct. A
    contradiction exceeds the full standard deviation of the heights: that of the group, with the rays, and the stated
    one of the source, which is common to its cells. Parts of a surface model above the ground by less than trees and
    buildings are no contradiction.
    """
    le90_m = max((part.le90_m for part in evidence.result.parts if part.le90_m is not None), default=np.inf)
    for one in evidence.result.heights:
        off, compared = one.gcps
        told = [group for group in one.groups if group.wrong and _is_contradiction(one, group)]
        undecided = any(not group.left_out for group in told)
        told = [group for group in told if not (undecided and group.left_out)]
        middle = float(np.median([group.offset_m for group in told])) if told else 0.0
        share = sum(group.observations for group in told) / max(one.observations, 1)
        outvoted = off > GROUND_TRUTH.outvoted_share * compared and one.left_out < one.observations
        if not (undecided or outvoted or share > GROUND_TRUTH.doubtful_parts):
            continue
        open_between = undecided or (not compared and share > GROUND_TRUTH.outvoted_share)
        if outvoted:
            what = f"its heights contradict those of {off} of {compared} GCPs, and outweigh them in the adjustment"
        else:
            who = (
                "all of its heights"
                if len(told) == len(one.groups)
                else f"the heights of {list_ids(g.name for g in told)}"
            )
            done = "were used, because the wrong ones cannot be identified" if undecided else "were not used"
            what = f"{who} differ by {middle:+.1f} m (median) from the other height observations of the block"
            what += f" (sigma {_compute_full_sigma_m(one, told[0]):.1f} m); they {done}"
        unusable = outvoted or (open_between and abs(middle) > 2.0 * le90_m)
        yield Reason(
            "sources-disagree", Level.UNUSABLE if unusable else Level.DOUBTFUL, f"{one.source}: {what}",
            "check the height datum of laser points, DEM and GCPs: heights above a geoid and above the ellipsoid "
            "differ by tens of metres; a DEM with contradicting parts may be a mosaic with steps",
        )  # fmt: skip


def _compute_full_sigma_m(source: HeightAgreement, group: SourceGroup) -> float:
    """Return the standard deviation of a group's offset, with the stated one of its source, in metres."""
    return float(np.hypot(group.sigma_m, source.sigma_m / source.sigma_factor))


def _is_contradiction(source: HeightAgreement, group: SourceGroup) -> bool:
    """Return True if the offset of a group exceeds its full standard deviation, trees and buildings included."""
    limit_m = EFFECT.doubtful_factor * _compute_full_sigma_m(source, group)
    above_m = GROUND_TRUTH.canopy_m if source.source == "DEM" else 0.0
    return not -limit_m <= group.offset_m <= limit_m + above_m


def find_heights_off_rpcs(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for heights that move the block by more than the errors of its RPCs explain."""
    result = evidence.result
    sigma_m = result.rpcs_height_sigma_m
    if not result.heights or result.rpcs_alone_m is None or sigma_m is None:
        return
    away_m = -result.rpcs_alone_m[2]
    if abs(away_m) > EFFECT.doubtful_factor * sigma_m:
        held = [one.source for one in result.heights if one.left_out < one.observations]
        yield Reason(
            "sources-disagree", Level.DOUBTFUL,
            f"the heights of {' and '.join(held)} move the block by {away_m:+.1f} m from its height by the RPCs "
            f"alone, {abs(away_m) / sigma_m:.0f} times the standard deviation of that height",
            "check unit and datum of these heights (`laser_datum`, `dem_datum`): heights above a geoid and above "
            "the ellipsoid differ by tens of metres",
        )  # fmt: skip


def find_height_scatter(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for heights whose scatter about the ground is much larger than their standard deviations."""
    for one in evidence.result.heights:
        if one.sigma_factor > EFFECT.doubtful_factor and not one.contradicts:
            yield Reason(
                "sources-disagree", Level.DOUBTFUL,
                f"{one.source}: the RMS difference of its heights from the ground in the images is {one.rmse_m:.0f} "
                f"m, {one.sigma_factor:.0f} times the given standard deviation",
                "check position, column and unit of these heights, or give a realistic sigma",
            )  # fmt: skip


def find_laser_canopy(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for laser points rejected because they are lower: the used ones may be canopy."""
    laser = evidence.result.laser
    if laser is None:
        return
    fits = laser.reason == ""
    low = (laser.reason == MISFIT) & (laser.residual_m < -GROUND_TRUTH.canopy_m)
    if low.sum() < max(
        GROUND_TRUTH.few_laser, GROUND_TRUTH.few_laser_share * (fits.sum() + (laser.reason == MISFIT).sum())
    ):
        return
    yield Reason(
        "sources-disagree", Level.DOUBTFUL,
        f"{low.sum()} laser points are {-np.median(laser.residual_m[low]):.1f} m (median) lower than the "
        f"{fits.sum()} used ones, which may be canopy or roofs",
        "use ground heights (terrain heights of ATL08, a SlideRule fit without canopy), give the canopy height in "
        "a field `canopy_m`, or name a DEM",
    )  # fmt: skip


def find_unused_laser(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for a file of laser points of which none, or too few to control one another, are used."""
    found = evidence.result.laser
    if found is None:
        return
    used, number = int((found.reason == "").sum()), len(found.reason)
    enough = min(GROUND_TRUTH.few_laser, GROUND_TRUTH.few_laser_share * number)
    if used and (used >= enough or any(part.gcps for part in evidence.result.parts)):
        return
    reasons, count = np.unique(found.reason[found.reason != ""], return_counts=True)
    most = ", ".join(f"{count[k]} {reasons[k]}" for k in np.argsort(-count)[:3].tolist())
    yield Reason(
        "laser-few", Level.DOUBTFUL,
        f"{f'only {used}' if used else 'none'} of the {number} laser points can be used for the height of the block: "
        f"{most}",
        "the layer laser_points lists the reason for each; check coordinates and datum of the file, or name a file "
        "with more passes over the images",
    )  # fmt: skip


ON_GROUND_TRUTH = (
    find_control_misfit, find_check_misfit_in_images, find_control_outliers, find_check_point_errors,
    find_leave_one_out_errors, find_conflicting_heights, find_heights_off_rpcs, find_height_scatter,
    find_laser_canopy, find_unused_laser,
)  # fmt: skip
