"""A standard deviation that blunders do not touch."""

from typing import Any

import numpy as np

from .thresholds import threshold, thresholds


@thresholds
class ROBUST:
    """Which deviations from a middle, or from a robust fit, are outliers."""

    outlier: float = threshold(
        3.5, "sigma", "robust standard deviations beyond which a deviation is an outlier", "Iglewicz and Hoaglin 1993"
    )


MAD_TO_SIGMA = 1.4826  #: of a normal distribution: standard deviation over median absolute deviation


def robust_sigma(deviations: np.ndarray, axis: int | None = None) -> Any:
    """Return the standard deviation of normal ``deviations`` from their middle, by their median absolute value.

    deviations : (...) deviations from a middle, in any unit
    axis : along which the median is taken; by default over all
    Result: 1.4826 times the median absolute deviation, in the same unit.
    """
    return MAD_TO_SIGMA * np.median(np.abs(deviations), axis=axis)
