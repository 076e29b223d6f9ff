"""Prediction of an image: an orthoimage resampled into the image's geometry through RPC and DEM.

Both the image and the orthoimage are first resampled to working pixels of ``step`` image pixels, with a low-pass filter
if these are coarser, so that the two have the same detail. A working pixel ``(i, j)`` of a patch that begins at
``origin`` has the image coordinates ``origin + step * (i, j)``.

**Bias search.** The offset of an image from its RPC is determined by correlation with the prediction. Parts of the
image (or all of a small one) are predicted at a resolution at which the largest bias is a few tens of working pixels.
The correlation surfaces of their gradient directions are summed, so that parts with changes or clouds have little
influence. The search range is increased until there is a distinct peak.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...block.block import Image, Raster
from ...block.orthoimage import Orthoimage
from ...foundation.pixel_filters import blur, erode, interpolate, reduce_by_area
from ...foundation.thresholds import EQUALITY, GRIDS, MEMORY, threshold, thresholds
from ...surface.dem import HeightSurface, Status, intersect_surface
from ..window_matching.correlation import (
    CorrelationPeak,
    compute_orientation_field,
    correlate_fields,
    find_correlation_peak,
)
from ..window_matching.windows import MATCHING


@thresholds
class PATCH:
    """Selection of places in a reference, and resampling of it to images."""

    blur: float = threshold(0.45, "px of the coarser image", "standard deviation of the low-pass filter")
    valid: float = threshold(0.999, "", "smallest valid share of a resampled pixel (1 but for rounding)")
    largest_px: int = threshold(64_000_000, "working px", "largest source window; beyond, the position is wrong")


@dataclass(frozen=True, eq=False)
class Patch:
    """Grey values ``(lines, samples)`` float32 and their mask; ``origin`` is the image position of the first pixel."""

    grey: np.ndarray
    valid: np.ndarray
    origin: np.ndarray
    step: float


def read_means(
    raster: Raster, sample: int, line: int, samples: int, lines: int, factor: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of a window over ``factor`` x ``factor`` pixels and the mask of those with valid pixels only.

    The window may extend beyond the image. Element ``(0, 0)`` is centred at sample ``sample + (factor - 1) / 2``.
    """
    width, height = max(samples // factor, 1), max(lines // factor, 1)
    grey, valid = np.zeros((height, width), dtype=np.float32), np.zeros((height, width), dtype=bool)
    rows = max(MEMORY.part_px // factor, 1)
    for row in range(0, height, rows):
        count = min(rows, height - row)
        part = _read_with_padding(raster, sample, line + row * factor, width * factor, count * factor)
        if part is None:
            continue
        pixels, mask = part
        if factor > 1:
            share = reduce_by_area(mask.astype(np.float32), (width, count))
            pixels = reduce_by_area(np.where(mask, pixels, np.float32(0.0)), (width, count))
            mask = share > PATCH.valid
        grey[row : row + count], valid[row : row + count] = pixels, mask
    return grey, valid


def _read_with_padding(
    raster: Raster, sample: int, line: int, samples: int, lines: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return float32 pixels and mask of a window that may extend beyond the image; None if it is outside."""
    s0, l0 = max(sample, 0), max(line, 0)
    s1, l1 = min(sample + samples, raster.size[0]), min(line + lines, raster.size[1])
    if s1 <= s0 or l1 <= l0:
        return None
    pixels, mask = raster.read(s0, l0, s1 - s0, l1 - l0)
    pixels = np.where(mask, pixels, 0).astype(np.float32)
    if (s1 - s0, l1 - l0) == (samples, lines):
        return pixels, mask
    edges = ((l0 - line, line + lines - l1), (s0 - sample, sample + samples - s1))
    return np.pad(pixels, edges), np.pad(mask, edges)


def sample_patch(raster: Raster, x: np.ndarray, y: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels at positions ``x, y`` of any 2-d shape (NaN: none) and their mask, low-pass filtered to ``step``.

    ``step`` is the distance of neighbouring positions in pixels of the raster; below one, the raster has the larger
    pixels and is interpolated.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    nothing = np.zeros(x.shape, dtype=np.float32), np.zeros(x.shape, dtype=bool)
    if not finite.any():
        return nothing
    factor = max(int(step), 1)
    margin = 4 * factor + int(4 * step)
    left, top = (int(np.floor(c[finite].min())) - margin for c in (x, y))
    right, bottom = (int(np.ceil(c[finite].max())) + margin + factor for c in (x, y))
    if (right - left) / factor * (bottom - top) / factor > PATCH.largest_px or max(abs(left), abs(top)) > 2**30:
        return nothing
    grey, valid = read_means(raster, left, top, right - left, bottom - top, factor)
    if not valid.any():
        return nothing
    remaining_step = step / factor
    if remaining_step > 1.05:
        grey = blur(grey, PATCH.blur * np.sqrt(remaining_step**2 - 1.0) + 0.2)
    offset = (factor - 1) / 2.0
    column, row = (
        ((np.where(finite, c, -1e6) - start - offset) / factor).astype(np.float32) for c, start in ((x, left), (y, top))
    )
    pixels = interpolate(grey, column, row, order=3)
    mask = interpolate(erode(valid, 3).astype(np.float32), column, row, order=1, outside=0.0) > PATCH.valid
    return np.where(mask, pixels, np.float32(0.0)), mask


def read_patch(raster: Raster, origin: np.ndarray, shape: tuple[int, int], step: float) -> Patch:
    """Return a patch of an image; not resampled if ``step`` is 1 and ``origin`` a whole pixel."""
    lines, samples = shape
    if step == 1.0 and np.array_equal(origin, np.round(origin)):
        part = _read_with_padding(raster, int(origin[0]), int(origin[1]), samples, lines)
        grey, valid = part or (np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=bool))
        return Patch(grey, valid, origin, step)
    x, y = np.meshgrid(origin[0] + step * np.arange(samples), origin[1] + step * np.arange(lines))
    return Patch(*sample_patch(raster, x, y, step), origin, step)


def predict_patch(
    image: Image,
    reference: Orthoimage,
    surface: HeightSurface,
    origin: np.ndarray,
    shape: tuple[int, int],
    step: float,
    offset_px: np.ndarray,
    node_px: float,
    gsd_m: float,
) -> Patch:
    """Return the prediction of a patch of an image from an orthoimage.

    ``offset_px (2,)`` is the offset of the image's points from their positions by the RPC; rays are computed every
    ``node_px`` working pixels and interpolated; ``gsd_m`` is the ground distance of the image's pixels.
    """
    lines, samples = shape
    nodes = [int(np.ceil((count - 1) / node_px)) + 1 for count in (samples, lines)]
    grid = np.stack(np.meshgrid(*(np.arange(count) * node_px for count in nodes)), axis=-1).reshape(-1, 2)
    ground, status = intersect_surface(image.rpc, origin + step * grid - offset_px, surface)
    place = np.full((len(grid), 2), np.nan)
    intersected = status == Status.FOUND
    if intersected.any():
        place[intersected] = reference.to_pixels(ground[intersected, :2])
    if EQUALITY.majority <= intersected.mean() < 1.0:
        # For rays into gaps of the DEM, positions by the affine function of the others
        design = np.column_stack([np.ones(len(grid)), grid])
        coefficients = np.linalg.lstsq(design[intersected], place[intersected], rcond=None)[0]
        place = np.where(intersected[:, None], place, design @ coefficients)
    pixels = np.indices(shape) / node_px  # NaN next to a node without position
    x, y = (ndimage.map_coordinates(values.reshape(nodes[::-1]), pixels, order=1, mode="nearest") for values in place.T)
    return Patch(*sample_patch(reference.raster, x, y, step * gsd_m / reference.gsd_m), origin, step)


@thresholds
class BIAS:
    """Coarse-to-fine search for an image's bias relative to a reference."""

    first_search_px: float = threshold(64.0, "px", "half width of the first search")
    growth: int = threshold(4, "", "factor from one search to the next, and between resolution levels")
    reach: int = threshold(32, "working px", "half width of the search at the coarsest level")
    least_side: int = threshold(128, "working px", "smallest shorter side of an image at the coarsest level")
    fine_reach: int = threshold(8, "working px", "half width of the search at finer levels")
    site: int = threshold(160, "working px", "side of a correlated part of the image")
    rival: float = threshold(0.75, "", "largest ratio of the second and the highest peak (ambiguity)")


@dataclass(frozen=True, eq=False)
class ImageBias:
    """Found - expected position ``(2,)`` in image pixels, accurate to a working pixel, with measures of reliability."""

    offset_px: np.ndarray
    contrast: float
    rival: float


def search_bias(
    image: Image, reference: Orthoimage, surface: HeightSurface, gsd_m: float, step: float, search_px: float
) -> ImageBias | None:
    """Return an image's bias, accurate to about a working pixel of ``step`` image pixels; None without distinct peak.

    ``search_px`` is the largest bias that is searched.
    """
    size = image.known_size
    reach = min(BIAS.first_search_px * max(step, 1.0), search_px)
    while True:
        coarse = max(step, min(reach / BIAS.reach, min(size) / BIAS.least_side))
        peak = _find_peak(
            image, reference, surface, gsd_m=gsd_m, step=coarse, offset=np.zeros(2), reach=int(np.ceil(reach / coarse))
        )
        if peak is not None and peak.contrast >= MATCHING.contrast and peak.rival <= BIAS.rival:
            break
        if reach >= search_px:
            return None
        reach = min(reach * BIAS.growth, search_px)
    offset = peak.shift
    while coarse > step:
        coarse = max(coarse / BIAS.growth, step)
        finer = _find_peak(image, reference, surface, gsd_m=gsd_m, step=coarse, offset=offset, reach=BIAS.fine_reach)
        if finer is None:
            return None
        offset = finer.shift
    return ImageBias(offset, peak.contrast, peak.rival)


def _find_peak(
    image: Image,
    reference: Orthoimage,
    surface: HeightSurface,
    gsd_m: float,
    step: float,
    offset: np.ndarray,
    reach: int,
) -> CorrelationPeak | None:
    """Return the peak of the sum over all parts of the image; its ``shift`` is the total offset in image pixels."""
    total, energy = np.zeros((2 * reach + 1, 2 * reach + 1)), 0.0
    # Origin and shape ``(lines, samples)`` of the parts of the image, in working pixels of ``step``
    starts, sides = [], []
    for size in image.known_size:
        width = max(int(size / step), 1)
        count = min(max(int(np.ceil(width / BIAS.site)), 1), GRIDS.parts)
        side = min(width, BIAS.site) if count > 1 else width
        starts.append(np.linspace(0.0, size - step * side, count) if count > 1 else np.zeros(1))
        sides.append(side)
    sites = [(np.array([sample, line]), (sides[1], sides[0])) for line in starts[1] for sample in starts[0]]
    for origin, shape in sites:
        template = predict_patch(
            image,
            reference,
            surface,
            origin=origin,
            shape=shape,
            step=step,
            offset_px=offset,
            node_px=BIAS.fine_reach,
            gsd_m=gsd_m,
        )
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
