"""Images of any size in overlapping windows: each point belongs to the core of exactly one of them.

Cores tile the image on a grid that starts at (0, 0) and whose step is a multiple of all cell sizes and pyramid factors,
so that what is computed for a pixel does not depend on the window it is computed in. Windows reach beyond their cores
by the support of the detector; only points inside the core are kept.
"""

from dataclasses import dataclass

import numpy as np

from ...block.block import Raster
from ...foundation.pixel_filters import apply_opening, box_mean, dilate
from ...foundation.thresholds import threshold, thresholds


@thresholds
class WINDOWS:
    """Size of the windows that an image is read in, and which of their pixels are saturated."""

    core_px: int = threshold(1536, "px", "side of a core; with a halo of 256 a window has 2048 x 2048 pixels")
    grid_px: int = threshold(32, "px", "windows begin at multiples of it; side of the cells of local statistics")
    saturated_share: float = threshold(1e-4, "", "share of pixels from which the largest grey value is saturated")
    fill_side_px: int = threshold(31, "px", "side of the square whose mean replaces an invalid pixel")
    saturated_side_px: int = threshold(3, "px", "side of the smallest saturated area; single glints stay usable")


@dataclass(frozen=True, eq=False)
class Area:
    """A rectangle of an image: first sample and line, and where it ends (not included)."""

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
            (pixel[:, 0] >= self.left) & (pixel[:, 0] < self.right) & (pixel[:, 1] >= self.top)
            & (pixel[:, 1] < self.bottom)
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class DetectionWindow:
    """Pixels around a core: ``grey`` float32 and ``usable`` bool ``(lines, samples)``, beginning at ``area``.

    Not usable are invalid pixels, saturated areas and everything outside the image.
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
    """Return the mask of areas of saturated pixels, with the pixels beside them."""
    if saturation is None:
        return np.zeros(grey.shape, dtype=bool)
    return dilate(apply_opening(grey >= saturation, WINDOWS.saturated_side_px), WINDOWS.saturated_side_px)


def _fill_invalid(grey: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return the pixels with the invalid ones replaced by nearby valid ones, so that filters make no false edges."""
    if valid.all() or not valid.any():
        return grey
    grey = np.where(valid, grey, np.float32(0.0))
    mean, share = (box_mean(layer.astype(np.float64), WINDOWS.fill_side_px) for layer in (grey, valid))
    near = mean / np.maximum(share, WINDOWS.fill_side_px**-2.0)
    return np.where(valid, grey, near.astype(np.float32))
