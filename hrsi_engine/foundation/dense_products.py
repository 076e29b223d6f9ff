"""Products of dense matrices, by the faster of the two BLAS libraries at hand.

The wheels of NumPy and SciPy each bring their own. That of NumPy 1.26 does not know processors of the last years and
falls back to instructions of 2004: 16 instead of 65 billion operations a second with the one of SciPy 1.13. The threads
of SciPy's, though, wait for one another by spinning and make it ten times slower where the machine has other work: it
is asked only where it works in the calling thread alone (`threads.one_thread_calls`).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import blas

from .threads import are_one_thread_calls


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return ``first (i, j)`` times ``second (j, k)``, both of float64."""
    if not are_one_thread_calls() or not (first.size and second.size):
        return np.asarray(first @ second)
    # BLAS counts by columns: the rows of a matrix are the columns of its transpose, (A B)' = B' A'
    left, left_turned = (second, 1) if second.flags.f_contiguous else (second.T, 0)
    right, right_turned = (first, 1) if first.flags.f_contiguous else (first.T, 0)
    return np.asarray(blas.dgemm(1.0, left, right, trans_a=left_turned, trans_b=right_turned).T)
