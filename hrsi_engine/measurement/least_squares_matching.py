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
does to noise (`SIGMA_FACTOR`, from simulation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from .. import compiled_code

#: What became of a window: matched; leaves the images or their valid pixels; no texture; ran away; iterations used up.
DONE, OUTSIDE, WEAK, DIVERGED, UNFINISHED = 0, 1, 2, 3, 4
TERMS = 8  # two shifts, four affine terms, gain, offset
SMALLEST_GAIN = 0.05
TAPER = 0.6  # of half the window: standard deviation of the Gaussian weights


@dataclass(frozen=True)
class LsmOptions:
    """How windows are matched.

    window_px : side of the template, odd; most : iterations
    closure_px : largest change at which they stop; reach_px : farthest from the start
    """

    window_px: int = 31
    most: int = 20
    closure_px: float = 3e-3
    reach_px: float = 4.0

    @property
    def half(self) -> int:
        return self.window_px // 2

    def weights(self) -> np.ndarray:
        """Return the weights of the template's pixels, ``(side, side)``: a Gaussian, 0.25 at the middle of the edge."""
        line = np.exp(-0.5 * (np.arange(-self.half, self.half + 1) / (TAPER * self.half)) ** 2)
        return line[:, None] * line


class Patches(NamedTuple):
    """Matched windows: positions ``xy (n, 2)`` and ``affine (n, 2, 2)`` in the second image, covariance (n, 2, 2) px²,
    correlation, gain and RMS of the residual grey values (n,), status (n,)."""

    xy: np.ndarray
    affine: np.ndarray
    covariance: np.ndarray
    correlation: np.ndarray
    gain: np.ndarray
    rms: np.ndarray
    status: np.ndarray

    @property
    def sigma_px(self) -> np.ndarray:
        """Standard deviation of a coordinate, mean of both axes, ``(n,)``."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2) / 2.0)


class MatchImage:
    """An image prepared for matching: band-passed grey values, spline coefficients, slopes.

    ``smooth_px`` is the Gaussian that smooths, ``remove_px`` the one whose result is taken away; 0 for neither.
    """

    def __init__(self, pixels: np.ndarray, valid: np.ndarray, smooth_px: float = 0.0, remove_px: float = 0.0) -> None:
        self.valid = valid
        raw = pixels.astype(np.float32)
        self.grey = cv2.GaussianBlur(raw, (0, 0), smooth_px) if smooth_px > 0.0 else raw
        if remove_px > 0.0:
            self.grey = self.grey - cv2.GaussianBlur(raw, (0, 0), remove_px)
        self._clear: dict[int, np.ndarray] = {}

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Coefficients of the cubic B-spline through the grey values, float32."""
        return np.asarray(ndimage.spline_filter(self.grey, order=3, output=np.float32, mode="mirror"))

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of that spline by column and by row at the pixels, float32."""
        smooth, slope = np.array([1, 4, 1], np.float32) / 6.0, np.array([-1, 0, 1], np.float32) / 2.0
        border = cv2.BORDER_REFLECT_101
        return (
            cv2.sepFilter2D(self.coefficients, cv2.CV_32F, slope, smooth, borderType=border),
            cv2.sepFilter2D(self.coefficients, cv2.CV_32F, smooth, slope, borderType=border),
        )

    def clear(self, distance_px: int) -> np.ndarray:
        """Return the mask of pixels with nothing but valid pixels of the image so far around them (square)."""
        if distance_px not in self._clear:
            square = np.ones((2 * distance_px + 1, 2 * distance_px + 1), np.uint8)
            self._clear[distance_px] = cv2.erode(
                self.valid.astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0
            ).astype(bool)
        return self._clear[distance_px]


Results = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def match_patches(
    first: MatchImage,
    second: MatchImage,
    centre: np.ndarray,
    start: np.ndarray,
    affine: np.ndarray,
    options: LsmOptions | None = None,
) -> Patches:
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
    rows = np.flatnonzero(_usable_template(first, centre, options.half) & np.isfinite(start).all(axis=1))
    if len(rows):
        part: Results = tuple(column[rows] for column in results)  # type: ignore[assignment]
        _implementation()(first, second, centre[rows], part, options)
        for column, values in zip(results, part, strict=True):
            column[rows] = values
    xy, shape, covariance, figures, status = results
    _mark_unclear(second, xy, shape, status, options)
    return Patches(xy, shape, covariance, figures[:, 0], figures[:, 1], figures[:, 2], status)


def _usable_template(first: MatchImage, centre: np.ndarray, half: int) -> np.ndarray:
    rows, columns = first.grey.shape
    usable = np.all((centre >= half) & (centre < np.array([columns, rows]) - half), axis=1)
    usable[usable] = first.clear(half)[centre[usable, 1], centre[usable, 0]]
    return usable


def _mark_unclear(
    second: MatchImage, xy: np.ndarray, affine: np.ndarray, status: np.ndarray, options: LsmOptions
) -> None:
    """Set the status of windows that meet invalid pixels of the second image."""
    if second.valid.all() or not len(xy):
        return
    matched = np.flatnonzero((status == DONE) | (status == UNFINISHED))
    size = np.ceil(options.half * np.abs(affine[matched]).sum(axis=2).max(axis=1)).astype(np.int64) + 1
    pixel = np.floor(xy[matched] + 0.5).astype(np.int64)
    for reach in np.unique(size):
        here = matched[size == reach]
        column, row = pixel[size == reach].T
        status[here[~second.clear(int(reach))[row, column]]] = OUTSIDE


Implementation = Callable[[MatchImage, MatchImage, np.ndarray, "Results", LsmOptions], None]


def _implementation() -> Implementation:
    if compiled_code.wanted():
        return _by_compiled_loops
    from .lsm_arrays import match_in_parts

    return match_in_parts


def _by_compiled_loops(
    first: MatchImage, second: MatchImage, centre: np.ndarray, results: Results, options: LsmOptions
) -> None:
    from .lsm_kernels import match_range

    match_range(
        0, len(centre), (first.grey, *first.slopes, second.coefficients), centre, options.weights(),
        (options.most, options.closure_px, options.reach_px), results,
    )  # fmt: skip
