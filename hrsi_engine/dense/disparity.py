"""Dense disparities of a rectified pair: semi-global matching, then least-squares matching at every pixel.

OpenCV's semi-global matching (Hirschmueller 2008) finds the whole pixel on images that are normalised to local mean 0
and standard deviation 1, as radiometry differs between images. Its fractions of pixels are drawn to whole ones. They
are replaced by least-squares matching (Ackermann 1984; thesis chapter 3) in a window around each pixel: with the second
image resampled by the disparities ``R(u - d)``, a correction ``delta`` and an offset ``o`` are estimated in

    L - R = -R' delta + o,      delta = -cov(R', L - R) / var(R'),

where ``cov`` and ``var`` are those of the window: box filters, thus some operations a pixel for all windows. Each pixel
of a window is resampled by its own disparity, and disparities are smoothed only over neighbours of similar ones:
windows across the wall of a building do not mix its roof with the ground.

Where images differ by more than noise (walls, shadows, uniform roofs of which a window shows only an edge), residuals
r are correlated and lie where the gradients are. The standard deviation is therefore that of the scores z = R' r in
areas of k² pixels, which needs neither white nor equal noise (White 1980; Newey and West 1987), together with the
roughness of the disparities in the window, of which an edge shows only one:

    sigma² = k² mean(mean_k(z)²) / (n (var(R') - s²/4)²) + c² var(d).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..foundation.pixel_filters import box_mean, filter_separable, interpolate, load_opencv, make_valid_mean
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import threshold, thresholds


@thresholds
class DISPARITY:
    """Semi-global and dense least-squares matching."""

    speckle_px: int = threshold(100, "px", "smallest area of connected disparities")
    least_correlation: float = threshold(0.2, "", "smallest correlation of a window")
    least_support: float = threshold(0.35, "", "smallest mean correlation of the windows around a pixel, 0 where none")
    largest_sigma_px: float = threshold(1.0, "px", "largest standard deviation of a disparity")
    roughness: float = threshold(1.2, "", "standard deviation of a disparity over the roughness of its window")


#: Normalisation: sides of the windows of the local median, of the mean that smooths its steps, and of the contrast.
MEDIAN_PX, MEDIAN_SMOOTH_PX, CONTRAST_PX = 15, 5, 41
#: Semi-global matching: side of its block, and penalties of disparity steps of 1 and more, for each pixel of the block.
BLOCK_PX, PENALTIES = 3, (4, 16)
#: Least-squares matching: side of the window, iterations, and largest correction of an iteration.
WINDOW_PX, LSM_ITERATIONS, STEP_PX = 7, 3, 0.5
LAG_PX = 3  #: side of the area in which residuals are correlated
FLOOR_PX = 0.02  #: part of the standard deviation of a disparity that its residuals do not show (resampling)
SUPPORT_PX = 15  #: side of the area in which matches support one another
SMOOTH_PX = 1.0  #: difference of disparities whose neighbours are smoothed with a weight of 0.6


class Disparities(NamedTuple):
    """Disparities and their standard deviations ``(rows, columns)``, px, float32; NaN where nothing matches."""

    disparity: np.ndarray
    sigma_px: np.ndarray


def normalise_contrast(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return grey values with local mean 0 and standard deviation 1, float32; 0 where they are not valid.

    Bright roofs must not flatten the ground around them: what exceeds a multiple of the usual contrast of the tile is
    cut off, and the local level is a median: a mean draws an outline of a bright object at half the size of its window.
    """
    if not valid.any():
        return np.zeros(grey.shape, np.float32)
    filled = np.where(valid, grey, 0).astype(np.float32)
    low, high = np.percentile(filled[valid], (0.5, 99.5))
    step = max(float(high - low) / 255.0, 1e-6)
    levels = np.clip((filled - low) / step, 0, 255).astype(np.uint8)
    median = load_opencv().medianBlur(levels, MEDIAN_PX).astype(np.float32)
    deviation = filled - (np.float32(low) + step * make_valid_mean(valid, MEDIAN_SMOOTH_PX)(median))
    usual = max(float(robust_sigma(deviation[valid])), 1e-6)
    deviation = np.clip(deviation, -4.0 * usual, 4.0 * usual)
    contrast = np.sqrt(np.maximum(make_valid_mean(valid, CONTRAST_PX)(deviation * deviation), 0.0))
    return np.where(valid, deviation / (contrast + 0.15 * usual), np.float32(0.0))


