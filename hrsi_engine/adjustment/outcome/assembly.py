"""From the last solution to an `Adjustment`: arrays in the order of the block, sigma0, and warnings."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...block.exposures import find_passes
from ...block.pointing import estimate_pointing
from ...foundation.thresholds import REDUNDANCY
from ...ground.geodesy import ground_difference_m
from ..gauss_newton import GaussNewton, Solution
from ..preparation.problem import Problem
from ..priors.common_drift import count_points_per_error
from ..priors.earlier_cameras import JointCameras
from ..result import Adjustment, CameraEstimates, CrossValidation, Decision, Finding, ModelTest, VarianceComponent
from ..source_results import HeightAgreement, PlanAgreement
from ..statistics.precision import Precision, compute_deletion_tests
from ..statistics.shared_shifts import propagate_jitter, propagate_pointing, propagate_shifts
from .area_accuracy import describe_parts, predict_without_surveys
from .final_cameras import FinalCameras, compute_final_cameras, keep_rpc_position
from .result_warnings import warn_of_result

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


@dataclass(frozen=True, eq=False)
class FinalEstimate:
    """The last solution of an adjustment, its precision, and what follows from both.

    solution, precise : with parts that only RPCs determine at the RPCs' position (`keep_rpc_position`)
    cameras : final cameras (`compute_final_cameras`), and positions and residuals by these
    sigma0 : square root of the variance factor of all observations
    """

    problem: Problem
    loop: GaussNewton
    findings: RoundFindings
    solution: Solution
    precise: Precision
    cameras: FinalCameras
    sigma0: float

    @cached_property
    def is_placed(self) -> np.ndarray:
        """Mask ``(m,)`` of points with a position: also check points, but none whose measurements were all rejected."""
        observations = self.problem.observations
        return self.solution.weighting.contributes | observations.located | ~observations.contributing_points

    @cached_property
    def points_per_error(self) -> np.ndarray:
        """Number ``(images,)`` of tie points that share an error, 1 if GCPs determine the drifts (`common_drift`)."""
        observations = self.problem.observations
        return count_points_per_error(observations.cameras, self.loop.common)[observations.camera_of_image]

    @cached_property
    def shared_shifts(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Effect on points of errors of coordinate operations and of the pointing of passes, None without any.

        Further columns are the uncertainty of jitter. The movement of each point by one standard deviation of each
        error, ``(m, 3, e)`` in metres; and the part of these errors in the covariances, where they are treated as
        independent, ``(m, 3, 3)`` in m².
        """
        problem, loop, solution, observations = self.problem, self.loop, self.solution, self.problem.observations
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

    def expand_points(self, values: np.ndarray) -> np.ndarray:
        """Return values of the block's points from those of points in solver order ``(m, …)``; NaN for all others."""
        return _expand_rows(len(self.problem.block.points), self.problem.observations.points, values)


class PointCovariances(NamedTuple):
    """Covariances of points in m², from which sigmas, ellipses and predicted accuracies are derived.

    points : (points, 3, 3) of the block's points, NaN without position or with a survey rejected as wrong
    sigma_m : (points, 3) standard deviations, with the errors of coordinate operations
    without_survey : (m, 3, 3) of the points in solver order, GCPs without their own survey, with those errors
    camera_factor : (images,) variance factor of each image's parameters
    widened : factor of predicted standard deviations by the GCPs' leave-one-out errors
    """

    points: np.ndarray
    sigma_m: np.ndarray
    without_survey: np.ndarray
    camera_factor: np.ndarray
    widened: float


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
    final = FinalEstimate(
        problem=problem,
        loop=loop,
        findings=round_findings,
        solution=solution,
        precise=precise,
        cameras=cameras,
        sigma0=sigma0,
    )
    covariances = _scale_covariances(final)
    parts = describe_parts(problem, solution, covariances.without_survey, prior_share, covariances.widened)
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
    camera, factor = observations.camera_of_image, covariances.camera_factor
    cofactors = precise.cameras[loop.pattern.diagonal[camera]]  # of each image's own parameters
    shifts = final.shared_shifts
    return Adjustment(
        block=block, model=problem.model, values=cameras.values[camera],
        values_sigma=np.sqrt(factor[:, None] * precise.parameters[camera][:, own_covariance]),
        cameras=CameraEstimates(problem.camera, solution.state.values[camera], factor[:, None, None] * cofactors),
        ground=final.expand_points(np.where(final.is_placed[:, None], cameras.ground, np.nan)),
        ground_sigma_m=covariances.sigma_m, ground_covariance_m2=covariances.points,
        **_describe_measurements(final),
        observations=observed, redundancy=redundancy, unknowns=unknowns, sigma0=sigma0,
        converged=solution.converged, status=solution.status,
        history=tuple(loop.history), solves=loop.solves, findings=tuple(round_findings.findings),
        variance_components=round_findings.components, parts=parts, cross_validation=round_findings.cross_validation,
        warnings=(*problem.warnings, *round_findings.warnings, *warnings), heights=heights, plan=plan,
        surfaces=tuple(one.summarise(observations.points) for one in problem.surface_plans),
        rpcs_alone_m=_measure_rpcs_alone_m(problem, solution),
        rpcs_height_sigma_m=by_rpcs.sigma_m if by_rpcs else None, laser=laser, tests=round_findings.tests,
        survey_factors=(horizontal, height, correlated), choice=problem.choice, joint=_join_cameras(final),
        shared_shifts_m=None if shifts is None else final.expand_points(shifts[0]),
        jitter=problem.options.jitter_estimate,
    )  # fmt: skip


