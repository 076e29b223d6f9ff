"""Filters and resampling of images: computed by OpenCV if it can be imported, otherwise by NumPy and SciPy.

No other module uses OpenCV's filters, since QGIS on Windows has no OpenCV. The results are equal except for rounding
and for `interpolate`, where OpenCV has steps of 1/32 pixel. ``HRSI_OPENCV=0`` turns OpenCV off. Images are float32
``(lines, samples)``, masks bool; borders have SciPy's names: ``mirror`` reflects about the centre of the last pixel,
``reflect`` about its outer edge, and ``constant`` is 0 outside.
"""

import os
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

#: Smoothing and derivative kernel of an isotropic gradient (Scharr 2000); it is 32 times the gradient.
SCHARR = np.array([3.0, 10.0, 3.0]), np.array([-1.0, 0.0, 1.0])


def should_use_opencv() -> bool:
    """Return True if OpenCV can be imported and HRSI_OPENCV is not 0."""
    if os.environ.get("HRSI_OPENCV") == "0":
        return False
    try:
        import_module("cv2")
    except ImportError:
        return False
    return True


@cache
def _choose_filters() -> Any:
    """Return the class that implements the filters; OpenCV is imported when the first image is filtered."""
    if should_use_opencv():
        return import_module(".opencv_filters", __package__).OpenCVFilters
    return import_module(".array_filters", __package__).ArrayFilters


def filter_separable(
    image: np.ndarray, along_row: Sequence[float] | np.ndarray, along_column: Sequence[float] | np.ndarray,
    border: str = "mirror",
) -> np.ndarray:  # fmt: skip
    """Return the correlation with a separable kernel; both factors have odd length and are (anti)symmetric.

    The type, float32 or float64, is that of the image; the kernel is centred at the pixel.
    """
    kernels = (np.asarray(kernel, image.dtype) for kernel in (along_row, along_column))
    return np.asarray(_choose_filters().filter_separable(image, *kernels, border))


def blur(image: np.ndarray, sigma_px: float, border: str = "mirror") -> np.ndarray:
    """Return the image smoothed by a Gaussian that is truncated at four standard deviations."""
    return np.asarray(_choose_filters().blur(image, float(sigma_px), border))


def slopes(image: np.ndarray, smooth: np.ndarray, slope: np.ndarray, border: str = "mirror") -> tuple[np.ndarray, ...]:
    """Return the gradients along rows and columns: ``slope`` is the derivative kernel, ``smooth`` the one across it."""
    return filter_separable(image, slope, smooth, border), filter_separable(image, smooth, slope, border)


def box_mean(image: np.ndarray, side: int) -> np.ndarray:
    """Return the mean of a square window of odd ``side`` around each pixel, mirrored at the border; float32 or 64."""
    return np.asarray(_choose_filters().box_mean(image, side))


def compute_smaller_eigenvalue(xx: np.ndarray, yy: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the smaller eigenvalue of symmetric 2 x 2 tensors (Shi and Tomasi 1994: the strength of a corner)."""
    return np.asarray(0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def erode(mask: np.ndarray, side: int, outside: bool = True) -> np.ndarray:
    """Return the morphological erosion of a mask by a square of odd side; ``outside`` is the value beyond the image."""
    return np.asarray(_choose_filters().erode(mask, side, outside))


def dilate(mask: np.ndarray, side: int) -> np.ndarray:
    """Return the morphological dilation of a mask by a square of odd side."""
    return ~erode(~mask, side)


def apply_opening(mask: np.ndarray, side: int) -> np.ndarray:
    """Return the morphological opening of a mask by a square of odd side."""
    return dilate(erode(mask, side), side)


def compute_local_maximum(image: np.ndarray, radius_px: float) -> np.ndarray:
    """Return the maximum within a circle of this radius around each pixel."""
    return np.asarray(_choose_filters().compute_local_maximum(image, radius_px))


def reduce_by_area(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image reduced to ``size`` (samples, lines): means of the old pixels, weighted by overlapping area."""
    return np.asarray(_choose_filters().reduce_by_area(image, size))


def reduce_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a mask reduced to ``size`` (samples, lines): the old pixels at the upper left corners of the new ones."""
    return np.asarray(_choose_filters().reduce_mask(mask, size))


def enlarge(image: np.ndarray, factor: int) -> np.ndarray:
    """Return an image with ``factor`` times as many pixels along each axis, interpolated linearly."""
    return np.asarray(_choose_filters().enlarge(image, factor))


def interpolate(
    image: np.ndarray, x: np.ndarray, y: np.ndarray, order: int, outside: float | None = None
) -> np.ndarray:
    """Return the grey values of an image at columns ``x`` and rows ``y`` (float32, equal shape), which may be outside.

    order : 0 nearest, 1 linear, 3 cubic convolution; outside : value outside the image, None for the nearest pixel
    """
    return np.asarray(_choose_filters().interpolate(image, x, y, order, outside))
