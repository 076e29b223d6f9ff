"""The 20 terms of an RPC and the evaluation of its four polynomials, in normalised coordinates and without copies.

Everything specific to RPCs is in three tables, used by all evaluations including the compiled ones (`compiled_rpc`):
`POWERS` defines the terms, `FACTORS` how each is the product of earlier ones, `DERIVATIVES` converts the coefficients
of a cubic to those of its three derivatives in the ten quadratic terms. An evaluation consists of the terms, two
products of coefficients with them, and the quotient rule (`slope_of_ratio`).

A few thousand points at a time use buffers that fit into the processor's cache: the monomials are written to rows
``(20, n)`` and multiplied with the coefficients of all polynomials together. Memory does not depend on the number of
points.

Inverse of an RPC: the ground position of an image point at a given height, in normalised coordinates.

An RPC has no closed inverse. It begins with the affine function of (sample, line, height) at the centre of the RPC's
domain. The derivatives there, one set for each point, serve for a few steps of Newton's method, after which most points
have an error below 1e-9 px. The others (outside the domain, near zeros of the denominator) are computed by Newton's
iteration with the derivatives of each step.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..foundation.thresholds import EQUALITY, ITERATIONS, threshold, thresholds
from ..ground.ellipsoid import Number

_SPEED = "measured for speed, 2026-11-21"
_ROUNDING = "rounding of a longitude: 3e-9 px"


@thresholds
class EVALUATION:
    """Sizes of batches and limits of iterations in the evaluation and inversion of RPCs."""

    chunk: int = threshold(12288, "points", "size of a buffer: fewer cost calls, more leave the cache", _SPEED)
    product_limit: int = threshold(2**18, "multiplications", "largest product on one thread of OpenBLAS", _SPEED)
    accepted_px: float = threshold(1e-8, "px", "largest error of an accepted image point", _ROUNDING)
    chord_evaluations: int = threshold(5, "evaluations", "largest number with the derivatives of the start")
    domain_margin: float = threshold(1.5, "half extents", "normalised coordinate up to which a result is accepted")


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


class Solver:
    """Computes normalised lon and lat ``(2, n)`` of normalised image points and heights, for one RPC."""

    def __init__(self, polynomials: np.ndarray, image_scale: np.ndarray) -> None:
        self._polynomials, self._scale_px = polynomials, np.abs(image_scale)[:, None]
        self._derivatives = np.concatenate([polynomials @ matrix for matrix in DERIVATIVES[:2]])
        with np.errstate(all="ignore"):
            # ``(2, 4)``: normalised L, P as an affine function of (1, sample, line, H), from the centre's derivatives
            terms = monomials(np.zeros((3, 1)))
            values = self._polynomials @ terms
            ratios = values[:2] / values[2:]
            derivatives = np.concatenate([self._polynomials @ matrix for matrix in DERIVATIVES])
            slopes = slopes_of_ratios(derivatives, terms, ratios, values[2:])[:, :, 0]
            inverse = np.linalg.pinv(slopes[:2].T) if np.isfinite(slopes).all() else np.zeros((2, 2))
            self._affine = np.column_stack([-inverse @ ratios, inverse, -inverse @ slopes[2]])

    def solve(self, target: np.ndarray, height: np.ndarray, work: Workspace) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised lon, lat ``(2, n)`` and whether each converged; at most `EVALUATION.chunk` points."""
        terms = work.terms(height.size)
        terms[1:3] = self._affine[:, :1] + self._affine[:, 1:3] @ target + self._affine[:, 3:] * height
        terms[3] = height
        for evaluation in range(1, EVALUATION.chord_evaluations + 1):
            ratios, denominators = work.ratios(self._polynomials, terms)
            if evaluation == 1:
                (a, c), (b, d) = slopes_of_ratios(self._derivatives, terms, ratios, denominators)
            miss = np.subtract(target, ratios, out=ratios)
            error = np.abs(miss * self._scale_px).max(axis=0)
            still_open = height.size - np.count_nonzero(error <= EQUALITY.rounding)
            if evaluation == EVALUATION.chord_evaluations or still_open <= EQUALITY.negligible * height.size:
                break
            terms[1:3] += solve_pair(a, b, c, d, *miss)
        lonlat, unsolved = terms[1:3].copy(), np.flatnonzero(~(error <= EQUALITY.rounding))
        error[unsolved] = np.inf  # the next iteration starts at these positions, and computes their errors again
        self._iterate_by_newton(lonlat, error, unsolved, target, height, limit=np.inf, iterations=ITERATIONS.most)
        # far from the solution, or near a zero of the denominator: short steps from the centre of the RPC's domain
        failed = np.flatnonzero(~(error <= EVALUATION.accepted_px))
        lonlat[:, failed], error[failed] = 0.0, np.inf
        self._iterate_by_newton(lonlat, error, failed, target, height, limit=0.5, iterations=8 * ITERATIONS.most)
        return lonlat, error <= EVALUATION.accepted_px

    def _iterate_by_newton(
        self,
        lonlat: np.ndarray,
        error: np.ndarray,
        places: np.ndarray,
        target: np.ndarray,
        height: np.ndarray,
        limit: float,
        iterations: int,
    ) -> None:
        """Improve ``lonlat`` and ``error`` in place at ``places`` by Newton's iteration with the analytic Jacobian.

        Every point keeps its best position, so that further iterations cannot increase its error. Points leave the
        iteration when they have converged. ``limit`` is the longest step in normalised coordinates.
        """
        current = lonlat[:, places]
        for _ in range(iterations):
            if not places.size:
                break
            terms = monomials(np.vstack([current, height[places]]))
            values = self._polynomials @ terms
            ratios = values[:2] / values[2:]
            (a, c), (b, d) = slopes_of_ratios(self._derivatives, terms, ratios, values[2:])
            miss = target[:, places] - ratios
            step = np.stack(solve_pair(a, b, c, d, *miss))
            reached = np.abs(miss * self._scale_px).max(axis=0)
            better = reached < error[places]
            lonlat[:, places[better]], error[places[better]] = current[:, better], reached[better]
            if np.isfinite(limit):
                step *= np.minimum(1.0, limit / np.maximum(np.abs(step).max(axis=0), 1e-300))
            keep = (
                (reached > EQUALITY.rounding)
                & (better | (reached > EVALUATION.accepted_px))
                & np.isfinite(step).all(axis=0)
            )
            places, current = places[keep], current[:, keep] + step[:, keep]
