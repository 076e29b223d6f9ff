"""Robust weight functions: weight of an observation from its residual in units of its standard deviation.

Each is ``psi(t) / t`` of an M-estimator; tuning constants give 95 % efficiency under normal errors (Huber 1981,
Holland and Welsch 1977). An image point has one weight, from the length of its residual.
"""

from collections.abc import Callable

import numpy as np


def least_squares(t: np.ndarray) -> np.ndarray:
    """Return 1 for every observation."""
    return np.ones_like(t)


def huber(t: np.ndarray, k: float = 1.345) -> np.ndarray:
    """Return 1 up to ``k``, then ``k / t``: the cost of large residuals is linear."""
    return k / np.maximum(t, k)


def cauchy(t: np.ndarray, c: float = 2.385) -> np.ndarray:
    """Return ``1 / (1 + (t / c)^2)``: the weight of blunders falls towards 0."""
    return 1.0 / (1.0 + (t / c) ** 2)


def tukey(t: np.ndarray, c: float = 4.685) -> np.ndarray:
    """Return ``(1 - (t / c)^2)^2``, and 0 beyond ``c``: blunders have no weight."""
    return np.maximum(1.0 - (t / c) ** 2, 0.0) ** 2


WEIGHTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "none": least_squares,
    "huber": huber,
    "cauchy": cauchy,
    "tukey": tukey,
}
