"""Least-squares matching of windows: sub-pixel position and covariance, affine shape, gain and offset of grey values.

A template T around a whole pixel of the first image is compared with the second image I under a warp W, an affine map
of the template's offsets x. Each iteration solves (observation equations: Gruen 1985; inverse compositional algorithm:
Baker and Matthews 2004)

    I(W(x)) = g T(x) + o + g grad T(x) (D x + d)

for a small warp (D, d) of the template, gain g and offset o, and then composes W with the inverse of this small warp.
Gradients and normal matrix are those of the template alone: they are computed once, and noise of the second image does
not enter the gradients. The second image is interpolated by cubic B-splines, whose error for band-limited images is far
below that of cubic convolution, so that positions are not biased towards whole or half pixels.

Grey values can be band-pass filtered first (`MatchImage`): images of different dates differ most in low frequencies
(shadows, moisture, plants), which are also strongest in the texture, so that unfiltered grey values would follow them.

The covariance is that of the normal equations with the variance of the residuals, times a factor for the effect of
filtering on noise (`Band.sigma_factor`, from simulation).

NumPy matches many windows together, by the same steps as the compiled loops of `lsm_kernels`. The equation is linear in
eight unknowns (g d, g D, g, o), in this order: with the columns

    A = [Tx, Ty, Tx x, Tx y, Ty x, Ty y, T - mean(T), 1]

(Tx, Ty gradient of the template, x, y offsets in half windows) and weights P the solution is (A'PA)^-1 A'P I(W). A'PA
depends on the template alone and is inverted once per window; d and D are the first six terms of the solution over g.
"""

import numpy as np

from ...foundation import compiled_code
from .windows import (
    DIVERGED,
    DONE,
    ITERATIONS_USED_UP,
    MATCHING,
    OUTSIDE,
    TERMS,
    WEAK,
    LsmOptions,
    MatchImage,
    PatchMatches,
    Results,
)

_OF_SLOPES = np.array([[0, 2, 3], [1, 4, 5]])  # indices of the terms of Tx and Ty: times 1, x and y
_GREY, _ONE = 6, 7


def match_patches(
    first: MatchImage, second: MatchImage, centre: np.ndarray, start: np.ndarray, affine: np.ndarray,
    options: LsmOptions | None = None,
) -> PatchMatches:  # fmt: skip
    """Match windows around whole pixels of the first image in the second image.

    centre : (n, 2) column, row; start : (n, 2) approximate positions in the second image, accurate to about 2 px
    affine : (n, 2, 2) approximate derivatives of positions in the second image by those in the first
    """
    options = options or LsmOptions()
    centre = np.asarray(centre, dtype=np.int64).reshape(-1, 2)
    count = len(centre)
    results: Results = (
        np.array(start, dtype=np.float64), np.array(affine, dtype=np.float64), np.full((count, 2, 2), np.nan),
        np.zeros((count, 3)), np.full(count, OUTSIDE, dtype=np.int64),
    )  # fmt: skip
    # Templates inside the image, without invalid pixels
    half, usable = options.half, np.isfinite(start).all(axis=1)
    usable &= np.all((centre >= half) & (centre < np.array(first.grey.shape[::-1]) - half), axis=1)
    usable[usable] = first.mask_clear(half)[centre[usable, 1], centre[usable, 0]]
    rows = np.flatnonzero(usable)
    if len(rows):
        part: Results = tuple(column[rows] for column in results)  # type: ignore[assignment]
        if compiled_code.is_wanted():
            from .lsm_kernels import match_range

            match_range(
                0, len(rows), (first.grey, *first.slopes, second.coefficients), centre[rows], options.make_weights(),
                (options.iterations, options.closure_px, options.reach_px), part,
            )  # fmt: skip
        else:
            for start_row in range(0, len(rows), MATCHING.batch):
                batch = slice(start_row, start_row + MATCHING.batch)
                _match_batch(first, second, centre[rows[batch]], tuple(column[batch] for column in part), options)  # type: ignore[arg-type]
        for column, values in zip(results, part, strict=True):
            column[rows] = values
    xy, shape, covariance, figures, status = results
    if not second.valid.all() and count:
        # Windows that contain invalid pixels of the second image
        matched = np.flatnonzero((status == DONE) | (status == ITERATIONS_USED_UP))
        size = np.ceil(half * np.abs(shape[matched]).sum(axis=2).max(axis=1)).astype(np.int64) + 1
        pixel = np.floor(xy[matched] + 0.5).astype(np.int64)
        for reach in np.unique(size):
            here = matched[size == reach]
            column, row = pixel[size == reach].T
            status[here[~second.mask_clear(int(reach))[row, column]]] = OUTSIDE
    # The order of sums in compiled loops depends on memory addresses. Differences far below a millionth of a pixel are
    # rounded off, so that threads, processes and interrupted runs give equal points
    xy, shape, covariance, figures = xy.round(6), shape.round(9), covariance.round(12), figures.round(9)
    return PatchMatches(xy, shape, covariance, figures[:, 0], figures[:, 1], figures[:, 2], status)


