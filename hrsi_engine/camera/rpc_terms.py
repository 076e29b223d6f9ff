"""The 20 terms of an RPC and the evaluation of its four polynomials, in normalised coordinates and without copies.

Everything specific to RPCs is in three tables, used by all evaluations including the compiled ones (`compiled_rpc`):
`POWERS` defines the terms, `FACTORS` how each is the product of earlier ones, `DERIVATIVES` converts the coefficients
of a cubic to those of its three derivatives in the ten quadratic terms. An evaluation consists of the terms, two
products of coefficients with them, and the quotient rule (`slope_of_ratio`).

A few thousand points at a time use buffers that fit into the processor's cache: the monomials are written to rows
``(20, n)`` and multiplied with the coefficients of all polynomials together. Memory does not depend on the number of
points.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from ..foundation.workers.threads import thread_count
from ..ground.ellipsoid import Number

_SPEED = "measured for speed, 2026-11-21"
_ROUNDING = "rounding of a longitude: 3e-9 px"


@thresholds
class EVALUATION:
    """Sizes of batches and limits of iterations in the evaluation and inversion of RPCs."""

    chunk: int = threshold(12288, "points", "size of a buffer: fewer cost calls, more leave the cache", _SPEED)
    product_limit: int = threshold(2**18, "multiplications", "largest product on one thread of OpenBLAS", _SPEED)
    threaded_chunks: int = threshold(20, "buffers", "number of buffers from which threads are faster", _SPEED)
    most_threads: int = threshold(4, "threads", "largest number: more threads wait for memory", _SPEED)
    accepted_px: float = threshold(1e-8, "px", "largest error of an accepted image point", _ROUNDING)
    chord_evaluations: int = threshold(4, "evaluations", "largest number with the derivatives of the fitted inverse")
    nodes: int = threshold(7, "nodes", "along each axis, for the fit of the inverse polynomial")
    domain_margin: float = threshold(1.5, "half extents", "normalised coordinate up to which the cubic inverse is used")


#: Powers of (L, P, H) of the 20 terms, in RPC00B order.
POWERS = np.array(
    [
        (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2),
        (1, 1, 1), (3, 0, 0), (1, 2, 0), (1, 0, 2), (2, 1, 0), (0, 3, 0), (0, 1, 2), (2, 0, 1), (0, 2, 1), (0, 0, 3),
    ]
)  # fmt: skip
QUADRATIC_TERMS = 10  # the first ten terms have degree 2 or less, sufficient for derivatives


def chunks(count: int, size: int = EVALUATION.chunk) -> Iterator[slice]:
    """Yield slices of at most ``size`` that cover ``count`` points."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def for_parts(count: int, work: Callable[[slice, Workspace], None]) -> None:
    """Call ``work(part, workspace)`` for slices of ``count`` points of the size of the buffers, without warnings.

    Many points are distributed to threads, since NumPy releases the GIL. A small number is computed in the calling
    thread, since the callers may use threads themselves.
    """
    is_threaded = count >= EVALUATION.threaded_chunks * EVALUATION.chunk
    threads = min(EVALUATION.most_threads, thread_count()) if is_threaded else 1
    parts = chunks(count)
    if threads == 1:
        _work_through(parts, count, work)
        return
    lock = threading.Lock()

    def take_parts() -> Iterator[slice]:
        while True:
            with lock:
                part = next(parts, None)
            if part is None:
                return
            yield part

    with ThreadPoolExecutor(threads) as pool:
        for future in [pool.submit(_work_through, take_parts(), count, work) for _ in range(threads)]:
            future.result()


def _work_through(parts: Iterator[slice], count: int, work: Callable[[slice, Workspace], None]) -> None:
    workspace = Workspace(count)
    with np.errstate(all="ignore"):
        for part in parts:
            work(part, workspace)


def _find_factors() -> np.ndarray:
    """Return ``(20, 2)``: the indices of the two earlier terms whose product is each term; 0 for the first four."""
    index = {tuple(powers): term for term, powers in enumerate(POWERS.tolist())}
    factors = np.zeros((20, 2), dtype=np.int64)
    for term, powers in enumerate(POWERS.tolist()[4:], start=4):
        axis = max(axis for axis in range(3) if powers[axis])
        powers[axis] -= 1
        factors[term] = index[tuple(powers)], 1 + axis
    return factors


