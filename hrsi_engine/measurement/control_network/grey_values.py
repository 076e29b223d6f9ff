"""Normalised cross correlation of patches of the first window with their affine images in the second."""

import numpy as np

from ...foundation.pixel_filters import interpolate
from ...foundation.thresholds import threshold, thresholds
from .views import NetworkWindow


@thresholds
class PATCHES:
    """Patches whose grey values are correlated."""

    half_px: int = threshold(8, "px", "half side: patches of 17 x 17 px")
    least_usable: float = threshold(0.75, "", "smallest share of pixels usable in both windows")
    batch: int = threshold(1800, "patches", "patches in memory at a time")


def correlate_patches(
    first: NetworkWindow, second: NetworkWindow, first_xy: np.ndarray, second_xy: np.ndarray, A: np.ndarray,
    half_px: int = PATCHES.half_px,
) -> np.ndarray:  # fmt: skip
    """Return the correlation coefficient ``(n,)`` of each patch with its image under ``A`` (n, 2, 2).

    0 where too few pixels of the patch are usable.
    """
    result = np.empty(len(first_xy))
    for start in range(0, len(first_xy), PATCHES.batch):
        part = slice(start, start + PATCHES.batch)
        y, x = np.mgrid[-half_px : half_px + 1, -half_px : half_px + 1]
        offsets = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
        # A patch is spread over as many pixels of the image with the larger scale, so that neither is undersampled.
        ours, our_usable = _sample_patches(first, first_xy[part][:, None, :] + offsets)
        moved = np.einsum("nij,kj->nki", A[part], offsets)
        theirs, their_usable = _sample_patches(second, second_xy[part][:, None, :] + moved)
        weight = (our_usable & their_usable).astype(np.float32)
        count = np.maximum(weight.sum(axis=1), 1.0)
        a, b = ((grey - ((grey * weight).sum(axis=1) / count)[:, None]) * weight for grey in (ours, theirs))
        product = (a * b).sum(axis=1) / np.sqrt(np.maximum((a * a).sum(axis=1) * (b * b).sum(axis=1), 1e-12))
        result[part] = np.where(weight.mean(axis=1) >= PATCHES.least_usable, product, 0.0)
    return result


def _sample_patches(view: NetworkWindow, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return grey values and usability of positions ``(n, k, 2)``, bilinear."""
    places = xy.astype(np.float32)
    grey = interpolate(view.grey, places[..., 0], places[..., 1], order=1)
    usable = interpolate(view.usable.view(np.uint8), places[..., 0], places[..., 1], order=0, outside=0)
    return grey, usable.astype(bool)
