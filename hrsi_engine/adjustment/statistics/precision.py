"""Precision of the unknowns from the factors of the normal equations (thesis eqs. 5.50-5.55), and what follows.

The covariance of the image parameters is the inverse of the reduced matrix, on the pattern of images that share
points. A point's cofactor follows from its own block and the images that see it::

    Qx = V^-1 + V^-1 (sum_ij W_i' Q_ij W_j) V^-1

The cofactor of a residual is that of the observation less that of what was computed for it; their ratio is the
redundancy number r, the share of an error that shows in its own residual (Baarda 1968).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...foundation.thresholds import threshold, thresholds
from ..gauss_newton import GaussNewton, Solution

#: Non-centrality of Baarda's test: an error this many sigmas large is found with 80 % at 0.1 % false alarms.
NON_CENTRALITY = 4.13


@thresholds
class ReliabilityThresholds:
    """Which residuals tell of their own observation."""

    least_redundancy: float = threshold(1e-3, "", "a residual with less says nothing of its observation")


RELIABILITY = ReliabilityThresholds()

#: What holds 90 % of normal errors: a circle, of the radial RMSE (NSSDA), and a band to both sides, of the RMSE.
CIRCLE_90, LINE_90 = 1.5175, 1.6449


@dataclass(frozen=True, eq=False)
class Precision:
    """Cofactors at a solution; all NaN where the cameras' are not known.

    parameters : (cameras, p) variances
    points : (m, 3, 3) cofactors in m²
    residuals : (n, 2, 2) cofactors of the residuals in px²
    cameras : (blocks, p, p) cofactors on the pattern
    """

    parameters: np.ndarray
    points: np.ndarray
    residuals: np.ndarray
    cameras: np.ndarray | None

    def own_cameras(self, loop: GaussNewton) -> np.ndarray:
        """Return the cofactors of each camera's own parameters ``(cameras, p, p)``."""
        if self.cameras is None:
            return np.full((*self.parameters.shape, self.parameters.shape[1]), np.nan)
        return self.cameras[loop.pattern.diagonal]


def compute_camera_cofactors(loop: GaussNewton, solution: Solution) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the cofactors of each camera's own parameters ``(cameras, p, p)``, and all of them (see `Precision`)."""
    loop.system.factorise(solution.normals.blocks, loop.prior_weight)
    cameras = loop.system.compute_cofactors()
    if cameras is None:
        return np.full((*loop.prior_weight.shape, loop.prior_weight.shape[1]), np.nan), None
    return cameras[loop.pattern.diagonal], cameras


def compute_precision(loop: GaussNewton, solution: Solution) -> Precision:
    """Return all cofactors at a solution."""
    cameras, spread = loop.compute_cofactors(solution)
    n, m = len(solution.factor), len(solution.normals.inverse)
    if cameras is None or spread is None:
        own = np.full(loop.prior_weight.shape, np.nan)
        return Precision(own, np.full((m, 3, 3), np.nan), np.full((n, 2, 2), np.nan), None)
    own = cameras[loop.pattern.diagonal].diagonal(axis1=1, axis2=2)
    residuals = np.negative(spread.computed, out=spread.computed)
    weight = solution.weight
    with np.errstate(divide="ignore"):
        residuals[:, [0, 1], [0, 1]] += np.where(weight > 0.0, 1.0 / weight, np.nan)[:, None]
    return Precision(own, spread.points, residuals, cameras)


def compute_deletion_tests(residual: np.ndarray, cofactors: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return by how much the weighted sum of squares falls when an image point is left out, ``(n,)``.

    v' Qv^-1 v of residuals ``(n, 2)``; under normal errors chi² with two degrees of freedom. Directions in which less
    than `RELIABILITY.least_redundancy` of an error shows are not tested.
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
        testable = share > RELIABILITY.least_redundancy
        total[testable] += weight[testable] * x[testable] ** 2 / share[testable]
    return total


@dataclass(frozen=True, eq=False)
class ErrorEllipse:
    """Horizontal error ellipses (one sigma): semi-axes (m) and the azimuth of the longer one, degrees from north."""

    major_m: np.ndarray
    minor_m: np.ndarray
    azimuth_deg: np.ndarray


def error_ellipses(covariance_m2: np.ndarray) -> ErrorEllipse:
    """Return the ellipses of covariances ``(m, 3, 3)`` or ``(m, 2, 2)``, east and north first."""
    east, north, mixed = covariance_m2[:, 0, 0], covariance_m2[:, 1, 1], covariance_m2[:, 0, 1]
    middle, half = 0.5 * (east + north), np.hypot(0.5 * (east - north), mixed)
    azimuth = np.degrees(0.5 * np.arctan2(2.0 * mixed, north - east)) % 180.0
    return ErrorEllipse(np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0)), azimuth)


def minimal_detectable_error(redundancy: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return the internal reliability: the smallest error that the test finds with 80 % (Baarda)."""
    with np.errstate(divide="ignore"):
        return NON_CENTRALITY * sigma / np.sqrt(np.maximum(redundancy, 0.0))


def external_reliability(redundancy: np.ndarray) -> np.ndarray:
    """Return the external reliability: the most an undetected error moves any unknown, in that unknown's sigmas."""
    with np.errstate(divide="ignore"):
        return NON_CENTRALITY * np.sqrt(np.maximum(1.0 - redundancy, 0.0) / np.maximum(redundancy, 0.0))


def predict_accuracy(covariance_m2: np.ndarray, survey_m2: np.ndarray) -> dict[str, float | None]:
    """Return the RMSE, CE90 and LE90 to expect at points with covariances ``(k, 3, 3)`` of position and survey.

    Coordinates that were not surveyed (an infinite variance) are not compared.
    """
    known = np.isfinite(covariance_m2).all(axis=(1, 2))
    if not known.any():
        return {"rmse_east_m": None, "rmse_north_m": None, "rmse_height_m": None, "ce90_m": None, "le90_m": None}
    variance = (covariance_m2[known] + survey_m2[known]).diagonal(axis1=1, axis2=2)
    compared = np.isfinite(variance)
    with np.errstate(invalid="ignore"):
        rmse = np.sqrt(np.where(compared, variance, 0.0).sum(axis=0) / compared.sum(axis=0))
    east, north, height = (float(value) if np.isfinite(value) else None for value in rmse)
    return {"rmse_east_m": east, "rmse_north_m": north, "rmse_height_m": height, **errors_90(east, north, height)}


def errors_90(east_m: float | None, north_m: float | None, height_m: float | None) -> dict[str, float | None]:
    """Return ``ce90_m`` and ``le90_m`` of RMSEs or standard deviations; None without finite ones."""
    circle = None if east_m is None or north_m is None else CIRCLE_90 * float(np.hypot(east_m, north_m))
    line = None if height_m is None else LINE_90 * height_m
    return {
        "ce90_m": None if circle is None or not np.isfinite(circle) else circle,
        "le90_m": None if line is None or not np.isfinite(line) else line,
    }
