"""Jitter curves by their equations and priors, and the priors by their marginal likelihood.

The priors R are damped vibrations (`line_splines`). Frequency, damping and standard deviation are equal for all images,
and nearly equal for both axes: where only differences of images are observed, their jitter is shared by them, and what
no ray shows of an axis is as large as on the other one. (A prior for each curve gives all of it to one image.) The
logarithms t of these parameters are unknown, with a wide normal distribution of their own. The most likely t has the
largest marginal likelihood, times that distribution::

    log p(y | t) = -(y' y - y' B x) / 2 n - log det K / 2 + log det R / 2 + constant

A few images can vibrate in nearly the same phase by chance: their differences are then small, and so is the standard
deviation. So t is uncertain, and its errors are part of those of the curves: each sample of the posterior has a t of
its own. It comes from a Metropolis chain (Tierney, Ann. Statist. 22, 1994, 1701-1762, independence chain) that proposes
from normal distributions with the curvature of log p at its maxima (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, 5.2 and 5.4.1; Rue, Martino and Chopin, J. R. Statist. Soc. B 71, 2009, 319-392). The robust
weights of the points are those of a strongly damped vibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize, sparse, special
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import threshold, thresholds
from .line_splines import LineSpline


@thresholds
class JITTER_PRIORS:
    """Limits for the search for priors of jitter curves, and for the samples of their distribution."""

    start_px: float = threshold(1.0, "px", "initial standard deviation of a curve")
    dampings: tuple[float, ...] = threshold(
        (0.1, 1e-5), "", "initial dampings: a vibration over some periods, and nearly a sine"
    )
    spread: float = threshold(3.0, "", "a priori standard deviation of the logarithms of a prior's three parameters")
    axis_spread: float = threshold(0.3, "", "a priori standard deviation of their difference between the two axes")
    samples: int = threshold(24, "samples", "samples of the posterior distribution for the precision of curves")
    settled_likelihood: float = threshold(0.3, "", "difference of log likelihoods at convergence")


class EquationRows(NamedTuple):
    """Equations without the points' positions: matrix of splines and cameras, right side, and each row's point."""

    matrix: sparse.csr_matrix
    right: np.ndarray
    point: np.ndarray


class WeightedPoints:
    """The equations with robust weights, and what all priors share.

    Unknowns are in the order of ``order``: the s coefficients of the splines for a small bandwidth (Cuthill and McKee),
    then the c parameters of the cameras. Of the normal matrix, ``band (bandwidth + 1, s)`` is the lower part of the
    splines' block by its diagonals, as LAPACK stores it, ``border (s, c)`` and ``corner (c, c)`` belong to the cameras.

    root, right : equations and right side in standard deviations of a weight of 1; ``projected`` is root' right
    splines : of each exposure, the samples' and the lines'
    prior_columns : unknowns in that order of each row of the priors
    """

    def __init__(self, rows: EquationRows, splines: Sequence[LineSpline]) -> None:
        self.right, self.noise, self.splines = rows.right, 1.0, splines
        _, self.number = np.unique(rows.point, return_inverse=True)
        self.counts = np.bincount(self.number)
        starts = np.cumsum([0, *(spline.size for spline in splines)])
        self.size = size = int(starts[-1])
        columns = np.vstack([start + one.prior_columns for start, one in zip(starts, splines, strict=False)])
        pattern = sparse.csr_matrix((np.ones(columns.size), columns.ravel(), np.arange(0, columns.size + 1, 3)))
        pattern = pattern.T @ pattern + rows.matrix[:, :size].T @ rows.matrix[:, :size]
        self.order = np.arange(rows.matrix.shape[1])
        self.order[:size] = reverse_cuthill_mckee(pattern.tocsr(), symmetric_mode=True)
        place = np.argsort(self.order)
        self.matrix, self.prior_columns = rows.matrix[:, self.order], place[columns]
        row, column = place[np.array(pattern.nonzero())]
        self.diagonals = int(np.abs(row - column).max()) + 1
        # Elements of the band from products of two elements of a prior's row, those of the upper part left out
        row, column = self.prior_columns[:, :, None], self.prior_columns[:, None, :]
        self.is_lower = row >= column
        self.band_index = ((row - column) * size + column)[self.is_lower]
        self.weigh(np.zeros_like(rows.right))
        # A weak prior of the cameras: undetermined parameters (the block's position) stay unchanged
        squares = np.diag(self.corner)
        self.of_cameras = np.diag(1e-6 * np.maximum(squares, 1e-12 * max(squares.max(initial=0.0), 1e-12)))

    def weigh(self, residual: np.ndarray) -> None:
        """Set the robust weights of the points by their ``residual (rows,)``: Cauchy's, of the RMS of their rows."""
        length = np.sqrt(np.bincount(self.number, residual**2) / (self.counts * self.noise))
        self.weight = (1.0 / (1.0 + (length / ROBUST.outlier) ** 2))[self.number]
        self.root = sparse.diags(np.sqrt(self.weight)) @ self.matrix
        self.projected = self.matrix.T @ (self.weight * self.right)
        normal, size = (self.root.T @ self.root).tocsc(), self.size
        lower = sparse.tril(normal[:size, :size]).tocoo()
        self.band = np.zeros((self.diagonals, size))
        self.band[lower.row - lower.col, lower.col] = lower.data
        self.border, self.corner = normal[:size, size:].toarray(), normal[size:, size:].toarray()

    def reweigh(self, fit: CurveFit) -> None:
        """Set noise and robust weights by the residuals of a fit."""
        residual = self.right - self.matrix @ fit.solved
        errors = np.column_stack([fit.draw(number) - fit.solved for number in range(8)])
        unsure = float(np.mean(np.sum((self.root @ errors) ** 2, axis=0)))
        # Noise is at least 1: dense matches agree better than stated, which does not improve GCPs and heights
        self.noise = max(float(self.weight @ residual**2 + unsure) / float(self.weight.sum()), 1.0)
        self.weigh(residual)