def _match_batch(
    first: MatchImage, second: MatchImage, centre: np.ndarray, results: Results, options: LsmOptions
) -> None:
    """Match windows whose templates are inside the first image; ``results`` are changed in place."""
    xy, affine, _, _, status = results
    weight, half = options.make_weights().ravel(), options.half
    line = np.arange(-half, half + 1, dtype=np.float64)
    column, row = (centre[:, axis, None] + line.astype(np.int64) for axis in (0, 1))
    place = (row[:, :, None] * first.grey.shape[1] + column[:, None]).reshape(len(centre), -1)
    # Gradients of the templates and grey values minus their mean (3, n, pixels): their products with 1, x, y are all
    # columns of the design matrices; affine terms are in half windows
    template = np.stack([layer.ravel().take(place) for layer in (*first.slopes, first.grey)]).astype(np.float64)
    gx, gy, grey = template
    grey -= (grey @ weight / weight.sum())[:, None]
    ones = np.ones_like(weight)
    basis = np.stack([ones, *(values.ravel() for values in np.meshgrid(line / half, line / half))])
    squares = (basis[:, None] * basis).reshape(len(basis) ** 2, -1).T
    N = np.empty((len(centre), TERMS, TERMS))
    for terms, slope in zip(_OF_SLOPES, (gx, gy), strict=True):
        weighted = slope * weight
        for others, other in zip(_OF_SLOPES, (gx, gy), strict=True):
            N[:, terms[:, None], others] = (weighted * other @ squares).reshape(-1, len(basis), len(basis))
        for term, values in ((_GREY, grey), (_ONE, ones)):
            N[:, terms, term] = N[:, term, terms] = weighted * values @ basis.T
    N[:, _GREY, _GREY], N[:, _GREY, _ONE], N[:, _ONE, _ONE] = grey**2 @ weight, grey @ weight, weight.sum()
    N[:, _ONE, _GREY] = N[:, _GREY, _ONE]
    diagonal = np.sqrt(np.einsum("nii->ni", N))
    positive = diagonal.min(axis=1) > 0.0
    safe = np.where(positive[:, None], diagonal, 1.0)
    smallest = np.linalg.eigvalsh(N / (safe[:, :, None] * safe[:, None, :]))[:, 0]
    solvable = positive & (smallest > 1e-9)
    status[:] = np.where(solvable, ITERATIONS_USED_UP, WEAK)
    inverse = np.full_like(N, np.nan)
    inverse[solvable] = np.linalg.inv(N[solvable])
    begin = xy.copy()
    solution, seen = np.zeros((len(centre), TERMS)), np.zeros(place.shape)
    going = np.flatnonzero(solvable)
    rows, columns = second.coefficients.shape
    for _ in range(options.iterations):
        reach = half * np.abs(affine[going]).sum(axis=2)
        inside = np.all((xy[going] - reach >= 1.0) & (xy[going] + reach < np.array([columns, rows]) - 3.0), axis=1)
        status[going[~inside]] = OUTSIDE
        going = going[inside]
        if not len(going):
            break
        # Positions of the window's pixels as the sum of terms of columns and rows, (2, n, side, side)
        along, down = (affine[going, :, axis, None].transpose(1, 0, 2) * line for axis in (0, 1))
        at = (xy[going].T[..., None] + along)[:, :, None] + down[..., None]
        values = _interpolate_spline(second.coefficients, *at).reshape(len(going), -1)
        seen[going] = values
        values = values * weight
        chosen = template if len(going) == len(centre) else template[:, going]  # indexing copies, which is slower
        by_slope = (chosen * values) @ basis.T
        right = np.empty((len(going), TERMS))
        right[:, _OF_SLOPES] = by_slope[:2].transpose(1, 0, 2)
        right[:, _GREY], right[:, _ONE] = by_slope[2, :, 0], values.sum(axis=1)
        solution[going] = (inverse[going] @ right[..., None])[..., 0]
        going = _update_warps(xy, affine, begin, status, solution, going, options)
    _judge_windows(results, (template, seen, solution), (N, inverse), (weight, basis))


