"""Ellipses through edge points: where the centre of a roundabout, tank or pool is, and how well it is known.

The direct fit minimises the algebraic distance under the constraint that the conic is an ellipse (Halir and Flusser
1998); it is what hand-measured edge points were evaluated with in chapter 2 of the thesis. The geometric fit starts
there and minimises the distances of the points from the curve, so that its covariance is that of the centre. The curve
is ``(x - c)^T Q (x - c) = 1``: unlike semi-axes and angle, ``Q`` is well determined for circles too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import SolveError

FEWEST_POINTS = 6  # five determine an ellipse: the sixth tells how good it is
_ITERATIONS = 20
_STEP_PX = 1e-5


@dataclass(frozen=True, eq=False)
class Ellipse:
    """An ellipse fitted to edge points.

    centre : (2,) sample, line; semi_axes : (2,) px, the longer one first
    azimuth_rad : direction of the longer axis, from +sample towards +line, -pi/2 … pi/2
    covariance_px2 : (2, 2) of the centre, from the residuals
    residual_px : (n,) signed distances of the points, outside positive; used : (n,) mask of points not left out
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
        """Standard deviation of a coordinate of the centre (mean of the two axes)."""
        return float(np.sqrt(np.trace(self.covariance_px2) / 2.0))

    def outline(self, count: int = 72) -> np.ndarray:
        """Return points on the curve, ``(count, 2)``."""
        t = 2.0 * np.pi * np.arange(count) / count
        cos, sin = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        along, aside = self.semi_axes[0] * np.cos(t), self.semi_axes[1] * np.sin(t)
        return self.centre + np.column_stack([cos * along - sin * aside, sin * along + cos * aside])


def fit_ellipse(xy: np.ndarray, method: str = "geometric") -> Ellipse:
    """Return the ellipse through edge points ``(n, 2)``; ``method`` is one of `FITS`.

    Raises `SolveError` for fewer than six points and for points that do not lie along an ellipse.
    """
    return _fit(np.asarray(xy, dtype=np.float64), np.ones(len(xy), dtype=bool), FITS[method])


def fit_ellipse_robust(xy: np.ndarray, tolerance_px: float = 0.5, method: str = "geometric", seed: int = 1) -> Ellipse:
    """Return the ellipse that most points agree with; the others (stray edges) are left out.

    Ellipses through random sixes of points are tried, the one with most points within ``tolerance_px`` wins
    (RANSAC, Fischler and Bolles 1981) and is fitted again to those points. Raises `SolveError` as `fit_ellipse` does.
    """
    xy = np.asarray(xy, dtype=np.float64)
    _require_points(len(xy))
    near = _largest_agreement(xy, tolerance_px, np.random.default_rng(seed))
    ellipse = _fit(xy, near, FITS[method])
    for _ in range(3):
        near = np.abs(ellipse.residual_px) < tolerance_px
        if near.sum() < FEWEST_POINTS or np.array_equal(near, ellipse.used):
            break
        ellipse = _fit(xy, near, FITS[method])
    return ellipse


def _largest_agreement(xy: np.ndarray, tolerance_px: float, rng: np.random.Generator, trials: int = 60) -> np.ndarray:
    """Return the mask of the largest set of points near one ellipse; all points are the first trial."""
    best = np.zeros(len(xy), dtype=bool)
    for trial in range(trials):
        chosen = np.arange(len(xy)) if trial == 0 else rng.choice(len(xy), FEWEST_POINTS, replace=False)
        try:
            centre, Q = _direct(xy[chosen])
        except SolveError:
            continue
        near = np.abs(_distances(xy - centre, Q)[0]) < tolerance_px
        if near.sum() > best.sum():
            best = near
        if best.sum() > 0.95 * len(xy):
            break
    if best.sum() < FEWEST_POINTS:
        raise SolveError(
            f"no ellipse passes within {tolerance_px:g} px of {FEWEST_POINTS} of the {len(xy)} edge points"
        )
    return best


def _require_points(count: int) -> None:
    if count < FEWEST_POINTS:
        raise SolveError(f"an ellipse needs {FEWEST_POINTS} edge points or more, {count} were given: measure more")


