"""Reading of image windows as tiles, at full or reduced resolution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...block.block import Image, average_blocks, read_overview_pixels
from ...foundation.thresholds import SIGNIFICANCE, threshold, thresholds
from ..tile_matching.epipolar import transfer
from ..tile_matching.types import ImageTile, TilePairGeometry


@thresholds
class TIE_WINDOWS:
    """Sizes of the windows of an image and its partners, and limits for matching them."""

    full_px: int = threshold(
        2048, "px", "longer side of an overview at most, and of an image that is matched everywhere"
    )
    window_px: int = threshold(256, "px", "side of the windows of larger images", "tiles of most GeoTIFFs")
    surplus: int = threshold(3, "", "ratio of measured and wanted points of a cell; tracks are selected later")
    valid_share: float = threshold(0.3, "", "smallest share of valid pixels in a window")
    side_px: int = threshold(64, "px", "smallest side of a window's part in a partner image")


class ImageWindow(NamedTuple):
    """Pixels of an image: first sample and line, number of samples and lines."""

    sample: int
    line: int
    samples: int
    lines: int

    def inside(self, size: tuple[int, int]) -> ImageWindow:
        """Return the intersection with an image of a size; without samples or lines if it is empty."""
        sample, line = max(self.sample, 0), max(self.line, 0)
        right, bottom = min(self.sample + self.samples, size[0]), min(self.line + self.lines, size[1])
        return ImageWindow(sample, line, max(right - sample, 0), max(bottom - line, 0))

    def grow(self, border: int) -> ImageWindow:
        """Return the window with a border on all sides."""
        return ImageWindow(self.sample - border, self.line - border, self.samples + 2 * border, self.lines + 2 * border)

    def contains(self, xy: np.ndarray) -> np.ndarray:
        """Return which positions ``(n, 2)`` are in the window."""
        from_corner = xy - (self.sample, self.line)
        return np.asarray(
            ((from_corner >= -0.5) & (from_corner < np.array([self.samples, self.lines]) - 0.5)).all(axis=1)
        )


def read_tile(image: Image, window: ImageWindow, step: int = 1) -> ImageTile | None:
    """Return the means of ``step`` x ``step`` pixels in a window; None if it contains no valid pixel."""
    inside = window.inside(image.known_size)
    if inside.samples < step or inside.lines < step:
        return None
    grey, valid = image.pixels.read(*inside)
    if not valid.any():
        return None
    if step > 1:
        grey, valid = average_blocks(grey, valid, step)
    origin = inside.sample + (step - 1) / 2.0, inside.line + (step - 1) / 2.0
    return ImageTile(np.asarray(grey, dtype=np.float32), valid, origin, float(step))


def read_overview(image: Image, step: int) -> ImageTile:
    """Return a complete image as means of ``step`` x ``step`` pixels."""
    return ImageTile(*read_overview_pixels(image, step), ((step - 1) / 2.0, (step - 1) / 2.0), float(step))


def predict_window(geometry: TilePairGeometry, window: ImageWindow, border: int) -> ImageWindow:
    """Return the window of the second image that shows a window of the first; empty if there is none."""
    corners = np.array(
        [
            (window.sample + s * (window.samples - 1), window.line + t * (window.lines - 1))
            for s in (0.0, 0.5, 1.0)
            for t in (0.0, 0.5, 1.0)
        ]
    )
    heights = np.concatenate(compute_height_limits(geometry, corners))
    positions = transfer(geometry.first, geometry.second, np.concatenate([corners, corners]), heights)
    positions = positions[np.isfinite(positions).all(axis=1)] + geometry.bias_px
    if not len(positions):
        return ImageWindow(0, 0, 0, 0)
    margin = max(geometry.margin_px) + border
    first, last = np.floor(positions.min(axis=0) - margin), np.ceil(positions.max(axis=0) + margin)
    return ImageWindow(int(first[0]), int(first[1]), int(last[0] - first[0]) + 1, int(last[1] - first[1]) + 1)


def compute_height_limits(geometry: TilePairGeometry, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest possible heights ``(n,)`` of points of the first image."""
    if geometry.heights is None or geometry.height_sigma_m is None:
        return np.full(len(xy), geometry.lowest_m), np.full(len(xy), geometry.highest_m)
    height, reach = geometry.heights_at(xy), SIGNIFICANCE.sigmas * geometry.height_sigma_m
    return height - reach, height + reach