def _judge_windows(
    results: Results, windows: tuple[np.ndarray, np.ndarray, np.ndarray], normals: tuple[np.ndarray, np.ndarray],
    of_pixels: tuple[np.ndarray, np.ndarray],
) -> None:  # fmt: skip
    """Set correlation, gain, RMS residual and covariance of the windows that were matched.

    windows : templates (3, n, pixels), sampled grey values (n, pixels), solutions (n, `TERMS`)
    normals : normal matrices and their inverses (n, `TERMS`, `TERMS`)
    of_pixels : weights (pixels,), and 1, x, y (3, pixels)
    """
    _, affine, covariance, figures, status = results
    (template, seen, solution), (N, inverse), (weight, basis) = windows, normals, of_pixels
    matched = np.flatnonzero((status == DONE) | (status == ITERATIONS_USED_UP))
    gx, gy, grey = template[:, matched]
    seen, solution = seen[matched], solution[matched]
    spread = ((seen - (seen @ weight / weight.sum())[:, None]) ** 2) @ weight
    figures[matched, 0] = (grey * seen) @ weight / np.sqrt(np.maximum(N[matched, _GREY, _GREY] * spread, 1e-30))
    figures[matched, 1] = solution[:, _GREY]
    by_x, by_y = (solution[:, terms] @ basis for terms in _OF_SLOPES)
    residual = seen - (gx * by_x + gy * by_y + solution[:, _GREY, None] * grey + solution[:, _ONE, None])
    figures[matched, 2] = np.sqrt(residual**2 @ weight / weight.sum())
    scale = (figures[matched, 2] / figures[matched, 1]) ** 2
    by_template = inverse[matched, :2, :2] * scale[:, None, None]
    covariance[matched] = affine[matched] @ by_template @ affine[matched].transpose(0, 2, 1)


def _interpolate_spline(coefficients: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the spline's values, float32, at columns ``x`` and rows ``y`` that are 1 … size - 3 cells inside."""
    column, row = x.astype(np.int64), y.astype(np.int64)
    across, down = (_compute_spline_weights((at - whole).astype(np.float32)) for at, whole in ((x, column), (y, row)))
    width = coefficients.shape[1]
    flat = np.ravel(coefficients)
    row -= 1
    row *= width
    row += column
    row -= 1
    total, line, term = (np.empty(x.shape, np.float32) for _ in range(3))
    total.fill(0.0)
    for j, below in enumerate(down):
        np.multiply(across[0], flat[j * width :].take(row), out=line)
        for i in (1, 2, 3):
            np.multiply(across[i], flat[j * width + i :].take(row), out=term)
            line += term
        line *= below
        total += line
    return total


def _compute_spline_weights(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the four weights of the cubic B-spline at the fraction t of a cell, float32."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    return s2 * s / 6.0, 2.0 / 3.0 - 0.5 * t2 * (1.0 + s), 2.0 / 3.0 - 0.5 * s2 * (1.0 + t), t2 * t / 6.0


def _update_warps(
    xy: np.ndarray, affine: np.ndarray, begin: np.ndarray, status: np.ndarray, solution: np.ndarray, going: np.ndarray,
    options: LsmOptions,
) -> np.ndarray:  # fmt: skip
    """Compose the warps with the inverses of the templates' small warps; return the windows still iterating."""
    half = options.half
    gain = solution[going, 6]
    fine = gain > MATCHING.smallest_gain
    status[going[~fine]] = DIVERGED
    going, gain = going[fine], gain[fine]
    small = np.eye(2) + (solution[going, 2:6] / gain[:, None] / half).reshape(-1, 2, 2)
    shift = solution[going, :2] / gain[:, None]
    det = np.linalg.det(small)
    fine = (det > 0.5) & (det < 2.0) & ((shift**2).sum(axis=1) <= 4.0 * half**2)
    status[going[~fine]] = DIVERGED
    going, small, shift = going[fine], small[fine], shift[fine]
    inverse = np.linalg.inv(small)
    back = -np.einsum("nij,nj->ni", inverse, shift)
    xy[going] += np.einsum("nij,nj->ni", affine[going], back)
    affine[going] = affine[going] @ inverse
    near = ((xy[going] - begin[going]) ** 2).sum(axis=1) <= options.reach_px**2
    status[going[~near]] = DIVERGED
    change = np.abs(back).sum(axis=1) + 0.25 * half * np.abs(inverse - np.eye(2)).sum(axis=(1, 2))
    status[going[near & (change < options.closure_px)]] = DONE
    return going[near & (change >= options.closure_px)]
