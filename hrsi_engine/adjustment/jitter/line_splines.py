"""Cubic B-splines along the lines of an exposure, and the prior of their smoothness.

On knots at a spacing h a function of the line is f = sum of B_j x_j, with four B_j different from zero at each line.
Its prior is a damped vibration that white noise w excites (a continuous autoregression of order 2). With the standard
deviation s, the angular frequency k and the damping a > 0 it is::

    f'' + 2 sqrt(a) k f' + k^2 f = sqrt(4 k^3 sqrt(a)) s w      at the first line: f ~ N(0, s^2), f' ~ N(0, k^2 s^2)

For a = 1 it is the Matern process of smoothness 3/2, whose correlation falls to 0.14 at the range sqrt(12) / k; a small
a is a vibration with periods about 2 pi / k in a band of the relative half width sqrt(a), and without damping it is a
sine. The equation applies at the knots, with w / sqrt(h): together with the two values of the first line these are as
many equations F as coefficients, and the precision matrix is R = F' F, which is banded. At the knots, splines of a
sine have a curvature of other size than its own, which k^2 f is multiplied by.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse


@dataclass(frozen=True, eq=False)
class LineSpline:
    """The splines over lines ``first`` to ``first + intervals * spacing``."""

    first: float
    spacing: float
    intervals: int

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.intervals + 3

    @property
    def last(self) -> float:
        """The last line."""
        return self.first + self.spacing * self.intervals

    def evaluate(self, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the first of the four splines at each line ``(n,)`` and the values of the four ``(n, 4)``."""
        place = np.clip((np.asarray(line) - self.first) / self.spacing, 0.0, self.intervals)
        cell = np.minimum(place.astype(np.int64), self.intervals - 1)
        t = place - cell
        columns = (1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6
        return cell, np.stack(columns, axis=-1)

    def make_matrix(self, line: np.ndarray) -> sparse.csr_matrix:
        """Return the values of all splines at lines ``(n, size)``."""
        cell, values = self.evaluate(line)
        columns = cell[:, None] + np.arange(4)
        return sparse.csr_matrix(
            (values.ravel(), columns.ravel(), np.arange(0, values.size + 1, 4)), (len(cell), self.size)
        )

    def make_prior(self, frequency: float, damping: float) -> np.ndarray:
        """Return F ``(size, 3)`` for a standard deviation of 1, whose rows belong to the columns of `prior_columns`."""
        k, a, h = frequency, damping, self.spacing
        value, slope, curvature = (
            np.array([1, 4, 1]) / 6.0,
            np.array([-1, 0, 1]) / (2.0 * h),
            np.array([1, -2, 1]) / h**2,
        )
        cosine = np.cos(min(k * h, np.pi))
        square = 6.0 * (1.0 - cosine) / (h**2 * (2.0 + cosine))
        equation = np.sqrt(h / (4.0 * k**3 * np.sqrt(a))) * (square * value + 2.0 * np.sqrt(a) * k * slope + curvature)
        return np.vstack([value, slope / k, np.tile(equation, (self.intervals + 1, 1))])

    @property
    def prior_columns(self) -> np.ndarray:
        """The coefficients ``(size, 3)`` of the rows of `make_prior`."""
        return np.maximum(np.arange(self.size) - 2, 0)[:, None] + np.arange(3)
