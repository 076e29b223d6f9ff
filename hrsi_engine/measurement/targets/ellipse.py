"""Ellipses through edge points: the centre of a roundabout, tank or pool, and its covariance.

The direct fit minimises the algebraic distance under the constraint that the conic is an ellipse (Halir and Flusser
1998); it was used for manually measured edge points in chapter 2 of the thesis. The geometric fit starts from it and
minimises the distances of the points from the curve, so that its covariance is that of the centre. The curve is
``(x - c)^T Q (x - c) = 1``: in contrast to semi-axes and angle, ``Q`` is well determined for circles too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...foundation.errors import SolveError
from ...foundation.thresholds import EQUALITY, ITERATIONS, SAMPLES


@dataclass(frozen=True, eq=False)
class Ellipse:
    """An ellipse fitted to edge points.

    centre : (2,) sample, line; semi_axes : (2,) px, the longer one first
    azimuth_rad : direction of the longer axis, from +sample towards +line, -pi/2 … pi/2
    covariance_px2 : (2, 2) of the centre, from the residuals
    residual_px : (n,) signed distances of the points, positive outside; used : (n,) mask of points used in the fit
    """

    centre: np.ndarray
    semi_axes: np.ndarray
    azimuth_rad: float
    covariance_px2: np.ndarray
    residual_px: np.ndarray
    used: np.ndarray

    @property
    def rmse_px(self) -> float:
        """Root mean square distance of the used points."""
        return float(np.sqrt(np.mean(self.residual_px[self.used] ** 2)))

    @property
    def sigma_px(self) -> float:
        """Standard deviation of a coordinate of the centre (quadratic mean of the two axes)."""
        return float(np.sqrt(np.trace(self.covariance_px2) / 2.0))

    def outline(self, count: int = 72) -> np.ndarray:
        """Return points on the curve, ``(count, 2)``."""
        t = 2.0 * np.pi * np.arange(count) / count
        cos, sin = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        along, across = self.semi_axes[0] * np.cos(t), self.semi_axes[1] * np.sin(t)
        return self.centre + np.column_stack([cos * along - sin * across, sin * along + cos * across])


def fit_ellipse(xy: np.ndarray, method: str = "geometric") -> Ellipse:
    """Return the ellipse through edge points ``(n, 2)``; ``method`` is one of `FITS`.

    Raises `SolveError` for fewer than six points and for points that are not along an ellipse.
    """
    return _fit_points(np.asarray(xy, dtype=np.float64), np.ones(len(xy), dtype=bool), FITS[method])


def fit_ellipse_robust(xy: np.ndarray) -> Ellipse:
    """Return the ellipse with the largest number of inliers; the other points (stray edges) are not used.

    Of the ellipses through random samples of six points, the one with most points within half a pixel is selected
    (RANSAC, Fischler and Bolles 1981) and fitted again to those points. Raises `SolveError` like `fit_ellipse`.
    """
    xy = np.asarray(xy, dtype=np.float64)
    _require_points(len(xy))
    # The largest set of inliers of one ellipse; all points are the first trial
    rng, samples = np.random.default_rng(1), np.zeros((60, len(xy)))
    samples[0] = 1.0
    for trial in samples[1:]:
        trial[rng.choice(len(xy), SAMPLES.redundant, replace=False)] = 1.0
    all_points = np.broadcast_to(xy, (len(samples), *xy.shape))
    centre, Q, valid = fit_direct_ellipses(all_points, samples)
    agreeing = (np.abs(compute_ellipse_distances(all_points, centre, Q)) < 0.5) & valid[:, None]
    count = agreeing.sum(axis=1)
    inliers = agreeing[0 if count[0] > 0.95 * len(xy) else int(np.argmax(count))]
    if inliers.sum() < SAMPLES.redundant:
        raise SolveError(f"no ellipse passes within half a pixel of {SAMPLES.redundant} of the {len(xy)} edge points")
    ellipse = _fit_points(xy, inliers, FITS["geometric"])
    for _ in range(3):
        inliers = np.abs(ellipse.residual_px) < 0.5
        if inliers.sum() < SAMPLES.redundant or np.array_equal(inliers, ellipse.used):
            break
        ellipse = _fit_points(xy, inliers, FITS["geometric"])
    return ellipse


def _require_points(count: int) -> None:
    if count < SAMPLES.redundant:
        raise SolveError(f"an ellipse needs {SAMPLES.redundant} edge points or more, {count} were given: measure more")


def _fit_points(xy: np.ndarray, inliers: np.ndarray, fit: EllipseFit) -> Ellipse:
    """Return the ellipse through the ``inliers (n,)`` of points ``xy (n, 2)``; raise `SolveError` if there is none."""
    _require_points(int(inliers.sum()))
    spread = np.linalg.svd(xy[inliers] - xy[inliers].mean(axis=0), compute_uv=False)
    if not spread[0] > 0.0:
        raise SolveError("the edge points coincide: measure points around the object")
    if not spread[1] > 1e-9 * spread[0]:
        raise SolveError("the edge points lie on a line: measure points all around the object")
    unit_weights = np.ones((1, int(inliers.sum())))
    centres, forms, valid = fit(xy[None, inliers], unit_weights)
    if not valid[0]:
        raise SolveError("the edge points do not lie along an ellipse: check them, measure all around the object")
    centre, Q = centres[0], forms[0]
    residual, _ = _compute_distances(xy - centre, Q)
    covariance = compute_centre_covariances(xy[None, inliers], unit_weights, centres, forms)[0]
    semi_axes, azimuth = compute_axes(Q)
    return Ellipse(centre, semi_axes, float(azimuth), covariance, residual, inliers)


# ---- many ellipses at once -------------------------------------------------------------------------------------
# Points are (n, m, 2), weights (n, m) with 0 for padding and unused points; results are centres (n, 2), forms
# Q (n, 2, 2) and the mask (n,) of valid ellipses.


def compute_axes(Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return semi-axes ``(…, 2)``, the longer one first, and its azimuth ``(…,)`` of forms ``(…, 2, 2)``."""
    eigenvalues, axes = np.linalg.eigh(Q)  # in ascending order: the longer axis first
    azimuth = np.arctan2(axes[..., 1, 0], axes[..., 0, 0])
    return 1.0 / np.sqrt(eigenvalues), (azimuth + np.pi / 2.0) % np.pi - np.pi / 2.0


