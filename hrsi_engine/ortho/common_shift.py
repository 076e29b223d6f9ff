"""The shift that most of the ground has between two orthoimages, where it may be larger than windows are searched.

Probes spread over the common area are compared at half resolution by the directions of their gradients. The
correlation surfaces of all probes are added before the peak is sought: what they share adds up, while chance likeness
of single probes (rows of houses, fields, water) does not.
"""

from __future__ import annotations

import numpy as np

from ..foundation.pixel_filters import reduce_by_area
from ..measurement.window_matching.orientation_correlation import (
    compute_orientation_field,
    correlate_fields,
    find_correlation_peak,
)
from .misregistration import Read

FARTHEST_PX = 256  # shifts up to here are found
REDUCTION = 2
SHIFT_PROBE_PX = 256  # side of a probe; less in a small area
SHIFT_PROBES = 4  # along each side of the area
SURFACE_CONTRAST = 8.0  # robust standard deviations of the surface above which a peak counts; chance reaches 5


def common_shift(first: Read, second: Read, columns: int, rows: int) -> np.ndarray:
    """Return the common shift ``(2,)`` in whole pixels, right and down, good to about `REDUCTION`; 0 where none shows.

    ``first(...)`` and ``second(...)`` read the common area of columns x rows pixels; the second beyond it, too.
    """
    side = min(SHIFT_PROBE_PX, columns // 2, rows // 2) // REDUCTION * REDUCTION
    if side < 16 * REDUCTION:
        return np.zeros(2, dtype=int)
    total = np.zeros((2 * FARTHEST_PX // REDUCTION + 1,) * 2)
    wide = side + 2 * FARTHEST_PX
    for row in np.linspace(0, rows - side, SHIFT_PROBES).astype(int).tolist():
        for column in np.linspace(0, columns - side, SHIFT_PROBES).astype(int).tolist():
            probe = _field(*first(column, row, side, side))
            if probe.any():
                total += correlate_fields(probe, _field(*second(column - FARTHEST_PX, row - FARTHEST_PX, wide, wide)))
    peak = find_correlation_peak(total)
    if peak.contrast < SURFACE_CONTRAST:
        return np.zeros(2, dtype=int)
    return np.rint(peak.shift * REDUCTION - FARTHEST_PX).astype(int)


def _field(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return the directions of gradients of means of pixels; 0 where not all of a mean is valid."""
    size = (grey.shape[1] // REDUCTION, grey.shape[0] // REDUCTION)
    mean = reduce_by_area(np.where(valid, grey, 0).astype(np.float32), size)
    known = reduce_by_area(valid.astype(np.float32), size) > 0.999
    return compute_orientation_field(mean, known)