class CurveFit:
    """Curves with a prior ``(6,)``: frequency, damping and standard deviation of either axis.

    The splines are eliminated by the Cholesky factor L of their band, whose border becomes Z = L^-1 border.
    ``solved`` are the unknowns in the order of `WeightedPoints`.
    """

    def __init__(self, weighted: WeightedPoints, prior: np.ndarray) -> None:
        self.weighted = weighted
        axes = prior.reshape(2, 3).tolist() * (len(weighted.splines) // 2)
        rows_of_splines = [
            spline.make_prior(frequency, damping) / sigma
            for spline, (frequency, damping, sigma) in zip(weighted.splines, axes, strict=True)
        ]
        self._prior_rows = np.vstack(rows_of_splines)
        # The priors' part of the normal matrix, as a band from the non-zero elements (n, 3) of their rows
        products = (self._prior_rows[:, :, None] * self._prior_rows[:, None, :])[weighted.is_lower]
        of_priors = np.bincount(weighted.band_index, products, weighted.band.size).reshape(weighted.band.shape)
        band = weighted.band / weighted.noise + of_priors
        self._factor = linalg.cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        self._border = self._divide(weighted.border / weighted.noise)
        self._corner = (weighted.corner + weighted.of_cameras) / weighted.noise - self._border.T @ self._border
        # The first three rows of F have the first three coefficients, and each further row has one more
        log_root_prior = sum(
            np.linalg.slogdet(rows[:3])[1] + (len(rows) - 3) * np.log(abs(rows[3, 2])) for rows in rows_of_splines
        )
        log_root_band = float(np.sum(np.log(self._factor[0])))
        self._log_determinants = 2.0 * (log_root_band - log_root_prior) + np.linalg.slogdet(self._corner)[1]
        self.solved = self._solve(weighted.projected / weighted.noise)

    def compute_log_likelihood(self) -> float:
        """Return the logarithm of the marginal likelihood of the prior, but for a constant.

        It is -(y' P y / n - y' P B x / n + log det K - log det R) / 2 at the solution x, with the weights P of the
        points.
        """
        weighted = self.weighted
        misfit = float(weighted.weight @ weighted.right**2 - weighted.projected @ self.solved) / weighted.noise
        return -0.5 * (misfit + self._log_determinants)

    def draw(self, seed: int) -> np.ndarray:
        """Return a sample ``(unknowns,)`` of the posterior."""
        rng, weighted = np.random.default_rng([seed, 2]), self.weighted
        right = weighted.root.T @ rng.normal(0.0, 1.0, weighted.root.shape[0]) / np.sqrt(weighted.noise)
        of_prior = self._prior_rows * rng.normal(0.0, 1.0, (len(self._prior_rows), 1))
        right += np.bincount(weighted.prior_columns.ravel(), of_prior.ravel(), len(right))
        return self.solved + self._solve(right)

    def _solve(self, right: np.ndarray) -> np.ndarray:
        """Return the unknowns for a right side ``(unknowns,)``, by the splines' factor and the cameras' complement."""
        size = self.weighted.size
        reduced = self._divide(right[:size])
        cameras = np.linalg.solve(self._corner, right[size:] - self._border.T @ reduced)
        return np.concatenate([self._divide(reduced - self._border @ cameras, "T"), cameras])

    def _divide(self, right: np.ndarray, transposed: str = "N") -> np.ndarray:
        """Return L^-1 right, or L'^-1 right if ``transposed`` is T, with the shape of ``right (s, …)``."""
        return np.asarray(linalg.lapack.dtbtrs(self._factor, right, uplo="L", trans=transposed)[0]).reshape(right.shape)


class _Posterior:
    """Distribution of the logarithms x ``(6,)`` of a prior (`CurveFit`), whose density is exp(-cost).

    period : lines of the strongest wave, which is the typical period of the curves
    """

    def __init__(self, weighted: WeightedPoints, period: float) -> None:
        self.weighted = weighted
        typical = [2.0 * np.pi / period, np.sqrt(np.prod(JITTER_PRIORS.dampings)), JITTER_PRIORS.start_px]
        self.typical = np.tile(np.log(typical), 2)
        longest = max(spline.spacing * spline.intervals for spline in weighted.splines)
        self.steps = np.array([period / (2.0 * longest), -1.0, -0.5])  # half the resolution of the frequency
        one = np.eye(3)
        self.weights = np.block([[one / JITTER_PRIORS.spread, 0.0 * one], [-one / JITTER_PRIORS.axis_spread] * 2])
        self.weights[3:, 3:] *= -1.0

    def compute_log_likelihood(self, x: np.ndarray) -> float:
        """Return the logarithm of the marginal likelihood."""
        return CurveFit(self.weighted, np.exp(x)).compute_log_likelihood()

    def compute_cost(self, x: np.ndarray) -> float:
        """Return the negative logarithm of the density, but for a constant."""
        return 0.5 * float(np.sum((self.weights @ (x - self.typical)) ** 2)) - self.compute_log_likelihood(x)

    def minimise(self, x: np.ndarray, axes: Sequence[int]) -> np.ndarray:
        """Return x with the least cost, whose three parameters are changed equally on some axes."""
        moves = np.hstack([np.diag(self.steps) * (axis in axes) for axis in (0, 1)])
        found = optimize.minimize(
            lambda parts: self.compute_cost(x + parts @ moves),
            np.zeros(3),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([np.zeros(3), np.eye(3)]),
                "xatol": np.inf,
                "fatol": JITTER_PRIORS.settled_likelihood,
            },
        )
        return np.asarray(x + found.x @ moves)

    def approximate(self, mode: np.ndarray) -> np.ndarray:
        """Return the root L ``(6, 6)`` of the covariance L L' of a normal distribution about a minimum ``mode (6,)``.

        It is Laplace's approximation, with the second derivatives of the likelihood by central differences.
        """
        # Second derivatives of the logarithm by central differences
        steps = 0.3 * np.tile(self.steps, 2)
        at_mode, moves = self.compute_log_likelihood(mode), np.diag(steps)

        def rise(move: np.ndarray) -> float:
            return 0.5 * (self.compute_log_likelihood(mode + move) + self.compute_log_likelihood(mode - move)) - at_mode

        single = np.array([rise(move) for move in moves])
        curvature = np.diag(single)
        for row, column in zip(*np.tril_indices(len(mode), -1), strict=True):
            both = 0.5 * (rise(moves[row] + moves[column]) - single[row] - single[column])
            curvature[row, column] = curvature[column, row] = both
        curvature = 2.0 * curvature / np.outer(steps, steps)
        squares, vectors = np.linalg.eigh(-curvature)
        information = vectors * np.maximum(squares, 0.0) @ vectors.T + self.weights.T @ self.weights
        return np.asarray(np.linalg.inv(np.linalg.cholesky(information)).T)


