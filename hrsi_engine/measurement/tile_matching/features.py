"""SIFT of satellite images: 8 bit with the contrast where the image has its own, and good distances of descriptors."""

from typing import NamedTuple

import numpy as np

from ...foundation.pixel_filters import erode, should_use_opencv
from ...foundation.thresholds import threshold, thresholds
from .sift_arrays import detect_sift_by_numpy


@thresholds
class FEATURES:
    """How SIFT features are found in satellite images and compared."""

    contrast: float = threshold(0.01, "", "least of a feature: 11 bit, little texture", "Lowe 2004 has 0.03")
    valid_px: int = threshold(9, "px", "side of the square around a feature that must be valid")
    stretch: tuple[float, float] = threshold((1.0, 99.0), "%", "percentiles of the grey values that become 0 and 255")
    lenient_ratio: float = threshold(0.9, "", "of descriptors' distances; geometry decides", "Lowe 2004 has 0.8")


class SiftFeatures(NamedTuple):
    """Positions ``(n, 2)`` (column, row), strengths ``(n,)`` and descriptors ``(n, 128)`` uint8."""

    xy: np.ndarray
    strength: np.ndarray
    descriptors: np.ndarray


def detect_sift_features(grey: np.ndarray, valid: np.ndarray, most: int) -> SiftFeatures:
    """Return the strongest SIFT features (Lowe 2004) of a window: by OpenCV where it is there, else by NumPy."""
    byte = stretch_to_byte(grey, valid)
    if byte is None:
        return SiftFeatures(np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.uint8))
    usable = erode(valid, FEATURES.valid_px)
    if should_use_opencv():
        return _detect_by_opencv(byte, usable, most)
    return SiftFeatures(*detect_sift_by_numpy(byte, usable, most, FEATURES.contrast))


def _detect_by_opencv(byte: np.ndarray, usable: np.ndarray, most: int) -> SiftFeatures:
    import cv2

    sift = cv2.SIFT_create(nfeatures=most, contrastThreshold=FEATURES.contrast, enable_precise_upscale=True)
    points, descriptors = sift.detectAndCompute(byte, None if usable.all() else usable.view(np.uint8))
    if not points:
        return SiftFeatures(np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.uint8))
    xy = np.array([point.pt for point in points], dtype=np.float64)
    strength = np.array([point.response for point in points])
    return SiftFeatures(xy, strength, np.clip(descriptors, 0, 255).astype(np.uint8))


def stretch_to_byte(grey: np.ndarray, valid: np.ndarray) -> np.ndarray | None:
    """Return the window as 8 bit between the 1st and 99th percentile; None where it holds no texture at all."""
    if not valid.any():
        return None
    low, high = np.percentile(grey[valid][::7], FEATURES.stretch)
    if not high > low:
        return None
    return np.clip((grey.astype(np.float32) - low) * (255.0 / (high - low)), 0.0, 255.0).astype(np.uint8)


def compute_root_sift(descriptors: np.ndarray) -> np.ndarray:
    """Return square roots of L1-normalised descriptors: their dot product is Hellinger's (Arandjelovic 2012)."""
    total = descriptors.sum(axis=1, keepdims=True, dtype=np.float32)
    return np.sqrt(descriptors / np.maximum(total, 1e-7)).astype(np.float32)


def invert_descriptors(descriptors: np.ndarray) -> np.ndarray:
    """Return the SIFT descriptors ``(n, 128)`` that the same points have in the image's negative.

    All gradients are turned by 180 degrees, and with them the point's own direction, in which they count: the 4 x 4
    parts of a descriptor are those at the opposite places, with the same 8 directions in each.
    """
    return descriptors.reshape(-1, 4, 4, 8)[:, ::-1, ::-1].reshape(-1, 128)
