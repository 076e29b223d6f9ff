"""Curves of jitter along the lines of a block's exposures, from the residuals of all image points together.

Measured minus computed image points y, in standard deviations, with the cameras and points of an adjustment::

    y = B x + A a + J d + e      B x: splines of the exposures' lines (`line_splines`), prior R / s^2
                                 A a: changes of the cameras' corrections, J d: of the points' positions in metres

A point's d is eliminated with an orthonormal basis N of the null space of J' (N' J = 0), together with its other
observations: its survey, heights of a surface or of laser points are further rows, each height with its own sigma. Two
rays have one equation for a point, across the epipolar line: vibration along it, or equal in both images, has no
equation and keeps its prior. The posterior of x has the precision matrix K = B' B / n + R, with the variance n of the
noise, 1 or more. Its constant and linear part is shared with the corrections, and cancels in B x + A a.

The priors R are damped vibrations (`line_splines`). Frequency, damping and standard deviation are equal for all images,
and nearly equal for both axes: where only differences of images are observed, their jitter is shared by them, and what
no ray shows of an axis is as large as on the other one. (A prior for each curve gives all of it to one image.) The
logarithms t of these parameters are unknown, with a wide normal distribution of their own. The most likely t has the
largest marginal likelihood, times that distribution::

    log p(y | t) = -(y' y - y' B x) / 2 n - log det K / 2 + log det R / 2 + constant

A few images can vibrate in nearly the same phase by chance: their differences are then small, and so is the standard
deviation. So t is uncertain, and its errors are part of those of the curves: each sample of the posterior has a t of
its own, normally distributed with the curvature of log p (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, 5.2 and 5.4.1; Rue, Martino and Chopin, J. R. Statist. Soc. B 71, 2009, 319-392). The robust weights of
the points are those of a strongly damped vibration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize, sparse, special
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import SuperLU, splu

from ...block.block import Image, Measurements, number_exposures
from ...block.jitter_curve import JitterCurve, JitterEstimate
from ...foundation.errors import InputError
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import threshold, thresholds
from ...refinement.model import estimate_priors
from ...refinement.stacked_cameras import linearise_images
from ..gauss_newton import Solution
from ..preparation.problem import Problem
from .line_splines import LineSpline


@thresholds
class JITTER_CURVES:
    """Limits for the estimation of jitter curves and for its convergence."""

    knots_in_period: int = threshold(6, "knots", "knots of the spline in the shortest period: 99.7 % of a sine remain")
    least_wave_px: float = threshold(
        0.05, "px", "smallest amplitude of a wave that is corrected", "amplitude 0.02 px of the Pleiades triplet"
    )
    least_spacing: float = threshold(8.0, "lines", "smallest distance between knots")
    start_px: float = threshold(1.0, "px", "initial standard deviation of a curve")
    dampings: tuple[float, ...] = threshold(
        (0.1, 1e-5), "", "initial dampings: a vibration over some periods, and nearly a sine"
    )
    spread: float = threshold(3.0, "", "a priori standard deviation of the logarithms of a prior's three parameters")
    axis_spread: float = threshold(0.3, "", "a priori standard deviation of their difference between the two axes")
    most_points: int = threshold(100_000, "points", "largest number in use; of more points, an even choice")
    samples: int = threshold(24, "samples", "samples of the posterior distribution for the precision of curves")
    settled_likelihood: float = threshold(0.3, "", "difference of log likelihoods at convergence")
    settled_px: float = threshold(0.03, "px", "RMS change of the curves at convergence", "smaller than an image error")
    most_parts: int = threshold(2, "parts", "successive corrections; the second removes remaining waves")


ROBUST_STEPS = 3  # in which the robust weights of points are updated


class _Rows(NamedTuple):
    """Equations without the points' positions: matrix of splines and cameras, right side, and each row's point."""

    matrix: sparse.csr_matrix
    right: np.ndarray
    point: np.ndarray


@dataclass(frozen=True, eq=False)
class _Place:
    """Position of an exposure's spline among the unknowns: samples from ``start`` on, followed by the lines."""

    spline: LineSpline
    start: int

    @property
    def stop(self) -> int:
        return self.start + 2 * self.spline.size


