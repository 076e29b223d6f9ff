"""Fit of fixed cameras to image points: strict leave-one-out prediction, image pairs, ground points.

Each track (one ground point on several images) is intersected by least squares, weights W = 1 / sigma². With B the
derivatives of its image points by the ground (px per metre) and e the residuals, leaving the image point i out changes
its own residual to (e.g. Cook and Weisberg, 1982, section 2.2.3)::

    H_ii = B_i (B' W B)^-1 B_i' w_i
    e_i without i = (I - H_ii)^-1 e_i          covariance sigma_i² (I - H_ii)^-1

so that one intersection is enough for all predictions of a track; the cameras are linear over the few pixels of a
residual. A quantity that only the image point itself determines has no prediction: if the other rays are nearly
parallel, the factor (I - H_ii)^-1/2 by which they enlarge the noise is very large, and the prediction is not used.

Two rays have one condition, that they intersect: the left null vector n of the pair's B (4, 3), n'n = 1. Their residual
across the epipolar lines is n'e, whatever the ground point at which e was computed. With n = (n1, n2) of the two
images, the distances of the image points from each other's epipolar lines are n'e / |n1| and n'e / |n2|.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse

from ..block.block import Block, stack_rpcs
from ..foundation.large_arrays import finite_rows
from ..foundation.robust_scale import MAD_TO_SIGMA, ROBUST, robust_sigma
from ..foundation.thresholds import SAMPLES, threshold, thresholds
from ..refinement.models import MODELS
from .observations import Observations, select_points
from .starting_values.intersection import estimate_start_positions, intersect_points


@thresholds
class PREDICTION:
    """Limits for predictions of image points from the other images."""

    most_enlargement: float = threshold(10.0, "", "largest sigma of a prediction over that of a measurement")


TREND_ROUNDS = 6
PARALLEL_SINE = 1e-5  # of the angle below which rays count as parallel: 0.1 px of 0.5 m is 5 km in height


@dataclass(frozen=True, eq=False)
class TrackFit:
    """Fit of tracks to one set of cameras; rows as in the observations, NaN where a point cannot be intersected.

    ground : (m, 3) least-squares intersection of all rays of each point
    by_ground : (n, 2, 3) derivatives of the image points by the ground, px per metre
    fit_px : (n, 2) observed - computed at that position
    predicted_px : (n, 2) observed - predicted from the other images alone; NaN where these do not determine it
    enlargement : (n,) standard deviation of that residual over the image point's own, RMS of both coordinates
    """

    ground: np.ndarray
    by_ground: np.ndarray
    fit_px: np.ndarray
    predicted_px: np.ndarray
    enlargement: np.ndarray


@dataclass(frozen=True, eq=False)
class PairFit:
    """Fit of the rays of two images (indices) to each other.

    points : (k,) indices of their common points among the tracks
    across_px : (k,) residuals of these across the epipolar lines, shared by both images
    left_px : (k,) the same without their affine trend over the first image: noise of an image coordinate
    epipolar_px : (k, 2) distances of the first and of the second image's points from the epipolar lines of the others
    """

    first: int
    second: int
    points: np.ndarray
    across_px: np.ndarray
    left_px: np.ndarray
    epipolar_px: np.ndarray


def sum_groups(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return the sums ``(m, …)`` of the rows of ``values (n, …)`` from each of the ``bounds (m + 1,)`` to the next.

    A sparse product: `numpy.add.reduceat` takes ten times as long for rows of a few numbers.
    """
    ones = np.ones(len(values))
    groups = sparse.csr_matrix((ones, np.arange(len(values)), bounds), (len(bounds) - 1, len(values)))
    shape = values.shape[1:]  # not -1, which an empty array cannot have
    return np.asarray(groups @ values.reshape(len(values), math.prod(shape))).reshape(-1, *shape)


