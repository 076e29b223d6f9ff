"""The report's entries on an adjusted block, named as in the report's schema (version 1).

They include the distribution of residuals and the coverage of the images by points, which characterise the quality of a
block. A normalised residual is v / (sigma sqrt(r)) with the observation's redundancy number r (Baarda 1968): a standard
normal variable if sigmas and model are correct.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..adjustment.evaluation import PairFit, TrackFit, find_wrong_tracks, fit_pairs, fit_tracks
from ..adjustment.hold_out import sample_tracks
from ..adjustment.observations import Observations
from ..adjustment.options import HOLD_OUT
from ..adjustment.result import Adjustment, DatumPart, Decision
from ..adjustment.statistics.precision import errors_90, predict_accuracy
from ..block.block import Role
from ..block.control_visibility import find_weak_control
from ..block.pointing import estimate_pointing
from ..foundation.errors import IDS_NAMED
from ..foundation.large_arrays import finite_rows
from ..foundation.robust_scale import ROBUST
from ..foundation.thresholds import GRIDS, LISTS, REDUNDANCY, SIGNIFICANCE
from ..refinement.model import RefitRPC
from .outliers import name_measurement, outlier_entries
from .residuals import Residuals, by_image, group_rmse, radial_rmse, rmse
from .surface_figures import describe_surface

NO_ROWS = np.zeros(0, dtype=np.int64)


def block_report(result: Adjustment, left: Residuals, refined: Sequence[RefitRPC]) -> dict[str, Any]:
    """Return the report's entries on the adjustment; paths, times and settings are added by the caller.

    result : the adjustment; left : its residuals; refined : the refined RPC of each image
    Result: entries by their names in ``report.json``, ready for JSON.
    """
    rows = dict(by_image(result.block, np.ones(len(result.block.measurements), dtype=bool)))
    return {
        "model": result.model.name,
        "converged": result.converged,
        "status": result.status,
        "iterations": len(result.history),
        "history": [{"cost": step.cost, "damping": step.damping} for step in result.history],
        "sigma0": result.sigma0,
        "observations": result.observations,
        "unknowns": result.unknowns,
        "redundancy": round(result.redundancy, 3),
        "images": {
            image.id: _image_entry(result, left, index, rows.get(index, NO_ROWS), refined[index])
            for index, image in enumerate(result.block.images)
        },
        **control_and_check(result, left),
        "ties": _tie_entry(result, left),
        "held_out": summarise_held_out(result, refined),
        **outlier_entries(result, left),
        "solves": result.solves,
        "rejected": _list_exclusions(result),
        "findings": [asdict(finding) for finding in result.findings],
        "variance_components": [asdict(part) for part in result.variance_components],
        "parts": [_part_entry(part) for part in result.parts],
        "cross_validation": _cross_validation(result),
        "heights": [asdict(source) for source in result.heights],
        "plan": None if result.plan is None else asdict(result.plan),
        "surface": [describe_surface(one) for one in result.surfaces],
        "crs_operations": [use.entry() for use in result.block.all_operations],
        "untested_by_check_points": _find_untested_accuracy(result),
        "rpcs_alone_m": None if result.rpcs_alone_m is None else list(result.rpcs_alone_m),
        "rpcs_height_sigma_m": result.rpcs_height_sigma_m,
    }


def _list_exclusions(result: Adjustment) -> dict[str, Any]:
    """Return the numbers of measurements rejected as blunders or as doubtful, and a list of the worst."""
    excluded = np.flatnonzero(result.decision != int(Decision.KEPT))
    excluded = excluded[np.argsort(-np.nan_to_num(result.statistic[excluded]), kind="stable")]
    return {
        "blunders": int((result.decision == int(Decision.BLUNDER)).sum()),
        "doubtful": int((result.decision == int(Decision.DOUBTFUL)).sum()),
        "measurements": [
            name_measurement(result, row)
            | {
                "verdict": Decision(result.decision[row]).name.lower(),
                "statistic": float(result.statistic[row]) if np.isfinite(result.statistic[row]) else None,
            }
            for row in excluded[: LISTS.rows].tolist()
        ],
    }


def _part_entry(part: DatumPart) -> dict[str, Any]:
    """Return the entry of images connected by common points; ``by_priors`` counts parameters determined by priors."""
    entry = asdict(part)
    entry["images"] = list(part.images[: LISTS.rows])
    entry["image_count"] = len(part.images)
    sigma = entry.pop("sigma_m")
    entry["parallel_points"], entry["parallel"] = len(part.parallel), list(part.parallel[: LISTS.rows])
    return entry | {
        f"sigma_{axis}_m": value if np.isfinite(value) else None
        for axis, value in zip(("east", "north", "height"), sigma, strict=True)
    }


def _cross_validation(result: Adjustment) -> dict[str, Any] | None:
    outcome = result.cross_validation
    if outcome is None:
        return None
    east, north, height = (rmse(outcome.error_m[:, axis]) for axis in range(3))
    return {
        "points": len(outcome.ids),
        "rmse_east_m": east,
        "rmse_north_m": north,
        "rmse_height_m": height,
        "errors_m": {
            name: [None if np.isnan(value) else float(value) for value in error]
            for name, error in zip(outcome.ids, outcome.error_m, strict=True)
        },
    }


def control_and_check(result: Adjustment, left: Residuals) -> dict[str, Any]:
    """Return the figures of the known points, by their role.

    result : the adjustment; left : its residuals
    Result: ``control`` and ``check``, in metres and pixels as stated by their keys.
    """
    check = _survey_entry(result, left, Role.CHECK)
    points = np.flatnonzero(result.block.points.role == Role.CHECK)
    check |= errors_90(check["rmse_east_m"], check["rmse_north_m"], check["rmse_height_m"])
    check["predicted"] = predict_accuracy(result.covariance_to_surveys_m2(points) + result.survey_covariance_m2(points))
    rejected = sorted({finding.id for finding in result.findings if finding.left_out and finding.what == "ground"})
    weak = find_weak_control(result.block) | {"rejected": rejected}
    control = _survey_entry(result, left, Role.GCP) | {"weak": weak}
    return {"control": control, "check": check}


def _image_entry(
    result: Adjustment, left: Residuals, index: int, image_rows: np.ndarray, refined: RefitRPC
) -> dict[str, Any]:
    values = zip(result.model.parameters, result.values[index], result.values_sigma[index], strict=True)
    return {
        "observations": int(result.has_residual[image_rows].sum()),
        "before_rmse_sample_px": rmse(left.before_px[image_rows, 0]),
        "before_rmse_line_px": rmse(left.before_px[image_rows, 1]),
        "rmse_sample_px": rmse(left.at_known_px[image_rows, 0]),
        "rmse_line_px": rmse(left.at_known_px[image_rows, 1]),
        "rpc_fit_max_px": refined.fit_max_px,
        "err_bias_m": refined.rpc.err_bias,
        "err_rand_m": refined.rpc.err_rand,
        "pointing": asdict(estimate_pointing(result.block.images[index])),
        "parameters": {name: {"value": float(value), "sigma": float(sigma)} for name, value, sigma in values},
    }


def _survey_entry(result: Adjustment, left: Residuals, role: Role) -> dict[str, Any]:
    points = result.block.points.role == role
    rows = points[result.block.measurements.point]
    east, north, height = (rmse(left.ground_m[points, axis]) for axis in range(3))
    # The standard deviations of surveyed east, north and height (k, 3); infinite where not surveyed
    sigma = np.sqrt(result.block.points.survey_covariance_m2(np.flatnonzero(points)).diagonal(axis1=1, axis2=2))
    return {
        "points": int(points.sum()),
        **{f"sigma_survey_{axis}_m": rmse(sigma[:, k]) for k, axis in enumerate(("east", "north", "height"))},
        "rmse_east_m": east,
        "rmse_north_m": north,
        "rmse_height_m": height,
        "rmse_sample_px": rmse(left.at_known_px[rows, 0]),
        "rmse_line_px": rmse(left.at_known_px[rows, 1]),
    }


def _tie_entry(result: Adjustment, left: Residuals) -> dict[str, Any]:
    """Return figures of the used tie measurements; ``by_rays`` has them by the number of images.

    ``images`` counts those connected by tie points: at least half of an exposure's tie measurements are kept, each with
    another ray.
    """
    block, point = result.block, result.block.measurements.point
    exposure = block.exposure_of_image
    is_tie = (block.points.role == Role.TIE)[point]
    is_kept = is_tie & (result.decision == int(Decision.KEPT))
    is_kept &= (np.bincount(point[is_kept], minlength=len(block.points)) > 1)[point]
    count, left_in = (
        np.bincount(exposure[block.measurements.image[rows]], minlength=len(exposure)) for rows in (is_tie, is_kept)
    )
    used_rows = np.flatnonzero(result.is_used_tie)
    rays = np.bincount(point[used_rows], minlength=len(block.points))
    points_with = np.bincount(rays)  # by the number of rays
    residuals = left.tie_before_px[used_rows], result.residual_px[used_rows]
    by_rays = zip(*(group_rmse(each, rays[point[used_rows]], len(points_with)) for each in residuals), strict=True)
    figures = {
        str(count): {"points": points, "observations": count * points, "before_rmse_px": before, "rmse_px": after}
        for count, (points, (before, after)) in enumerate(zip(points_with.tolist(), by_rays, strict=True))
        if count and points
    }
    before_px, after_px = (radial_rmse(each) for each in residuals)
    return {
        "points": int(points_with[1:].sum()),
        "observations": len(used_rows),
        "before_rmse_px": before_px,
        "rmse_px": after_px,
        "images": int(np.count_nonzero(((left_in > 0) & (2 * left_in >= count))[exposure])),
        "by_rays": figures,
    }


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


def rejection_warnings(result: Adjustment) -> list[str]:
    """Return the warning of gross errors that data snooping rejected, the worst first."""
    excluded = result.decision != int(Decision.KEPT)
    gross = int((excluded & (np.nan_to_num(result.statistic) > SIGNIFICANCE.extreme)).sum())
    if not gross:
        return []
    worst = [
        f"{entry['id']} on {entry['image']} ({entry['statistic']:.0f} sigma)"
        for entry in _list_exclusions(result)["measurements"][: min(gross, IDS_NAMED)]
    ]
    additional = " …" if gross > IDS_NAMED else ""
    return [
        f"{excluded.sum()} image points ({100.0 * excluded.mean():.2g} %) are outliers and are not used, {gross} of "
        f"them by more than {SIGNIFICANCE.extreme:g} sigma: {', '.join(worst)}{additional}"
    ]


def _find_untested_accuracy(result: Adjustment) -> dict[str, float | None] | None:
    """Return ``ce90_m`` and ``le90_m`` of coordinate operations common to check points and GCPs, which are untested.

    None without check points or such errors.
    """
    check = np.flatnonzero(result.block.points.role == Role.CHECK)
    if result.shared_shifts_m is None or not len(check):
        return None
    own_m = result.block.points.operation_shifts_m(check)
    shifts_m = result.shared_shifts_m[check][:, :, : own_m.shape[2]]
    secrets = np.sum(shifts_m**2 - (shifts_m - own_m) ** 2, axis=2)
    east, north, height = np.sqrt(np.maximum(np.nanmean(secrets, axis=0), 0.0)).tolist()
    return errors_90(east, north, height) if max(east, north, height) > 0.0 else None


NOT_EVALUATED = {"points": 0, "observations": 0, "rmse_px": None, "epipolar_rmse_px": None, "wrong": 0}


def summarise_held_out(result: Adjustment, refined: Sequence[RefitRPC]) -> dict[str, Any]:
    """Return the report's entry on held-out tie points, which were not used in the adjustment.

    ``tracks`` is the number of held-out tie points; of many an even sample is evaluated. Figures of the sample are
    ``points``, ``observations``, ``rmse_px`` (2D), ``epipolar_rmse_px``, the number of ``wrong`` matches, which are
    excluded, and under ``ties`` the same figures of an equal number of adjusted tie points.

    Both are intersected with the refined RPCs and evaluated in the same way: by the residuals at the intersected
    positions, and by the distance of each image point from the epipolar lines of the others of its track. Held-out
    tracks were not tested before, so wrong matches are excluded from both by a test that errors of cameras do not
    affect (`evaluation.find_wrong_tracks`), and counted.
    """
    block = result.block
    is_held_out = block.points.role == Role.HELD_OUT
    if not is_held_out.any():
        return NOT_EVALUATED | {"tracks": 0, "ties": NOT_EVALUATED}
    evaluated = block.with_cameras([new.rpc for new in refined])
    evaluated = evaluated.with_measurements(result.is_used_tie | is_held_out[block.measurements.point])
    several = evaluated.rays_per_point() >= 2
    tracks = int(np.count_nonzero(several & is_held_out))
    wanted = min(tracks, HOLD_OUT.most_evaluated)
    samples = np.zeros((2, len(several)), dtype=bool)  # of held-out and of adjusted tracks
    for sample, population in zip(samples, (several & is_held_out, several & ~is_held_out), strict=True):
        sample[sample_tracks(evaluated, population, min(1.0, wanted / max(population.sum(), 1)))] = True
    observations, fit = fit_tracks(evaluated, samples.any(axis=0), predict=False, start=result.ground)
    pairs = fit_pairs(observations, fit)
    is_wrong = find_wrong_tracks(observations, [pairs], ROBUST.rejected)
    held_out, ties = (
        _describe_fit(observations, fit, pairs, sample[observations.points], is_wrong) for sample in samples
    )
    return held_out | {"tracks": tracks, "ties": ties}


def _describe_fit(
    observations: Observations, fit: TrackFit, pairs: Sequence[PairFit], tracks: np.ndarray, is_wrong: np.ndarray
) -> dict[str, Any]:
    """Return the figures of the ``tracks (m,)`` in a mask, without the ``is_wrong (m,)`` ones."""
    intersected = tracks & np.isfinite(fit.ground).all(axis=1)
    tracks = intersected & ~is_wrong
    rows = tracks[observations.point]
    distances = [pair.epipolar_px[tracks[pair.points]].ravel() for pair in pairs]
    return {
        "points": int(tracks.sum()),
        "observations": int(rows.sum()),
        "rmse_px": radial_rmse(fit.fit_px[rows]),
        "epipolar_rmse_px": rmse(np.concatenate([np.zeros(0), *distances])),
        "wrong": int((intersected & is_wrong).sum()),
    }