def estimate_jitter(
    problem: Problem, solution: Solution, measured: Measurements, spacing: Mapping[int, float], period: float,
    priors: np.ndarray | None = None,
) -> JitterEstimate:  # fmt: skip
    """Return the jitter curves of some exposures.

    problem, solution : the adjustment, whose measurements may contain earlier corrections
    measured : the block's measurements, without the corrections to be estimated
    spacing : lines between knots by the number of the exposure (`number_exposures`), in pixels of its scene
    period : lines of the strongest wave
    priors : those of an earlier estimate (`JitterEstimate`); by default the most likely ones
    Raises `InputError` if no exposure has measurements over the lines between two knots.
    """
    places, unknowns = _place_splines(problem, spacing)
    if not places:
        raise InputError(
            f"`jitter` {min(spacing.values()):g}: no image has measurements over so many lines: name fewer, or auto"
        )
    weighted = _WeightedPoints(_form_rows(problem, solution, measured, places, unknowns), places.values())
    start = np.array([2.0 * np.pi / period, 1.0, JITTER_CURVES.start_px] * 2) if priors is None else priors[0]
    for _ in range(ROBUST_STEPS):
        weighted.reweigh(_Fit(weighted, start))
    if priors is None:
        priors = find_priors(weighted, period)
    mean = _Fit(weighted, priors[0]).solved
    fits = [_Fit(weighted, prior) for prior in priors[1:]]
    sampled_curves = np.column_stack([fit.draw(number) - mean for number, fit in enumerate(fits)])
    curves: dict[str, JitterCurve] = {}
    samples: list[dict[str, JitterCurve]] = [{} for _ in range(JITTER_CURVES.samples)]
    exposures = number_exposures(problem.observations.images)
    for image, exposure in zip(problem.observations.images, exposures.tolist(), strict=True):
        if exposure not in places:
            continue
        first, last = _lines_of(image)
        matrix = places[exposure].spline.make_matrix(_scene_lines(image, np.arange(first, last + 1)))
        unknown_slice = slice(places[exposure].start, places[exposure].stop)
        shift = np.stack([matrix @ axis for axis in np.split(mean[unknown_slice], 2)], axis=1) / image.camera_pixel
        errors = (
            np.stack([matrix @ axis for axis in np.split(sampled_curves[unknown_slice], 2)], axis=1)
            / image.camera_pixel
        )
        sigma = np.sqrt(np.mean(errors**2, axis=2))
        curves[image.id] = JitterCurve(first, shift, sigma)
        for number, sample in enumerate(samples):
            sample[image.id] = JitterCurve(first, errors[:, :, number], sigma)
    return JitterEstimate(curves, tuple(samples), priors)


def _lines_of(image: Image) -> tuple[int, int]:
    _, _, first, last = image.domain_px
    return int(np.floor(first)), int(np.ceil(last))


def _scene_lines(image: Image, line: np.ndarray | float) -> np.ndarray:
    first = 0.0 if image.tile is None else image.tile.first[1]
    return np.asarray(first + image.camera_pixel * np.asarray(line))


def _place_splines(problem: Problem, spacing: Mapping[int, float]) -> tuple[dict[int, _Place], int]:
    """Return the splines of the exposures over the lines with measurements, and the number of all unknowns."""
    observations, places, start = problem.observations, dict[int, _Place](), 0
    exposures = number_exposures(observations.images)
    for exposure, lines in spacing.items():
        measured = [
            _scene_lines(image, observations.xy[rows, 1])
            for image, exposure_of_image, rows in zip(
                observations.images, exposures.tolist(), observations.by_image, strict=True
            )
            if exposure_of_image == exposure
        ]
        reach = np.concatenate(measured)
        if len(reach) < 2 or np.ptp(reach) < lines:
            continue
        first, last = float(reach.min()), float(reach.max())
        intervals = max(int(np.ceil((last - first) / lines)), 4)
        places[exposure] = _Place(LineSpline(first, (last - first) / intervals, intervals), start)
        start = places[exposure].stop
    return places, start + problem.observations.cameras * len(problem.camera.parameters)


