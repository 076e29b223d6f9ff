"""By how much an image lies beside where its RPC puts it: correlation with its prediction, coarse to fine.

Parts of the image (all of it, where it is small) are predicted at a resolution at which the largest bias is a few tens
of working pixels; the correlation surfaces of their gradient directions are added, so that parts that changed, or
lie in clouds, are outvoted. The search begins small and grows until a peak stands out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...block.block import Image
from ...block.orthoimage import Orthoimage
from ...surface.dem import HeightSurface
from ..window_matching.orientation_correlation import (
    CorrelationPeak,
    compute_orientation_field,
    correlate_fields,
    find_correlation_peak,
)
from .predicted_patches import image_patch, predicted_patch

FIRST_SEARCH_PX = 64.0
SEARCH_GROWTH = 4.0
SEARCH_REACH = 32  # working pixels to each side at the coarsest step
LEAST_SIDE = 128  # working pixels along the shorter side of an image; fewer show too little
FINE_SEARCH_REACH_PX = 8
SITE = 160  # side of a part in working pixels
SITES = 4  # parts along each side of a large image
PEAK_CONTRAST = 9.0  # robust standard deviations by which a peak must stand out
CLEAR = 0.75  # a second peak above this share of the first makes it unclear
BIAS_NODE_PX = 8.0


@dataclass(frozen=True, eq=False)
class ImageBias:
    """Found - expected position ``(2,)`` in image pixels, to about a working pixel, and how clearly it was found."""

    offset_px: np.ndarray
    contrast: float
    rival: float


def search_bias(
    image: Image, reference: Orthoimage, surface: HeightSurface, gsd_m: float, step: float, search_px: float
) -> ImageBias | None:
    """Return an image's bias to about a working pixel of ``step`` image pixels; None where nothing stands out.

    ``search_px`` is the largest bias looked for.
    """
    size = image.known_size
    reach = min(FIRST_SEARCH_PX * max(step, 1.0), search_px)
    while True:
        coarse = max(step, min(reach / SEARCH_REACH, min(size) / LEAST_SIDE))
        peak = _peak(image, reference, surface, gsd_m, coarse, np.zeros(2), int(np.ceil(reach / coarse)))
        if peak is not None and peak.contrast >= PEAK_CONTRAST and peak.rival <= CLEAR:
            break
        if reach >= search_px:
            return None
        reach = min(reach * SEARCH_GROWTH, search_px)
    offset = peak.shift
    while coarse > step:
        coarse = max(coarse / SEARCH_GROWTH, step)
        finer = _peak(image, reference, surface, gsd_m, coarse, offset, FINE_SEARCH_REACH_PX)
        if finer is None:
            return None
        offset = finer.shift
    return ImageBias(offset, peak.contrast, peak.rival)


def _peak(
    image: Image, reference: Orthoimage, surface: HeightSurface, gsd_m: float, step: float, offset: np.ndarray,
    reach: int,
) -> CorrelationPeak | None:  # fmt: skip
    """Return the peak over all parts of the image; its ``shift`` is the whole offset in image pixels."""
    total, energy = np.zeros((2 * reach + 1, 2 * reach + 1)), 0.0
    # Origin and shape ``(lines, samples)`` of the parts of an image, in working pixels of ``step``
    starts, sides = [], []
    for size in image.known_size:
        whole = max(int(size / step), 1)
        count = min(max(int(np.ceil(whole / SITE)), 1), SITES)
        side = min(whole, SITE) if count > 1 else whole
        places = np.linspace(0.0, size - step * side, count) if count > 1 else np.zeros(1)
        starts.append(places)
        sides.append(side)
    sites = [(np.array([sample, line]), (sides[1], sides[0])) for line in starts[1] for sample in starts[0]]
    for origin, shape in sites:
        template = predicted_patch(image, reference, surface, origin, shape, step, offset, BIAS_NODE_PX, gsd_m)
        if not template.valid.any():
            continue
        window = (shape[0] + 2 * reach, shape[1] + 2 * reach)
        search = image_patch(image.pixels, origin - step * reach, window, step)
        first, second = (compute_orientation_field(patch.grey, patch.valid) for patch in (template, search))
        total += correlate_fields(first, second)
        energy += float(np.square(np.abs(first)).sum())
    if energy <= 0.0:
        return None
    peak = find_correlation_peak(total / energy)
    return peak._replace(shift=offset + step * (peak.shift - reach))