FACTORS = _find_factors()
_PRODUCTS = [(term, *FACTORS[term].tolist()) for term in range(4, 20)]


def fill_monomials(terms: np.ndarray) -> None:
    """Fill the rows of ``terms (20, n)`` from rows 1 to 3, the normalised lon, lat and height."""
    terms[0] = 1.0
    for term, earlier, axis in _PRODUCTS:
        np.multiply(terms[earlier], terms[axis], out=terms[term])


def monomials(normalised: np.ndarray) -> np.ndarray:
    """Return the 20 RPC terms ``(20, n)`` of normalised coordinates ``(3, n)``."""
    terms = np.empty((20, normalised.shape[1]))
    terms[1:4] = normalised
    fill_monomials(terms)
    return terms


def _make_derivative_matrices() -> np.ndarray:
    """Return ``(3, 20, 10)``: matrices from coefficients to those of the derivative by each axis (quadratic terms)."""
    index = {tuple(powers): term for term, powers in enumerate(POWERS[:QUADRATIC_TERMS])}
    matrices = np.zeros((3, 20, QUADRATIC_TERMS))
    for term, powers in enumerate(POWERS):
        for axis in range(3):
            if powers[axis]:
                lowered = powers.copy()
                lowered[axis] -= 1
                matrices[axis, term, index[tuple(lowered)]] = powers[axis]
    return matrices


DERIVATIVES = _make_derivative_matrices()


def multiply(coefficients: np.ndarray, terms: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Return ``coefficients (p, t) @ terms (t, n)`` in ``out``, in parts small enough for one thread of BLAS."""
    for part in chunks(terms.shape[1], EVALUATION.product_limit // coefficients.size):
        np.matmul(coefficients, terms[:, part], out=out[:, part])
    return out


class Workspace:
    """Buffers for the terms ``(20, n)`` and polynomial values ``(4, n)`` of up to `EVALUATION.chunk` points."""

    def __init__(self, count: int) -> None:
        width = min(EVALUATION.chunk, count)
        self._terms, self._values = np.empty((20, width)), np.empty((4, width))

    def terms(self, count: int) -> np.ndarray:
        """Return the buffer of the terms for ``count`` points."""
        return self._terms[:, :count]

    def ratios(self, polynomials: np.ndarray, terms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised image coordinates ``(2, n)`` and denominators ``(2, n)`` from rows 1 to 3 of ``terms``.

        ``polynomials (4, 20)``: sample and line numerator, sample and line denominator. Both results are views of the
        workspace.
        """
        fill_monomials(terms)
        values = multiply(polynomials, terms, self._values[:, : terms.shape[1]])
        np.divide(values[:2], values[2:], out=values[:2])
        return values[:2], values[2:]


def slope_of_ratio(numerator: Number, denominator: Number, ratio: Number, divisor: Number) -> Number:
    """Return the derivative of a ratio from those of its numerator and denominator; ``divisor`` is the denominator."""
    return (numerator - ratio * denominator) / divisor


def solve_pair(a: Number, b: Number, c: Number, d: Number, u: Number, v: Number) -> tuple[Number, Number]:
    """Return x and y of ``a x + b y = u, c x + d y = v``, numbers or arrays."""
    determinant = a * d - b * c
    return (d * u - b * v) / determinant, (a * v - c * u) / determinant


def slopes_of_ratios(
    derivatives: np.ndarray, terms: np.ndarray, ratios: np.ndarray, denominators: np.ndarray
) -> np.ndarray:
    """Return ``(axes, 2, n)``: derivatives of the ratios by the normalised ground axes.

    ``derivatives (4 * axes, 10)``: those of the four polynomials by each axis, on the quadratic terms.
    """
    count = terms.shape[1]
    products = multiply(derivatives, terms[:QUADRATIC_TERMS], np.empty((len(derivatives), count)))
    by_axis = products.reshape(-1, 4, count)
    return slope_of_ratio(by_axis[:, :2], by_axis[:, 2:], ratios, denominators)