class _PointTerms(NamedTuple):
    """Image points and their derivatives in units of their standard deviations, from a block's adjustment.

    right, by_ground, by_values : residuals (n, 2), derivatives (n, 2, 3) and (n, 2, p) by ground and cameras' values
    start, splines : (n, 2) first unknown and (n, 4) values of the splines, zero without a curve
    """

    right: np.ndarray
    by_ground: np.ndarray
    by_values: np.ndarray
    start: np.ndarray
    splines: np.ndarray


def _linearise_points(
    problem: Problem, solution: Solution, measured: Measurements, places: Mapping[int, _Place]
) -> _PointTerms:
    """Return residuals and derivatives of image points ``measured``, with an adjustment's cameras and points."""
    observations, camera = problem.observations, problem.camera
    values, ground = solution.state
    images, weight = observations.images, 1.0 / measured.sigma_px[observations.rows]
    at = linearise_images(
        camera, images, observations.image, observations.xy, values[observations.camera_of_image],
        ground[observations.point],
    )  # fmt: skip
    start, splines = np.zeros((observations.count, 2), dtype=np.int64), np.zeros((observations.count, 4))
    exposures = number_exposures(images).tolist()
    for image, exposure, rows in zip(images, exposures, observations.by_image, strict=True):
        if (place := places.get(exposure)) is not None:
            cell, factors = place.spline.evaluate(_scene_lines(image, observations.xy[rows, 1]))
            start[rows] = (place.start + cell)[:, None] + [0, place.spline.size]
            splines[rows] = factors * weight[rows, None] / image.camera_pixel
    return _PointTerms(
        weight[:, None] * (measured.xy[observations.rows] - at.computed), weight[:, None, None] * at.by_ground,
        weight[:, None, None] * at.by_values, start, splines,
    )  # fmt: skip


