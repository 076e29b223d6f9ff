"""Images of any size in overlapping windows: each point belongs to the core of exactly one of them.

Cores tile the image on a grid that starts at (0, 0) and whose step is a multiple of all cell sizes and pyramid factors,
so that the results at a pixel do not depend on the window. Windows extend beyond their cores by the support of the
detector; only points inside the core are kept.

Detectors use ``(grey - local mean) / local standard deviation``, so that the same thresholds are suitable for forests,
fields and towns. Local means and deviations are computed for cells of a fixed grid, averaged over 5 x 5 cells and
interpolated between their centres; the deviation has a lower limit, so that noise on water is not amplified.
"""

from dataclasses import dataclass

import numpy as np

from ...block.block import Raster
from ...foundation.pixel_filters import apply_opening, box_mean, dilate, enlarge, filter_separable
from ...foundation.robust_scale import MAD_TO_SIGMA, ROBUST
from ...foundation.thresholds import GRIDS, MEMORY, SIGNIFICANCE, threshold, thresholds


@thresholds
class WINDOWS:
    """Sizes of the windows in which an image is read, saturation, and local statistics."""

    core_px: int = threshold(1536, "px", "side of a window without its border; with one of 256 it is 2048")
    grid_px: int = threshold(32, "px", "grid of window origins; side of the cells of local statistics")
    fill_side_px: int = threshold(31, "px", "side of the square whose mean replaces invalid pixels")
    saturated_side_px: int = threshold(3, "px", "side of the smallest saturated area that is excluded")
    averaged_cells: int = threshold(5, "cells", "side of the square of cells with one local mean")


@dataclass(frozen=True, eq=False)
class Area:
    """A rectangle of an image: first sample and line, and its end (not included)."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def bounds(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom."""
        return self.left, self.top, self.right, self.bottom

    def contains(self, xy: np.ndarray) -> np.ndarray:
        """Return the mask of the points ``(n, 2)`` whose pixel is inside."""
        pixel = np.floor(xy + 0.5)
        return (
            (pixel[:, 0] >= self.left)
            & (pixel[:, 0] < self.right)
            & (pixel[:, 1] >= self.top)
            & (pixel[:, 1] < self.bottom)
        )


@dataclass(frozen=True, eq=False)
class DetectionWindow:
    """Pixels around a core: ``grey`` float32 and ``usable`` bool ``(lines, samples)``, beginning at ``area``.

    Invalid pixels, saturated areas and everything outside the image are not usable.
    """

    area: Area
    core: Area
    grey: np.ndarray
    usable: np.ndarray

    @property
    def origin(self) -> np.ndarray:
        """Sample and line of the window's first pixel, ``(2,)``."""
        return np.array([self.area.left, self.area.top], dtype=np.float64)


