"""Filters and resampling of images by OpenCV, which is imported when the first image is filtered.

Images are float32 ``(lines, samples)``, masks bool; borders are ``mirror`` (about the centre of the last pixel),
``reflect`` (about its outer edge) and ``constant`` (0 outside). Without OpenCV they raise `MissingPackageError`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .packages import require_package
from .thresholds import threshold, thresholds

#: Smoothing and derivative kernel of an isotropic gradient (Scharr 2000); it is 32 times the gradient.
SCHARR = np.array([3.0, 10.0, 3.0]), np.array([-1.0, 0.0, 1.0])
_BORDERS = {"reflect": "BORDER_REFLECT", "mirror": "BORDER_REFLECT_101", "constant": "BORDER_CONSTANT"}
_ORDERS = {0: "INTER_NEAREST", 1: "INTER_LINEAR", 3: "INTER_CUBIC"}
LONGEST_MAP = 1 << 14  # longest side of the coordinate maps of cv2.remap, which must be below 32768


@thresholds
class BLUR:
    """Smoothing before measurements, and the blur of edges in images."""

    sigma_px: float = threshold(0.7, "px", "standard deviation of the Gaussian before matching and derivatives")
    edge_px: float = threshold(1.5, "px", "distance from an edge or corner within which grey values are blurred")
    end_px: float = threshold(2.5, "px", "distance from an edge at which its blur has ended")


@thresholds
class STRETCH:
    """Grey values of an image for people and for feature detection."""

    percent: tuple[float, float] = threshold((1.0, 99.0), "%", "percentiles that become black and white")
    view_percent: tuple[float, float] = threshold((2.0, 98.0), "%", "percentiles of black and white of a view of it")


def load_opencv() -> Any:
    """Return the module cv2."""
    return require_package("cv2")


def filter_separable(
    image: np.ndarray,
    along_row: Sequence[float] | np.ndarray,
    along_column: Sequence[float] | np.ndarray,
    border: str = "mirror",
) -> np.ndarray:
    """Return the correlation with a separable kernel; both factors have odd length and are (anti)symmetric.

    The type, float32 or float64, is that of the image; the kernel is centred at the pixel.
    """
    cv2 = load_opencv()
    kernels = (np.asarray(kernel, image.dtype) for kernel in (along_row, along_column))
    return np.asarray(cv2.sepFilter2D(image, -1, *kernels, borderType=getattr(cv2, _BORDERS[border])))


def blur(image: np.ndarray, sigma_px: float, border: str = "mirror") -> np.ndarray:
    """Return the image smoothed by a Gaussian that is truncated at four standard deviations."""
    cv2 = load_opencv()
    return np.asarray(cv2.GaussianBlur(image, (0, 0), float(sigma_px), borderType=getattr(cv2, _BORDERS[border])))


def slopes(image: np.ndarray, smooth: np.ndarray, slope: np.ndarray, border: str = "mirror") -> tuple[np.ndarray, ...]:
    """Return the gradients along rows and columns: ``slope`` is the derivative kernel, ``smooth`` the one across it."""
    return filter_separable(image, slope, smooth, border), filter_separable(image, smooth, slope, border)


def box_mean(image: np.ndarray, side: int) -> np.ndarray:
    """Return the mean of a square window of odd ``side`` around each pixel, mirrored at the border; float32 or 64."""
    return np.asarray(load_opencv().boxFilter(image, -1, (side, side)))


def make_valid_mean(valid: np.ndarray, side: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function for the means of the valid pixels in square windows of odd ``side``, 0 where there are none."""
    share = np.maximum(box_mean(valid.astype(np.float32), side), 1e-6)
    return lambda image: np.asarray(box_mean(np.where(valid, image, np.float32(0.0)), side) / share)


def compute_smaller_eigenvalue(xx: np.ndarray, yy: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the smaller eigenvalue of symmetric 2 x 2 tensors (Shi and Tomasi 1994: the strength of a corner)."""
    return np.asarray(0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def erode(mask: np.ndarray, side: int, outside: bool = True) -> np.ndarray:
    """Return the morphological erosion of a mask by a square of odd side; ``outside`` is the value beyond the image."""
    cv2 = load_opencv()
    square, border = np.ones((side, side), np.uint8), {"borderType": cv2.BORDER_CONSTANT, "borderValue": int(outside)}
    return np.asarray(cv2.erode(mask.view(np.uint8), square, **border)).view(bool)


def dilate(mask: np.ndarray, side: int) -> np.ndarray:
    """Return the morphological dilation of a mask by a square of odd side."""
    return ~erode(~mask, side)


def apply_opening(mask: np.ndarray, side: int) -> np.ndarray:
    """Return the morphological opening of a mask by a square of odd side."""
    return dilate(erode(mask, side), side)


def compute_local_maximum(image: np.ndarray, radius_px: float) -> np.ndarray:
    """Return the maximum within a circle of this radius around each pixel."""
    reach = int(radius_px)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return np.asarray(load_opencv().dilate(image, (np.hypot(x, y) <= radius_px).astype(np.uint8)))


def reduce_by_area(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image reduced to ``size`` (samples, lines): means of the old pixels, weighted by overlapping area."""
    cv2 = load_opencv()
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def reduce_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a mask reduced to ``size`` (samples, lines): the old pixels at the upper left corners of the new ones."""
    cv2 = load_opencv()
    return np.asarray(cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST)).view(bool)


def enlarge(image: np.ndarray, factor: int) -> np.ndarray:
    """Return an image with ``factor`` times as many pixels along each axis, interpolated linearly."""
    cv2 = load_opencv()
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR))


def interpolate(
    image: np.ndarray, x: np.ndarray, y: np.ndarray, order: int, outside: float | None = None
) -> np.ndarray:
    """Return the grey values of an image at columns ``x`` and rows ``y`` (float32, equal shape), which may be outside.

    order : 0 nearest, 1 linear, 3 cubic convolution, all in steps of 1/32 px
    outside : value outside the image, None for the nearest pixel
    """
    cv2 = load_opencv()
    kind = cv2.BORDER_REPLICATE if outside is None else cv2.BORDER_CONSTANT
    method = {"interpolation": getattr(cv2, _ORDERS[order]), "borderMode": kind, "borderValue": outside or 0}
    if max(x.shape) < LONGEST_MAP:
        return np.asarray(cv2.remap(image, x, y, **method))
    parts = [slice(start, start + LONGEST_MAP) for start in range(0, x.size, LONGEST_MAP)]
    lines = [cv2.remap(image, x.ravel()[part][None], y.ravel()[part][None], **method)[0] for part in parts]
    return np.concatenate(lines).reshape(x.shape)
