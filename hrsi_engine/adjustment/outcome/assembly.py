"""From the last solution to an `Adjustment`: arrays in the order of the block, sigma0, and warnings."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...block.exposures import find_passes
from ...block.pointing import estimate_pointing
from ...foundation.thresholds import REDUNDANCY
from ...ground.geodesy import ground_difference_m
from ..gauss_newton import GaussNewton, Solution
from ..preparation.problem import Problem
from ..priors.common_drift import count_points_per_error
from ..priors.earlier_cameras import JointCameras
from ..result import (
    Adjustment,
    CameraEstimates,
    CrossValidation,
    Decision,
    Finding,
    ModelTest,
    VarianceComponent,
)
from ..source_results import HeightAgreement, PlanAgreement
from ..statistics.precision import Precision, compute_deletion_tests
from ..statistics.shared_shifts import propagate_jitter, propagate_pointing, propagate_shifts
from .area_accuracy import describe_parts, predict_without_surveys
from .final_cameras import FinalCameras, compute_final_cameras
from .result_warnings import warn_of_result
from .rpc_position import keep_rpc_position

ROWS_AT_ONCE = 200_000  # image points whose tests are computed together


@dataclass(eq=False)
class RoundFindings:
    """Findings of the rounds of an adjustment.

    Decisions (n,), values of failed tests (n,), the tie points' variance factor, findings, warnings, tests of sigmas;
    ``left_out_surveys`` are the normalised squares and degrees of freedom of the GCPs' leave-one-out errors.
    """

    decision: np.ndarray
    failed: np.ndarray | None = None
    tie_variance: float = 1.0
    findings: list[Finding] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    components: tuple[VarianceComponent, ...] = ()
    tests: tuple[ModelTest, ...] = ()
    sigma_px: np.ndarray | None = None
    survey_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    cross_validation: CrossValidation | None = None
    left_out_surveys: tuple[float, float] = (0.0, 0.0)


def assemble_adjustment(
    problem: Problem, loop: GaussNewton, round_findings: RoundFindings, solution: Solution, precise: Precision
) -> Adjustment:
    """Return the result of an adjustment from its last solution, findings and precision."""
    observed, positions = _count_observations(problem, solution)
    redundancy = compute_redundancy(problem, loop, solution, precise.parameters, precise.cameras)
    observations, block = problem.observations, problem.block
    unknowns = positions + len(precise.parameters) * len(problem.model.parameters)
    sigma0 = float(np.sqrt(loop.sum_of_squares(solution) / redundancy)) if redundancy > 0.5 else 1.0
    solution, precise = keep_rpc_position(problem, loop, solution, precise)
    own_covariance = slice(len(problem.model.parameters))  # followed by the drift that the model does not contain
    prior_share = _compute_prior_share(loop, precise.parameters)[:, own_covariance]
    cameras = compute_final_cameras(problem, loop, solution)
    points, camera = observations.points, observations.camera_of_image
    cofactors = precise.cameras[loop.pattern.diagonal[camera]]  # of each image's own parameters
    # check points have positions, too; a point whose measurements were all rejected has none
    placed = solution.weighting.contributes | observations.located | ~observations.contributing_points
    points_per_error = count_points_per_error(observations.cameras, loop.common)[camera]
    shared_shifts = _propagate_shared_errors(problem, loop, solution)
    covariance, sigma_m, without_surveys, factor, widened = _scale_covariances(
        problem, round_findings, solution, precise, cameras, sigma0, points_per_error, placed, shared_shifts
    )
    parts = describe_parts(problem, solution, without_surveys, prior_share, widened)
    plan = _judge_plan(problem, solution, precise)
    # Agreement of the external heights with the points, and the result of each laser point
    heights: tuple[HeightAgreement, ...] = ()
    laser, external = None, problem.height_observations
    by_rpcs = external.by_rpcs if external else None
    if external is not None:
        heights, judged = external.summarise_sources(
            solution.weighting.points, solution.state.ground, solution.normals.inverse, precise.points
        )
        if problem.laser is not None:
            of_laser = next(one for one in judged if one.source is problem.laser)
            laser = problem.laser.report_points(of_laser, solution.state.ground)
    horizontal, height, correlated = (max(sigma0, 1.0) * one for one in round_findings.survey_factors)
    warnings = warn_of_result(problem, loop, prior_share, parts, heights, plan)
    return Adjustment(
        block=block, model=problem.model, values=cameras.values[camera],
        values_sigma=np.sqrt(factor[:, None] * precise.parameters[camera][:, own_covariance]),
        cameras=CameraEstimates(problem.camera, solution.state.values[camera], factor[:, None, None] * cofactors),
        ground=_expand_rows(len(block.points), points, np.where(placed[:, None], cameras.ground, np.nan)),
        ground_sigma_m=sigma_m, ground_covariance_m2=covariance,
        **_describe_measurements(
            problem, round_findings, solution, precise, cameras.residual, placed[observations.point]
        ),
        observations=observed, redundancy=redundancy, unknowns=unknowns, sigma0=sigma0,
        converged=solution.converged, status=solution.status,
        history=tuple(loop.history), solves=loop.solves, findings=tuple(round_findings.findings),
        variance_components=round_findings.components, parts=parts, cross_validation=round_findings.cross_validation,
        warnings=(*problem.warnings, *round_findings.warnings, *warnings), heights=heights, plan=plan,
        surfaces=tuple(one.summarise(observations.points) for one in problem.surface_plans),
        rpcs_alone_m=_measure_rpcs_alone_m(problem, solution),
        rpcs_height_sigma_m=by_rpcs.sigma_m if by_rpcs else None, laser=laser, tests=round_findings.tests,
        survey_factors=(horizontal, height, correlated), choice=problem.choice,
        joint=_join_cameras(problem, loop, solution, cameras.squares, points_per_error),
        shared_shifts_m=None if shared_shifts is None else _expand_rows(len(block.points), points, shared_shifts[0]),
        jitter=problem.options.jitter_estimate,
    )  # fmt: skip


def _scale_covariances(
    problem: Problem,
    round_findings: RoundFindings,
    solution: Solution,
    precise: Precision,
    cameras: FinalCameras,
    sigma0: float,
    points_per_error: np.ndarray,
    placed: np.ndarray,
    shared_shifts: tuple[np.ndarray, np.ndarray] | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the covariances in m² from which sigmas, ellipses and predicted accuracies are derived.

    They are those of the block's points ``(points, 3, 3)``, NaN without position or with a survey rejected as wrong;
    standard deviations ``(points, 3)`` with the errors of coordinate operations; covariances of the points in solver
    order ``(m, 3, 3)``, GCPs without their own survey, with those errors; the variance factor of each image's
    parameters ``(images,)``; and the factor of predicted standard deviations by the GCPs' leave-one-out errors.
    ``points_per_error (images,)`` is a further factor of the cameras' share in the points' cofactors (`common_drift`).
    """
    observations = problem.observations
    image = observations.image[observations.first[:-1]]
    # Without GCPs the RPCs' error terms determine a part, and these do not depend on the residuals of image points. A
    # sigma0 below 1 is also that of the image points: it makes no survey better than stated.
    of_part = np.array([max(sigma0, 1.0) ** 2 if part.gcps else 1.0 for part in problem.parts])
    factor = of_part[_number_parts(problem)]
    of_point, systematic = factor[image, None, None], np.zeros_like(precise.points)
    by_cameras = np.flatnonzero(points_per_error[image] > 1.0)
    of_cameras = precise.points[by_cameras] - solution.normals.inverse[by_cameras]
    systematic[by_cameras] = ((points_per_error - 1.0) * factor)[image[by_cameras], None, None] * of_cameras
    without_drift = ground_difference_m(cameras.ground, solution.state.ground)  # a known error that remains
    systematic += without_drift[:, :, None] * without_drift[:, None, :]
    if problem.height_observations is not None:
        systematic[:, 2, 2] += problem.height_observations.find_unweighted_variance(
            solution.weighting.points, solution.state.ground, solution.normals.inverse, precise.points
        )
    left_out = observations.surveyed & ~solution.weighting.points.held  # wrong surveys: their covariances are not valid
    is_known = (placed & ~left_out)[:, None, None]
    covariance = np.where(is_known, of_point * precise.points + systematic, np.nan)
    without_survey = of_point * predict_without_surveys(problem, solution, precise) + systematic
    without_survey[np.isnan(covariance)] = np.nan
    squares, freedom = round_findings.left_out_surveys
    stated = REDUNDANCY.stated
    widened = np.sqrt(max((stated + squares / max(sigma0, 1.0) ** 2) / (stated + freedom), 1.0))
    of_shifts: np.ndarray | float = 0.0
    if shared_shifts is not None:
        shifts, excess = shared_shifts
        covariance, without_survey = covariance - excess, without_survey - excess + shifts @ shifts.swapaxes(1, 2)
        of_shifts = np.sum(shifts**2, axis=2)
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(covariance.diagonal(axis1=1, axis2=2) + of_shifts)
    expanded, sigma = (_expand_rows(len(problem.block.points), observations.points, one) for one in (covariance, sigma))
    return expanded, sigma, without_survey, factor * points_per_error, float(widened)


