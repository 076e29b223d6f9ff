"""Options, bands, prepared images, results and limits of window matching.

Differences between images of different dates (shadows, plants, moisture) are strongest at low frequencies, like the
texture itself. After removal of low frequencies every frequency is weighted by its information on the position, as in a
generalised least-squares adjustment. Noisy or blurred images need more smoothing: the best band is selected per pair.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...foundation.pixel_filters import blur, erode, filter_separable, slopes
from ...foundation.thresholds import threshold, thresholds

#: Status of a window: converged; outside the images or valid pixels; no texture; diverged; iteration limit reached.
DONE, OUTSIDE, WEAK, DIVERGED, ITERATIONS_USED_UP = 0, 1, 2, 3, 4
TERMS = 8  # two shifts, four affine terms, gain, offset


@thresholds
class MATCHING:
    """Weights and limits of correlation and least-squares matching."""

    contrast: float = threshold(9.0, "sigma", "smallest height of a peak above the others, in robust sigmas")
    edge_px: int = threshold(4, "px", "border of tiles and templates for filters and gradients")
    rival_px: int = threshold(3, "px", "distance up to which peaks or tracks are one")
    spline_reach_px: int = threshold(12, "px", "half length of the spline's filter (error 1e-7)", "Unser 1999")
    taper: float = threshold(0.6, "", "sigma of the Gaussian weights relative to half the window")
    gradient_smoothing_px: float = threshold(0.8, "px", "standard deviation of the Gaussian before gradients")
    gradient_side_px: int = threshold(5, "px", "side of the area that a gradient depends on")


@dataclass(frozen=True)
class LsmOptions:
    """Options of least-squares matching.

    window_px : side of the template, odd; iterations : largest number of iterations
    closure_px : largest change at which they end, a tenth of which is left; reach_px : largest distance from the start
    """

    window_px: int = 31
    iterations: int = 20
    closure_px: float = 1e-2
    reach_px: float = 4.0

    @property
    def half(self) -> int:
        return self.window_px // 2

    def make_weights(self) -> np.ndarray:
        """Return the weights of the template's pixels, ``(side, side)``: a Gaussian, 0.25 in the middle of a side."""
        line = np.exp(-0.5 * (np.arange(-self.half, self.half + 1) / (MATCHING.taper * self.half)) ** 2)
        return line[:, None] * line


class PatchMatches(NamedTuple):
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
        """Standard deviation of a coordinate, quadratic mean of both axes, ``(n,)``: at least that of rounding."""
        return np.maximum(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2) / 2.0), 1e-6)


class ResultCache:
    """Cache of results that depend on the pixels of one image only."""

    _results: dict[Hashable, Any]

    def compute_once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return ``make()``, computed at the first call with a key and cached."""
        if key not in self._results:
            self._results[key] = make()
        return self._results[key]


class MatchImage(ResultCache):
    """An image prepared for matching: band-pass filtered grey values, spline coefficients, derivatives.

    ``smooth_px`` and ``remove_px`` are standard deviations of Gaussian filters: the result of the second is subtracted
    from that of the first; 0 for none.
    """

    def __init__(self, pixels: np.ndarray, valid: np.ndarray, smooth_px: float = 0.0, remove_px: float = 0.0) -> None:
        self.valid = valid
        raw = pixels.astype(np.float32)
        self.grey = blur(raw, smooth_px) if smooth_px > 0.0 else raw
        if remove_px > 0.0:
            self.grey = self.grey - blur(raw, remove_px)
        self._results = {}

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Coefficients of the cubic B-spline through the grey values, float32.

        The recursive filter (Unser 1999) has the impulse response sqrt(3) z^|k|. Truncated at 1e-7 and applied as a
        filter of finite length, it takes a third of the time.
        """
        pole = np.sqrt(3.0) - 2.0
        response = (
            np.sqrt(3.0) * pole ** np.abs(np.arange(-MATCHING.spline_reach_px, MATCHING.spline_reach_px + 1))
        ).astype(np.float32)
        return filter_separable(self.grey, response, response)

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the spline by column and by row at the pixels, float32."""
        smooth, slope = np.array([1, 4, 1], np.float32) / 6.0, np.array([-1, 0, 1], np.float32) / 2.0
        by_column, by_row = slopes(self.coefficients, smooth, slope)
        return by_column, by_row

    def mask_clear(self, distance_px: int) -> np.ndarray:
        """Return the mask of pixels with only valid pixels of the image within a (square) distance."""
        clear: np.ndarray = self.compute_once(
            ("clear", distance_px), lambda: erode(self.valid, 2 * distance_px + 1, outside=False)
        )
        return clear


Results = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Band:
    """A band-pass of two Gaussians (standard deviations in px): the result of the first minus that of the second.

    sigma_factor : true standard deviation of a matched position over that of the normal equations, which assume that
    residuals of pixels are independent and Gaussian weights inverse variances; from simulated windows with noise
    """

    smooth_px: float
    remove_px: float
    sigma_factor: float

    def filter_image(self, pixels: np.ndarray, valid: np.ndarray, coarser: float = 1.0) -> MatchImage:
        """Return an image in this band; ``coarser`` is the pixel size of the other image relative to this one."""
        smooth = float(np.hypot(self.smooth_px * coarser, 0.5 * np.sqrt(coarser**2 - 1.0)))
        return MatchImage(pixels, valid, smooth, self.remove_px * coarser)


MATCHING_BANDS: dict[str, Band] = {
    "fine": Band(0.0, 1.0, 0.77),
    "middle": Band(0.5, 2.0, 0.97),
    "coarse": Band(0.9, 5.0, 1.75),
}
SEARCH_BAND = Band(0.7, 1.5, 1.0)