def fit_tracks(
    block: Block, is_selected: np.ndarray, predict: bool = True, start: np.ndarray | None = None
) -> tuple[Observations, TrackFit]:
    """Intersect points with the block's cameras and predict each of their image points from the others.

    is_selected : (points,) mask of the points that are used, each on two images or more; their surveys are not used
    predict : if false, the predictions and their enlargements are NaN
    start : (points, 3) approximate positions, if they are known
    Result: the observations that the fit's rows refer to, and the fit.
    """
    observations = select_points(block, is_selected)
    none, no_values = MODELS["none"], np.zeros((len(block.images), 0))
    start_positions = estimate_start_positions(observations) if start is None else start[observations.points]
    ground = intersect_points(observations, none, no_values, start_positions)
    fit, by_ground = np.full((observations.count, 2), np.nan), np.full((observations.count, 2, 3), np.nan)
    rows = np.flatnonzero(finite_rows(ground)[observations.point])
    computed, by_ground[rows] = stack_rpcs(block.images).project_with_metric_jacobian(
        observations.image[rows], ground[observations.point[rows]]
    )
    fit[rows] = observations.xy[rows] - computed
    unknown = np.full_like(fit, np.nan), np.full(len(fit), np.nan)
    predicted, enlargement = _predict(observations, by_ground, fit) if predict else unknown
    return observations, TrackFit(ground, by_ground, fit, predicted, enlargement)


