"""Large arrays of zeros in large pages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def zeros(shape: Sequence[int]) -> np.ndarray:
    """Return zeros as `numpy.zeros` does, in pages of 2 MB where the system has them.

    NumPy asks for these from 4 MB on, but up to 1.26 only for arrays that are not to be zero. Sums over 10 000 images
    took more than half of their time for pages of 4 kB, which the system clears one by one.
    """
    array = np.empty(shape)
    array.fill(0.0)
    return array