def _scale_covariances(final: FinalEstimate) -> PointCovariances:
    """Return the covariances of the points: cofactors times variance factors, plus the known systematic errors.

    The cameras' share in the cofactors is further multiplied by the tie points per error (`common_drift`).
    """
    problem, solution, precise = final.problem, final.solution, final.precise
    observations, points_per_error = problem.observations, final.points_per_error
    unit_variance = max(final.sigma0, 1.0) ** 2
    image = observations.image[observations.first[:-1]]
    # Without GCPs the RPCs' error terms determine a part, and these do not depend on the residuals of image points. A
    # sigma0 below 1 is also that of the image points: it makes no survey better than stated.
    factor = np.array([unit_variance if part.gcps else 1.0 for part in problem.parts])[_number_parts(problem)]
    of_point, systematic = factor[image, None, None], np.zeros_like(precise.points)
    by_cameras = np.flatnonzero(points_per_error[image] > 1.0)
    of_cameras = precise.points[by_cameras] - solution.normals.inverse[by_cameras]
    systematic[by_cameras] = ((points_per_error - 1.0) * factor)[image[by_cameras], None, None] * of_cameras
    without_drift = ground_difference_m(final.cameras.ground, solution.state.ground)  # a known error that remains
    systematic += without_drift[:, :, None] * without_drift[:, None, :]
    if problem.height_observations is not None:
        systematic[:, 2, 2] += problem.height_observations.find_unweighted_variance(
            solution.weighting.points, solution.state.ground, solution.normals.inverse, precise.points
        )
    left_out = observations.surveyed & ~solution.weighting.points.held  # wrong surveys: their covariances are not valid
    is_known = (final.is_placed & ~left_out)[:, None, None]
    covariance = np.where(is_known, of_point * precise.points + systematic, np.nan)
    without_survey = of_point * predict_without_surveys(problem, solution, precise) + systematic
    without_survey[np.isnan(covariance)] = np.nan
    squares, freedom = final.findings.left_out_surveys
    stated = REDUNDANCY.stated
    widened = float(np.sqrt(max((stated + squares / unit_variance) / (stated + freedom), 1.0)))
    of_shifts: np.ndarray | float = 0.0
    if final.shared_shifts is not None:
        shifts, excess = final.shared_shifts
        covariance, without_survey = covariance - excess, without_survey - excess + shifts @ shifts.swapaxes(1, 2)
        of_shifts = np.sum(shifts**2, axis=2)
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(covariance.diagonal(axis1=1, axis2=2) + of_shifts)
    expanded, sigma_m = final.expand_points(covariance), final.expand_points(sigma)
    return PointCovariances(expanded, sigma_m, without_survey, factor * points_per_error, widened)


def _join_cameras(final: FinalEstimate) -> JointCameras:
    """Return the cameras' joint normal equations for later adjustments, divided by the tie points per error."""
    problem, loop, solution, observations = final.problem, final.loop, final.solution, final.problem.observations
    pattern, fixed = loop.pattern, np.isinf(loop.prior_weight)
    blocks = solution.normals.blocks.copy()
    of_model = np.arange(pattern.parameters)
    blocks[pattern.diagonal[:, None], of_model, of_model] += np.where(fixed, 0.0, loop.prior_weight)
    scale = np.ones(pattern.cameras)
    scale[observations.camera_of_image] = final.points_per_error
    blocks /= scale[pattern.rows][:, None, None]
    gcps = np.array([part.gcps for part in problem.parts])[_number_parts(problem)]
    return JointCameras(
        images=tuple(image.id for image in observations.images),
        camera=observations.camera_of_image,
        parameters=tuple(problem.camera.parameters),
        values=solution.state.values,
        rows=pattern.rows,
        columns=pattern.columns,
        blocks=blocks,
        fixed=fixed,
        squares=final.cameras.squares,
        gcps=gcps,
    )


def _describe_measurements(final: FinalEstimate) -> dict[str, Any]:
    """Return the fields of an `Adjustment` that have a row for each measurement of the block."""
    problem, solution, precise, round_findings = final.problem, final.solution, final.precise, final.findings
    block, rows, count = problem.block, problem.observations.rows, len(problem.block.measurements)
    is_kept = (solution.weight > 0.0) & final.is_placed[problem.observations.point]
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
        "residual_px": _expand_rows(count, rows, np.where(is_kept[:, None], final.cameras.residual, np.nan)),
        "weight": _expand_rows(count, rows, np.where(is_kept, solution.factor, 0.0), 0.0),
        "redundancy_numbers": _expand_rows(count, rows, redundancy_numbers),
        "statistic": _expand_rows(count, rows, statistic),
        "decision": _expand_rows(count, rows, round_findings.decision, int(Decision.KEPT)),
        "estimate_residual_px": estimate,
        "estimated_sigma_px": sigma,
    }


def _expand_rows(length: int, rows: np.ndarray, values: np.ndarray, empty: float = np.nan) -> np.ndarray:
    """Return an array ``(length, …)`` with ``values`` at ``rows``; the values themselves if they are all rows."""
    if len(values) == length:
        return values
    result = np.full((length, *values.shape[1:]), empty, dtype=values.dtype)
    result[rows] = values
    return result


def _compute_prior_share(loop: GaussNewton, variances: np.ndarray) -> np.ndarray:
    """Return the share of each parameter that follows from its prior, ``(cameras, p)``; 1 for fixed ones.

    It is p q of the prior weight p and the parameter's ``variances (cameras, p)`` q: what a redundancy number is for
    observations.
    """
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
    """Return the index of each image's part of the block, ``(images,)``."""
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
    east, north, up = np.median(ground_difference_m(problem.start.ground[ties], solution.state.ground[ties]), axis=0)
    return float(east), float(north), float(up)
