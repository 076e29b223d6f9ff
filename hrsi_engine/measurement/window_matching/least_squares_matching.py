"""Least-squares matching of windows: sub-pixel position and covariance, affine shape, gain and offset of grey values.

A template T around a whole pixel of the first image is compared with the second image I under a warp W: an affine map
of the template's offsets x. Each iteration fits (Gruen 1985 has the observation equations; Baker and Matthews 2004,
inverse compositional)

    I(W(x)) = g T(x) + o + g grad T(x) (D x + d)

for a small warp (D, d) of the template itself, gain g and offset o, and then replaces W by W after the inverse of that
small warp. Slopes and normal matrix are those of the template alone: they are computed once, and noise of the second
image does not enter the slopes. The second image is interpolated by cubic B-splines, whose error on band-limited images
is far below that of cubic convolution, so that positions do not lock to whole or half pixels.

Grey values may be band-passed first (`MatchImage`): between dates low frequencies differ most, as shadows, moisture and
plants do, and they are strongest in the texture as well, so that plain grey values would follow them.

The covariance is that of the normal equations with the variance of the residuals, times a factor for what filtering
does to noise (`Band.sigma_factor`, from simulation).
"""

import numpy as np

from ...foundation import compiled_code
from .lsm_arrays import match_batches
from .windows import DONE, ITERATIONS_USED_UP, OUTSIDE, LsmOptions, MatchImage, PatchMatches, Results


def match_patches(
    first: MatchImage, second: MatchImage, centre: np.ndarray, start: np.ndarray, affine: np.ndarray,
    options: LsmOptions | None = None,
) -> PatchMatches:  # fmt: skip
    """Match windows of the first image around whole pixels in the second image.

    centre : (n, 2) column, row; start : (n, 2) approximate positions in the second image, to about 2 px
    affine : (n, 2, 2) approximate Jacobian second by first
    """
    options = options or LsmOptions()
    centre = np.asarray(centre, dtype=np.int64).reshape(-1, 2)
    count = len(centre)
    results: Results = (
        np.array(start, dtype=np.float64), np.array(affine, dtype=np.float64), np.full((count, 2, 2), np.nan),
        np.zeros((count, 3)), np.full(count, OUTSIDE, dtype=np.int64),
    )  # fmt: skip
    rows = np.flatnonzero(_has_usable_template(first, centre, options.half) & np.isfinite(start).all(axis=1))
    if len(rows):
        part: Results = tuple(column[rows] for column in results)  # type: ignore[assignment]
        match = _match_by_numba if compiled_code.is_wanted() else match_batches
        match(first, second, centre[rows], part, options)
        for column, values in zip(results, part, strict=True):
            column[rows] = values
    xy, shape, covariance, figures, status = results
    _mark_invalid(second, xy, shape, status, options)
    # Compiled loops add in an order that depends on where arrays lie in memory: what is below a millionth of a pixel
    # means nothing and is dropped, so that threads, processes and runs that were stopped give the same points.
    xy, shape, covariance, figures = xy.round(6), shape.round(9), covariance.round(12), figures.round(9)
    return PatchMatches(xy, shape, covariance, figures[:, 0], figures[:, 1], figures[:, 2], status)


def _has_usable_template(first: MatchImage, centre: np.ndarray, half: int) -> np.ndarray:
    rows, columns = first.grey.shape
    usable = np.all((centre >= half) & (centre < np.array([columns, rows]) - half), axis=1)
    usable[usable] = first.mask_clear(half)[centre[usable, 1], centre[usable, 0]]
    return usable


def _mark_invalid(
    second: MatchImage, xy: np.ndarray, affine: np.ndarray, status: np.ndarray, options: LsmOptions
) -> None:
    """Set the status of windows that meet invalid pixels of the second image."""
    if second.valid.all() or not len(xy):
        return
    matched = np.flatnonzero((status == DONE) | (status == ITERATIONS_USED_UP))
    size = np.ceil(options.half * np.abs(affine[matched]).sum(axis=2).max(axis=1)).astype(np.int64) + 1
    pixel = np.floor(xy[matched] + 0.5).astype(np.int64)
    for reach in np.unique(size):
        here = matched[size == reach]
        column, row = pixel[size == reach].T
        status[here[~second.mask_clear(int(reach))[row, column]]] = OUTSIDE


def _match_by_numba(
    first: MatchImage, second: MatchImage, centre: np.ndarray, results: Results, options: LsmOptions
) -> None:
    from .lsm_kernels import match_range

    match_range(
        0, len(centre), (first.grey, *first.slopes, second.coefficients), centre, options.make_weights(),
        (options.iterations, options.closure_px, options.reach_px), results,
    )  # fmt: skip
