"""Corner detectors on the structure tensor: Harris and Stephens (1988) and Förstner and Gülch (1987).

The tensor ``A`` of thesis eq. 3.1 averages products of the derivatives over a patch. Harris takes its strength
``det A - kappa (trace A)²`` (eq. 3.2), Förstner ``w = det A / trace A`` and the roundness ``q = 4 det A / (trace A)²``.
Interest points are local maxima of the strength above the threshold TB, super points those above TA > TB.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...foundation.thresholds import threshold, thresholds
from ...measurement.interest_points.corners import (
    CORNER_DETECTION,
    SIMULATED_OBJECTS,
    StructureTensor,
    compute_structure_tensor,
    find_local_maxima,
    mask_usable_surroundings,
)
from ...measurement.interest_points.windows import STATISTICS_HALO_PX, DetectionWindow, ImageStatistics, normalise
from .options import CornerOptions


@thresholds
class CORNER_PEAKS:
    """Limits for corners among the maxima of an interest operator, and their precision."""

    support_px: int = threshold(12, "px", "reach of the pixels that influence the strength")
    roundness: float = threshold(0.5, "", "smallest roundness q: 1 for gradients of all directions, 0 on an edge")
    model_sigma_px: float = threshold(0.25, "px", "repeatability between views, without noise", SIMULATED_OBJECTS)


class CornerPeaks(NamedTuple):
    """Local maxima: sub-pixel positions (n, 2) in the image, strengths (n,), sigma (n,) px."""

    xy: np.ndarray
    strength: np.ndarray
    sigma_px: np.ndarray


def compute_harris_strength(tensor: StructureTensor, options: CornerOptions) -> np.ndarray:
    """Return thesis eq. 3.2, positive at corners."""
    trace = tensor.xx + tensor.yy
    return tensor.xx * tensor.yy - tensor.xy**2 - np.float32(options.kappa) * trace**2


def compute_foerstner_strength(tensor: StructureTensor, options: CornerOptions) -> np.ndarray:
    """Return Förstner's w where the gradients are round enough, else 0."""
    trace = np.maximum(tensor.xx + tensor.yy, np.float32(1e-12))
    determinant = tensor.xx * tensor.yy - tensor.xy**2
    return np.where(4.0 * determinant > CORNER_PEAKS.roundness * trace**2, determinant / trace, np.float32(0.0))


Strength = Callable[[StructureTensor, CornerOptions], np.ndarray]


def compute_corner_halo_px(options: CornerOptions) -> int:
    """Return how far a window must reach beyond its core."""
    return STATISTICS_HALO_PX + CORNER_PEAKS.support_px + int(np.ceil(options.radius_px)) + 1


def find_corner_peaks(
    window: DetectionWindow, statistics: ImageStatistics, options: CornerOptions, strength_of: Strength
) -> CornerPeaks:
    """Return the local maxima of positive strength in a window's core; thresholds are applied later."""
    tensor = compute_structure_tensor(normalise(window, statistics))
    strength = strength_of(tensor, options)
    strength[~mask_usable_surroundings(window.usable, CORNER_PEAKS.support_px)] = 0.0
    # At the edges of the image the filters used its mirror image
    edge = CORNER_PEAKS.support_px
    strength = np.pad(strength[edge:-edge, edge:-edge], edge)
    rows, columns = np.nonzero(find_local_maxima(strength, options.radius_px))
    offset = compute_peak_offsets(strength, rows, columns)
    xy = np.column_stack([columns, rows]) + offset + window.origin
    is_inside = window.core.contains(xy)
    rows, columns, xy = rows[is_inside], columns[is_inside], xy[is_inside]
    noise = statistics.noise / statistics.deviation_floor
    return CornerPeaks(xy, strength[rows, columns], _estimate_sigmas(tensor, rows, columns, noise))


def compute_peak_offsets(strength: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return sub-pixel offsets ``(n, 2)`` (sample, line) of maxima: the peak of the paraboloid through 3 x 3 pixels."""
    n = {(j, i): strength[rows + j, columns + i].astype(np.float64) for j in (-1, 0, 1) for i in (-1, 0, 1)}
    by_x, by_y = (n[0, 1] - n[0, -1]) / 2.0, (n[1, 0] - n[-1, 0]) / 2.0
    by_xx, by_yy = n[0, 1] - 2.0 * n[0, 0] + n[0, -1], n[1, 0] - 2.0 * n[0, 0] + n[-1, 0]
    by_xy = (n[1, 1] - n[1, -1] - n[-1, 1] + n[-1, -1]) / 4.0
    determinant = by_xx * by_yy - by_xy**2
    sharp = determinant > 1e-12 * np.maximum(n[0, 0] ** 2, 1e-30)
    safe = np.where(sharp, determinant, 1.0)
    offset = np.column_stack([by_xy * by_y - by_yy * by_x, by_xy * by_x - by_xx * by_y]) / safe[:, None]
    return np.where(sharp[:, None], np.clip(offset, -1.0, 1.0), 0.0)


def _estimate_sigmas(tensor: StructureTensor, rows: np.ndarray, columns: np.ndarray, noise: float) -> np.ndarray:
    """Return the standard deviation of a coordinate ``(n,)``: from noise, and the repeatability of maxima."""
    xx, xy, yy = (layer[rows, columns].astype(np.float64) for layer in tensor)
    effective = 4.0 * np.pi * CORNER_DETECTION.patch_px**2  # pixels in the patch
    by_noise = noise**2 / effective * (xx + yy) / np.maximum(xx * yy - xy**2, 1e-12) / 2.0
    return np.sqrt(by_noise + CORNER_PEAKS.model_sigma_px**2)
