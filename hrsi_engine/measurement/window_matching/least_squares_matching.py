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

Before that, windows are searched by normalised cross-correlation in a box around their predicted positions, long along
the epipolar line and narrow across it (`search_windows`). The result is the best whole-pixel position with its
correlation and that of the best other peak in the box: for repetitive patterns this rival is nearly as good.

The loops over windows are compiled (`lsm_kernels`) and loaded at their first use: other modules work without numba.
"""

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from ...foundation.packages import require_package
from .windows import DONE, ITERATIONS_USED_UP, OUTSIDE, LsmOptions, MatchImage, PatchMatches, Results


def load_kernels() -> Any:
    """Return the module `lsm_kernels`; raise `MissingPackageError` without numba."""
    require_package("numba")
    return import_module(".lsm_kernels", __package__)


def match_patches(
    first: MatchImage,
    second: MatchImage,
    centre: np.ndarray,
    start: np.ndarray,
    affine: np.ndarray,
    options: LsmOptions | None = None,
) -> PatchMatches:
    """Match windows around whole pixels of the first image in the second image.

    centre : (n, 2) column, row; start : (n, 2) approximate positions in the second image, accurate to about 2 px
    affine : (n, 2, 2) approximate derivatives of positions in the second image by those in the first
    """
    options = options or LsmOptions()
    centre = np.asarray(centre, dtype=np.int64).reshape(-1, 2)
    count = len(centre)
    results: Results = (
        np.array(start, dtype=np.float64),
        np.array(affine, dtype=np.float64),
        np.full((count, 2, 2), np.nan),
        np.zeros((count, 3)),
        np.full(count, OUTSIDE, dtype=np.int64),
    )
    # Templates inside the image, without invalid pixels
    half, usable = options.half, np.isfinite(start).all(axis=1)
    usable &= np.all((centre >= half) & (centre < np.array(first.grey.shape[::-1]) - half), axis=1)
    usable[usable] = first.mask_clear(half)[centre[usable, 1], centre[usable, 0]]
    rows = np.flatnonzero(usable)
    if len(rows):
        part: Results = tuple(column[rows] for column in results)  # type: ignore[assignment]
        load_kernels().match_range(
            0,
            len(rows),
            (first.grey, *first.slopes, second.coefficients),
            centre=centre[rows],
            weight=options.make_weights(),
            limits=(options.iterations, options.closure_px, options.reach_px),
            results=part,
        )
        for column, values in zip(results, part, strict=True):
            column[rows] = values
    xy, shape, covariance, figures, status = results
    if not second.valid.all() and count:
        # Windows that contain invalid pixels of the second image
        matched = np.flatnonzero((status == DONE) | (status == ITERATIONS_USED_UP))
        size = np.ceil(half * np.abs(shape[matched]).sum(axis=2).max(axis=1)).astype(np.int64) + 1
        pixel = np.floor(xy[matched] + 0.5).astype(np.int64)
        for reach in np.unique(size):
            rows_of_size = matched[size == reach]
            column, row = pixel[size == reach].T
            status[rows_of_size[~second.mask_clear(int(reach))[row, column]]] = OUTSIDE
    # The order of sums in compiled loops depends on memory addresses. Differences far below a millionth of a pixel are
    # rounded off, so that threads, processes and interrupted runs give equal points
    xy, shape, covariance, figures = xy.round(6), shape.round(9), covariance.round(12), figures.round(9)
    return PatchMatches(
        xy=xy,
        affine=shape,
        covariance=covariance,
        correlation=figures[:, 0],
        gain=figures[:, 1],
        rms=figures[:, 2],
        status=status,
    )


class SearchPeaks(NamedTuple):
    """Best positions ``xy (n, 2)``, their correlation, that of the best other peak (-1 without), and whether the best
    position is inside its box and not at its edge (then the true one may be outside)."""

    xy: np.ndarray
    correlation: np.ndarray
    rival: np.ndarray
    inside: np.ndarray


def search_windows(
    first: MatchImage,
    second: MatchImage,
    centre: np.ndarray,
    predicted: np.ndarray,
    direction: np.ndarray,
    reach: np.ndarray,
    half: int,
) -> SearchPeaks:
    """Search windows of ``2 half + 1`` pixels around whole pixels ``centre (n, 2)`` of the first image in the second.

    predicted : (n, 2) positions in the second image; direction : (n, 2) unit vectors along the boxes
    reach : (n, 2) half length along ``direction`` and half width of each box. Positions whose window contains invalid
    pixels are skipped; without valid positions the correlation is -1.
    """
    centre = np.asarray(centre, dtype=np.int64).reshape(-1, 2)
    best = np.array(predicted, dtype=np.float64)
    figures = np.full((len(centre), 3), -1.0)
    rows = np.flatnonzero(first.mask_clear(half)[centre[:, 1], centre[:, 0]] & np.isfinite(best).all(axis=1))
    if len(rows):
        part = best[rows], figures[rows]
        kernels = load_kernels()
        spreads = second.compute_once(("spreads", half), lambda: kernels.compute_window_spreads(second.grey, half))
        margin = (0, 0), (0, kernels.SIDE_BY_SIDE - 1)
        kernels.search_range(
            0,
            len(rows),
            first.grey,
            second.compute_once("padded", lambda: np.pad(second.grey, margin)),
            second.mask_clear(half),
            spreads,
            centre[rows],
            best[rows],
            direction[rows],
            np.ascontiguousarray(reach[rows]),
            half,
            *part,
        )
        best[rows], figures[rows] = part
    return SearchPeaks(best, figures[:, 0], figures[:, 1], figures[:, 2] > 0.0)
