"""Large arrays: zeros in pages of 2 MB, and fast tests, sums and inverses of the rows of arrays with few columns."""

from collections.abc import Sequence
from functools import reduce

import numpy as np


def allocate_zeros(shape: Sequence[int]) -> np.ndarray:
    """Return an array of zeros like `numpy.zeros`, in memory pages of 2 MB if the system has them.

    NumPy requests such pages from 4 MB on, but up to version 1.26 not for `numpy.zeros`. Sums over 10 000 images
    spent more than half of their time on pages of 4 kB, which the system clears one by one.
    """
    array = np.empty(shape)
    array.fill(0.0)
    return array


def any_of_rows(mask: np.ndarray) -> np.ndarray:
    """Return which rows of a mask ``(n, k)`` with few columns contain True, ``(n,)``.

    Equal to ``mask.any(axis=1)``, which loops over the k values of each row and takes five to ten times as long.
    """
    return reduce(np.logical_or, mask.T)


def finite_rows(values: np.ndarray) -> np.ndarray:
    """Return which rows of ``values (n, k)`` are finite in all columns, ``(n,)``; for small k, see `any_of_rows`."""
    return reduce(np.logical_and, map(np.isfinite, values.T))


def square_lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the sums of squares ``(n,)`` of ``vectors (n, k)``; for small k, see `any_of_rows`."""
    return np.einsum("ij,ij->i", vectors, vectors)


def invert_2x2(matrices: np.ndarray) -> np.ndarray:
    """Return the inverses of matrices ``(n, 2, 2)``, infinite or NaN for singular ones (LAPACK is far slower)."""
    a, b, c, d = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
    adjugate = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(adjugate / (a * d - b * c)[:, None, None])
