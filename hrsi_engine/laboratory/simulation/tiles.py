"""Tiles of fixed size that pictures of the simulated ground are made of, and painting the ground into one.

What a pixel is does not depend on the window, the block size or the number of threads, because every window is
cut from the same tiles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from .landscape import Objects
from .texture import SensorTexture, compute_cover
from .world import constant, constants


@constants
class TILES:
    """Tiles of simulated images, and reach of blur."""

    tile_px: int = constant(256, "px", "side of a tile")
    reach_sigmas: float = constant(4.0, "sigma", "reach of an object's blur")


def cut_window(
    tile: Callable[[int, int], np.ndarray], size: tuple[int, int], sample: int, line: int, samples: int, lines: int
) -> np.ndarray:
    """Return a window ``(lines, samples)`` of the picture whose tiles ``tile(row, column)`` returns.

    Raises ValueError where the window is not inside the picture's ``size``.
    """
    if sample < 0 or line < 0 or sample + samples > size[0] or line + lines > size[1]:
        raise ValueError(f"window {sample}, {line}, {samples} x {lines} is not inside {size[0]} x {size[1]}")
    window = np.empty((lines, samples), dtype=np.uint16)
    tops = range(line // TILES.tile_px, -(-(line + lines) // TILES.tile_px))
    for row, column in product(tops, range(sample // TILES.tile_px, -(-(sample + samples) // TILES.tile_px))):
        top, left = row * TILES.tile_px - line, column * TILES.tile_px - sample  # of the tile, in the window
        part = tile(row, column)[max(-top, 0) : lines - top, max(-left, 0) : samples - left]
        window[max(top, 0) :, max(left, 0) :][: part.shape[0], : part.shape[1]] = part
    return window


def compute_tile_shape(size: tuple[int, int], row: int, column: int) -> tuple[int, int]:
    """Return lines and samples of a tile; those at the right and lower border are smaller."""
    return min(TILES.tile_px, size[1] - row * TILES.tile_px), min(TILES.tile_px, size[0] - column * TILES.tile_px)


@dataclass(frozen=True, eq=False)
class TilePainter:
    """Paints the ground and its objects into tiles.

    ``boxes`` are first and last sample and line around each object in the picture, ``(n, 4)`` integers.
    """

    size: tuple[int, int]
    texture: SensorTexture
    objects: Objects
    boxes: np.ndarray
    blur_m: float

    @classmethod
    def from_objects(
        cls,
        size: tuple[int, int],
        texture: SensorTexture,
        objects: Objects,
        centres_px: np.ndarray,
        gsd_m: float,
        blur_m: float,
    ) -> TilePainter:
        """Return the painter of objects whose centres lie at ``(n, 2)`` sample, line; ``gsd_m`` is the smallest one.

        The boxes are twice as large as the objects, room for what relief inside an object does to its outline.
        """
        reach_px = ((np.hypot(*objects.size_m.T) + TILES.reach_sigmas * blur_m) / gsd_m)[:, None]
        low, high = np.floor(centres_px - reach_px), np.ceil(centres_px + reach_px)
        boxes = np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]])
        return cls(size, texture, objects, np.nan_to_num(boxes, nan=-1e9).astype(np.int64), blur_m)

    def grey(
        self, row: int, column: int, east: np.ndarray, north: np.ndarray, lean: np.ndarray | None = None
    ) -> np.ndarray:
        """Return a tile's blurred grey values, float32, of the chart positions of its pixels.

        ``lean (2, …)``, metres by which lines of sight move per metre of height, matters for high objects.
        """
        grey = self.texture.grey(east, north)
        for index, part in self.touching(row, column):
            self.paint(index, grey[part], east[part], north[part])
        return grey

    def paint(self, index: int, grey: np.ndarray, east: np.ndarray, north: np.ndarray) -> None:
        """Paint an object over grey values at chart positions, in place."""
        cover = compute_cover(self.objects, index, east, north, self.blur_m)
        grey += cover * (self.objects.grey[index, self.texture.band] - grey)

    def touching(self, row: int, column: int) -> list[tuple[int, tuple[slice, slice]]]:
        """Return the objects that touch a tile, in painting order, and the part of it that each one's box covers."""
        tiles = []
        for index in self._touching.get((row, column), ()):
            s0, s1, l0, l1 = self.boxes[index] - np.repeat([column * TILES.tile_px, row * TILES.tile_px], 2)
            tiles.append((index, (slice(max(l0, 0), l1 + 1), slice(max(s0, 0), s1 + 1))))
        return tiles

    @cached_property
    def _touching(self) -> dict[tuple[int, int], list[int]]:
        """Objects that touch each tile, in painting order."""
        limits = np.repeat(self.size, 2) - 1
        visible = (self.boxes[:, 1::2] >= 0).all(axis=1) & (self.boxes[:, ::2] <= limits[::2]).all(axis=1)
        touching: dict[tuple[int, int], list[int]] = {}
        for index in np.flatnonzero(visible):
            first_column, last_column, first_row, last_row = np.clip(self.boxes[index], 0, limits) // TILES.tile_px
            for tile in product(range(first_row, last_row + 1), range(first_column, last_column + 1)):
                touching.setdefault(tile, []).append(int(index))
        return touching