def _compute_distances(d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return signed distances from the curve to first order (Sampson 1982), and the unit gradient of ``d' Q d``."""
    gradient = 2.0 * d @ Q
    length = np.maximum(np.hypot(gradient[..., 0], gradient[..., 1]), 1e-12)
    return (0.5 * np.sum(gradient * d, axis=-1) - 1.0) / length, gradient / length[..., None]


def compute_ellipse_distances(xy: np.ndarray, centres: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return the signed distances ``(n, m)`` of points from their ellipses, positive outside."""
    return _compute_distances(xy - centres[:, None], Q)[0]


def _linearise(d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances ``(n, m)``, and their derivatives by the centre and Qxx, Qxy, Qyy ``(n, m, 5)``.

    d : (n, m, 2) points minus centres, px; Q : (n, 2, 2)
    """
    distance, normal = _compute_distances(d, Q)
    length = 2.0 * np.maximum(np.hypot(*np.moveaxis(d @ Q, -1, 0)), 1e-12)
    x, y = d[..., 0] / length, d[..., 1]
    columns = [-normal[..., 0], -normal[..., 1], d[..., 0] * x, 2.0 * x * y, y * y / length]
    return distance, np.stack(columns, axis=-1)


def compute_centre_covariances(xy: np.ndarray, weight: np.ndarray, centres: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return the covariances ``(n, 2, 2)`` of the centres, px²: inverse normal matrix times the residuals' variance.

    The variance has the redundancy of points minus five parameters; neighbouring points are taken as independent.
    """
    distance, A = _linearise(xy - centres[:, None], Q)
    redundancy = np.maximum((weight > 0.0).sum(axis=1) - 5, 1)
    variance = np.sum(weight * distance**2, axis=1) / redundancy
    N = np.swapaxes(A, 1, 2) @ (weight[..., None] * A)
    return variance[:, None, None] * np.linalg.pinv(N)[:, :2, :2]


def fit_direct_ellipses(xy: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ellipses of minimum algebraic distance (Halir and Flusser 1998), for centred and scaled points.

    The conic's quadratic part is the eigenvector of the reduced scatter matrix with 4 a c - b² > 0. Invalid ones have Q
    = I.
    """
    total = weight.sum(axis=1)
    middle = np.sum(weight[..., None] * xy, axis=1) / total[:, None]
    d = np.where(weight[..., None] > 0.0, xy - middle[:, None], 0.0)
    scale = np.maximum(np.abs(d).max(axis=(1, 2)), 1e-12)
    x, y = np.moveaxis(d / scale[:, None, None], -1, 0)
    quadratic, linear = np.stack([x * x, x * y, y * y], axis=-1), np.stack([x, y, np.ones_like(x)], axis=-1)
    weighted = np.swapaxes(weight[..., None] * linear, 1, 2)
    to_linear = -_solve_systems(weighted @ linear, weighted @ quadratic)
    S = np.swapaxes(quadratic, 1, 2) @ (weight[..., None] * (quadratic + linear @ to_linear))
    constrained = np.stack([S[:, 2] / 2.0, -S[:, 1], S[:, 0] / 2.0], axis=1)
    vectors = np.real(np.linalg.eig(constrained)[1])
    determinant = 4.0 * vectors[:, 0] * vectors[:, 2] - vectors[:, 1] ** 2
    best = np.argmax(determinant, axis=1)
    row = np.arange(len(xy))
    a = vectors[row, :, best]
    b = (to_linear @ a[..., None])[..., 0]
    Q = np.stack([a[:, 0], a[:, 1] / 2.0, a[:, 1] / 2.0, a[:, 2]], axis=1).reshape(-1, 2, 2)
    centre = _solve_systems(Q, -b[:, :2, None] / 2.0)[..., 0]
    level = np.einsum("ni,nij,nj->n", centre, Q, centre) - b[:, 2]
    valid = (determinant[row, best] > 0.0) & (level * np.trace(Q, axis1=1, axis2=2) > 0.0)
    Q = np.where(valid[:, None, None], Q / np.where(level == 0.0, 1.0, level)[:, None, None], np.eye(2))
    return middle + scale[:, None] * centre, Q / scale[:, None, None] ** 2, valid


def fit_geometric_ellipses(xy: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ellipses of minimum squared distances, by Gauss-Newton iteration from the direct fit.

    Iterations that lead away from the minimum, as with half an ellipse and noise, leave the direct fit.
    """
    centre, Q, valid = fit_direct_ellipses(xy, weight)
    iterated = iterate_ellipses(xy[valid], weight[valid], centre[valid], Q[valid])
    squares_before, squares_after = (
        np.sum(weight[valid] * compute_ellipse_distances(xy[valid], *ellipse) ** 2, axis=1)
        for ellipse in ((centre[valid], Q[valid]), iterated)
    )
    nearer = np.flatnonzero(valid)[squares_after <= squares_before]
    centre[nearer], Q[nearer] = (part[squares_after <= squares_before] for part in iterated)
    return centre, Q, valid


def iterate_ellipses(
    xy: np.ndarray, weight: np.ndarray, centre: np.ndarray, Q: np.ndarray, iterations: int = ITERATIONS.most
) -> tuple[np.ndarray, np.ndarray]:
    """Return centres and forms after at most ``iterations`` Gauss-Newton steps towards minimum squared distances."""
    centre, Q = centre.copy(), Q.copy()
    rows = np.arange(len(xy))  # those that have not converged
    for _ in range(iterations):
        distance, A = _linearise(xy[rows] - centre[rows, None], Q[rows])
        scale = 1.0 / np.maximum(np.sqrt(np.sum(A**2, axis=1)), 1e-30)
        A *= scale[:, None]
        weighted = np.swapaxes(weight[rows, :, None] * A, 1, 2)
        step = -scale * _solve_systems(weighted @ A, weighted @ distance[..., None])[..., 0]
        new_form = Q[rows] + step[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
        # if a short arc would become a hyperbola, the previous ellipse is kept
        closed = (np.linalg.det(new_form) > 0.0) & (new_form[:, 0, 0] > 0.0)
        rows, step, new_form = rows[closed], step[closed], new_form[closed]
        centre[rows] += step[:, :2]
        Q[rows] = new_form
        rows = rows[np.abs(step[:, :2]).max(axis=1) >= EQUALITY.rounding]
        if not len(rows):
            break
    return centre, Q


def _solve_systems(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the solutions ``(n, k, c)`` of systems A ``(n, k, k)``; of minimum norm if one of them is singular."""
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        return np.linalg.pinv(A) @ b


EllipseFit = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
#: Methods of fitting ellipses to weighted points.
FITS: dict[str, EllipseFit] = {"geometric": fit_geometric_ellipses, "direct": fit_direct_ellipses}