def _predict(observations: Observations, by_ground: np.ndarray, fit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``predicted_px (n, 2)`` and ``enlargement (n,)`` of `TrackFit` from the fit of all rays.

    With the redundancy matrix R = I - B (B' W B)^-1 B' W of an image point, its residual v by all rays gives the
    prediction error R^-1 v, and R^-1 is the covariance of that error in units of the measurement's variance. NaN where
    R is nearly singular: without the image point, the others determine no position.

    by_ground : (n, 2, 3) px/m; fit : (n, 2) v, px
    """
    # B' W B of each point, and the part of each image point's noise that its own prediction contains
    weight = observations.sigma_px**-2.0
    normal = sum_groups(by_ground.swapaxes(1, 2) @ (weight[:, None, None] * by_ground), observations.first)
    regular = np.isfinite(normal).all(axis=(1, 2))
    normal[~regular] = np.eye(3)
    inverse = np.linalg.pinv(normal, hermitian=True)[observations.point]
    left = np.eye(2) - np.einsum("nki,nij,nlj,n->nkl", by_ground, inverse, by_ground, weight)
    left[~np.isfinite(left).all(axis=(1, 2))] = np.nan
    finite = np.isfinite(left[:, 0, 0])
    lowest = np.full(len(left), np.nan)
    lowest[finite] = np.linalg.eigvalsh(left[finite])[:, 0]
    predictable = lowest > PREDICTION.most_enlargement**-2.0
    predicted, enlargement = np.full_like(fit, np.nan), np.full(len(fit), np.nan)
    cofactor = np.linalg.inv(left[predictable])
    predicted[predictable] = (cofactor @ fit[predictable, :, None])[:, :, 0]
    enlargement[predictable] = np.sqrt(0.5 * np.trace(cofactor, axis1=1, axis2=2))
    return predicted, enlargement


def _list_common_points(observations: Observations, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows ``(k,)`` of each point in two images, that of the image with the smaller index first.

    usable : (n,) rows that are compared, in the order of the points
    """
    point = observations.point[usable]
    ones, second_lists = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for step in range(1, int(np.diff(observations.first).max(initial=1))):  # rows of one point follow one another
        same_point = np.flatnonzero(point[step:] == point[:-step])
        one, second_rows = usable[same_point], usable[same_point + step]
        is_reversed = observations.image[one] > observations.image[second_rows]
        ones.append(np.where(is_reversed, second_rows, one))
        second_lists.append(np.where(is_reversed, one, second_rows))
    return np.concatenate(ones), np.concatenate(second_lists)


def fit_pairs(observations: Observations, fit: TrackFit) -> list[PairFit]:
    """Return the fit of each pair of images with common points: residuals of rays across the epipolar lines."""
    first, second = _list_common_points(observations, np.flatnonzero(finite_rows(fit.fit_px)))
    count = len(observations.images)
    # parallel rays have no distance across an epipolar line
    ray = np.cross(fit.by_ground[:, 0], fit.by_ground[:, 1])
    sine = np.linalg.norm(np.cross(ray[first], ray[second]), axis=1)
    crossing = sine > PARALLEL_SINE * np.linalg.norm(ray[first], axis=1) * np.linalg.norm(ray[second], axis=1)
    first, second = first[crossing], second[crossing]
    key = observations.image[first].astype(np.int64) * count + observations.image[second]
    order = np.argsort(key * len(observations.points) + observations.point[first], kind="stable")
    if not len(order):
        return []
    first, second, key = first[order], second[order], key[order]
    begin = np.flatnonzero(np.diff(key, prepend=-1))
    group = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(key)))
    # The left null vectors: signed 3 x 3 minors of B (n, 4, 3), with the same sign for all points of a pair of images
    a, b = (fit.by_ground[rows] for rows in (first, second))
    minors = [np.einsum("nki,ni->nk", one[:, ::-1], ray[rows]) for one, rows in ((a, second), (b, first))]
    normal = np.concatenate(minors, axis=1) * [1.0, -1.0, 1.0, -1.0]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    normal *= np.where(np.einsum("nk,nk->n", normal, normal[begin][group]) < 0.0, -1.0, 1.0)[:, None]
    middle = sum_groups(normal[:, :2], np.append(begin, len(normal)))
    largest = middle[np.arange(len(begin)), np.argmax(np.abs(middle), axis=1)]
    normal *= np.where(largest >= 0.0, 1.0, -1.0)[group, None]
    across = np.einsum("nk,nk->n", normal, np.concatenate([fit.fit_px[first], fit.fit_px[second]], axis=1))
    lines = np.linalg.norm(normal.reshape(-1, 2, 2), axis=2)  # n is (n1, n2): n1 is normal to the line in image 1
    epipolar = across[:, None] / np.maximum(lines, 1e-12)
    # Without the affine trend of each group over the positions
    bounds = np.append(begin, len(across))
    size = np.diff(bounds)
    terms = np.column_stack([np.ones(len(across)), observations.places[first]])
    terms[:, 1:] *= (size >= SAMPLES.fewest)[group, None]

    def find_medians(values: np.ndarray) -> np.ndarray:
        ordered = values.copy()
        for part in parts:
            ordered[part].sort()
        return np.asarray(0.5 * (ordered[begin + (size - 1) // 2] + ordered[begin + size // 2]))

    parts = [slice(begin_row, end_row) for begin_row, end_row in pairwise(bounds.tolist())]
    left, inliers = across - find_medians(across)[group], np.zeros(len(across), dtype=bool)
    for _ in range(TREND_ROUNDS):
        limit = ROBUST.outlier * np.maximum(MAD_TO_SIGMA * find_medians(np.abs(left)), 1e-9)
        previous, inliers = inliers, np.abs(left) <= limit[group]
        if (inliers == previous).all():
            break
        weighted_terms = terms * inliers[:, None]
        normal = sum_groups(weighted_terms[:, :, None] * weighted_terms[:, None, :], bounds)
        right = sum_groups(weighted_terms * across[:, None], bounds)
        trend = (np.linalg.pinv(normal, rcond=1e-12, hermitian=True) @ right[:, :, None])[:, :, 0]
        left = across - np.einsum("nt,nt->n", terms, trend[group])
    return [
        PairFit(
            *divmod(int(key[part.start]), count), observations.point[first[part]], across[part], left[part],
            epipolar[part],
        )
        for part in parts
    ]  # fmt: skip


def find_wrong_tracks(observations: Observations, sets: Sequence[Sequence[PairFit]], reject: float) -> np.ndarray:
    """Return a mask ``(m,)`` of tracks that are wrong with every set of cameras.

    Errors of cameras are smooth: they are the trend of a pair's residuals. A track is wrong if with *every* set of
    cameras the distance of two of its rays, without the trend, is ``reject`` times the typical one. So rejecting
    favours no set.

    sets : the pairs of each set of cameras; reject : in robust standard deviations; 0 leaves nothing out
    """
    is_wrong = np.full(len(observations.points), bool(reject))
    for pairs in sets if reject else ():
        largest = np.zeros(len(is_wrong))
        for pair in pairs:
            largest[pair.points] = np.maximum(largest[pair.points], np.abs(pair.left_px))
        typical = float(robust_sigma(np.concatenate([pair.left_px for pair in pairs]))) if pairs else 0.0
        is_wrong &= largest > reject * max(typical, 1e-9)
    return is_wrong
