"""The 20 terms of an RPC and the evaluation of its four polynomials, in normalised coordinates and without copies.

A few thousand points at a time go through buffers that stay in the processor's cache: the monomials are written into
``(20, n)`` rows and multiplied with the coefficients of all polynomials at once. Memory does not grow with the
number of points.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

CHUNK = 12288  # points in the buffers: fewer cost calls, more leave the cache
#: Multiplications in one matrix product: OpenBLAS starts threads above, which cost more than they save here.
PRODUCT_LIMIT = 2**18
THREADED = 20 * CHUNK  # points from which threads pay
MAX_THREADS = 4  # the processor's memory and Python's lock leave nothing to more
#: Powers of (L, P, H) of the 20 terms, in RPC00B order.
POWERS = np.array(
    [
        (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2),
        (1, 1, 1), (3, 0, 0), (1, 2, 0), (1, 0, 2), (2, 1, 0), (0, 3, 0), (0, 1, 2), (2, 0, 1), (0, 2, 1), (0, 0, 3),
    ]
)  # fmt: skip
QUADRATIC_TERMS = 10  # the first ten terms have degree 2 at most: all that derivatives need


def chunks(count: int, size: int = CHUNK) -> Iterator[slice]:
    """Yield slices of at most ``size`` that cover ``count`` points."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def for_parts(count: int, work: Callable[[slice, Workspace], None]) -> None:
    """Call ``work(part, workspace)`` for slices of at most `CHUNK` of ``count`` points, silent about bad numbers.

    From `THREADED` points on, threads take the parts in turn: NumPy lets them compute at the same time. Fewer points
    belong to callers that have threads of their own.
    """
    threads = min(MAX_THREADS, os.cpu_count() or 1) if count >= THREADED else 1
    parts = chunks(count)
    if threads == 1:
        _work_off(parts, count, work)
        return
    lock = threading.Lock()

    def taken() -> Iterator[slice]:
        while True:
            with lock:
                part = next(parts, None)
            if part is None:
                return
            yield part

    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(_work_off, taken(), count, work) for _ in range(threads)]:
            done.result()


def _work_off(parts: Iterator[slice], count: int, work: Callable[[slice, Workspace], None]) -> None:
    workspace = Workspace(count)
    with np.errstate(all="ignore"):
        for part in parts:
            work(part, workspace)


def fill_monomials(terms: np.ndarray) -> None:
    """Complete the rows of ``terms (20, n)`` from rows 1 to 3, the normalised lon, lat and height."""
    axes, squares = terms[1:4], terms[7:10]
    lon, lat, hgt = axes
    terms[0] = 1.0
    np.multiply(axes[1:], lon, out=terms[4:6])
    np.multiply(lat, hgt, out=terms[6])
    np.multiply(axes, axes, out=squares)
    np.multiply(terms[4], hgt, out=terms[10])
    np.multiply(squares, lon, out=terms[11:14])
    np.multiply(squares, lat, out=terms[14:17])
    np.multiply(squares, hgt, out=terms[17:20])


def monomials(normalised: np.ndarray) -> np.ndarray:
    """Return the 20 RPC terms ``(20, n)`` of normalised coordinates ``(3, n)``."""
    terms = np.empty((20, normalised.shape[1]))
    terms[1:4] = normalised
    fill_monomials(terms)
    return terms


def _derivative_matrices() -> np.ndarray:
    """Return ``(3, 20, 10)``: derivative of a coefficient vector by each axis, on the ten quadratic terms."""
    index = {tuple(powers): term for term, powers in enumerate(POWERS[:QUADRATIC_TERMS])}
    matrices = np.zeros((3, 20, QUADRATIC_TERMS))
    for term, powers in enumerate(POWERS):
        for axis in range(3):
            if powers[axis]:
                lowered = powers.copy()
                lowered[axis] -= 1
                matrices[axis, term, index[tuple(lowered)]] = powers[axis]
    return matrices


DERIVATIVES = _derivative_matrices()


def multiply(coefficients: np.ndarray, terms: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Return ``coefficients (p, t) @ terms (t, n)`` in ``out``, in pieces that one thread multiplies."""
    for part in chunks(terms.shape[1], PRODUCT_LIMIT // coefficients.size):
        np.matmul(coefficients, terms[:, part], out=out[:, part])
    return out


class Workspace:
    """Buffers for the terms ``(20, n)`` and polynomial values ``(4, n)`` of up to `CHUNK` points."""

    def __init__(self, count: int) -> None:
        width = min(CHUNK, count)
        self._terms, self._values = np.empty((20, width)), np.empty((4, width))

    def terms(self, count: int) -> np.ndarray:
        """Return the buffer of the terms for ``count`` points."""
        return self._terms[:, :count]

    def ratios(self, polynomials: np.ndarray, terms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised image coordinates ``(2, n)`` and denominators ``(2, n)``; rows 1-3 of ``terms`` are set.

        ``polynomials (4, 20)``: sample and line numerator, sample and line denominator. Both results are views of the
        workspace.
        """
        fill_monomials(terms)
        values = multiply(polynomials, terms, self._values[:, : terms.shape[1]])
        np.divide(values[:2], values[2:], out=values[:2])
        return values[:2], values[2:]


def slopes_of_ratios(
    derivatives: np.ndarray, terms: np.ndarray, ratios: np.ndarray, denominators: np.ndarray
) -> np.ndarray:
    """Return ``(axes, 2, n)``: derivatives of the ratios by the normalised ground axes.

    ``derivatives (4 * axes, 10)``: those of the four polynomials by each axis, on the quadratic terms.
    """
    count = terms.shape[1]
    products = multiply(derivatives, terms[:QUADRATIC_TERMS], np.empty((len(derivatives), count)))
    by_axis = products.reshape(-1, 4, count)
    slopes = by_axis[:, :2]
    by_axis[:, 2:] *= ratios
    slopes -= by_axis[:, 2:]
    slopes /= denominators
    return slopes