def _form_rows(
    problem: Problem, solution: Solution, measured: Measurements, places: Mapping[int, _Place], unknowns: int
) -> _Rows:
    """Return the equations of the points that are used; of very many points an even choice."""
    observations, ground, p = problem.observations, solution.state.ground, len(problem.camera.parameters)
    first_camera = unknowns - observations.cameras * p
    right, by_ground, by_values, start, splines = _linearise_points(problem, solution, measured, places)
    # Points measured on an exposure with a curve; their priors as square roots of the weight matrices
    usable = observations.contributing_points & np.isfinite(ground).all(axis=1)
    usable &= np.logical_and.reduceat(np.isfinite(right).all(axis=1), observations.first[:-1])
    usable &= np.logical_or.reduceat(splines.any(axis=1), observations.first[:-1])
    # Surveys as stated: their sigmas and rejections, estimated without these curves, are consequences of the jitter
    weighting, heights = solution.weighting, problem.height_observations
    priors = problem.survey_weighting(weighting.image, observations.survey_weight, weighting.points).points
    if heights is not None:  # jitter displaces the points, so that most heights deviate
        priors = heights.add_to_priors(priors, ground, solution.normals.inverse, by_cell=True)
    selected = np.flatnonzero(usable & ((np.diff(observations.first) > 1) | priors.held))
    selected = selected[:: max(-(-len(selected) // JITTER_CURVES.most_points), 1)]
    matrices, rights, points = [sparse.csr_matrix((0, unknowns))], [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    lengths = np.diff(observations.first)[selected]
    squares, vectors = np.linalg.eigh(priors.build_weight_matrices(selected, observed=True))
    roots = np.sqrt(np.maximum(squares, 0.0))[:, :, None] * vectors.swapaxes(1, 2)
    ranks = (squares > 1e-9 * np.maximum(squares[:, 2:], 1e-300)).sum(axis=1)  # observed coordinates come last
    misses = priors.compute_misclosures_m(ground[selected], selected)
    for k in np.unique(lengths).tolist():
        for rank in range(4):
            rows_of_kind = np.flatnonzero((lengths == k) & (ranks == rank))
            points_of_kind = selected[rows_of_kind]
            rows = observations.first[points_of_kind][:, None] + np.arange(k)
            of_prior = roots[rows_of_kind, 3 - rank :]
            jacobian = np.concatenate([by_ground[rows].reshape(len(points_of_kind), 2 * k, 3), of_prior], axis=1)
            observed = np.einsum("mij,mj->mi", of_prior, misses[rows_of_kind])
            y = np.concatenate([right[rows].reshape(len(points_of_kind), 2 * k), observed], axis=1)
            if not len(points_of_kind) or jacobian.shape[1] <= 3:
                continue
            basis = np.linalg.qr(jacobian, mode="complete")[0][:, :, 3:]
            count = basis.shape[2]
            of_rays = basis[:, : 2 * k].reshape(len(points_of_kind), k, 2, count)
            by_spline = np.einsum("mkar,mkj->mrkaj", of_rays, splines[rows])
            by_camera = np.einsum("mkar,mkap->mrkp", of_rays, by_values[rows])
            columns = np.broadcast_to(start[rows][:, None, :, :, None] + np.arange(4), by_spline.shape)
            cameras = first_camera + p * observations.camera[rows][:, None, :, None] + np.arange(p)
            data = np.concatenate([by_spline.reshape(-1, 8 * k), by_camera.reshape(-1, k * p)], axis=1)
            column_indices = np.concatenate(
                [columns.reshape(-1, 8 * k), np.broadcast_to(cameras, by_camera.shape).reshape(-1, k * p)], axis=1
            )
            pointers = np.arange(0, data.size + 1, data.shape[1])
            matrices.append(sparse.csr_matrix((data.ravel(), column_indices.ravel(), pointers), (len(data), unknowns)))
            rights.append(np.einsum("mir,mi->mr", basis, y).ravel())
            points.append(np.repeat(points_of_kind, count))
    drifts = _form_drift_rows(problem, solution, first_camera, unknowns)
    return _Rows(
        sparse.vstack([*matrices, drifts.matrix]).tocsr(), np.concatenate([*rights, drifts.right]),
        np.concatenate([*points, drifts.point]),
    )  # fmt: skip


def _form_drift_rows(problem: Problem, solution: Solution, first_camera: int, unknowns: int) -> _Rows:
    """Return the a priori drift of each camera as equations, each with a number below 0 instead of a point.

    Curves could explain all residuals of the GCPs on their lines: without it, they would leave the drifts free.
    """
    observations, camera = problem.observations, problem.camera
    _, image = np.unique(observations.camera_of_image, return_index=True)
    images = [observations.images[index] for index in image.tolist()]
    sigma = np.array([camera.prior_sigmas(one, estimate_priors(one)) for one in images])
    column = np.flatnonzero(np.broadcast_to(camera.drifts, sigma.shape))
    weight = 1.0 / sigma.ravel()[column]
    matrix = sparse.csr_matrix((weight, (np.arange(len(column)), first_camera + column)), (len(column), unknowns))
    return _Rows(matrix, -weight * solution.state.values.ravel()[column], -1 - np.arange(len(column)))


class _WeightedPoints:
    """The equations with robust weights, and what all priors share.

    root, right : equations and right side in standard deviations of a weight of 1; ``normal`` is root' root
    order : of the unknowns, for a small bandwidth of the normal matrix (Cuthill and McKee), the cameras last
    splines, prior_columns : of all curves, and the unknowns in that order that each row of their priors has
    """

    def __init__(self, rows: _Rows, places: Iterable[_Place]) -> None:
        self.rows, self.noise, self.splines = rows, 1.0, [place.spline for place in places for _ in "xy"]
        _, self.number = np.unique(rows.point, return_inverse=True)
        self.counts = np.bincount(self.number)
        sizes = [spline.size for spline in self.splines]
        starts = np.cumsum([0, *sizes])
        columns = np.vstack([start + one.prior_columns for start, one in zip(starts, self.splines, strict=False)])
        roots = self.form_prior(columns, np.ones(columns.shape))
        self.order = np.arange(roots.shape[1])
        normal = rows.matrix.T @ rows.matrix + roots.T @ roots
        self.order[: starts[-1]] = reverse_cuthill_mckee(
            normal[: starts[-1], : starts[-1]].tocsr(), symmetric_mode=True
        )
        self.prior_columns = np.argsort(self.order)[columns]
        self.weigh(np.zeros_like(rows.right))
        # A weak prior of the cameras: undetermined parameters (the block's position) stay unchanged
        squares = self.normal.diagonal()
        squares[: starts[-1]] = 0.0
        self.of_cameras = sparse.diags(1e-6 * np.maximum(squares, 1e-12 * max(squares.max(), 1e-12)))

    def form_prior(self, columns: np.ndarray, values: np.ndarray) -> sparse.csr_matrix:
        """Return the equations of the priors of all curves from their non-zero elements ``(n, 3)``."""
        shape = len(values), self.rows.matrix.shape[1]
        return sparse.csr_matrix((values.ravel(), columns.ravel(), np.arange(0, values.size + 1, 3)), shape)

    def weigh(self, residual: np.ndarray) -> None:
        """Set the robust weights of the points by their residuals."""
        length = np.sqrt(np.bincount(self.number, residual**2) / (self.counts * self.noise))
        self.weight = (1.0 / (1.0 + (length / ROBUST.outlier) ** 2))[self.number]
        root = np.sqrt(self.weight)
        self.root, self.right = (sparse.diags(root) @ self.rows.matrix)[:, self.order], root * self.rows.right
        self.normal, self.projected = (self.root.T @ self.root).tocsc(), self.root.T @ self.right

    def reweigh(self, fit: _Fit) -> None:
        """Set noise and robust weights by the residuals of a fit."""
        residual = self.rows.right - self.rows.matrix @ fit.solved
        errors = np.column_stack([fit.draw(number) - fit.solved for number in range(8)])[self.order]
        unsure = float(np.mean(np.sum((self.root @ errors) ** 2, axis=0)))
        # Noise is at least 1: dense matches agree better than stated, which does not improve GCPs and heights
        self.noise = max(float(self.weight @ residual**2 + unsure) / float(self.weight.sum()), 1.0)
        self.weigh(residual)


class _Fit:
    """Curves with a prior ``(6,)``: frequency, damping and standard deviation of either axis; ``solved``: unknowns."""

    def __init__(self, weighted: _WeightedPoints, prior: np.ndarray) -> None:
        self.weighted = weighted
        axes = prior.reshape(2, 3).tolist() * (len(weighted.splines) // 2)
        values = [
            spline.make_prior(frequency, damping) / sigma
            for spline, (frequency, damping, sigma) in zip(weighted.splines, axes, strict=True)
        ]
        self.root = weighted.form_prior(weighted.prior_columns, np.vstack(values))
        # The first three rows of F have the first three coefficients, and each further row has one more
        self.of_prior = 2.0 * sum(
            np.linalg.slogdet(one[:3])[1] + (len(one) - 3) * np.log(abs(one[3, 2])) for one in values
        )
        self._factor: SuperLU = splu(
            ((weighted.normal + weighted.of_cameras) / weighted.noise + self.root.T @ self.root).tocsc(),
            permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
        self.solved = self._solve(weighted.projected / weighted.noise)

    def compute_log_likelihood(self) -> float:
        """Return the logarithm of the marginal likelihood of the prior, but for a constant."""
        weighted = self.weighted
        fitted = float(weighted.projected @ self.solved[weighted.order])
        determinant = float(np.sum(np.log(np.abs(self._factor.U.diagonal()))))
        return -0.5 * ((float(weighted.right @ weighted.right) - fitted) / weighted.noise + determinant - self.of_prior)

    def draw(self, seed: int) -> np.ndarray:
        """Return a sample ``(unknowns,)`` of the posterior."""
        rng, weighted = np.random.default_rng([seed, 2]), self.weighted
        right = weighted.root.T @ rng.normal(0.0, 1.0, weighted.root.shape[0]) / np.sqrt(weighted.noise)
        return self.solved + self._solve(right + self.root.T @ rng.normal(0.0, 1.0, self.root.shape[0]))

    def _solve(self, right: np.ndarray) -> np.ndarray:
        solved = np.empty_like(right)
        solved[self.weighted.order] = self._factor.solve(right)
        return solved


def find_priors(weighted: _WeightedPoints, period: float) -> np.ndarray:
    """Return the most likely prior, and priors of samples: ``(1 + samples, 6)`` as of `_Fit`.

    The likelihood can have two maxima, for a sine and for a vibration that varies: both are sampled, by their shares.

    period : lines of the strongest wave
    """
    typical = np.log([2.0 * np.pi / period, np.sqrt(np.prod(JITTER_CURVES.dampings)), JITTER_CURVES.start_px])
    longest = max(spline.spacing * spline.intervals for spline in weighted.splines)
    steps = np.array([period / (2.0 * longest), -1.0, -0.5])  # half the resolution of the frequency

    one, none = np.eye(3), np.zeros((3, 3))
    of_block, second, of_axes = np.hstack([one, none]), np.hstack([none, one]), np.hstack([-one, one])
    weights = np.vstack([of_block / JITTER_CURVES.spread, of_axes / JITTER_CURVES.axis_spread])

    def compute_log_likelihood(x: np.ndarray) -> float:
        return _Fit(weighted, np.exp(x)).compute_log_likelihood()

    def compute_cost(x: np.ndarray) -> float:
        return 0.5 * float(np.sum((weights @ (x - np.tile(typical, 2))) ** 2)) - compute_log_likelihood(x)

    def minimise(x: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Return x with the least cost of those moved by multiples of ``moved (3, 6)``."""
        found = optimize.minimize(
            lambda parts: compute_cost(x + parts @ moved), np.zeros(3), method="Nelder-Mead",
            options={"initial_simplex": np.vstack([np.zeros(3), np.eye(3)]), "xatol": np.inf,
                     "fatol": JITTER_CURVES.settled_likelihood},
        )  # fmt: skip
        return np.asarray(x + found.x @ moved)

    starts = [np.tile([typical[0], np.log(damping), typical[2]], 2) for damping in JITTER_CURVES.dampings]
    modes = [
        minimise(minimise(start, np.diag(steps) @ (of_block + second)), np.diag(steps) @ second) for start in starts
    ]
    costs = np.array([compute_cost(mode) for mode in modes])
    modes = [modes[number] for number in np.flatnonzero(special.softmax(-costs) > 1.0 / JITTER_CURVES.samples)]
    roots, evidence = list[np.ndarray](), list[float]()
    for mode in modes:
        squares, vectors = np.linalg.eigh(-_compute_curvature(compute_log_likelihood, mode, 0.3 * np.tile(steps, 2)))
        information = vectors * np.maximum(squares, 0.0) @ vectors.T + weights.T @ weights
        roots.append(np.linalg.inv(np.linalg.cholesky(information)).T)
        evidence.append(float(np.linalg.slogdet(roots[-1])[1]) - compute_cost(mode))
    rng, best = np.random.default_rng(3), int(np.argmax(evidence))
    chosen = rng.choice(len(modes), JITTER_CURVES.samples, p=special.softmax(evidence))
    samples = [modes[mode] + roots[mode] @ rng.normal(0.0, 1.0, 6) for mode in chosen.tolist()]
    return np.exp(np.vstack([modes[best], *samples]))


def _compute_curvature(function: Callable[[np.ndarray], float], x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the second derivatives ``(n, n)`` of a function at x by differences over steps ``(n,)``."""
    curvature, moves = np.zeros((len(x), len(x))), np.diag(steps)
    for row, column in zip(*np.tril_indices(len(x)), strict=True):
        corners = [function(x + p * moves[row] + q * moves[column]) * p * q for p in (1.0, -1.0) for q in (1.0, -1.0)]
        curvature[row, column] = curvature[column, row] = sum(corners) / (4.0 * steps[row] * steps[column])
    return curvature
