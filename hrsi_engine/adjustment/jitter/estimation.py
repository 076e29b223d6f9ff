"""Curves of jitter along the lines of a block's exposures, from the residuals of all image points together.

Measured minus computed image points y, in standard deviations, with the cameras and points of an adjustment::

    y = B x + A a + J d + e      B x: splines of the exposures' lines (`line_splines`), prior R / s^2
                                 A a: changes of the cameras' corrections, J d: of the points' positions in metres

A point's d is eliminated with an orthonormal basis N of the null space of J' (N' J = 0), together with its other
observations: its survey, heights of a surface or of laser points are further rows, each height with its own sigma. Two
rays have one equation for a point, across the epipolar line: vibration along it, or equal in both images, has no
equation and keeps its prior. The curves have no constant and linear part, which belong to the corrections (Q x = 0 by
conditioning, Rue and Held, Gaussian Markov Random Fields, 2005, 2.3.3). They also have no cubic part if waves are short
and observations are few, so that few GCPs do not bend the block. The posterior has the precision matrix K = B' B / n +
R / s^2, with the variance n of the noise, 1 or more. All curves have one variance s^2: where only differences of images
are observed, their jitter is shared by them. (A variance for each curve gives all of it to one image.) It is iterated
by expectation maximisation (Dempster, Laird and Rubin, J. R. Statist. Soc. B 39, 1977, 1-38): the mean square of the
curves and of samples of their error, on the axis that is better observed, whose variance is also used for the other
one, over the share of the prior's variance that remains under Q x = 0. Several priors are tested, and that with the
largest marginal likelihood is used. They share the robust weights of the points, which are those of the first one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse, special
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import SuperLU, splu

from ...block.block import Image, Measurements, number_exposures
from ...block.jitter_curve import JitterCurve, JitterEstimate
from ...foundation.errors import InputError
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, ITERATIONS, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ...refinement.model import estimate_priors
from ...refinement.stacked_cameras import linearise_images
from ..gauss_newton import Solution
from ..preparation.problem import Problem
from .line_splines import LOW_DEGREES, MOST_LOW_DEGREES, LineSpline


@thresholds
class JITTER_CURVES:
    """Limits for the estimation of jitter curves and for its convergence."""

    knots_in_period: int = threshold(6, "knots", "knots of the spline in the shortest period: 99.7 % of a sine remain")
    least_wave_px: float = threshold(
        0.05, "px", "smallest amplitude of a wave that is corrected", "amplitude 0.02 px of the Pleiades triplet"
    )
    least_spacing: float = threshold(8.0, "lines", "smallest distance between knots")
    ranges: tuple[float, ...] = threshold(
        (0.5, 1.0), "", "correlation lengths of priors without a period, in periods of the strongest wave"
    )
    damping: tuple[float, ...] = threshold((0.3, 0.1, 0.02), "", "damping ratios of priors with its period, in turn")
    start_px: float = threshold(1.0, "px", "initial standard deviation of a curve")
    least_px: float = threshold(0.003, "px", "smallest sigma of a curve: a smaller one has no effect")
    settled_variance: float = threshold(0.03, "", "relative change of the variance at convergence")
    weak: float = threshold(
        0.5, "", "posterior variance of an axis's curve relative to the prior one, above which it has no cubic part"
    )
    most_points: int = threshold(100_000, "points", "largest number in use; of more points, an even choice")
    samples: int = threshold(24, "samples", "samples of the posterior distribution for the precision of curves")
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
    prior: tuple[float, float, float] | None = None,
) -> JitterEstimate:  # fmt: skip
    """Return the jitter curves of some exposures.

    problem, solution : the adjustment, whose measurements may contain earlier corrections
    measured : the block's measurements, without the corrections to be estimated
    spacing : lines between knots by the number of the exposure (`number_exposures`), in pixels of its scene
    period : lines of the strongest wave
    prior : that of an earlier estimate (`JitterEstimate`); by default the most likely of several
    Raises `InputError` if no exposure has measurements over the lines between two knots.
    """
    places, unknowns = _place_splines(problem, spacing, period)
    if not places:
        raise InputError(
            f"`jitter` {min(spacing.values()):g}: no image has measurements over so many lines: name fewer, or auto"
        )
    rows = _form_rows(problem, solution, measured, places, unknowns)
    splines, priors = list(places.values()), [prior[:2]] if prior else list_priors(period)
    weighted, variance = _WeightedPoints(rows, splines, priors[0]), (prior[2] if prior else JITTER_CURVES.start_px) ** 2
    fits = list[tuple[float, float, _Fit]]()
    for number, one in enumerate(priors):
        weighted.noise = fits[0][1] if fits else 1.0
        fit = _Fit(weighted, splines, one, variance)
        fit.iterate(0 if number else ROBUST_STEPS - (prior is not None))
        variance = fit.variance
        fits.append((fit.compute_log_likelihood(), weighted.noise, fit))
    _, weighted.noise, likely = max(fits, key=lambda one: one[0])
    mean, sampled_curves = likely.solved, likely.draw(JITTER_CURVES.samples)
    sampled_curves = likely.compare_with_surveys(problem.observations.surveyed) * sampled_curves
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
    return JitterEstimate(curves, tuple(samples), (*likely.prior, float(np.sqrt(likely.variance))))


def list_priors(period: float) -> list[tuple[float, float]]:
    """Return frequencies and dampings (`line_splines`) of the priors to be tested."""
    smooth = [(np.sqrt(12.0) / (share * period), 1.0) for share in JITTER_CURVES.ranges]
    return [*smooth, *((2.0 * np.pi / period, damping) for damping in JITTER_CURVES.damping)]


def _lines_of(image: Image) -> tuple[int, int]:
    _, _, first, last = image.domain_px
    return int(np.floor(first)), int(np.ceil(last))


def _scene_lines(image: Image, line: np.ndarray | float) -> np.ndarray:
    first = 0.0 if image.tile is None else image.tile.first[1]
    return np.asarray(first + image.camera_pixel * np.asarray(line))


def _place_splines(problem: Problem, spacing: Mapping[int, float], period: float) -> tuple[dict[int, _Place], int]:
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
        # A polynomial of degree d has d / 2 oscillations: longer than half of them is no jitter
        degrees = int(np.clip((last - first) / period, LOW_DEGREES, MOST_LOW_DEGREES))
        places[exposure] = _Place(LineSpline(first, (last - first) / intervals, intervals, degrees), start)
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
    """The equations with robust weights, and the parts of the solution that all priors share.

    root, right : equations and right side in standard deviations of a weight of 1; ``normal`` is root' root
    order : of the unknowns, for a small bandwidth of the normal matrix (Cuthill and McKee), the cameras last
    """

    def __init__(self, rows: _Rows, places: list[_Place], prior: tuple[float, float]) -> None:
        """Prepare the equations; any ``prior`` will do: the matrices of all have the same non-zero elements."""
        self.rows, self.noise, splines = rows, 1.0, places[-1].stop
        _, self.number = np.unique(rows.point, return_inverse=True)
        self.counts = np.bincount(self.number)
        self.weigh(np.zeros_like(rows.right))
        # A weak prior of the cameras: undetermined parameters (the block's position) stay unchanged
        squares = self.normal.diagonal()[splines:]
        self.of_cameras = 1e-6 * np.maximum(squares, 1e-12 * max(squares.max(initial=0.0), 1e-12))
        of_axes = [root.T @ root for place in places for root in [place.spline.make_prior_root(*prior)] * 2]
        pattern = (self.normal[:splines, :splines] + sparse.block_diag(of_axes)).tocsr()
        self.order = np.arange(self.normal.shape[0])
        self.order[:splines] = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        self.weak = dict[int, bool]()  # by the first unknown of an axis: True if its curve is mostly prior

    def weigh(self, residual: np.ndarray) -> None:
        """Set the robust weights of the points by their residuals."""
        length = np.sqrt(np.bincount(self.number, residual**2) / (self.counts * self.noise))
        self.weight = (1.0 / (1.0 + (length / ROBUST.outlier) ** 2))[self.number]
        root, self.root = np.sqrt(self.weight), self.rows.matrix.copy()
        self.root.data *= np.repeat(root, np.diff(self.root.indptr))
        self.right = root * self.rows.right
        self.normal, self.projected = (self.root.T @ self.root).tocsc(), self.root.T @ self.right
        self.noisy = dict[int, np.ndarray]()

    def draw(self, count: int) -> np.ndarray:
        """Return samples of root' e, the same ones at each call."""
        if count not in self.noisy:
            rng = np.random.default_rng([count, 1])
            self.noisy[count] = self.root.T @ rng.normal(0.0, 1.0, (self.root.shape[0], count))
        return self.noisy[count]


