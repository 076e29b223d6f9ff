"""Fitting RPCs to correspondences between ground and image, and refitting an RPC that has been corrected.

For one image coordinate ``r`` (normalised) and the row of 20 terms ``t`` of a ground point, the RPC's ratio
``r = t.a / (1 + t'.b)`` (``t'``: the terms without the constant) becomes linear after multiplication with the
denominator::

    (t.a - r t'.b - r) / D = v,        D = 1 + t'.b of the iteration before

Iterating with the weights ``1 / D`` minimises the image residuals themselves (Tao and Hu 2001, PE&RS 67(12)
"A comprehensive study of the rational function model", iterative weighted least squares). Numerator and denominator
are nearly collinear for a nearly affine camera; a ridge so small that its effect is below 1e-6 px keeps the denominator
near 1 and every coefficient bounded, and prefers lower terms if the points do not determine them. The observation
equations are reduced to their triangular factor part by part (normal equations would square the condition number),
so that the memory does not grow with their number.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..foundation.errors import SolveError
from ..foundation.thresholds import EQUALITY, ITERATIONS, MEMORY, threshold, thresholds
from ..ground.geodesy import continuous_longitudes, wrap_degrees
from .rpc import RPC, Localization
from .rpc_terms import POWERS, monomials


@thresholds
class FIT:
    """Damping, iterations and grids of the fit of an RPC to correspondences."""

    ridges: tuple[float, ...] = threshold(
        (1e-16, 1e-12, 1e-9, 1e-6, 1e-3), "", "damping factors, tried in turn; the first has no effect"
    )
    good_px: float = threshold(1e-3, "px", "largest difference at check points that ends the search")
    grid: tuple[int, int, int] = threshold(
        (15, 15, 6), "nodes", "samples, lines, heights of the grid of a fit", "pushbroom: exact to 1e-6 px"
    )
    flat_m: float = threshold(1.0, "m", "range of heights below which the RPC has no height terms")


#: Nodes of the check points along each axis: one more, so that both have only the corners in common.
CHECK_GRID = (FIT.grid[0] + 1, FIT.grid[1] + 1, FIT.grid[2] + 1)
#: Smallest scales of the normalisation: degrees (about 1 m), degrees, metres, pixels, pixels.
SMALLEST_SCALE = np.array([1e-5, 1e-5, FIT.flat_m, 1.0, 1.0])
#: Terms that a number of points can determine: (points needed, terms of the numerator, terms of the denominator).
TERMS_BY_POINTS = ((45, 20, 20), (24, 20, 1), (12, 10, 1), (5, 4, 1))
#: Damping of the numerator's terms relative to that of the denominator's, by degree. With points at few different
#: heights the powers of H are not separable (with three heights H**3 equals H); the lowest one must be preferred.
NUMERATOR_DAMPING = np.array([0.0, 0.0, 1.0, 10.0])[POWERS.sum(axis=1)]
HEIGHT_TERMS = np.array([3, 5, 6, 9, 10, 13, 16, 17, 18, 19])  # those with a power of H

Correct = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class RpcFit:
    """A fitted RPC, with the largest and RMS length (px) of its image differences.

    `fit_rpc` computes the differences at the given points, `refit_rpc` on an independent grid.

    Parameters
    ----------
    rpc : RPC
        The fitted camera.
    max_px, rms_px : float
        Largest and RMS length of the image differences.
    warnings : tuple of str
        Restrictions of the fit, for the user.
    ridge : float
        Damping of the denominators that was used.
    """

    rpc: RPC
    max_px: float
    rms_px: float
    warnings: tuple[str, ...] = ()
    ridge: float = FIT.ridges[0]


def fit_rpc(
    ground: np.ndarray,
    image: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    ridge: float = FIT.ridges[0],
    common_denominator: bool = False,
) -> RpcFit:
    """Return the RPC that maps ground points to image points with the smallest residuals (least squares).

    With few points (fewer than 45) only the lower terms are estimated, with points at one height no terms in height;
    the ``warnings`` of the result state this.

    Parameters
    ----------
    ground : (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres; they may cross the 180 degree meridian.
    image : (n, 2) ndarray
        Sample, line in pixels.
    weights : (n,) ndarray, optional
        Relative weights of the squared residuals; by default all equal.
    ridge : float
        Damping of the denominators, as a variance ratio to the normalised image residuals. The default does not damp
        terms that the points determine; 1e-6 and more is for noisy measurements.
    common_denominator : bool
        One denominator for sample and line; affine corrections can then be included exactly.

    Returns
    -------
    RpcFit
        The RPC with its differences at the points.

    Raises
    ------
    SolveError
        Fewer than 5 points, or collinear or coincident points.
    ValueError
        Arrays of other shapes, or values that are not finite.
    """
    ground, image = np.asarray(ground, dtype=np.float64), np.asarray(image, dtype=np.float64)
    if ground.ndim != 2 or ground.shape[1] != 3 or image.shape != (len(ground), 2):
        raise ValueError(f"ground {ground.shape} and image {image.shape}: (n, 3) and (n, 2) are needed")
    if weights is not None and np.shape(weights) != (len(ground),):
        raise ValueError(f"weights have shape {np.shape(weights)}, ({len(ground)},) is needed")
    if not (np.isfinite(ground).all() and np.isfinite(image).all()):
        raise ValueError("ground or image points are not finite")
    if len(ground) < TERMS_BY_POINTS[-1][0]:
        raise SolveError(f"{len(ground)} correspondences do not determine an RPC: give at least 5, or better 50")
    # OFF and SCALE of lon, lat, height, sample and line that take the points to [-1, 1]
    values = np.column_stack([continuous_longitudes(ground[:, 0]), ground[:, 1:], image])
    low, high = values.min(axis=0), values.max(axis=0)
    offset, scale = (low + high) / 2.0, np.maximum((high - low) / 2.0, SMALLEST_SCALE)
    offset[0] = wrap_degrees(offset[0])
    lonlat_difference = np.column_stack([wrap_degrees(ground[:, :1] - offset[0]), ground[:, 1:] - offset[1:3]])
    terms = monomials((lonlat_difference / scale[:3]).T).T
    target = (image - offset[3:]) / scale[3:]
    root_weights = np.ones(len(ground)) if weights is None else np.sqrt(weights / np.mean(weights))
    # Terms that are estimated in numerator and denominator
    count = len(ground)
    warnings: list[str] = []
    _, numerators, denominators = next(row for row in TERMS_BY_POINTS if count >= row[0])
    if denominators < 20:
        warnings.append(
            f"{count} correspondences carry only {numerators} terms without denominator: 45 carry a full RPC"
        )
    numerator, denominator = np.arange(numerators), np.arange(1, denominators)
    if np.ptp(ground[:, 2]) <= FIT.flat_m:
        warnings.append(
            f"all heights lie within {FIT.flat_m:g} m of {np.mean(ground[:, 2]):.1f} m: the RPC does not depend on "
            "height and is valid there only"
        )
        numerator, denominator = np.setdiff1d(numerator, HEIGHT_TERMS), np.setdiff1d(denominator, HEIGHT_TERMS)
    singular = np.linalg.svd(terms[:, :3], compute_uv=False)
    if singular[-1] < 1e-6 * singular[0]:
        raise SolveError("the correspondences lie on a line or at one place: give points over the whole image")
    system = _System(terms, target, root_weights, numerator, denominator, ridge)
    axis_groups = [[0, 1]] if common_denominator else [[0], [1]]
    sample, line = (one for axes in axis_groups for one in _iterate_least_squares(system, axes, scale[3:][axes]))
    rpc = RPC(
        long_off=offset[0], lat_off=offset[1], height_off=offset[2], samp_off=offset[3], line_off=offset[4],
        long_scale=scale[0], lat_scale=scale[1], height_scale=scale[2], samp_scale=scale[3], line_scale=scale[4],
        samp_num=sample[0], samp_den=sample[1], line_num=line[0], line_den=line[1],
    )  # fmt: skip
    return RpcFit(rpc, *_compute_differences(rpc, ground, image), tuple(warnings), ridge)


def refit_rpc(
    rpc: RPC, correct: Correct, domain_px: tuple[float, float, float, float], heights: tuple[float, float]
) -> RpcFit:
    """Return the RPC of ``rpc`` followed by a correction of its image coordinates.

    A virtual control grid over the image and the height range is transformed to the ground by ``rpc``, its image
    coordinates are corrected, and an RPC is fitted. The differences are computed on another, staggered grid.

    correct : function of image points (n, 2) and their ground points (n, 3), returns corrected image points (n, 2)
    domain_px : first and last sample, first and last line of the domain of the RPC. OFF and SCALE of ``rpc`` are no
    substitute: for a crop they are often those of the full scene
    heights : lowest and highest ellipsoidal height (m) of the domain

    Raises `SolveError` if ``rpc`` has no ground positions in the domain.
    """
    nodes = _make_virtual_points(rpc, correct, domain_px, heights, FIT.grid)
    staggered = _make_virtual_points(rpc, correct, domain_px, heights, CHECK_GRID)
    fit = best_fit(nodes, staggered)
    return replace(
        fit,
        rpc=replace(fit.rpc, err_bias=rpc.err_bias, err_rand=rpc.err_rand),
        warnings=fit.warnings + extrapolation_warnings(heights, rpc.height_range),
    )


def extrapolation_warnings(required_range: tuple[float, float], fitted_range: tuple[float, float]) -> tuple[str, ...]:
    """Return a warning if an RPC is to be used at heights (m) outside those from which it is computed.

    required_range : lowest and highest ellipsoidal height at which the RPC is to be used
    fitted_range : lowest and highest height of the data from which it is computed
    """
    slack = 0.01 * (fitted_range[1] - fitted_range[0])
    if required_range[0] >= fitted_range[0] - slack and required_range[1] <= fitted_range[1] + slack:
        return ()
    return (
        f"heights from {required_range[0]:.0f} to {required_range[1]:.0f} m are wanted, but only "
        f"{fitted_range[0]:.0f} to {fitted_range[1]:.0f} m "
        "are known: the RPC extrapolates there",
    )


def best_fit(
    points: tuple[np.ndarray, np.ndarray], check: tuple[np.ndarray, np.ndarray], common_denominator: bool = False
) -> RpcFit:
    """Fit an RPC to ``points`` (ground, image) with the damping that is best at other points ``check``.

    Without damping, denominators can fit noise or distortions that no RPC can represent, and have large errors between
    the points. The differences of the result are those at the check points.

    points, check : ground ``(n, 3)`` lon, lat, height and image ``(n, 2)`` sample, line
    common_denominator : as in `fit_rpc`
    Result: the camera with the most damping of those that are best at the check points, within 5 %.
    """
    fits = []
    for ridge in FIT.ridges:
        fit = fit_rpc(*points, ridge=ridge, common_denominator=common_denominator)
        largest, rms = _compute_differences(fit.rpc, *check)
        fits.append(replace(fit, max_px=largest, rms_px=rms))
        if largest < FIT.good_px:
            break
    best = min(fit.rms_px for fit in fits)
    return next(fit for fit in reversed(fits) if fit.rms_px <= (1.0 + EQUALITY.negligible) * best)


def fold_affine(rpc: RPC, matrix: np.ndarray) -> RPC | None:
    """Return ``rpc`` followed by an affine transformation of its image coordinates, if that is exactly an RPC.

    ``matrix (2, 3)``: ``sample' = m00 + m01 sample + m02 line``, ``line' = m10 + m11 sample + m12 line``. It is exact
    for shifts, for a scale of one coordinate by itself, and with cross terms where both coordinates have the same
    denominator. None otherwise: use `refit_rpc`.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    parts = (
        (rpc.samp_off, rpc.samp_scale, rpc.samp_num, rpc.samp_den),
        (rpc.line_off, rpc.line_scale, rpc.line_num, rpc.line_den),
    )
    sample, line = _fold_row(matrix[0], parts), _fold_row(matrix[1], parts)
    if sample is None or line is None:
        return None
    return replace(
        rpc,
        samp_off=sample[0],
        samp_scale=sample[1],
        samp_num=sample[2],
        samp_den=sample[3],
        line_off=line[0],
        line_scale=line[1],
        line_num=line[2],
        line_den=line[3],
    )


_Part = tuple[float, float, np.ndarray, np.ndarray]  # OFF, SCALE, numerator, denominator of an image coordinate


def _fold_row(row: np.ndarray, parts: tuple[_Part, _Part]) -> _Part | None:
    """Return the polynomials of ``row[0] + row[1] * sample + row[2] * line``, None if it is not exactly a ratio."""
    involved = [(factor, part) for factor, part in zip(row[1:], parts, strict=True) if factor != 0.0]
    if not involved:
        raise ValueError("an affine transformation that maps all image points to one line has no RPC")
    offset = float(row[0] + sum(factor * part[0] for factor, part in involved))
    _, scale, _, denominator = involved[0][1]
    if len(involved) == 1:
        factor, (_, _, numerator, _) = involved[0]
        # The sign is moved to the numerator, since some readers reject a negative SCALE
        return offset, abs(factor) * scale, numerator if factor > 0.0 else -numerator, denominator
    if not np.array_equal(denominator, involved[1][1][3]):
        return None
    numerator = sum((factor * part[1] / scale * part[2] for factor, part in involved), np.zeros(20))
    return offset, scale, numerator, denominator


# ---- virtual control grid --------------------------------------------------------------------------------------


def make_image_grid(domain_px: tuple[float, float, float, float], shape: tuple[int, int]) -> np.ndarray:
    """Return image points ``(n, 2)`` of a regular grid that includes the edges of the domain."""
    first_sample, last_sample, first_line, last_line = domain_px
    samples, lines = np.meshgrid(
        np.linspace(first_sample, last_sample, shape[0]), np.linspace(first_line, last_line, shape[1])
    )
    return np.column_stack([samples.ravel(), lines.ravel()])


def make_virtual_grid(
    rpc: RPC, domain_px: tuple[float, float, float, float], heights: tuple[float, float], shape: tuple[int, int, int]
) -> tuple[np.ndarray, Localization]:
    """Return image points ``(n, 2)`` of a grid over an image at several heights, and their ground points."""
    layer = make_image_grid(domain_px, shape[:2])
    image = np.tile(layer, (shape[2], 1))
    return image, rpc.localize(image, np.repeat(np.linspace(*heights, shape[2]), len(layer)))


def _make_virtual_points(
    rpc: RPC,
    correct: Correct,
    domain_px: tuple[float, float, float, float],
    heights: tuple[float, float],
    shape: tuple[int, int, int],
) -> tuple[np.ndarray, np.ndarray]:
    image, (ground, converged) = make_virtual_grid(rpc, domain_px, heights, shape)
    if np.count_nonzero(converged) < 0.5 * len(image):
        raise SolveError(
            f"the RPC has no ground positions for most of samples {domain_px[0]:g}..{domain_px[1]:g}, "
            f"lines {domain_px[2]:g}..{domain_px[3]:g} at heights {heights[0]:g}..{heights[1]:g} m: "
            "check that image size and RPC belong together"
        )
    ground = ground[converged]
    return ground, np.asarray(correct(image[converged], ground), dtype=np.float64)


def _compute_differences(rpc: RPC, ground: np.ndarray, image: np.ndarray) -> tuple[float, float]:
    """Return the largest and the RMS length (px) of the differences between observed and projected points."""
    squared = np.nan_to_num(np.sum((image - rpc.project(ground)) ** 2, axis=1), nan=np.inf)
    return float(np.sqrt(squared.max())), float(np.sqrt(squared.mean()))


# ---- iteratively reweighted least squares ----------------------------------------------------------------------


@dataclass(frozen=True)
class _System:
    """Terms ``(n, 20)``, normalised image ``(n, 2)``, roots of the weights ``(n,)``, and indices of estimated terms."""

    terms: np.ndarray
    target: np.ndarray
    root_weights: np.ndarray
    numerator: np.ndarray
    denominator: np.ndarray
    ridge: float

    def unpack(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return full numerator and denominator ``(20,)`` with the estimated coefficients."""
        numerator, denominator = np.zeros(20), np.zeros(20)
        numerator[self.numerator], denominator[0], denominator[self.denominator] = a, 1.0, b
        return numerator, denominator


def _iterate_least_squares(
    system: _System, axes: list[int], scale_px: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return numerator and denominator of each image axis; the given axes share one denominator."""
    divisor, rms_before = np.ones(len(system.terms)), 0.0  # an exact fit needs no weights
    count = len(system.numerator)
    polynomials: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(ITERATIONS.most):
        # Solve the observation equations with the damping
        unknowns = count * len(axes) + len(system.denominator)
        factor = np.zeros((0, unknowns + 1))
        for start, (place, axis) in product(range(0, len(system.terms), MEMORY.rows), enumerate(axes)):
            # weighted observation equations with the right-hand side as last column
            part = slice(start, start + MEMORY.rows)
            terms, target = system.terms[part], system.target[part, axis, None]
            equations = np.zeros((len(terms), unknowns + 1))
            equations[:, place * count : (place + 1) * count] = terms[:, system.numerator]
            equations[:, count * len(axes) : -1] = -target * terms[:, system.denominator]
            equations[:, -1:] = target
            equations *= (system.root_weights[part] / divisor[part])[:, None]
            factor = np.asarray(np.linalg.qr(np.vstack([factor, equations]), mode="r"))
        weights = np.concatenate(
            [*(NUMERATOR_DAMPING[system.numerator] for _ in axes), np.ones(len(system.denominator))]
        )
        damping = np.sqrt(system.ridge * len(system.terms)) * np.eye(unknowns, unknowns + 1) * weights[:, None]
        stacked = np.vstack([factor, damping])
        solution = np.linalg.lstsq(stacked[:, :-1], stacked[:, -1], rcond=1e-15)[0]
        b = solution[count * len(axes) :]
        candidate = [system.unpack(solution[i * count : (i + 1) * count], b) for i in range(len(axes))]
        divisor = system.terms @ candidate[0][1]
        if divisor.min() <= 0.0:  # a pole among the points: return the previous iteration
            return polynomials or [system.unpack(a[system.numerator], 0.0 * b) for a, _ in candidate]
        polynomials = candidate
        computed = (system.terms @ np.array([a for a, _ in polynomials]).T) / divisor[:, None]
        residuals = (system.target[:, axes] - computed) * scale_px * system.root_weights[:, None]
        rms = float(np.sqrt(np.mean(residuals**2)))
        if abs(rms_before - rms) < EQUALITY.rounding:
            break
        rms_before = rms
    return polynomials
