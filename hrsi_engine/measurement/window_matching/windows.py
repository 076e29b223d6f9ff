"""What windows are matched with: options and prepared images; and what comes out. `least_squares_matching` matches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

#: What became of a window: matched; leaves the images or their valid pixels; no texture; ran away; iterations used up.
DONE, OUTSIDE, WEAK, DIVERGED, ITERATIONS_USED_UP = 0, 1, 2, 3, 4
TERMS = 8  # two shifts, four affine terms, gain, offset
SMALLEST_GAIN = 0.05
RIVAL_PX = 3  # peaks nearer to the best one belong to it
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