class _Fit:
    """Curves with one prior: `iterate` estimates their variance, ``solved`` are the unknowns."""

    def __init__(
        self, weighted: _WeightedPoints, places: list[_Place], prior: tuple[float, float], variance: float
    ) -> None:
        self.weighted, self.places, self.prior, self.variance = weighted, places, prior, variance
        roots = [place.spline.make_prior_root(*prior) for place in places]
        self.roots, self.precisions = roots, [(root.T @ root).tocsc() for root in roots]
        self.along = [place.spline.make_matrix(place.spline.make_lines()) for place in places]
        self.of_priors = [splu(one) for one in self.precisions]
        self.set_low_degrees()
        self.noisy = dict[int, np.ndarray]()

    def set_low_degrees(self) -> None:
        """Form Q of all axes: without cubic part for weakly observed curves, which could bend heights to fit noise."""
        weak = self.weighted.weak
        self.low_of_axes = [
            place.spline.low_degrees[: None if weak.get(start) else LOW_DEGREES]
            for place in self.places for start in (place.start, place.start + place.spline.size)
        ]  # fmt: skip
        self.kept = [
            self.places[number // 2].spline.compute_mean_variance(self.of_priors[number // 2], low)
            for number, low in enumerate(self.low_of_axes)
        ]
        low = sparse.block_diag(self.low_of_axes).toarray()
        self.low = np.pad(low, ((0, 0), (0, self.weighted.root.shape[1] - low.shape[1])))

    def iterate(self, robust: int) -> None:
        """Iterate the robust weights in ``robust`` steps, and noise and variance of the curves until convergence."""
        weighted = self.weighted
        for step in range(robust + ITERATIONS.most):
            self._factorise()
            residual = weighted.rows.right - weighted.rows.matrix @ self.solved
            samples, squares = self.draw(8), list[float]()
            for number, (place, along) in enumerate(zip(self.places, self.along, strict=True)):
                axes, shares = np.split(np.arange(place.start, place.stop), 2), self.kept[2 * number : 2 * number + 2]
                estimated, unsure = (
                    [float(np.mean((along @ x[axis]) ** 2)) / share for axis, share in zip(axes, shares, strict=True)]
                    for x in (self.solved, samples)
                )
                squares.append(sum(min(zip(unsure, estimated, strict=True))))
                if step < robust:
                    weighted.weak |= {
                        int(axis[0]): of_prior > JITTER_CURVES.weak * self.variance
                        for axis, of_prior in zip(axes, unsure, strict=True)
                    }
            last_variance, self.variance = self.variance, max(float(np.mean(squares)), JITTER_CURVES.least_px**2)
            unsure_rows = float(np.mean(np.sum((weighted.root @ samples) ** 2, axis=0)))
            weight = weighted.weight
            # Noise is at least 1: dense matches agree better than stated, which does not improve GCPs and heights
            weighted.noise = max(float(weight @ residual**2 + unsure_rows) / float(weight.sum()), 1.0)
            if step < robust:
                weighted.weigh(residual)
                self.set_low_degrees()
            elif abs(np.log(self.variance / last_variance)) < JITTER_CURVES.settled_variance:
                break
        self._factorise()

    def compute_log_likelihood(self) -> float:
        """Return the logarithm of the marginal likelihood of the prior."""
        weighted = self.weighted
        quadratic = float(weighted.right @ weighted.right - weighted.projected @ self.solved) / weighted.noise
        free = sum(2.0 * (_log_determinant(one) - one.shape[0] * np.log(self.variance)) for one in self.of_priors)
        by_prior = sum(
            np.linalg.slogdet(self.variance * low @ self.of_priors[number // 2].solve(low.T))[1]
            for number, low in enumerate(self.low_of_axes)
        )
        by_all = np.linalg.slogdet(self.low @ self._spread)[1]
        rows = weighted.weight.sum() * np.log(weighted.noise)
        return -0.5 * float(rows + quadratic + _log_determinant(self._factor) - free + by_all - by_prior)

    def draw(self, count: int) -> np.ndarray:
        """Return samples ``(unknowns, count)`` of the posterior, without its mean."""
        if count not in self.noisy:
            rng = np.random.default_rng([count, 2])
            self.noisy[count] = np.zeros((self.low.shape[1], count))
            for place, root in zip(self.places, self.roots, strict=True):
                for axis in np.split(np.arange(place.start, place.stop), 2):
                    self.noisy[count][axis] = root.T @ rng.normal(0.0, 1.0, (root.shape[0], count))
        right = self.weighted.draw(count) / np.sqrt(self.weighted.noise) + self.noisy[count] / np.sqrt(self.variance)
        return self._condition(self._solve(right))

    def compare_with_surveys(self, surveyed: np.ndarray) -> float:
        """Return the factor, 1 or more, from the posterior's errors of the curves to those that surveyed points show.

        A wave that passes all images of a point by chance in nearly the same phase hardly shows in tie points, and its
        variance is too small. With residuals r of a point, the covariance C of its equations by the curves and cameras,
        the noise n and a weight w, its error in an adjustment without it has the square ``r' (I - C w / n)^-1 r / n``.
        The three directions are tested in which the curves have the largest shares, the eigenvalues of ``C w / n``:
        those of the point's position. The median over the points is not changed by few wrong surveys.

        surveyed : (m,) mask of the points
        """
        weighted, tests = self.weighted, list[tuple[float, float, int]]()
        points = np.unique(weighted.rows.point[weighted.rows.point >= 0])
        points = points[surveyed[points]]
        for point in points[:: max(-(-len(points) // SAMPLES.dense), 1)]:
            rows = np.flatnonzero(weighted.rows.point == point)
            matrix, weight = weighted.rows.matrix[rows], weighted.weight[rows[0]]
            covariance = matrix @ self._condition(self._solve(matrix.T.toarray())) * weight / weighted.noise
            residual = weighted.rows.right[rows] - matrix @ self.solved
            shares, directions = np.linalg.eigh(covariance)
            shares, directions = shares[-3:], directions[:, -3:]  # those of the position: rays determine the others
            squares = (residual @ directions) ** 2 / np.maximum(1.0 - shares, EQUALITY.rounding) / weighted.noise
            tests.append((float(squares.sum()), float(shares.sum()), len(shares)))
        if len(tests) < SAMPLES.plane:
            return 1.0
        squares, of_curves, freedom = np.array(tests).T
        excess = float(np.median(squares / special.chdtri(freedom, 0.5)))
        if special.chdtrc(freedom.sum(), freedom.sum() * excess) > SIGNIFICANCE.level:
            return 1.0
        return float(np.sqrt(1.0 + (excess - 1.0) * freedom.sum() / of_curves.sum()))

    def _factorise(self) -> None:
        """Compute ``solved`` for the current noise and variance."""
        weighted, order = self.weighted, self.weighted.order
        priors = [one / self.variance for one in self.precisions for _ in "xy"]
        prior = sparse.block_diag([*priors, sparse.diags(weighted.of_cameras / weighted.noise)])
        self._factor: SuperLU = splu(
            (weighted.normal / weighted.noise + prior).tocsr()[order][:, order].tocsc(), permc_spec="NATURAL",
            diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
        self._spread = self._solve(np.ascontiguousarray(self.low.T))
        self.solved = self._condition(self._solve(weighted.projected / weighted.noise))

    def _solve(self, right: np.ndarray) -> np.ndarray:
        solved = np.empty_like(right)
        solved[self.weighted.order] = self._factor.solve(np.ascontiguousarray(right[self.weighted.order]))
        return solved

    def _condition(self, x: np.ndarray) -> np.ndarray:
        """Return the unknowns without low degrees in the curves: the posterior under ``Q x = 0``."""
        return np.asarray(x - self._spread @ np.linalg.solve(self.low @ self._spread, self.low @ x))


def _log_determinant(factor: SuperLU) -> float:
    return float(np.sum(np.log(np.abs(factor.U.diagonal()))))
