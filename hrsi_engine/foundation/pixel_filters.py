"""Filters and resampling of images: the one door to OpenCV, which does them where it is there; else NumPy and SciPy.

A stock QGIS on Windows has no OpenCV. Both ways give the same to rounding, except for `interpolate`, where OpenCV has
32 steps of a pixel. ``HRSI_OPENCV=0`` turns OpenCV off. Images are ``(lines, samples)`` float32, masks bool; borders
have SciPy's names: ``mirror`` repeats the pixels inside around the last one, ``reflect`` around its edge, and beyond
``constant`` all is 0.
"""

import os
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

#: Weights across and along a slope that favour no direction (Scharr 2000); slopes come out 32 times too large.
SCHARR = np.array([3.0, 10.0, 3.0]), np.array([-1.0, 0.0, 1.0])


def should_use_opencv() -> bool:
    """Tell whether to use OpenCV: it can be imported, and HRSI_OPENCV is not 0."""
    if os.environ.get("HRSI_OPENCV") == "0":
        return False
    try:
        import_module("cv2")
    except ImportError:
        return False
    return True


@cache
def _choose_filters() -> Any:
    """Return who does the work; OpenCV is loaded when a first image is filtered."""
    if should_use_opencv():
        return import_module(".opencv_filters", __package__).OpenCVFilters
    return import_module(".array_filters", __package__).ArrayFilters


def filter_separable(
    image: np.ndarray, along_row: Sequence[float] | np.ndarray, along_column: Sequence[float] | np.ndarray,
    border: str = "mirror",
) -> np.ndarray:  # fmt: skip
    """Return the correlation with a kernel that is the product of two, both odd and symmetric or antisymmetric.

    float32 or float64, as the image; the kernels' middles are at the pixel.
    """
    kernels = (np.asarray(kernel, image.dtype) for kernel in (along_row, along_column))
    return np.asarray(_choose_filters().filter_separable(image, *kernels, border))


def blur(image: np.ndarray, sigma_px: float, border: str = "mirror") -> np.ndarray:
    """Return the image smoothed by a Gaussian, cut off at four standard deviations."""
    return np.asarray(_choose_filters().blur(image, float(sigma_px), border))


def slopes(image: np.ndarray, smooth: np.ndarray, slope: np.ndarray, border: str = "mirror") -> tuple[np.ndarray, ...]:
    """Return the grey value gradients along rows and columns, from one kernel along the direction and one across it."""
    return filter_separable(image, slope, smooth, border), filter_separable(image, smooth, slope, border)


def box_mean(image: np.ndarray, side: int) -> np.ndarray:
    """Return the mean over an odd square around each pixel, mirrored at the border; float32 or float64."""
    return np.asarray(_choose_filters().box_mean(image, side))


def compute_smaller_eigenvalue(xx: np.ndarray, yy: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the smaller eigenvalue of symmetric 2 x 2 tensors (Shi and Tomasi 1994: the strength of a corner)."""
    return np.asarray(0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2))


def erode(mask: np.ndarray, side: int, outside: bool = True) -> np.ndarray:
    """Return the morphological erosion of a mask by an odd square; ``outside`` is the value beyond the image's edge."""
    return np.asarray(_choose_filters().erode(mask, side, outside))


def dilate(mask: np.ndarray, side: int) -> np.ndarray:
    """Return the morphological dilation of a mask by an odd square."""
    return ~erode(~mask, side)


def apply_opening(mask: np.ndarray, side: int) -> np.ndarray:
    """Return the morphological opening of a mask by an odd square."""
    return dilate(erode(mask, side), side)


def largest_within(image: np.ndarray, radius_px: float) -> np.ndarray:
    """Return the largest value within a radius of each pixel."""
    return np.asarray(_choose_filters().largest_within(image, radius_px))


def reduce_by_area(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image of fewer pixels, ``size`` (samples, lines): means weighted by the area they share."""
    return np.asarray(_choose_filters().reduce_by_area(image, size))


def reduce_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a mask of fewer pixels, ``size`` (samples, lines): those at their upper left corners."""
    return np.asarray(_choose_filters().reduce_mask(mask, size))


def enlarge(image: np.ndarray, factor: int) -> np.ndarray:
    """Return an image of ``factor`` times as many pixels along each axis, linear between the pixels' middles."""
    return np.asarray(_choose_filters().enlarge(image, factor))


def interpolate(
    image: np.ndarray, x: np.ndarray, y: np.ndarray, order: int, outside: float | None = None
) -> np.ndarray:
    """Return an image at columns ``x`` and rows ``y`` (float32, of one shape), which may lie beyond it.

    order : 0 the nearest pixel, 1 linear, 3 cubic convolution; outside : value there, None for that of the last pixel
    """
    return np.asarray(_choose_filters().interpolate(image, x, y, order, outside))
