"""The shift that most of the ground has between two orthoimages, where it may be larger than windows are searched.

Probes spread over the common area are compared at half resolution by the directions of their gradients. The
correlation surfaces of all probes are added before the peak is sought: what they share adds up, while chance likeness
of single probes (rows of houses, fields, water) does not.
"""

import numpy as np

from ..foundation.pixel_filters import reduce_by_area
from ..measurement.window_matching.orientation_correlation import (
    compute_orientation_field,
    correlate_fields,
    find_correlation_peak,
)
from .misregistration import SHIFT, Read


def find_common_shift(first: Read, second: Read, columns: int, rows: int) -> np.ndarray:
    """Return the common shift ``(2,)`` in whole pixels, right and down, to about 2 px; 0 where none shows.

    ``first(...)`` and ``second(...)`` read the common area of columns x rows pixels; the second beyond it, too.
    """
    side = min(SHIFT.probe_px, columns // 2, rows // 2) // SHIFT.reduction * SHIFT.reduction
    if side < 16 * SHIFT.reduction:
        return np.zeros(2, dtype=int)
    total = np.zeros((2 * SHIFT.farthest_px // SHIFT.reduction + 1,) * 2)
    wide = side + 2 * SHIFT.farthest_px
    for row in np.linspace(0, rows - side, SHIFT.probes).astype(int).tolist():
        for column in np.linspace(0, columns - side, SHIFT.probes).astype(int).tolist():
            probe = _compute_field(*first(column, row, side, side))
            if probe.any():
                total += correlate_fields(
                    probe, _compute_field(*second(column - SHIFT.farthest_px, row - SHIFT.farthest_px, wide, wide))
                )
    peak = find_correlation_peak(total)
    if peak.contrast < SHIFT.contrast:
        return np.zeros(2, dtype=int)
    return np.rint(peak.shift * SHIFT.reduction - SHIFT.farthest_px).astype(int)


def _compute_field(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return the directions of gradients of means of pixels; 0 where not all of a mean is valid."""
    size = (grey.shape[1] // SHIFT.reduction, grey.shape[0] // SHIFT.reduction)
    mean = reduce_by_area(np.where(valid, grey, 0).astype(np.float32), size)
    known = reduce_by_area(valid.astype(np.float32), size) > 0.999
    return compute_orientation_field(mean, known)
