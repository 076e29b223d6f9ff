"""Precision of the unknowns from the factors of the normal equations (thesis eqs. 5.50-5.55), and what follows.

The covariance of the image parameters is the inverse of the reduced matrix, on the pattern of images that share
points. A point's cofactor follows from its own block and the images on which it is measured::

    Qx = V^-1 + V^-1 (sum_ij W_i' Q_ij W_j) V^-1

The cofactor of a residual is that of the observation minus that of the computed observation; its ratio to the first is
the redundancy number r, the share of an error that appears in its own residual (Baarda 1968).

The CE90 of many points is the radius r that contains 90 % of their horizontal errors. Each point has its own error
ellipse, with semi-axes a and b (one sigma), so that it is the quantile of a mixture, not a mean: a few points with very
large ellipses belong to the other 10 %::

    sum_i w_i mean_phi exp(-r² / (2 (a_i² cos² phi + b_i² sin² phi))) = 0.1

The LE90 is defined in the same way, from the heights' standard deviations.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from ...foundation.thresholds import REDUNDANCY, threshold, thresholds
from ..gauss_newton import GaussNewton, Solution


@thresholds
class RELIABILITY:
    """Limits below which residuals are not tested and beyond which standard deviations are not reported."""

    farthest_m: float = threshold(1e5, "m", "largest standard deviation of a determined coordinate")


LEAST_SIGMA_M = 1e-6  # smallest sigma of a position, so that points without error have a CE90, too
DIRECTIONS = 16  # of a half circle, in which an error ellipse is integrated: errors of a CE90 are 1e-4
#: Factors of 90 % limits of normal errors: circle, from the radial RMSE (NSSDA); symmetric interval, from the RMSE.
CIRCLE_90, LINE_90 = 1.5175, 1.6449


@dataclass(frozen=True, eq=False)
class Precision:
    """Cofactors at a solution.

    parameters : (cameras, p) variances
    points : (m, 3, 3) cofactors in m²
    residuals : (n, 2, 2) cofactors of the residuals in px²
    cameras : (blocks, p, p) cofactors on the pattern
    """

    parameters: np.ndarray
    points: np.ndarray
    residuals: np.ndarray
    cameras: np.ndarray


def compute_precision(loop: GaussNewton, solution: Solution) -> Precision:
    """Return all cofactors at a solution."""
    cameras = loop.compute_camera_cofactors(solution)
    spread = loop.equations.compute_cofactors(solution.state, solution.weight, solution.normals, cameras)
    variances = cameras[loop.pattern.diagonal].diagonal(axis1=1, axis2=2)
    residuals = np.negative(spread.computed, out=spread.computed)
    weight = solution.weight
    with np.errstate(divide="ignore"):
        residuals[:, [0, 1], [0, 1]] += np.where(weight > 0.0, 1.0 / weight, np.nan)[:, None]
    return Precision(variances, spread.points, residuals, cameras)


def compute_deletion_tests(residual: np.ndarray, cofactors: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the decrease of the weighted sum of squares if an image point is left out, ``(n,)``.

    It is v' Qv^-1 v of the residuals v; for normal errors chi² with two degrees of freedom (Baarda 1968). Directions in
    which less than `REDUNDANCY.tested` of an error appears in the residual are not tested.

    residual : (n, 2) px; cofactors : (n, 2, 2) Qv, px²; weight : (n,) 1/px²
    """
    a, d, b = cofactors[:, 0, 0] * weight, cofactors[:, 1, 1] * weight, cofactors[:, 0, 1] * weight
    middle, half = 0.5 * (a + d), np.hypot(0.5 * (a - d), b)
    angle = 0.5 * np.arctan2(2.0 * b, a - d)
    cosine, sine = np.cos(angle), np.sin(angle)
    total = np.zeros(len(residual))
    for share, x in (
        (middle + half, residual[:, 0] * cosine + residual[:, 1] * sine),
        (middle - half, residual[:, 1] * cosine - residual[:, 0] * sine),
    ):
        testable = share > REDUNDANCY.tested
        total[testable] += weight[testable] * x[testable] ** 2 / share[testable]
    return total


def predict_accuracy(covariance: np.ndarray, weight: np.ndarray | None = None) -> dict[str, float | None]:
    """Return the expected RMSE, CE90 and LE90 of points, or of differences of points.

    Coordinates that were not surveyed (an infinite variance) or not determined (NaN, or beyond
    ``RELIABILITY.farthest_m``) are not compared.

    covariance : (k, 3, 3) m², east, north, height; weight : (k,) of the points, equal by default
    Result: ``rmse_east_m``, ``rmse_north_m``, ``rmse_height_m``, ``ce90_m``, ``le90_m``; None where nothing is compared
    """
    variance = covariance.diagonal(axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        compared = variance < RELIABILITY.farthest_m**2
    share = compared * (np.ones(len(variance)) if weight is None else weight)[:, None]
    plan, height = np.flatnonzero(compared[:, :2].all(axis=1)), np.flatnonzero(compared[:, 2])
    with np.errstate(invalid="ignore"):
        rmse = np.sqrt(np.where(compared, variance * share, 0.0).sum(axis=0) / share.sum(axis=0))
    names = ("rmse_east_m", "rmse_north_m", "rmse_height_m")
    figures = {name: float(value) if np.isfinite(value) else None for name, value in zip(names, rmse, strict=True)}
    directions = (np.arange(DIRECTIONS) + 0.5) * (np.pi / DIRECTIONS)
    major, minor = np.maximum(compute_semi_axes(covariance[plan]), LEAST_SIGMA_M)
    along = np.hypot(major[:, None] * np.cos(directions), minor[:, None] * np.sin(directions))
    sigma = np.maximum(np.sqrt(variance[height, 2]), LEAST_SIGMA_M)
    return figures | {
        "ce90_m": _find_quantile_90(lambda r: np.exp(-0.5 * (r / along) ** 2).mean(axis=1), major, share[plan, 0]),
        "le90_m": _find_quantile_90(lambda r: special.erfc(r / sigma / np.sqrt(2.0)), sigma, share[height, 2]),
    }


def _find_quantile_90(beyond: Callable[[float], np.ndarray], sigma: np.ndarray, weight: np.ndarray) -> float | None:
    """Return the limit that 90 % of the errors of points do not exceed, None without points.

    ``beyond`` returns the probability ``(k,)`` of each point's error to exceed a length, ``sigma (k,)`` its largest
    standard deviation.
    """
    if not len(sigma):
        return None
    low, high = np.log(0.1 * sigma.min()), np.log(10.0 * sigma.max())
    return float(np.exp(optimize.brentq(lambda r: np.average(beyond(np.exp(r)), weights=weight) - 0.1, low, high)))


def compute_semi_axes(covariance_m2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the semi-axes (m, one sigma) of the horizontal error ellipses of covariances ``(k, 3, 3)``."""
    east, north, mixed = covariance_m2[:, 0, 0], covariance_m2[:, 1, 1], covariance_m2[:, 0, 1]
    middle, half = 0.5 * (east + north), np.hypot(0.5 * (east - north), mixed)
    return np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0))


def errors_90(east_m: float | None, north_m: float | None, height_m: float | None) -> dict[str, float | None]:
    """Return ``ce90_m`` and ``le90_m`` of RMSEs or standard deviations; None where they are not determined."""
    circle = None if east_m is None or north_m is None else CIRCLE_90 * float(np.hypot(east_m, north_m))
    line = None if height_m is None else LINE_90 * height_m
    return {
        name: None if value is None or not value < RELIABILITY.farthest_m else value
        for name, value in (("ce90_m", circle), ("le90_m", line))
    }
