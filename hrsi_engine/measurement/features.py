"""SIFT features of an image, tile by tile, computed when first asked for and kept.

Tiles are fixed per image, so that a keypoint has one identity whichever neighbour it is matched with: that is what
makes multi-image tracks possible. Keypoints follow the convention (0, 0) = centre of the first pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np

from ..block import Image

TILE_PX = 1024
BORDER_PX = 32  # read around a tile, so that features near its edge are found as if there were no edge
CONTRAST = 0.01  # SIFT's contrast threshold: low, for satellite images of 11 bit and little texture
STRETCH_PERCENT = (1.0, 99.0)


class Features(NamedTuple):
    """Keypoints ``xy (k, 2)``, descriptors ``(k, 128)`` of unit length (RootSIFT), and the number of the first one."""

    xy: np.ndarray
    descriptors: np.ndarray
    first_number: int


@dataclass(eq=False)
class FeatureStore:
    """Features of one image by tile; keypoint numbers are unique within the image."""

    image: Image
    per_tile: int
    _tiles: dict[int, Features] = field(default_factory=dict)
    _count: int = 0

    @property
    def tile_grid(self) -> tuple[int, int]:
        """Number of tiles along samples and lines; tiles are as equal as can be."""
        assert self.image.size is not None
        return tuple(max(1, round(length / TILE_PX)) for length in self.image.size)  # type: ignore[return-value]

    def window(self, tile: int) -> tuple[int, int, int, int]:
        """Return a tile's first sample, first line, samples and lines."""
        assert self.image.size is not None
        columns, rows = self.tile_grid
        row, column = divmod(tile, columns)
        s0, s1 = (self.image.size[0] * c // columns for c in (column, column + 1))
        l0, l1 = (self.image.size[1] * r // rows for r in (row, row + 1))
        return s0, l0, s1 - s0, l1 - l0

    def tiles_in(self, window: tuple[float, float, float, float]) -> list[int]:
        """Return the tiles that a window (first sample, last sample, first line, last line) touches."""
        columns, rows = self.tile_grid
        touched = []
        for tile in range(columns * rows):
            s0, l0, samples, lines = self.window(tile)
            if s0 <= window[1] and s0 + samples > window[0] and l0 <= window[3] and l0 + lines > window[2]:
                touched.append(tile)
        return touched

    def tile(self, tile: int) -> Features:
        """Return the features of a tile."""
        if tile not in self._tiles:
            xy, descriptors = self._detect(tile)
            self._tiles[tile] = Features(xy, descriptors, self._count)
            self._count += len(xy)
        return self._tiles[tile]

    def positions(self) -> np.ndarray:
        """Return the positions of all features found so far, in the order of their numbers, ``(k, 2)``."""
        found = [features.xy for features in self._tiles.values()]
        return np.concatenate(found) if found else np.empty((0, 2))

    def inside(self, window: tuple[float, float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions, descriptors and numbers of the features in a window."""
        tiles = [self.tile(tile) for tile in self.tiles_in(window)]
        if not tiles:
            return np.empty((0, 2)), np.empty((0, 128), np.float32), np.empty(0, np.int64)
        xy = np.concatenate([tile.xy for tile in tiles])
        descriptors = np.concatenate([tile.descriptors for tile in tiles])
        numbers = np.concatenate([tile.first_number + np.arange(len(tile.xy)) for tile in tiles])
        here = (xy[:, 0] >= window[0]) & (xy[:, 0] <= window[1]) & (xy[:, 1] >= window[2]) & (xy[:, 1] <= window[3])
        return xy[here], descriptors[here], numbers[here]

    def _detect(self, tile: int) -> tuple[np.ndarray, np.ndarray]:
        assert self.image.raster is not None and self.image.size is not None
        s0, l0, samples, lines = self.window(tile)
        left, top = max(0, s0 - BORDER_PX), max(0, l0 - BORDER_PX)
        right = min(self.image.size[0], s0 + samples + BORDER_PX)
        bottom = min(self.image.size[1], l0 + lines + BORDER_PX)
        grey, valid = self.image.raster.read(left, top, right - left, bottom - top)
        stretched = stretch_to_byte(grey, valid)
        if stretched is None:
            return np.empty((0, 2)), np.empty((0, 128), np.float32)
        sift = cv2.SIFT_create(
            nfeatures=self.per_tile, nOctaveLayers=3, contrastThreshold=CONTRAST, edgeThreshold=10, sigma=1.6,
            enable_precise_upscale=True,
        )  # fmt: skip
        mask = cv2.erode(valid.astype(np.uint8), np.ones((9, 9), np.uint8)) if not valid.all() else None
        keypoints, descriptors = sift.detectAndCompute(stretched, mask)
        if not keypoints:
            return np.empty((0, 2)), np.empty((0, 128), np.float32)
        xy = np.array([point.pt for point in keypoints], dtype=np.float64) + (left, top)
        _, once = np.unique(xy, axis=0, return_index=True)  # SIFT repeats a point for each orientation: keep one
        own = once[
            (xy[once, 0] >= s0) & (xy[once, 0] < s0 + samples) & (xy[once, 1] >= l0) & (xy[once, 1] < l0 + lines)
        ]
        return xy[own], root_sift(descriptors[own])


def stretch_to_byte(grey: np.ndarray, valid: np.ndarray) -> np.ndarray | None:
    """Return the window as 8 bit between the 1st and 99th percentile; None where it holds no texture at all."""
    if not valid.any():
        return None
    low, high = np.percentile(grey[valid][::7], STRETCH_PERCENT)
    if not high > low:
        return None
    return np.clip((grey.astype(np.float32) - low) * (255.0 / (high - low)), 0.0, 255.0).astype(np.uint8)


def root_sift(descriptors: np.ndarray) -> np.ndarray:
    """Return square roots of L1-normalised descriptors: their dot product is Hellinger's (Arandjelovic 2012)."""
    return np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-7)).astype(np.float32)