def compute_disparities(
    left: np.ndarray, right: np.ndarray, valid: np.ndarray, disparities: tuple[float, float]
) -> Disparities:
    """Return the disparities of normalised images of equal size.

    valid : mask of usable pixels of the left image
    disparities : smallest and largest one to be searched
    """
    cv2 = load_opencv()
    first = int(np.floor(disparities[0])) - 2
    count = -(-(int(np.ceil(disparities[1])) + 2 - first) // 16) * 16
    p1, p2 = (p * BLOCK_PX**2 for p in PENALTIES)
    matcher = cv2.StereoSGBM_create(
        minDisparity=first, numDisparities=count, blockSize=BLOCK_PX, P1=p1, P2=p2, disp12MaxDiff=1,
        preFilterCap=31, uniquenessRatio=5, speckleWindowSize=DISPARITY.speckle_px, speckleRange=1,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    bytes_of = [np.clip(128.0 + 42.0 * grey, 0, 255).astype(np.uint8) for grey in (left, right)]
    whole = matcher.compute(*bytes_of).astype(np.float32) / 16.0
    found = (whole >= first) & valid
    return refine_disparities(left, right, np.where(found, whole, np.float32(np.nan)))


def refine_disparities(left: np.ndarray, right: np.ndarray, start: np.ndarray) -> Disparities:
    """Return disparities refined by least-squares matching in a window around every pixel; ``start`` is NaN if none."""
    found = np.isfinite(start)
    v, u = np.indices(start.shape, dtype=np.float32)
    slope = filter_separable(right, (-0.5, 0.0, 0.5), (1.0,))
    disparity = _smooth(start, found)
    mean = make_valid_mean(found, WINDOW_PX)
    for _ in range(LSM_ITERATIONS):
        disparity = np.rint(disparity * 32.0) / np.float32(32.0)  # steps of `interpolate`
        position = u - disparity
        resampled = interpolate(right, position, v, 3, outside=0.0)
        derivative = interpolate(slope, position, v, 1, outside=0.0)
        difference = left - resampled
        g, r = mean(derivative), mean(difference)
        g_variance = np.maximum(mean(derivative * derivative) - g * g, 1e-6)
        correction = -(mean(derivative * difference) - g * r) / g_variance
        disparity = disparity + np.clip(correction, -STEP_PX, STEP_PX)
        disparity = _smooth(np.where(found, disparity, np.float32(np.nan)), found)
    r_variance = np.maximum(mean(difference * difference) - r * r, 1e-6)
    first, second = mean(left), mean(resampled)
    covariance = mean(left * resampled) - first * second
    variances = (mean(left * left) - first * first) * (mean(resampled * resampled) - second * second)
    correlation = covariance / np.sqrt(np.maximum(variances, 1e-6))
    # Noise has gradients too: those of its difference [-1/2, 0, 1/2] are a quarter of the variance of L - R
    g_signal = np.maximum(g_variance - 0.25 * r_variance, 1e-6)
    count = WINDOW_PX**2 * np.maximum(box_mean(found.astype(np.float32), WINDOW_PX), 1e-6)
    score = np.where(found, (derivative - g) * (difference - r), np.float32(0.0))
    variance = LAG_PX**2 * mean(box_mean(score, LAG_PX) ** 2) / (count * g_signal**2)
    # What remains of the disparities without their local mean has no slope
    remainder = np.where(found, disparity - mean(disparity), np.float32(0.0))
    variance += DISPARITY.roughness**2 * mean(remainder * remainder)
    sigma = np.sqrt(np.maximum(variance, 0.0) + FLOOR_PX**2)
    # A wall has windows of low correlation among good ones; water and clouds have chance matches among nothing
    support = box_mean(np.where(found, np.maximum(correlation, 0.0), np.float32(0.0)), SUPPORT_PX)
    usable = (
        found
        & (correlation > DISPARITY.least_correlation)
        & (support > DISPARITY.least_support)
        & (sigma < DISPARITY.largest_sigma_px)
    )
    none = np.float32(np.nan)
    return Disparities(np.where(usable, disparity, none), np.where(usable, sigma, none))


def _smooth(disparity: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Return disparities smoothed over neighbours with similar ones (bilateral filter); 0 where there are none."""
    if not found.any():
        return np.zeros_like(disparity)
    apart = np.float32(np.nanmin(disparity) - 20.0 * SMOOTH_PX)
    filled = np.where(found, disparity, apart).astype(np.float32)
    smooth = load_opencv().bilateralFilter(filled, 5, SMOOTH_PX, 2.0)
    return np.where(found, smooth, np.float32(0.0))
