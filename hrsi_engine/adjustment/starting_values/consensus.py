"""Robust start without wrong tie measurements: test whether image pairs agree about their epipolar lines.

Two rays have one condition that is independent of the ground point. With the derivatives B by the ground of both image
points and the vector n that is normal to all of them, n' (B_1; B_2) = 0, it is the *parallax* across the epipolar line

    y = n' (v_1; v_2)        v = observed - computed, at any point near both rays

For a pair of images, errors of the cameras make it a constant, or a plane if they drift; a wrong measurement makes it
arbitrary. The plane nearest to most parallaxes of a pair is found by the least quantile of squares (Rousseeuw and Leroy
1987): planes through three points and constants through one are tried, the best is refined by concentration (Rousseeuw
and Van Driessen 1999). With a share e of wrong measurements (1 - e)² of the parallaxes are right: 36 % at e = 40 %,
hence the quantile. It does not depend on any point's share of wrong rays, and needs no estimated cameras.

The scale of the parallaxes is that of a normal distribution on a uniform background, by expectation and maximisation.
A measurement is used in the start if it agrees with half of the others of its point that it was compared with.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import REDUNDANCY, SAMPLES, threshold, thresholds
from ...foundation.workers.threads import thread_count
from ..equations import NormalEquations, State
from ..observations import Observations

POINTS_AT_ONCE = 50_000


@thresholds
class PARALLAX:
    """Limits for the agreement of tie measurements before the adjustment."""

    quantile: float = threshold(
        0.3,
        "",
        "share of correct parallaxes that is assumed for each image pair: (1 - 0.4)² = 0.36 with 40 % wrong "
        "measurements",
        "least quantile of squares (Rousseeuw and Leroy 1987)",
    )
    planes_tried: int = threshold(
        80,
        "planes",
        "planes tried for each image pair: one of them has three correct parallaxes with 98 % "
        "probability if 36 % are correct",
        "probability: 1 - (1 - 0.36³)^80",
    )


PARALLEL = 1e-9  # sine of the angle below which rays count as parallel
LEAST_AREA = 1e-6  # twice the area of a triangle that defines a plane; an image's side is 2
PLANE_STEPS = 6
CYCLES = 60
PAIRS_AT_ONCE = 200


class Parallaxes(NamedTuple):
    """Parallaxes of pairs of measurements of a point: rows of both, parallax y (px) and its standard deviation (px)."""

    first: np.ndarray
    second: np.ndarray
    y: np.ndarray
    sigma: np.ndarray


def find_agreeing_measurements(
    equations: NormalEquations, observations: Observations, state: State, is_used: np.ndarray
) -> np.ndarray:
    """Return True for measurements that agree with the others of their points, ``(n,)``.

    state : initial cameras and points, which may have errors of tens of pixels
    is_used : (m,) mask of the points to compare; the measurements of all others count as agreeing
    """
    agreeing = np.ones(observations.count, dtype=bool)
    parts: list[np.ndarray] = []  # points with equal numbers of measurements, two or more
    for length, points in observations.by_length.items():
        compared_points = points[is_used[points]]
        if length >= 2 and len(compared_points):
            parts += np.array_split(compared_points, 1 + len(compared_points) * length // (2 * POINTS_AT_ONCE))
    with ThreadPoolExecutor(thread_count(0)) as pool:
        parallaxes = list(pool.map(partial(_compute_parallaxes, equations, observations, state), parts))
    if not parallaxes:
        return agreeing
    pairs = Parallaxes(*(np.concatenate(columns) for columns in zip(*parallaxes, strict=True)))
    departure, judged = _measure_departures(observations, pairs)
    if judged.sum() < SAMPLES.fewest:
        return agreeing
    # The standard deviation of the correct departures, by a normal distribution on a uniform background
    size = np.abs(departure[judged])[:: 1 + int(judged.sum()) // 50_000]
    reach = max(float(np.quantile(size, 0.99)), 1e-12)
    size = size[size <= reach]
    sigma = max(float(np.quantile(size, 0.5 * PARALLAX.quantile)) / 0.3, 1e-6 * reach)
    right = 0.5
    for _ in range(CYCLES):
        normal = right * np.sqrt(2.0 / np.pi) / sigma * np.exp(-0.5 * (size / sigma) ** 2)
        share = normal / (normal + (1.0 - right) / reach)
        right = float(np.clip(share.mean(), 0.05, 0.999))
        sigma = max(float(np.sqrt((share @ size**2) / share.sum())), 1e-6 * reach)
    is_near = ~judged | (np.abs(departure) <= ROBUST.outlier * sigma)
    compared, agreed = np.zeros(observations.count), np.zeros(observations.count)
    for rows in (pairs.first, pairs.second):
        compared += np.bincount(rows, minlength=len(compared))
        agreed += np.bincount(rows, weights=is_near, minlength=len(compared))
    return np.asarray(2.0 * agreed >= compared)


def _compute_parallaxes(
    equations: NormalEquations, observations: Observations, state: State, points: np.ndarray
) -> Parallaxes:
    """Return the parallaxes between the measurements of points with k image points each."""
    length = int(observations.first[points[0] + 1] - observations.first[points[0]])
    rows, linear = equations.linearise_points(state, points)
    rows = rows.reshape(-1, length)
    residual, by_ground = linear.residual.reshape(-1, length, 2), linear.by_ground.reshape(-1, length, 2, 3)
    ray = _multiply_as_vectors(by_ground[:, :, 0], by_ground[:, :, 1])
    scale_of_one, scale_of_other = np.linalg.norm(by_ground, axis=(2, 3)), np.linalg.norm(ray, axis=2)
    swapped = by_ground[:, :, ::-1] * np.array([[1.0], [-1.0]])
    sigma = observations.sigma_px[rows]
    columns: list[tuple[np.ndarray, ...]] = []
    for one, second_ray in list_ray_pairs(length):
        # n: the 3 x 3 minors of (B_1; B_2), each without one row
        on_one = np.einsum("mci,mi->mc", swapped[:, one], ray[:, second_ray])
        on_other = np.einsum("mci,mi->mc", swapped[:, second_ray], ray[:, one])
        squares_one, squares_other = (np.einsum("mc,mc->m", n, n) for n in (on_one, on_other))
        length_of_n = np.sqrt(squares_one + squares_other)
        # an image given twice has parallel rays, which have no epipolar plane
        crossing = length_of_n > PARALLEL * scale_of_one[:, one] * scale_of_other[:, second_ray]
        y = np.einsum("mc,mc->m", on_one, residual[:, one]) + np.einsum("mc,mc->m", on_other, residual[:, second_ray])
        spread = np.sqrt(squares_one * sigma[:, one] ** 2 + squares_other * sigma[:, second_ray] ** 2)
        columns_of_pair = rows[:, one], rows[:, second_ray], y, spread, length_of_n
        first, second, y, spread, length_of_n = (column[crossing] for column in columns_of_pair)
        columns.append((first, second, y / length_of_n, spread / length_of_n))
    return Parallaxes(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def list_ray_pairs(length: int) -> list[tuple[int, int]]:
    """Return the pairs of the rays of a point that are compared: all, or neighbours of a long track."""
    reach = length - 1 if length <= SAMPLES.tested else SAMPLES.tested // 2
    pairs = {tuple(sorted((i, (i + step) % length))) for i in range(length) for step in range(1, reach + 1)}
    return sorted((i, j) for i, j in pairs if i != j)


# ---- planes --------------------------------------------------------------------------------------------------------


def _measure_departures(observations: Observations, pairs: Parallaxes) -> tuple[np.ndarray, np.ndarray]:
    """Return each parallax's distance from its image pair's plane, in stated sigmas, and whether it can be tested.

    The plane over the first image's positions is that of the least quantile of squares (Rousseeuw and Leroy 1987). An
    image pair with few parallaxes has a constant instead; one with fewer than three is not tested.

    Result: ``(k,)`` distances and mask, in the order of ``pairs``
    """
    one, second = observations.image[pairs.first], observations.image[pairs.second]
    number = np.min_scalar_type(len(observations.images))  # smaller types are sorted faster
    smaller, larger = np.minimum(one, second).astype(number), np.maximum(one, second).astype(number)
    order = np.lexsort((larger, smaller))
    begins = np.ones(len(order), dtype=bool)
    begins[1:] = (np.diff(smaller[order]) != 0) | (np.diff(larger[order]) != 0)
    bounds = np.r_[np.flatnonzero(begins), len(order)]  # where pairs of images begin, and the last one ends
    rows = np.where(one > second, pairs.second, pairs.first)[order]  # on the first image
    departure, judged = np.zeros(len(order)), np.zeros(len(order), dtype=bool)
    count = np.diff(bounds)
    large = np.flatnonzero(count >= 3)

    def fit(part: np.ndarray, three: np.ndarray) -> None:
        """Test parallaxes of a ``part`` of the image pairs, by planes through ``three`` parallaxes of each sample."""
        size, span = count[part], slice(bounds[part[0]], bounds[part[-1] + 1])
        begin, place = bounds[part] - span.start, observations.places[rows[span]]
        terms = np.column_stack([np.ones(len(place)), place])
        y, sigma = pairs.y[order[span]], pairs.sigma[order[span]]
        # evenly over the parallaxes of each image pair; those of a small pair repeatedly
        step = np.maximum(size / SAMPLES.local, 1.0)[:, None] * np.arange(SAMPLES.local)
        picked = begin[:, None] + step.astype(np.int64) % size[:, None]
        planes, tilted = np.zeros((len(part), 3)), size >= SAMPLES.fewest
        rank = (SAMPLES.local * np.clip(3.0 / size, PARALLAX.quantile, 1.0)).astype(np.int64) - 1
        samples = terms[picked], y[picked], sigma[picked], rank
        planes[tilted] = _fit_planes(three, *(sample[tilted] for sample in samples))
        samples = samples[0][:, :, :1], *samples[1:]
        planes[~tilted, :1] = _fit_planes(None, *(sample[~tilted] for sample in samples))
        selected_rows = np.repeat(begin - np.cumsum(size) + size, size) + np.arange(
            size.sum()
        )  # skips pairs with fewer
        computed = np.einsum("nc,nc->n", terms[selected_rows], np.repeat(planes, size, axis=0))
        departure[order[span][selected_rows]] = (y[selected_rows] - computed) / sigma[selected_rows]
        judged[order[span][selected_rows]] = np.repeat(size >= SAMPLES.fewest, size)

    rng = np.random.default_rng(1)  # reproducible planes
    parts = [part for part in np.array_split(large, 1 + len(large) // PAIRS_AT_ONCE) if len(part)]
    three = [
        rng.integers(0, SAMPLES.local, (int((count[p] >= SAMPLES.fewest).sum()), PARALLAX.planes_tried, 3))
        for p in parts
    ]
    with ThreadPoolExecutor(thread_count(0)) as pool:
        list(pool.map(fit, parts, three))
    return departure, judged


def _fit_planes(
    three: np.ndarray | None, terms: np.ndarray, y: np.ndarray, sigma: np.ndarray, ranks: np.ndarray
) -> np.ndarray:
    """Return the plane ``(p, 3)`` nearest to most of the parallaxes of each of p image pairs, px by u and v.

    three : (p, t, 3) indices of the three parallaxes of each tried plane; None if there are too few for a plane: then
        ``terms (p, s, 1)`` and the result have only the constant
    terms : (p, s, 3) 1 and the position in the image, -1 to 1; y, sigma : (p, s) parallaxes and standard deviations, px
    ranks : (p,) number of certainly correct parallaxes, minus one
    """
    candidates = np.zeros((*y.shape, terms.shape[2]))
    candidates[:, :, 0] = y
    if three is not None:
        # Planes (p, t, 3) through three parallaxes each, by Cramer's rule; constants if the three are on a line
        pair = np.arange(len(y))[:, None, None]
        (first, second, third), y_of_three = np.moveaxis(terms[pair, three], 2, 0), y[pair, three]
        cyclic = ((second, third), (third, first), (first, second))
        minors = np.stack([_multiply_as_vectors(*pair) for pair in cyclic], axis=-2)
        area = (minors[..., 0, :] * first).sum(axis=-1)
        spread = np.abs(area) > LEAST_AREA
        through = (minors * y_of_three[..., None]).sum(axis=-2) / np.where(spread, area, 1.0)[..., None]
        through[~spread] = 0.0
        through[~spread, 0] = y_of_three[~spread, 0]
        candidates = np.concatenate([candidates, through], axis=1)
    plane = candidates[np.arange(len(y)), _find_nearest_planes(terms, y, sigma, candidates, ranks)]
    flat = REDUNDANCY.regularised * np.array([0.0, 1.0, 1.0])[: terms.shape[2]]
    for _ in range(PLANE_STEPS):
        # Parallaxes farther away than the one with rank ``kept`` have no weight
        distance = np.abs(y - (terms @ plane[:, :, None])[:, :, 0]) / sigma
        limit = np.take_along_axis(np.sort(distance, axis=1), ranks[:, None], axis=1)
        weight = np.where(distance <= limit, 1.0 / sigma**2, 0.0)
        normal = (terms * weight[..., None]).swapaxes(1, 2) @ terms
        normal[:, range(len(flat)), range(len(flat))] += flat * weight.sum(axis=1)[:, None]
        plane = np.linalg.solve(normal, ((terms * weight[..., None]).swapaxes(1, 2) @ y[..., None]))[..., 0]
    return plane


def _multiply_as_vectors(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the vector products ``(…, 3)`` of vectors ``first`` and ``second (…, 3)``.

    `numpy.cross` takes three times as long for many small arrays.
    """
    (a, b, c), (d, e, f) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1)


def _find_nearest_planes(
    terms: np.ndarray, y: np.ndarray, sigma: np.ndarray, candidates: np.ndarray, ranks: np.ndarray
) -> np.ndarray:
    """Return the index ``(p,)`` of the plane whose distance of rank ``ranks`` (0: the smallest) is the least.

    terms, y, sigma : (p, s, c), (p, s) and (p, s) of the parallaxes
    candidates : (p, t, c) planes, c of 3 or 1 for level ones
    ranks : (p,) ranks
    """
    distance = (candidates @ (terms / sigma[..., None]).swapaxes(1, 2)) - (y / sigma)[:, None]
    np.abs(distance, out=distance)
    distance.partition(np.unique(ranks), axis=2)
    return np.asarray(np.take_along_axis(distance, ranks[:, None, None], axis=2)[:, :, 0].argmin(axis=1))