def tile_region(region: Area, step: int = WINDOWS.core_px) -> list[Area]:
    """Return the cores that tile a region of an image, row by row."""
    lefts = range(region.left // step * step, region.right, step)
    tops = range(region.top // step * step, region.bottom, step)
    return [
        Area(max(x, region.left), max(y, region.top), min(x + step, region.right), min(y + step, region.bottom))
        for y in tops
        for x in lefts
    ]


def read_window(raster: Raster, core: Area, halo_px: int, saturation: float | None) -> DetectionWindow:
    """Return the window of a core; ``saturation`` is the grey value from which pixels are saturated."""
    left, top = (max(start - halo_px, 0) // WINDOWS.grid_px * WINDOWS.grid_px for start in (core.left, core.top))
    right, bottom = (
        -(-min(end + halo_px, size) // WINDOWS.grid_px) * WINDOWS.grid_px
        for end, size in zip((core.right, core.bottom), raster.size, strict=True)
    )
    s0, l0 = max(left, 0), max(top, 0)
    s1, l1 = min(right, raster.size[0]), min(bottom, raster.size[1])
    pixels, valid = raster.read(s0, l0, s1 - s0, l1 - l0)
    grey = _fill_invalid(pixels.astype(np.float32), valid)
    usable = valid & ~find_saturated_areas(grey, saturation)
    if grey.shape != (bottom - top, right - left):
        edges = ((l0 - top, bottom - l1), (s0 - left, right - s1))
        grey, usable = np.pad(grey, edges, mode="edge"), np.pad(usable, edges)
    return DetectionWindow(Area(left, top, right, bottom), core, grey, usable)


def find_saturated_areas(grey: np.ndarray, saturation: float | None) -> np.ndarray:
    """Return the mask of areas of saturated pixels, dilated by one pixel."""
    if saturation is None:
        return np.zeros(grey.shape, dtype=bool)
    return dilate(apply_opening(grey >= saturation, WINDOWS.saturated_side_px), WINDOWS.saturated_side_px)


def _fill_invalid(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return the image with invalid pixels replaced by the mean of nearby valid ones, so that filters find no edges."""
    if valid.all() or not valid.any():
        return grey
    grey = np.where(valid, grey, np.float32(0.0))
    mean, share = (box_mean(layer.astype(np.float64), WINDOWS.fill_side_px) for layer in (grey, valid))
    local_mean = mean / np.maximum(share, WINDOWS.fill_side_px**-2.0)
    return np.where(valid, grey, local_mean.astype(np.float32))


STATISTICS_HALO_PX = WINDOWS.grid_px * (WINDOWS.averaged_cells // 2 + 1)  # reach of pixels in a local mean
_SECOND_DIFFERENCE = (1.0, -2.0, 1.0)  # Immerkaer 1996: applied in both directions; the sum of squares is then 36


@dataclass(frozen=True)
class ImageStatistics:
    """Grey value from which pixels are saturated (None: never), noise, and the lower limit of local deviations."""

    saturation: float | None
    noise: float
    deviation_floor: float


def estimate_image_statistics(raster: Raster, region: Area, mask_saturated: bool = True) -> ImageStatistics:
    """Return the statistics of a region, from up to 4 x 4 distributed windows of 512 x 512 pixels."""
    samples = [read_window(raster, core, 0, None) for core in choose_sample_areas(region)]
    # The largest grey value is regarded as saturated if an implausibly large number of pixels has it
    greys = [window.grey[window.usable] for window in samples if window.usable.any()] if mask_saturated else []
    largest = max((float(grey.max()) for grey in greys), default=np.nan)
    limit = SIGNIFICANCE.false_alarm * sum(grey.size for grey in greys)
    saturation = largest if sum(int(np.sum(grey == largest)) for grey in greys) > limit else None
    noises = [estimate_noise(window.grey, window.usable) for window in samples if window.usable.any()]
    noise = float(np.median(noises)) if noises else 0.0
    return ImageStatistics(saturation, noise, max(ROBUST.rejected * noise, 1e-6))


def choose_sample_areas(region: Area) -> list[Area]:
    """Return sample areas distributed over a region, or the complete region if it is small."""
    side = MEMORY.window_px
    return [
        Area(x, y, min(x + side, region.right), min(y + side, region.bottom))
        for y in _choose_starts(region.top, region.bottom)
        for x in _choose_starts(region.left, region.right)
    ]


def _choose_starts(first: int, end: int) -> list[int]:
    count = min(GRIDS.parts, -(-(end - first) // MEMORY.window_px))
    last = max(first, end - MEMORY.window_px)
    return sorted(
        {int(start) // WINDOWS.grid_px * WINDOWS.grid_px for start in np.linspace(first, last, count)} | {first}
    )[:count]


def estimate_noise(grey: np.ndarray, usable: np.ndarray) -> float:
    """Return the standard deviation of the noise: the lower quartile of robust values of cells, to exclude texture."""
    side = WINDOWS.grid_px
    lines, samples = (length // side * side for length in grey.shape)
    if not lines or not samples:
        return 0.0
    shape = lines // side, side, samples // side, side
    curved = np.abs(filter_separable(grey, _SECOND_DIFFERENCE, _SECOND_DIFFERENCE)) / 6.0
    cells = curved[:lines, :samples].reshape(shape).transpose(0, 2, 1, 3).reshape(shape[0], shape[2], -1)
    is_complete = usable[:lines, :samples].reshape(shape).all(axis=(1, 3))
    return (
        float(MAD_TO_SIGMA * np.percentile(np.median(cells, axis=2)[is_complete], 25.0)) if is_complete.any() else 0.0
    )


def normalise(window: DetectionWindow, statistics: ImageStatistics) -> np.ndarray:
    """Return ``(grey - local mean) / local deviation`` of a window, float32; 0 for areas without usable pixels."""
    # Mean and deviation of the usable pixels in the surrounding cells
    kernel = np.ones(WINDOWS.averaged_cells)
    sums = [filter_separable(layer, kernel, kernel, "constant") for layer in _sum_cells(window)]
    mean, deviation = (_interpolate_cells(values) for values in _compute_moments(*sums))
    relative = (window.grey - mean) / np.maximum(deviation, statistics.deviation_floor)
    return np.where(np.isfinite(relative), relative, 0.0).astype(np.float32)


def _sum_cells(window: DetectionWindow) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return number of usable pixels, sum and sum of squares of each cell, float64."""
    lines, samples = (length // WINDOWS.grid_px for length in window.grey.shape)
    shape = lines, WINDOWS.grid_px, samples, WINDOWS.grid_px
    area = np.s_[: lines * WINDOWS.grid_px, : samples * WINDOWS.grid_px]
    weight = window.usable[area].astype(np.float64)
    grey = window.grey[area] * weight
    return tuple(layer.reshape(shape).sum(axis=(1, 3)) for layer in (weight, grey, grey * grey))


def _compute_moments(count: np.ndarray, total: np.ndarray, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
        variance = np.maximum(squares / count - mean**2, 0.0)
    return np.where(count > 0, mean, np.nan), np.where(count > 0, np.sqrt(variance), np.nan)


def _interpolate_cells(cells: np.ndarray) -> np.ndarray:
    """Return the values of cells at every pixel, interpolated bilinearly between cell centres."""
    finite = np.isfinite(cells)
    filled = np.where(finite, cells, np.mean(cells[finite]) if finite.any() else 0.0).astype(np.float32)
    return enlarge(filled, WINDOWS.grid_px)
