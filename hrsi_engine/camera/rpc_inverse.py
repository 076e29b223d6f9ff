"""Inverse of an RPC: the ground position of an image point at a given height, in normalised coordinates.

An RPC has no closed inverse. Once per RPC a cubic polynomial for normalised lon and lat as a function of (sample, line,
height) is fitted over the RPC's ground domain; its error is about a thousandth of a pixel, and its derivatives replace
the inverse Jacobian in Newton's method. After two evaluations of the RPC most points have an error below 1e-9 px.
Points that do not converge (outside the domain, near zeros of the denominator) are computed by Newton's iteration with
the analytic Jacobian. So are few points, for which the fit would take longer.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..foundation.thresholds import EQUALITY, ITERATIONS
from .rpc_terms import (
    DERIVATIVES,
    EVALUATION,
    QUADRATIC_TERMS,
    Workspace,
    fill_monomials,
    monomials,
    multiply,
    slopes_of_ratios,
    solve_pair,
)


class Inverse(NamedTuple):
    """Inverse polynomials: cubic RPC terms with (sample, line, height) instead of (L, P, H).

    ``off (2, 1)``, ``scale (2, 1)`` normalise sample and line (normalised by the RPC) to [-1, 1] over its ground
    domain; ``lonlat (2, 20)`` are the coefficients of normalised lon and lat; ``slopes (4, 10)`` those of their
    derivatives by normalised sample, then by line.
    """

    off: np.ndarray
    scale: np.ndarray
    lonlat: np.ndarray
    slopes: np.ndarray


def fit_inverse(polynomials: np.ndarray) -> Inverse:
    """Fit the inverse at Chebyshev nodes of the cube [-1, 1]**3, those where the denominators do not change sign.

    ``polynomials (4, 20)`` as in `Workspace.ratios`. If too few nodes are usable the inverse is NaN, and `Solver`
    uses Newton's iteration.
    """
    axis = np.cos(np.pi * (np.arange(EVALUATION.nodes) + 0.5) / EVALUATION.nodes)
    ground = np.stack(np.meshgrid(axis, axis, axis, indexing="ij")).reshape(3, -1)
    values = polynomials @ monomials(ground)
    ratios = values[:2] / values[2:]
    usable = (values[2:] * polynomials[2:, :1] > 0.0).all(axis=0) & np.isfinite(ratios).all(axis=0)
    low = ratios[:, usable].min(axis=1, keepdims=True, initial=np.inf)
    high = ratios[:, usable].max(axis=1, keepdims=True, initial=-np.inf)
    offset, scale = (low + high) / 2.0, (high - low) / 2.0
    if np.count_nonzero(usable) < len(axis) ** 2 or not np.isfinite(scale).all() or not (scale > 0.0).all():
        nothing = np.full((2, 1), np.nan)
        return Inverse(nothing, nothing, np.full((2, 20), np.nan), np.full((4, QUADRATIC_TERMS), np.nan))
    terms = monomials(np.vstack([(ratios - offset) / scale, ground[2:]])[:, usable])
    # Normal equations take a tenth of the time of a decomposition, and are well conditioned at these nodes
    try:
        lonlat = np.linalg.solve(terms @ terms.T, terms @ ground[:2, usable].T).T
    except np.linalg.LinAlgError:  # too few usable nodes
        lonlat = np.linalg.lstsq(terms.T, ground[:2, usable].T, rcond=None)[0].T
    slopes = np.concatenate([lonlat @ DERIVATIVES[axis] / scale[axis] for axis in (0, 1)])
    return Inverse(offset, scale, lonlat, slopes)


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

    @cached_property
    def _inverse(self) -> Inverse:
        with np.errstate(all="ignore"):
            return fit_inverse(self._polynomials)

    def solve(self, target: np.ndarray, height: np.ndarray, work: Workspace) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised lon, lat ``(2, n)`` and whether each converged; at most `EVALUATION.chunk` points."""
        if height.size < EVALUATION.nodes**3:  # fewer than are needed for the fit of the inverse
            lonlat, error = self._predict_by_affine(target, height), np.full(height.size, np.inf)
        else:
            lonlat, error = self._iterate_by_inverse(target, height, work)
        unsolved = np.flatnonzero(~(error <= EQUALITY.rounding))
        error[unsolved] = np.inf  # the next iteration starts at these positions, and computes their errors again
        self._iterate_by_newton(lonlat, error, unsolved, target, height, limit=np.inf, iterations=ITERATIONS.most)
        # far from the solution, or near a zero of the denominator: short steps from the centre of the RPC's domain
        failed = np.flatnonzero(~(error <= EVALUATION.accepted_px))
        lonlat[:, failed], error[failed] = 0.0, np.inf
        self._iterate_by_newton(lonlat, error, failed, target, height, limit=0.5, iterations=8 * ITERATIONS.most)
        return lonlat, error <= EVALUATION.accepted_px

    def _iterate_by_inverse(
        self, target: np.ndarray, height: np.ndarray, work: Workspace
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return lon, lat ``(2, n)`` and errors in px of Newton's iteration with the inverse's derivatives."""
        lonlat, slopes = self._predict(target, height, work)
        terms = work.terms(height.size)
        terms[1:3], terms[3] = lonlat, height
        for evaluation in range(1, EVALUATION.chord_evaluations + 1):
            ratios, _ = work.ratios(self._polynomials, terms)
            miss = np.subtract(target, ratios, out=ratios)
            error = np.abs(miss * self._scale_px).max(axis=0)
            still_open = height.size - np.count_nonzero(error <= EQUALITY.rounding)
            if evaluation == EVALUATION.chord_evaluations or still_open <= EQUALITY.negligible * height.size:
                break
            terms[1:3] += slopes[:2] * miss[0]
            terms[1:3] += slopes[2:] * miss[1]
        return terms[1:3].copy(), error

    def _predict(self, target: np.ndarray, height: np.ndarray, work: Workspace) -> tuple[np.ndarray, np.ndarray]:
        """Return approximate lon, lat ``(2, n)`` and their derivatives ``(4, n)`` by normalised sample, then line."""
        inverse, terms = self._inverse, work.terms(height.size)
        np.subtract(target, inverse.off, out=terms[1:3])
        terms[1:3] /= inverse.scale
        terms[3] = height
        outside = ~(np.abs(terms[1:4]).max(axis=0) <= EVALUATION.domain_margin)
        fill_monomials(terms)
        lonlat = multiply(inverse.lonlat, terms, np.empty((2, height.size)))
        slopes = multiply(inverse.slopes, terms[:QUADRATIC_TERMS], np.empty((4, height.size)))
        if outside.any():
            lonlat[:, outside] = self._predict_by_affine(target[:, outside], height[outside])
        return lonlat, slopes

    def _predict_by_affine(self, target: np.ndarray, height: np.ndarray) -> np.ndarray:
        return np.asarray(self._affine[:, :1] + self._affine[:, 1:3] @ target + self._affine[:, 3:] * height)

    def _iterate_by_newton(
        self, lonlat: np.ndarray, error: np.ndarray, places: np.ndarray, target: np.ndarray, height: np.ndarray,
        limit: float, iterations: int,
    ) -> None:  # fmt: skip
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
