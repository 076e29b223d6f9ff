"""Cubic B-splines along the lines of an exposure, and the prior of their smoothness.

On knots at a spacing h a function of the line is f = sum of B_j x_j, with four B_j different from zero at each line.
Its prior is a Gaussian process, the solution of a stochastic differential equation (Lindgren, Rue and Lindstroem, J. R.
Statist. Soc. B 73, 2011, 423-498, with the oscillating fields of 3.3). With the standard deviation s, the angular
frequency k and the damping a, 0 < a <= 1, the precision matrix R of x is that of

    x' R x = (1 / (4 k^3 s^2 sqrt(a))) times the integral of k^4 f^2 + 2 (2 a - 1) k^2 f'^2 + f''^2

For a = 1 it is the Matern process of smoothness 3/2, whose correlation falls to 0.14 at the range r = sqrt(12) / k; a
small a is a vibration with periods about 2 pi / k in a band of the relative half width sqrt(a). Except for terms at the
ends, R is the sum of a times that of a = 1, and of 1 - a times the square of k^2 f + f'', the equation of a vibration.
R is banded. Functions without constant and linear part fulfil Q x = 0, Q the integrals of the B_j times the Legendre
polynomials of degree 0 and 1; further degrees if waves are short relative to the lines.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU

LOW_DEGREES = 2  # constant and linear, which RPC corrections contain
MOST_LOW_DEGREES = 4  # up to the cubic
NODES = 48  # lines over which a variance is averaged, which changes near the ends


@dataclass(frozen=True, eq=False)
class LineSpline:
    """The splines over lines ``first`` to ``first + intervals * spacing``."""

    first: float
    spacing: float
    intervals: int
    degrees: int = LOW_DEGREES

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.intervals + 3

    @property
    def last(self) -> float:
        """The last line."""
        return self.first + self.spacing * self.intervals

    def make_lines(self) -> np.ndarray:
        """Return lines over the whole range, four between two knots."""
        return np.linspace(self.first, self.last, 4 * self.intervals + 1)

    def evaluate(self, line: np.ndarray, derivative: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return the first of the four splines at each line ``(n,)`` and the values of the four ``(n, 4)``."""
        place = np.clip((np.asarray(line) - self.first) / self.spacing, 0.0, self.intervals)
        cell = np.minimum(place.astype(np.int64), self.intervals - 1)
        t = place - cell
        one = np.ones_like(t)
        columns = (
            ((1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6),
            (-((1 - t) ** 2) / 2, (3 * t**2 - 4 * t) / 2, (-3 * t**2 + 2 * t + 1) / 2, t**2 / 2),
            (one - t, 3 * t - 2, one - 3 * t, t),
        )[derivative]
        return cell, np.stack(columns, axis=-1) / self.spacing**derivative

    def make_matrix(self, line: np.ndarray, derivative: int = 0) -> sparse.csr_matrix:
        """Return the values of all splines at lines ``(n, size)``."""
        cell, values = self.evaluate(line, derivative)
        columns = cell[:, None] + np.arange(4)
        return sparse.csr_matrix(
            (values.ravel(), columns.ravel(), np.arange(0, values.size + 1, 4)), (len(cell), self.size)
        )

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Lines and weights of a Gaussian quadrature that is exact for products of two splines."""
        x, weight = np.polynomial.legendre.leggauss(4)
        line = self.first + self.spacing * (np.arange(self.intervals)[:, None] + (x + 1.0) / 2.0)
        return line.ravel(), np.tile(weight * self.spacing / 2.0, self.intervals)

    def make_prior_root(self, frequency: float, damping: float) -> sparse.csr_matrix:
        """Return F with ``F' F = R`` for a standard deviation of 1."""
        line, weight = self._nodes
        k, a = frequency, damping
        values = [sparse.diags(np.sqrt(weight)) @ self.make_matrix(line, derivative) for derivative in range(3)]
        parts = [np.sqrt(a) * k**2 * values[0], np.sqrt(2.0 * a) * k * values[1], np.sqrt(a) * values[2]]
        if a < 1.0:
            parts.append(np.sqrt(1.0 - a) * (k**2 * values[0] + values[2]))
        return (sparse.vstack(parts) / np.sqrt(4.0 * k**3 * np.sqrt(a))).tocsr()

    @cached_property
    def low_degrees(self) -> np.ndarray:
        """Q ``(degrees, size)`` of the module's docstring, rows scaled to unit length."""
        line, weight = self._nodes
        t = 2.0 * (line - self.first) / (self.spacing * self.intervals) - 1.0
        legendre = np.polynomial.legendre.legvander(t, self.degrees - 1)
        rows = (self.make_matrix(line).T @ (weight[:, None] * legendre)).T
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))

    def compute_mean_variance(self, prior: SuperLU, low: np.ndarray) -> float:
        """Return the mean variance over the lines of curves with ``low (d, size) @ x = 0``, ``prior`` factors R."""
        basis = self.make_matrix(self.first + self.spacing * self.intervals * (np.arange(NODES) + 0.5) / NODES)
        spread = prior.solve(basis.T.toarray())
        projected = low @ spread
        absorbed = np.sum(projected * np.linalg.solve(low @ prior.solve(low.T.copy()), projected))
        return float(np.sum(basis.T.multiply(spread)) - absorbed) / NODES
