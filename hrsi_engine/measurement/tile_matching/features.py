"""What SIFT needs of satellite images: 8 bit with the contrast where the image has its own, and good distances."""

from __future__ import annotations

import numpy as np

SIFT_CONTRAST = 0.01  # SIFT's contrast threshold: low, for satellite images of 11 bit and little texture
TILE_STRETCH_PERCENT = (1.0, 99.0)


def stretch_to_byte(grey: np.ndarray, valid: np.ndarray) -> np.ndarray | None:
    """Return the window as 8 bit between the 1st and 99th percentile; None where it holds no texture at all."""
    if not valid.any():
        return None
    low, high = np.percentile(grey[valid][::7], TILE_STRETCH_PERCENT)
    if not high > low:
        return None
    return np.clip((grey.astype(np.float32) - low) * (255.0 / (high - low)), 0.0, 255.0).astype(np.uint8)


def root_sift(descriptors: np.ndarray) -> np.ndarray:
    """Return square roots of L1-normalised descriptors: their dot product is Hellinger's (Arandjelovic 2012)."""
    total = descriptors.sum(axis=1, keepdims=True, dtype=np.float32)
    return np.sqrt(descriptors / np.maximum(total, 1e-7)).astype(np.float32)


def descriptors_of_negative(descriptors: np.ndarray) -> np.ndarray:
    """Return the SIFT descriptors ``(n, 128)`` that the same points have in the image's negative.

    All gradients are turned by 180 degrees, and with them the point's own direction, in which they count: the 4 x 4
    parts of a descriptor are those at the opposite places, with the same 8 directions in each.
    """
    return descriptors.reshape(-1, 4, 4, 8)[:, ::-1, ::-1].reshape(-1, 128)
