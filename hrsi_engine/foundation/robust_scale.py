"""Robust estimate of a standard deviation, insensitive to gross errors."""

from typing import Any

import numpy as np

from .thresholds import threshold, thresholds


@thresholds
class ROBUST:
    """Limits for deviations from a median or from a robust fit, and for weights that fall with them (Hampel 1974)."""

    outlier: float = threshold(
        3.5, "sigma", "robust standard deviations beyond which a deviation is an outlier", "Iglewicz and Hoaglin 1993"
    )
    full_weight: float = threshold(2.5, "sigma", "residual up to which an observation keeps its weight", "Hampel 1974")
    rejected: float = threshold(4.0, "sigma", "residual from which an observation has no weight", "Hampel 1974")


MAD_TO_SIGMA = 1.4826  #: standard deviation over median absolute deviation, for a normal distribution


def robust_sigma(deviations: np.ndarray, axis: int | None = None) -> Any:
    """Return the standard deviation of normally distributed deviations, estimated from their median absolute value.

    deviations : (...) deviations from a median or a fit, in any unit
    axis : the axis of the median; by default over all values
    Result: 1.4826 times the median absolute deviation, in the same unit.
    """
    return MAD_TO_SIGMA * np.median(np.abs(deviations), axis=axis)