def _fit(xy: np.ndarray, used: np.ndarray, fit: Fit) -> Ellipse:
    _require_points(int(used.sum()))
    centre, Q = fit(xy[used])
    residual, gradient = _distances(xy - centre, Q)
    design = _design(xy[used] - centre, Q, gradient[used])
    redundancy = int(used.sum()) - 5
    variance = float(np.sum(residual[used] ** 2)) / redundancy
    covariance = variance * np.linalg.pinv(design.T @ design)[:2, :2]
    eigenvalues, axes = np.linalg.eigh(Q)  # ascending: the longer axis first
    azimuth = float(np.arctan2(axes[1, 0], axes[0, 0]))
    azimuth = (azimuth + np.pi / 2.0) % np.pi - np.pi / 2.0
    return Ellipse(centre, 1.0 / np.sqrt(eigenvalues), azimuth, covariance, residual, used)


def _distances(d: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return signed distances from the curve to first order (Sampson 1982), and the length of the gradient."""
    Qd = d @ Q
    gradient = np.maximum(2.0 * np.hypot(Qd[:, 0], Qd[:, 1]), 1e-12)
    return (np.sum(Qd * d, axis=1) - 1.0) / gradient, gradient


def _design(d: np.ndarray, Q: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Return the derivatives of the distances by centre, Qxx, Qxy and Qyy, ``(n, 5)``."""
    Qd = d @ Q
    columns = [-2.0 * Qd[:, 0], -2.0 * Qd[:, 1], d[:, 0] ** 2, 2.0 * d[:, 0] * d[:, 1], d[:, 1] ** 2]
    return np.column_stack(columns) / gradient[:, None]


def _direct(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and Q of the direct fit; raises `SolveError` where no ellipse comes out."""
    middle = xy.mean(axis=0)
    scale = float(np.abs(xy - middle).max())
    if not scale > 0.0:
        raise SolveError("the edge points coincide: measure points around the object")
    x, y = ((xy - middle) / scale).T
    quadratic, linear = np.column_stack([x * x, x * y, y * y]), np.column_stack([x, y, np.ones_like(x)])
    try:
        to_linear = -np.linalg.solve(linear.T @ linear, linear.T @ quadratic)
    except np.linalg.LinAlgError:
        raise SolveError("the edge points lie on a line: measure points all around the object") from None
    S = quadratic.T @ quadratic + quadratic.T @ linear @ to_linear
    _, vectors = np.linalg.eig(np.array([S[2] / 2.0, -S[1], S[0] / 2.0]))
    vectors = np.real(vectors)
    determinant = 4.0 * vectors[0] * vectors[2] - vectors[1] ** 2
    if not determinant.max() > 0.0:
        raise SolveError("the edge points do not lie along an ellipse: check them")
    a = vectors[:, int(np.argmax(determinant))]
    centre, Q = _normal_form(a, to_linear @ a)
    return middle + scale * centre, Q / scale**2


def _normal_form(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and Q of ``a0 x² + a1 xy + a2 y² + b0 x + b1 y + b2 = 0``."""
    Q = np.array([[a[0], a[1] / 2.0], [a[1] / 2.0, a[2]]])
    centre = np.linalg.solve(Q, -b[:2] / 2.0)
    level = centre @ Q @ centre - b[2]
    if not level * np.trace(Q) > 0.0:
        raise SolveError("the edge points do not lie along an ellipse: check them")
    return centre, Q / level


def _geometric(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and Q of the least-squares distances, by Gauss-Newton from the direct fit."""
    centre, Q = _direct(xy)
    for _ in range(_ITERATIONS):
        distance, gradient = _distances(xy - centre, Q)
        step = _least_squares(_design(xy - centre, Q, gradient), -distance)
        moved = Q + np.array([[step[2], step[3]], [step[3], step[4]]])
        if not (np.linalg.det(moved) > 0.0 and moved[0, 0] > 0.0):
            break  # short arcs may open into a hyperbola: what is there is as good as it gets
        centre, Q = centre + step[:2], moved
        if np.abs(step[:2]).max() < _STEP_PX:
            break
    return centre, Q


def _least_squares(design: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the least-squares solution by scaled normal equations: quick, and the five unknowns are well apart."""
    scale = 1.0 / np.maximum(np.sqrt(np.sum(design**2, axis=0)), 1e-30)
    A = design * scale
    try:
        return scale * np.linalg.solve(A.T @ A, A.T @ wanted)
    except np.linalg.LinAlgError:
        raise SolveError("the edge points do not determine an ellipse: measure points all around the object") from None


Fit = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
#: Ways to fit an ellipse: points ``(n, 2)`` to centre and Q.
FITS: dict[str, Fit] = {"geometric": _geometric, "direct": _direct}
