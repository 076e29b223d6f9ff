"""Accuracy of the ground that each part of a block measures: its headline where there are no check points.

The figures are those of points that nobody surveyed, over the area (`precision.predict_accuracy`): of tie points, or
else of check points. Of a part that has nothing but GCPs they are what everything but its own survey says of each
GCP. With the cofactors Q of its adjusted position and the weights P of its survey these are exactly

    (Q^-1 - P)^-1

A GCP on one image keeps its surveyed height there, and predicts no height. Points on nearly parallel rays are counted
and left out: how well they are known says nothing of the area. So are points that only coarser bands of exposures see
(multispectral ones), where others are on the panchromatic images: their noise is that of larger pixels.
"""

from __future__ import annotations

import numpy as np

from ..foundation.large_arrays import finite_rows
from .equations.states import FREE_POINT_SIGMA_M
from .few_gcps import compare_few_gcps
from .gauss_newton import Solution
from .problem import Problem
from .result import DatumPart
from .statistics.precision import Precision, predict_accuracy, weigh_by_area
from .weak_geometry import RAY_GEOMETRY

MOST_POINTS = 4000  # of a part that its accuracy is taken from


def describe_parts(
    problem: Problem, solution: Solution, precise: Precision, covariance: np.ndarray, prior_share: np.ndarray,
    leave_one_out: float,
) -> tuple[DatumPart, ...]:  # fmt: skip
    """Return what holds each part of the block and the accuracy that it predicts.

    ``covariance (m, 3, 3)`` are those of all points by everything but their own surveys (`predict_without_surveys`),
    ``leave_one_out`` by how much the GCPs' leave-one-out errors exceed them.
    """
    observations = problem.observations
    known = finite_rows(covariance[:, :2, :2].reshape(-1, 4))
    parallel = known & _find_parallel_rays(problem, solution, precise)
    finest = np.array([image.camera_pixel == 1.0 for image in observations.images])
    on_finest = observations.count_rays((solution.weight > 0.0) & finest[observations.image]) > 1
    first_image, located = observations.image[observations.first[:-1]], observations.located
    ties = observations.contributing_points & ~located
    ids, parts = problem.block.points.ids[observations.points], []
    for part in problem.parts:
        here = known & np.isin(first_image, part.images)
        candidates = next((one for one in (here & ties, here & ~located) if one.any()), here)
        if not finest.all() and (candidates & on_finest).any():
            candidates &= on_finest
        left_out = candidates & parallel if (candidates & ~parallel).any() else np.zeros_like(candidates)
        chosen = np.flatnonzero(candidates & ~left_out)
        used = chosen[:: -(-len(chosen) // MOST_POINTS)] if len(chosen) else chosen
        apart = compare_few_gcps(problem, solution, part)
        widened = leave_one_out if part.gcps else 1.0
        weight = weigh_by_area(solution.state.ground[used])
        area = predict_accuracy(widened**2 * covariance[used], np.zeros((len(used), 3, 3)), weight)
        if apart is not None and area["ce90_m"]:  # one of them may be wrong: beyond both it bends by twice as much
            widened *= max(min(apart.factor / widened, 1.0 + 2.0 * apart.metres / area["ce90_m"]), 1.0)
            area = predict_accuracy(widened**2 * covariance[used], np.zeros((len(used), 3, 3)), weight)
        sigma = [area[name] for name in ("rmse_east_m", "rmse_north_m", "rmse_height_m")]
        east, north, height = (np.nan if value is None else value for value in sigma)
        parts.append(
            DatumPart(
                tuple(observations.images[k].id for k in part.images), part.gcps, part.ties,
                float(np.nan_to_num(prior_share[np.unique(observations.camera_of_image[part.images])]).sum()),
                (east, north, height), area["ce90_m"], area["le90_m"], len(chosen),
                tuple(ids[left_out].tolist()), widened, apart,
            )
        )  # fmt: skip
    return tuple(parts)


def predict_without_surveys(problem: Problem, solution: Solution, precise: Precision) -> np.ndarray:
    """Return the cofactors ``(m, 3, 3)`` of all points by everything but their own surveys, NaN where there are none.

    Nothing is predicted of the height of a GCP on a single ray.
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
    """Return the cofactors ``(g, 3, 3)`` of GCPs without their own surveys, or with their surveyed height alone."""
    survey = solution.weighting.points.build_weight_matrices(gcps, observed=True)
    survey[keep_height, 2] = survey[keep_height, :, 2] = 0.0
    known = finite_rows(cofactors.reshape(-1, 9))
    normal = np.linalg.inv(np.where(known[:, None, None], cofactors, np.eye(3))) - survey
    normal[:, range(3), range(3)] += FREE_POINT_SIGMA_M**-2
    return np.asarray(np.where(known[:, None, None], np.linalg.inv(normal), np.nan))


def _find_parallel_rays(problem: Problem, solution: Solution, precise: Precision) -> np.ndarray:
    """Return which points ``(m,)`` have error ellipsoids as long as those of rays that hardly converge.

    Two rays that converge by an angle g leave an ellipsoid whose longest semi-axis is 2 / tan g times the shortest.
    What else holds a point, a DEM or a laser height, makes it shorter.
    """
    observations = problem.observations
    by_rays = solution.normals.inverse.copy()
    gcps = np.flatnonzero(observations.surveyed)
    single = observations.count_rays(solution.weight > 0.0) < 2
    by_rays[gcps] = _remove_surveys(solution, by_rays[gcps], gcps, single[gcps])
    longest = 2.0 / np.tan(np.radians(RAY_GEOMETRY.weak_angle_deg))
    by_rays = np.nan_to_num(by_rays)
    # trace³ / determinant is at least the ratio of the squared semi-axes: most points need no eigenvalues
    volume = np.einsum("mi,mi->m", by_rays[:, 0], np.cross(by_rays[:, 1], by_rays[:, 2]))
    parallel = ~single & (np.trace(by_rays, axis1=1, axis2=2) ** 3 > longest**2 * volume)
    squares = np.linalg.eigvalsh(by_rays[parallel])
    parallel[parallel] = squares[:, 2] > longest**2 * squares[:, 0]
    return np.asarray(parallel)
