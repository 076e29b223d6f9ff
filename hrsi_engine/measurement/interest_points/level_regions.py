"""Candidate regions: compact areas that are brighter, darker or more homogeneous than their surroundings.

Bright and dark regions are maximally stable extremal regions (Matas et al. 2002) of the image in local standard
deviations; large ones are also searched in the image reduced by 4. Homogeneous ("even") regions are those of the
gradient magnitude, with any surroundings: a grey roof between bright crowns and dark shadows has no closed grey level
but a closed edge. Only compact regions are kept: their second moments agree with the area of an ellipse or rectangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...foundation.pixel_filters import BLUR, blur, load_opencv, reduce_by_area, reduce_mask, slopes
from ...foundation.thresholds import SAMPLES, threshold, thresholds
from .corners import SIMULATED_OBJECTS, make_gaussian_kernels

BRIGHT, DARK, HOMOGENEOUS = 1, -1, 0


@thresholds
class REGION:
    """Limits for stable and compact regions of grey levels and gradients (MSER), candidates of objects."""

    scales: tuple[int, int] = threshold((1, 4), "", "reduction factors of the image for the search")
    level_step: float = threshold(0.05, "sigma", "difference of the 256 grey levels, in local standard deviations")
    stable_steps: int = threshold(4, "levels", "difference of the levels compared", SIMULATED_OBJECTS)
    largest_change: float = threshold(0.7, "", "largest relative change of area between them", SIMULATED_OBJECTS)
    even_stable_steps: int = threshold(
        16, "levels", "difference of the compared gradient levels (even regions)", SIMULATED_OBJECTS
    )
    half_slope: float = threshold(0.5, "sigma/px", "gradient at half of the gradient levels")
    smallest_at_scale_px: int = threshold(12, "px", "smallest side of a region in reduced pixels")
    compactness: float = threshold(0.86, "", "smallest area over that of the inertial ellipse", SIMULATED_OBJECTS)


@dataclass(frozen=True, eq=False)
class LevelRegions:
    """Compact regions of a window.

    pixels : (k, 2) column, row of the pixels, sorted by region, in the window reduced by ``scale``
    bounds : (n + 1,) first pixel of each region; scale : (n,); sign : (n,) `BRIGHT`, `DARK` or `HOMOGENEOUS`
    """

    pixels: np.ndarray
    bounds: np.ndarray
    scale: np.ndarray
    sign: np.ndarray

    def __len__(self) -> int:
        return len(self.scale)

    def centres(self) -> np.ndarray:
        """Return the mean position of each region's pixels in full-resolution pixels of the window, ``(n, 2)``."""
        total = np.add.reduceat(self.pixels.astype(np.float64), self.bounds[:-1]) if len(self) else np.empty((0, 2))
        return (total / np.diff(self.bounds)[:, None] + 0.5) * self.scale[:, None] - 0.5

    def select(self, keep: np.ndarray) -> LevelRegions:
        """Return the selected regions (mask)."""
        counts = np.diff(self.bounds)
        bounds = np.r_[0, np.cumsum(counts[keep])]
        return LevelRegions(self.pixels[np.repeat(keep, counts)], bounds, self.scale[keep], self.sign[keep])


