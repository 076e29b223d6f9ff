"""Predicted accuracy of the ground points of each part of a block: its main figure if there are no check points.

The figures are those of points without a survey, over the area (`precision.predict_accuracy`): of tie points. For a
part without tie points they are those of its check points and of each GCP predicted by all observations except its own
survey, so that they do not depend on which of its points are check points. With the cofactors Q of a GCP's adjusted
position and the weights P of its survey these are exactly

    (Q^-1 - P)^-1

A GCP on one image keeps its surveyed height there, and predicts no height. Points on nearly parallel rays are counted
and left out: their precision is not that of the area. So are points that only coarser bands of exposures observe
(multispectral ones), if others are on the panchromatic images: their noise is that of larger pixels.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy import special

from ...block.block import Image
from ...block.pointing import compute_gsds_m, estimate_pointing
from ...foundation.large_arrays import finite_rows
from ...foundation.thresholds import SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..equations.states import FREE_POINT_SIGMA_M
from ..gauss_newton import Solution
from ..observations import Observations
from ..preparation.parts import Part
from ..preparation.problem import Problem
from ..result import ContradictingGcps, DatumPart
from ..starting_values.weak_geometry import RAY_GEOMETRY, compute_base_to_height
from ..statistics.precision import Precision, predict_accuracy

MOST_POINTS = 4000  # of a part, from which its accuracy is computed
AREA_CELLS = 20  # along each side of the area of a part


@thresholds
class AREA_ACCURACY:
    """Limit beyond which a predicted accuracy is that of the RPCs, not of the images."""

    determined_gsds: float = threshold(
        1000.0,
        "GSD",
        "largest CE90 of a determined plan, and LE90 over B/H of determined heights",
        "KOMPSAT-3 (48.5 m CE90, 0.7 m) at B/H 0.42: LE90 125 m, 425 GSD",
    )


def describe_parts(
    problem: Problem, solution: Solution, covariance: np.ndarray, prior_share: np.ndarray, leave_one_out: float
) -> tuple[DatumPart, ...]:
    """Return the constraints of each part of the block (GCPs, tie points, priors) and its predicted accuracy.

    ``covariance (m, 3, 3)`` are those of all points without their own surveys (`predict_without_surveys`),
    ``leave_one_out`` the factor by which the GCPs' leave-one-out errors exceed them.
    """
    finite = finite_rows(covariance[:, :2, :2].reshape(-1, 4))
    observations = problem.observations
    parallel = finite & _find_parallel_points(observations, solution)
    finest = np.array([image.camera_pixel == 1.0 for image in observations.images])
    on_finest = observations.count_rays((solution.weight > 0.0) & finest[observations.image]) > 1
    first_image, located = observations.image[observations.first[:-1]], observations.located
    ties = observations.contributing_points & ~located
    ids, parts = problem.block.points.ids[observations.points], []
    for part in problem.parts:
        of_part = finite & np.isin(first_image, part.images)
        candidates = of_part & ties if (of_part & ties).any() else of_part
        if not finest.all() and (candidates & on_finest).any():
            candidates &= on_finest
        left_out = candidates & parallel if (candidates & ~parallel).any() else np.zeros_like(candidates)
        eligible = np.flatnonzero(candidates & ~left_out)
        sampled = eligible[:: -(-len(eligible) // MOST_POINTS)] if len(eligible) else eligible
        contradiction = compare_few_gcps(problem, solution, part)
        widened = leave_one_out if part.gcps else 1.0
        # weight by area: the points of one cell share its weight
        plan = solution.state.ground[sampled, :2]
        low, high = plan.min(axis=0, initial=np.inf), plan.max(axis=0, initial=-np.inf)
        cell = np.minimum((plan - low) / np.maximum(high - low, 1e-12) * AREA_CELLS, AREA_CELLS - 1).astype(np.int64)
        cell = cell @ [1, AREA_CELLS]
        weight = 1.0 / np.bincount(cell)[cell]
        area = predict_accuracy(widened**2 * covariance[sampled], weight)
        if contradiction is not None and area["ce90_m"]:  # if one is wrong, the error beyond both is twice as large
            widened *= max(min(contradiction.factor / widened, 1.0 + 2.0 * contradiction.metres / area["ce90_m"]), 1.0)
            area = predict_accuracy(widened**2 * covariance[sampled], weight)
        sigma = [area[name] for name in ("rmse_east_m", "rmse_north_m", "rmse_height_m")]
        east, north, height = (np.nan if value is None else value for value in sigma)
        images = [observations.images[k] for k in part.images]
        gsd_m, base_to_height = float(compute_gsds_m(images).max()), compute_base_to_height(images)
        limits_m = {"ce90_m": AREA_ACCURACY.determined_gsds * gsd_m}
        if not part.gcps and problem.height_observations is None:  # heights by the rays of the RPCs
            limits_m["le90_m"] = limits_m["ce90_m"] * base_to_height
        parts.append(
            DatumPart(
                images=tuple(image.id for image in images),
                gcps=part.gcps,
                ties=part.ties,
                by_priors=float(np.nan_to_num(prior_share[np.unique(observations.camera_of_image[part.images])]).sum()),
                sigma_m=(east, north, height),
                ce90_m=area["ce90_m"],
                le90_m=area["le90_m"],
                points=len(eligible),
                parallel=tuple(ids[left_out].tolist()),
                leave_one_out=widened,
                apart=contradiction,
                gsd_m=gsd_m,
                base_to_height=base_to_height,
                undetermined=tuple(name for name, limit_m in limits_m.items() if (area[name] or 0.0) > limit_m),
            )
        )
    return tuple(parts)


def _find_parallel_points(observations: Observations, solution: Solution) -> np.ndarray:
    """Return the mask ``(m,)`` of points whose error ellipsoids are as long as those of nearly parallel rays.

    For two rays with convergence angle g the longest semi-axis is 2 / tan g times the shortest; other observations of a
    point shorten it.
    """
    by_rays, gcps = solution.normals.inverse.copy(), np.flatnonzero(observations.surveyed)
    single = observations.count_rays(solution.weight > 0.0) < 2
    by_rays[gcps] = _remove_surveys(solution, by_rays[gcps], gcps, single[gcps])
    longest = 2.0 / np.tan(np.radians(RAY_GEOMETRY.weak_angle_deg))
    by_rays = np.nan_to_num(by_rays)
    # trace³ / determinant is at least the ratio of the squared semi-axes: most points need no eigenvalues
    volume = np.einsum("mi,mi->m", by_rays[:, 0], np.cross(by_rays[:, 1], by_rays[:, 2]))
    parallel = ~single & (np.trace(by_rays, axis1=1, axis2=2) ** 3 > longest**2 * volume)
    squares = np.linalg.eigvalsh(by_rays[parallel])
    parallel[parallel] = squares[:, 2] > longest**2 * squares[:, 0]
    return parallel


def predict_without_surveys(problem: Problem, solution: Solution, precise: Precision) -> np.ndarray:
    """Return the cofactors ``(m, 3, 3)`` of all points by all observations except their own surveys; NaN if unknown.

    The height of a GCP on a single ray is not predicted (NaN).
    """
    observations = problem.observations
    gcps = np.flatnonzero(observations.surveyed)
    rays = observations.count_rays(solution.weight > 0.0)[gcps]
    cofactors = precise.points.copy()
    cofactors[gcps] = _remove_surveys(solution, precise.points[gcps], gcps, rays < 2)
    single = gcps[rays < 2]
    cofactors[single, 2] = cofactors[single, :, 2] = np.nan
    return cofactors


def _remove_surveys(solution: Solution, cofactors: np.ndarray, gcps: np.ndarray, keep_height: np.ndarray) -> np.ndarray:
    """Return the cofactors ``(g, 3, 3)`` of GCPs without their own surveys (except heights if ``keep_height (g,)``)."""
    survey = solution.weighting.points.build_weight_matrices(gcps, observed=True)
    survey[keep_height, 2] = survey[keep_height, :, 2] = 0.0
    finite = finite_rows(cofactors.reshape(-1, 9))
    normal = np.linalg.inv(np.where(finite[:, None, None], cofactors, np.eye(3))) - survey
    normal[:, range(3), range(3)] += FREE_POINT_SIGMA_M**-2
    return np.asarray(np.where(finite[:, None, None], np.linalg.inv(normal), np.nan))


def compare_few_gcps(problem: Problem, solution: Solution, part: Part) -> ContradictingGcps | None:
    """Return the two GCPs of a part that disagree most; None if they agree, or if the part has more than a few GCPs.

    Tie points do not determine a block's scale, rotation and position, and two or three GCPs leave these little or no
    redundancy: a wrong one deforms the block without residuals. In the difference of two GCPs the image's shift
    cancels::

        d = (observed - vendor's camera)_a - (observed - vendor's camera)_b     variance: surveys, measurements, drift

    where the drift is the sensor's a priori one, over the distance of the two in the image. An error of the ground
    position has the same effect in all images, whose drifts are independent: three images that would each have to drift
    by 3 sigma are stronger evidence than one. If d exceeds the limit, one GCP is wrong, or the images are distorted;
    the data do not show which, and predictions have to include it.
    """
    observations = problem.observations
    located = (observations.survey_weight > 0.0).all(axis=1) & solution.weighting.contributes
    is_used = located[observations.point] & (solution.weight > 0.0) & np.isin(observations.image, part.images)
    points = np.unique(observations.point[is_used])
    if not 2 <= len(points) <= SAMPLES.plane:
        return None
    contradictions = [_compare_pair(problem, is_used, list(pair)) for pair in combinations(points.tolist(), 2)]
    excess, worst = max(contradictions, key=lambda one: one[0])
    return worst if excess > 1.0 else None


def _compare_pair(problem: Problem, is_used: np.ndarray, pair: list[int]) -> tuple[float, ContradictingGcps | None]:
    """Return chi² of the difference of two GCPs on their common images, divided by its limit, and that difference."""
    observations = problem.observations
    images: list[Image] = []
    differences: list[np.ndarray] = []
    slopes: list[np.ndarray] = []
    noise: list[float] = []  # variances of the two coordinates of each image
    drifts: list[float] = []
    for index in np.unique(observations.image[is_used]).tolist():
        rows_of_pair = [
            np.flatnonzero(is_used & (observations.image == index) & (observations.point == point)) for point in pair
        ]
        if not all(map(len, rows_of_pair)):
            continue
        image, rows = observations.images[index], [of_point[0] for of_point in rows_of_pair]
        projected, by_ground = image.rpc.project_with_metric_jacobian(observations.survey[pair])
        images.append(image)
        differences.append(np.subtract(*(observations.xy[rows] - projected)))
        slopes.append(by_ground)
        noise += [np.sum(observations.sigma_px[rows] ** 2)] * 2
        drifts += [(estimate_pointing(image).drift * np.hypot(*np.subtract(*observations.xy[rows]))) ** 2] * 2
    if not images:
        return 0.0, None
    slope = np.concatenate(slopes, axis=1)  # (2, 2 images, 3)
    stated = np.diag(noise) + np.sum((slope / observations.survey_weight[pair][:, None]) @ slope.swapaxes(1, 2), axis=0)
    difference = np.concatenate(differences)
    covariance = stated + np.diag(drifts)
    displaced = np.linalg.solve(covariance, slope[0]).T  # a point moved on the ground: equal for all images
    by_ground = float(displaced @ difference @ np.linalg.pinv(displaced @ slope[0]) @ displaced @ difference)
    blocks = [slice(2 * k, 2 * k + 2) for k in range(len(images))]  # or a wrong measurement on one of them
    single = max(float(difference[k] @ np.linalg.solve(covariance[k, k], difference[k])) for k in blocks)
    excess = max(
        one / special.chdtri(freedom, SIGNIFICANCE.false_alarm) for one, freedom in ((by_ground, 3.0), (single, 2.0))
    )
    factor = float(np.sqrt(difference @ np.linalg.solve(stated, difference) / len(difference)))
    worst = int(np.argmax(np.linalg.norm(differences, axis=1)))
    metres = float(np.hypot(*np.linalg.solve(slopes[worst][0][:, :2], differences[worst])))
    name_a, name_b = (str(problem.block.points.ids[observations.points[point]]) for point in pair)
    description = ContradictingGcps(
        (name_a, name_b), images[worst].id, metres, float(np.sqrt(max(by_ground, single))), factor
    )
    return float(excess), description