def _propagate_shared_errors(
    problem: Problem, loop: GaussNewton, solution: Solution
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the effect on points of errors of coordinate operations and of the pointing of passes, None without any.

    Further columns are the uncertainty of jitter. The results are the movement of each point by one standard deviation
    of each error, ``(m, 3, e)``; and the part of these errors in the covariances, where they are treated as
    independent, ``(m, 3, 3)``.
    """
    observations = problem.observations
    of_surveys = problem.block.points.operation_shifts_m(observations.points)
    operations, passes = of_surveys[observations.surveyed].any(), []
    # The cameras of each pass with several images, if only their a priori pointing determines them
    believed = np.isfinite(problem.prior_weight).all(axis=1) & (problem.prior_weight > 0.0).all(axis=1)
    for part in problem.parts:
        if part.gcps or part.places:
            believed[observations.camera_of_image[part.images]] = False
    for images in find_passes(observations.images):
        cameras = np.unique(observations.camera_of_image[images])
        cameras = cameras[believed[cameras]]
        believed[cameras] = False  # tiles of one camera can have different start times
        passes += [cameras] if len(cameras) > 1 else []
    jitter = problem.options.jitter_estimate
    if not operations and not passes and jitter is None:
        return None
    shifted, excess = [np.zeros_like(of_surveys)], np.zeros((len(of_surveys), 3, 3))
    if operations:
        shifted = [propagate_shifts(loop, solution, observations.surveyed, of_surveys)]
    with np.errstate(divide="ignore"):
        sigma = 1.0 / np.sqrt(problem.prior_weight)
    for cameras in passes:
        pointing = np.flatnonzero(~problem.camera.drifts)
        shifts, too_much = propagate_pointing(loop, solution, sigma, cameras, pointing)
        shifted.append(shifts)
        excess += too_much
    if jitter is not None:
        shifted.append(propagate_jitter(loop, solution, problem.camera, jitter))
    return np.concatenate(shifted, axis=2), excess


def _join_cameras(
    problem: Problem, loop: GaussNewton, solution: Solution, squares: np.ndarray, points_per_error: np.ndarray
) -> JointCameras:
    """Return the cameras' joint normal equations for later adjustments, divided by ``points_per_error``."""
    pattern, observations, fixed = loop.pattern, problem.observations, np.isinf(loop.prior_weight)
    blocks = solution.normals.blocks.copy()
    of_model = np.arange(pattern.parameters)
    blocks[pattern.diagonal[:, None], of_model, of_model] += np.where(fixed, 0.0, loop.prior_weight)
    scale = np.ones(pattern.cameras)
    scale[observations.camera_of_image] = points_per_error
    blocks /= scale[pattern.rows][:, None, None]
    gcps = np.array([part.gcps for part in problem.parts])[_number_parts(problem)]
    return JointCameras(
        tuple(image.id for image in observations.images),
        observations.camera_of_image,
        tuple(problem.camera.parameters),
        solution.state.values,
        pattern.rows,
        pattern.columns,
        blocks,
        fixed,
        squares,
        gcps,
    )


def _describe_measurements(
    problem: Problem,
    round_findings: RoundFindings,
    solution: Solution,
    precise: Precision,
    residual: np.ndarray,
    placed: np.ndarray,
) -> dict[str, Any]:
    """Return the fields of an `Adjustment` that have a row for each measurement of the block.

    ``residual (n, 2)`` are those by the final cameras; ``placed (n,)`` is True if a measurement's point has a position.
    """
    block, rows, count = problem.block, problem.observations.rows, len(problem.block.measurements)
    is_kept = (solution.weight > 0.0) & placed
    # Redundancy numbers, and test values in standard deviations by the tie points' own variance factor; NaN for
    # measurements that are not used
    judged = np.flatnonzero((solution.weight > 0.0) & solution.weighting.contributes[problem.observations.point])
    redundancy_numbers = np.full((len(rows), 2), np.nan, dtype=np.float32)
    statistic = np.full(len(rows), np.nan, dtype=np.float32)
    for part in np.array_split(judged, 1 + len(judged) // ROWS_AT_ONCE):
        weight, cofactors = solution.weight[part], precise.residuals[part]
        redundancy_numbers[part] = np.clip(weight[:, None] * cofactors[:, [0, 1], [0, 1]], 0.0, 1.0)
        tests = compute_deletion_tests(solution.normals.residual[part], cofactors, weight)
        statistic[part] = np.sqrt(tests / round_findings.tie_variance)
    if round_findings.failed is not None:
        statistic = np.where(np.isnan(statistic), round_findings.failed, statistic)
    estimate = None
    if problem.camera is not problem.model:  # the drift that the model does not contain was estimated, too
        estimate = _expand_rows(count, rows, np.where(is_kept[:, None], solution.normals.residual, np.nan))
    sigma = None
    if round_findings.sigma_px is not None and not np.array_equal(
        round_findings.sigma_px, block.measurements.sigma_px[rows]
    ):
        sigma = block.measurements.sigma_px.copy()
        sigma[rows] = round_findings.sigma_px
    return {
        "residual_px": _expand_rows(count, rows, np.where(is_kept[:, None], residual, np.nan)),
        "weight": _expand_rows(count, rows, np.where(is_kept, solution.factor, 0.0), 0.0),
        "redundancy_numbers": _expand_rows(count, rows, redundancy_numbers),
        "statistic": _expand_rows(count, rows, statistic),
        "decision": _expand_rows(count, rows, round_findings.decision, int(Decision.KEPT)),
        "estimate_residual_px": estimate,
        "estimated_sigma_px": sigma,
    }


def _expand_rows(length: int, rows: np.ndarray, values: np.ndarray, empty: float = np.nan) -> np.ndarray:
    """Return an array of ``length`` rows with ``values`` at ``rows``; the values themselves if they are all rows."""
    if len(values) == length:
        return values
    result = np.full((length, *values.shape[1:]), empty, dtype=values.dtype)
    result[rows] = values
    return result


def _compute_prior_share(loop: GaussNewton, variances: np.ndarray) -> np.ndarray:
    """Return the share of each parameter that follows from its prior ``(cameras, p)``; 1 for fixed ones."""
    fixed = np.isinf(loop.prior_weight)
    return np.where(fixed, 1.0, np.where(fixed, 0.0, loop.prior_weight) * variances)


def _count_observations(problem: Problem, solution: Solution) -> tuple[int, int]:
    """Return the number of observations that were not left out, and the number of unknowns of their points."""
    weighting, contributes = solution.weighting, solution.weighting.contributes
    rows = int(((weighting.image > 0.0) & contributes[problem.observations.point]).sum())
    return 2 * rows + int(weighting.points.observed[contributes].sum()), 3 * int(contributes.sum())


def compute_redundancy(
    problem: Problem, loop: GaussNewton, solution: Solution, variances: np.ndarray, cofactors: np.ndarray
) -> float:
    """Return the redundancy of a solution; parameters are counted by the share that does not follow from priors.

    ``variances (cameras, p)`` are the parameters' cofactors, ``cofactors`` those on the pattern.
    """
    observed, positions = _count_observations(problem, solution)
    unknown = float(np.sum(1.0 - _compute_prior_share(loop, variances)))
    unknown -= sum(joint.count_parameters(cofactors, loop.pattern) for joint in loop.joint)
    return observed - positions - unknown


def _number_parts(problem: Problem) -> np.ndarray:
    """Return the index of each image's part of the block."""
    part_of_image = np.zeros(len(problem.observations.images), dtype=np.int64)
    for number, part in enumerate(problem.parts):
        part_of_image[part.images] = number
    return part_of_image


def _judge_plan(problem: Problem, solution: Solution, precise: Precision) -> PlanAgreement | None:
    """Return the agreement of the places of a reference with the adjusted points; None without them."""
    reference = problem.plan_observations
    if reference is None:
        return None
    # Standard deviation of the block in plan by its RPCs, with independent errors of the images
    pointing = [estimate_pointing(image).sigma_m for image in problem.observations.images]
    excess = reference.places.ignores_rpc_priors or problem.observations.surveyed.any()
    rpcs_m = np.inf if excess else float(np.sqrt(1.0 / np.sum(np.array(pointing) ** -2.0)))
    return reference.summarise_places(
        solution.weighting.points, solution.state.ground, solution.normals.inverse, precise.points, rpcs_m
    )


def _measure_rpcs_alone_m(problem: Problem, solution: Solution) -> tuple[float, float, float] | None:
    """Return the median shift of the tie points from their adjusted positions to those by the original RPCs."""
    observations = problem.observations
    if not problem.position_observations:
        return None
    ties = solution.weighting.contributes & ~observations.located & (np.diff(observations.first) > 1)
    if not ties.any():
        return None
    displacement = ground_difference_m(problem.start.ground[ties], solution.state.ground[ties])
    east, north, up = np.median(displacement, axis=0)
    return float(east), float(north), float(up)