def find_compact_regions(z: np.ndarray, usable: np.ndarray, largest_px: float) -> LevelRegions:
    """Return the compact regions of a normalised image with sides up to ``largest_px``.

    Regions with pixels that are not ``usable``, or at the edge of the window, are excluded.
    """
    tables = []
    for scale in REGION.scales:
        if scale > 1 and largest_px < REGION.smallest_at_scale_px * scale:
            break
        size, reach = (z.shape[1] // scale, z.shape[0] // scale), largest_px / scale
        closed = reduce_mask(usable, size) if scale > 1 else usable
        reduced = blur(reduce_by_area(z, size) if scale > 1 else z, BLUR.sigma_px)
        # The normalised image in steps of `REGION.level_step`, 0 … 255
        level = np.rint(np.clip(reduced / REGION.level_step + 128.0, 0.0, 255.0)).astype(np.uint8)
        for sign, steps in ((BRIGHT, level), (DARK, 255 - level)):
            stable = _find_stable_regions(steps, REGION.stable_steps, REGION.largest_change, reach)
            tables.append(_select_compact(stable, closed, reach, scale, sign))
        if scale == REGION.scales[0]:
            # 255 where the smoothed image has no gradient, decreasing to 0 for very steep ones
            smooth, slope = make_gaussian_kernels(0.5)
            steepness = np.hypot(*slopes(reduced, smooth, slope, "reflect"))
            evenness = np.rint(255.0 * REGION.half_slope / (steepness + REGION.half_slope)).astype(np.uint8)
            even = _find_stable_regions(evenness, REGION.even_stable_steps, REGION.largest_change, reach)
            tables.append(_select_compact(even, closed, reach - 2.0 * BLUR.edge_px, scale, HOMOGENEOUS))
    counts = np.concatenate([np.diff(table.bounds) for table in tables])
    return LevelRegions(
        np.concatenate([table.pixels for table in tables]),
        np.r_[0, np.cumsum(counts)],
        np.concatenate([table.scale for table in tables]),
        np.concatenate([table.sign for table in tables]),
    )


def _find_stable_regions(
    steps: np.ndarray, stable_steps: int, largest_change: float, reach: float
) -> tuple[list, np.ndarray]:
    """Return pixels and bounding boxes of the maximally stable regions that are brighter than their surroundings."""
    finder = load_opencv().MSER_create(
        delta=stable_steps, min_area=SAMPLES.fewest, max_area=int(reach**2), max_variation=largest_change
    )
    finder.setPass2Only(True)
    pixels, boxes = finder.detectRegions(steps)
    return list(pixels), np.asarray(boxes, dtype=np.int64).reshape(-1, 4)


def _select_compact(
    stable: tuple[list, np.ndarray], usable: np.ndarray, reach: float, scale: int, sign: int
) -> LevelRegions:
    """Return the regions of usable pixels, away from the edges, whose moments agree with their area."""
    pixels, boxes = stable
    left, top, width, height = boxes.T
    count = np.array([len(p) for p in pixels], dtype=np.int64)
    keep = (width <= reach) & (height <= reach) & (left > 0) & (top > 0)
    keep &= (left + width < usable.shape[1]) & (top + height < usable.shape[0])
    keep &= count > 0.3 * width * height  # an ellipse fills 0.785 of an upright box, a square on its corner 0.5
    if scale > REGION.scales[0]:
        keep &= count >= REGION.smallest_at_scale_px**2 // 2
    selected = [pixels[k] for k in np.flatnonzero(keep)]
    if not selected:
        nothing = np.empty(0, dtype=np.int64)
        return LevelRegions(np.empty((0, 2), dtype=np.int32), np.zeros(1, dtype=np.int64), nothing, nothing)
    regions = LevelRegions(
        np.concatenate(selected),
        np.r_[0, np.cumsum(count[keep])],
        np.full(len(selected), scale),
        np.full(len(selected), sign),
    )
    starts, count = regions.bounds[:-1], np.diff(regions.bounds)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, starts) / count

    columns, rows = regions.pixels.astype(np.float64).T
    x, y = mean(columns), mean(rows)
    dx, dy = columns - np.repeat(x, count), rows - np.repeat(y, count)
    xx, yy, xy = mean(dx * dx) + 1.0 / 12.0, mean(dy * dy) + 1.0 / 12.0, mean(dx * dy)
    is_compact = count >= REGION.compactness * 4.0 * np.pi * np.sqrt(xx * yy - xy * xy)
    if not usable.all():
        is_compact &= np.logical_and.reduceat(usable[regions.pixels[:, 1], regions.pixels[:, 0]], regions.bounds[:-1])
    return regions.select(is_compact)