def sample_priors(weighted: WeightedPoints, period: float) -> np.ndarray:
    """Return the most likely prior, and samples of its distribution: ``(1 + samples, 6)``.

    period : lines of the strongest wave
    """
    posterior, rng = _Posterior(weighted, period), np.random.default_rng(3)
    # The minima of the cost, the least first: a sine and a vibration that varies can both be likely
    starts = [
        posterior.typical + np.tile([0.0, np.log(damping) - posterior.typical[1], 0.0], 2)
        for damping in JITTER_PRIORS.dampings
    ]
    minima = [posterior.minimise(start, (0, 1)) for start in starts]
    costs = np.array([posterior.compute_cost(minimum) for minimum in minima])
    modes = list[np.ndarray]()
    for number in np.argsort(costs).tolist():
        is_likely = costs[number] - costs.min() <= np.log(JITTER_PRIORS.samples)
        if is_likely and all(np.abs(minima[number] - mode)[:3].max() > 1.0 for mode in modes):
            modes.append(posterior.minimise(minima[number], (1,)))
    roots = [posterior.approximate(mode) for mode in modes]
    volumes = np.array([np.linalg.slogdet(root)[1] for root in roots])
    shares = special.softmax(
        [volume - posterior.compute_cost(mode) for volume, mode in zip(volumes, modes, strict=True)]
    )

    def compute_log_weight(x: np.ndarray) -> float:
        """Return the logarithm of the density over that of the proposals."""
        squares = [np.sum(np.linalg.solve(root, x - mode) ** 2) for root, mode in zip(roots, modes, strict=True)]
        return -posterior.compute_cost(x) - float(special.logsumexp(-0.5 * np.array(squares) - volumes, b=shares))

    samples = [modes[0]]
    log_weight = compute_log_weight(modes[0])
    for number in rng.choice(len(modes), JITTER_PRIORS.samples, p=shares).tolist():
        proposed = modes[number] + roots[number] @ rng.normal(0.0, 1.0, 6)
        proposed_weight = compute_log_weight(proposed)
        is_accepted = np.log(rng.random()) < proposed_weight - log_weight
        samples.append(proposed if is_accepted else samples[-1])
        log_weight = proposed_weight if is_accepted else log_weight
    return np.exp(samples)
