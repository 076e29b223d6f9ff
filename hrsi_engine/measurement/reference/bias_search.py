"""Offset of an image from the position that its RPC predicts: correlation with its prediction, coarse to fine.

Parts of the image (all of it, where it is small) are predicted at a resolution at which the largest bias is a few tens
of working pixels; the correlation surfaces of their gradient directions are added, so that parts that changed, or
lie in clouds, are outvoted. The search begins small and grows until a peak stands out.
"""

from dataclasses import dataclass

import numpy as np

from ...block.block import Image
from ...block.orthoimage import Orthoimage
from ...foundation.thresholds import threshold, thresholds
from ...surface.dem import HeightSurface
from ..window_matching.correlation import (
    CorrelationPeak,
    compute_orientation_field,
    correlate_fields,
    find_correlation_peak,
)
from .predicted_patches import predict_patch, read_patch


@thresholds
class BIAS:
    """Search for an image's offset to a reference, coarse to fine."""

    first_search_px: float = threshold(64.0, "px", "largest offset of the first attempt")
    growth: float = threshold(4.0, "", "of the search from attempt to attempt, of the resolution from step to step")
    reach: int = threshold(32, "working px", "to each side at the coarsest step")
    least_side: int = threshold(128, "working px", "along the shorter side of an image; fewer show too little")
    fine_reach: int = threshold(8, "working px", "to each side at finer steps")
    site: int = threshold(160, "working px", "side of a part of the image")
    sites: int = threshold(4, "parts", "along each side of a large image")
    contrast: float = threshold(9.0, "sigma", "robust standard deviations by which a peak must stand out")
    rival: float = threshold(0.75, "", "height over the peak's, above which a second one makes it ambiguous")
    node: float = threshold(8.0, "working px", "between nodes of the predicted part")


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
    reach = min(BIAS.first_search_px * max(step, 1.0), search_px)
    while True:
        coarse = max(step, min(reach / BIAS.reach, min(size) / BIAS.least_side))
        peak = _find_peak(image, reference, surface, gsd_m, coarse, np.zeros(2), int(np.ceil(reach / coarse)))
        if peak is not None and peak.contrast >= BIAS.contrast and peak.rival <= BIAS.rival:
            break
        if reach >= search_px:
            return None
        reach = min(reach * BIAS.growth, search_px)
    offset = peak.shift
    while coarse > step:
        coarse = max(coarse / BIAS.growth, step)
        finer = _find_peak(image, reference, surface, gsd_m, coarse, offset, BIAS.fine_reach)
        if finer is None:
            return None
        offset = finer.shift
    return ImageBias(offset, peak.contrast, peak.rival)


def _find_peak(
    image: Image, reference: Orthoimage, surface: HeightSurface, gsd_m: float, step: float, offset: np.ndarray,
    reach: int,
) -> CorrelationPeak | None:  # fmt: skip
    """Return the peak over all parts of the image; its ``shift`` is the whole offset in image pixels."""
    total, energy = np.zeros((2 * reach + 1, 2 * reach + 1)), 0.0
    # Origin and shape ``(lines, samples)`` of the parts of an image, in working pixels of ``step``
    starts, sides = [], []
    for size in image.known_size:
        whole = max(int(size / step), 1)
        count = min(max(int(np.ceil(whole / BIAS.site)), 1), BIAS.sites)
        side = min(whole, BIAS.site) if count > 1 else whole
        places = np.linspace(0.0, size - step * side, count) if count > 1 else np.zeros(1)
        starts.append(places)
        sides.append(side)
    sites = [(np.array([sample, line]), (sides[1], sides[0])) for line in starts[1] for sample in starts[0]]
    for origin, shape in sites:
        template = predict_patch(image, reference, surface, origin, shape, step, offset, BIAS.node, gsd_m)
        if not template.valid.any():
            continue
        window = (shape[0] + 2 * reach, shape[1] + 2 * reach)
        search = read_patch(image.pixels, origin - step * reach, window, step)
        first, second = (compute_orientation_field(patch.grey, patch.valid) for patch in (template, search))
        total += correlate_fields(first, second)
        energy += float(np.square(np.abs(first)).sum())
    if energy <= 0.0:
        return None
    peak = find_correlation_peak(total / energy)
    return peak._replace(shift=offset + step * (peak.shift - reach))
