"""The structure tensor of an image: products of the derivatives, averaged over a patch (thesis eq. 3.1)."""

from typing import NamedTuple

import numpy as np

from ...foundation.pixel_filters import compute_local_maximum, erode, filter_separable, slopes
from ...foundation.thresholds import threshold, thresholds

SIMULATED_OBJECTS = "simulated scenes of objects and corners, 2026-11-21 (tests/measurement/test_interest_points.py)"


@thresholds
class CORNER_DETECTION:
    """Filters of the structure tensor of the Förstner operator."""

    derivative_px: float = threshold(1.0, "px", "standard deviation of the Gaussian of the derivatives")
    patch_px: float = threshold(2.0, "px", "standard deviation of the Gaussian window")


class StructureTensor(NamedTuple):
    """Means over a patch of the products of the derivatives by sample (x) and line (y), each ``(lines, samples)``."""

    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray


def compute_structure_tensor(grey: np.ndarray) -> StructureTensor:
    """Return the structure tensor of an image (thesis eq. 3.1), float32."""
    smooth, slope = make_gaussian_kernels(CORNER_DETECTION.derivative_px)
    by_x, by_y = slopes(np.asarray(grey, np.float32), smooth, slope, "reflect")
    patch, _ = make_gaussian_kernels(CORNER_DETECTION.patch_px)

    def mean(product: np.ndarray) -> np.ndarray:
        return filter_separable(product, patch, patch, "reflect")

    return StructureTensor(mean(by_x * by_x), mean(by_x * by_y), mean(by_y * by_y))


def make_gaussian_kernels(sigma_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a Gaussian of sum 1 and its derivative, float32; correlation with the latter gives the gradient."""
    reach = int(np.ceil(3.5 * sigma_px))
    x = np.arange(-reach, reach + 1)
    smooth = np.exp(-0.5 * (x / sigma_px) ** 2)
    smooth /= smooth.sum()
    slope = x * smooth
    return smooth.astype(np.float32), (slope / np.sum(x * slope)).astype(np.float32)


def find_local_maxima(strength: np.ndarray, radius_px: float) -> np.ndarray:
    """Return the mask of pixels that are positive and the maximum within a radius."""
    return (strength > 0.0) & (strength >= compute_local_maximum(strength, radius_px))


def mask_usable_surroundings(usable: np.ndarray, distance_px: int) -> np.ndarray:
    """Return the mask of pixels without unusable pixels of the window within a (square) distance."""
    if usable.all():
        return usable
    return erode(usable, 2 * distance_px + 1)
