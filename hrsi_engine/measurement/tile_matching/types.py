"""What goes into and comes out of the matching of two windows: plain arrays, so that any process can do the work.

Positions are always (sample, line) of the full-resolution image, (0, 0) the centre of its first pixel.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from scipy import ndimage

from ...camera.rpc import RPC
from ..window_matching.windows import ResultCache


@dataclass(frozen=True, eq=False)
class ImageTile(ResultCache):
    """A window of an image, possibly of a level of its pyramid.

    pixels : (rows, cols) float32 grey values; valid : (rows, cols) bool, False for nodata, clouds, saturated areas
    origin_px : (sample, line) of the centre of the first pixel, in full-resolution coordinates
    step : full-resolution pixels per pixel of the tile, so that pixel (column, row) of the tile lies at
    ``origin_px + step * (column, row)``
    noise : standard deviation of the grey values' noise; None estimates it from the tile
    """

    pixels: np.ndarray
    valid: np.ndarray
    origin_px: tuple[float, float] = (0.0, 0.0)
    step: float = 1.0
    noise: float | None = None
    _results: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False)

    def times(self, contrast: int) -> ImageTile:
        """Return the tile, or (-1) its negative."""
        return self if contrast == 1 else replace(self, pixels=contrast * self.pixels.astype(np.float32))

    def to_tile(self, xy: np.ndarray) -> np.ndarray:
        """Return tile columns and rows ``(n, 2)`` of full-resolution positions."""
        return (np.asarray(xy, dtype=np.float64) - self.origin_px) / self.step

    def to_image(self, column_row: np.ndarray) -> np.ndarray:
        """Return full-resolution positions ``(n, 2)`` of tile columns and rows."""
        return np.asarray(column_row, dtype=np.float64) * self.step + self.origin_px


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """Ellipsoidal heights (m) of what the first image sees, on a regular grid of its full-resolution positions.

    heights_m : (rows, cols), finite; node (column, row) lies at ``origin_px + spacing_px * (column, row)``; bilinear
    between nodes, constant outside.
    """

    heights_m: np.ndarray
    origin_px: tuple[float, float] = (0.0, 0.0)
    spacing_px: float = 64.0

    def interpolate(self, xy: np.ndarray) -> np.ndarray:
        """Return heights ``(n,)`` at positions ``(n, 2)`` of the first image."""
        node = (np.asarray(xy, dtype=np.float64) - self.origin_px) / self.spacing_px
        return ndimage.map_coordinates(self.heights_m, node[:, ::-1].T, order=1, mode="nearest")


@dataclass(frozen=True, eq=False)
class TilePairGeometry:
    """Where points of the first image appear in the second.

    bias_px : (2,) known offset (sample, line) in the second image, observed - predicted by the RPCs
    margin_px : how far (px of the second image) the prediction may be off along and across the epipolar line, beyond
    what the heights between ``lowest_m`` and ``highest_m`` explain
    heights : approximate heights over the first image, or None: then the middle of lowest and highest
    height_sigma_m : how well ``heights`` are known; None: anything between lowest and highest
    contrasts : what grey values of the second image are multiplied by to look like the first's: -1 where what is light
    in the first is dark in the second, both where some is and some is not, as in another band
    """

    first: RPC
    second: RPC
    lowest_m: float
    highest_m: float
    bias_px: tuple[float, float] = (0.0, 0.0)
    margin_px: tuple[float, float] = (64.0, 64.0)
    heights: HeightGrid | None = None
    height_sigma_m: float | None = None
    contrasts: tuple[int, ...] = (1,)

    def heights_at(self, xy: np.ndarray) -> np.ndarray:
        """Return approximate heights ``(n,)`` at positions of the first image."""
        if self.heights is None:
            return np.full(len(xy), 0.5 * (self.lowest_m + self.highest_m))
        return self.heights.interpolate(xy)


@dataclass(frozen=True, eq=False)
class TileMatches:
    """Matched positions, columns of length n.

    first_xy, second_xy : (n, 2) full-resolution positions. ``first_xy`` are interest points of the first tile, whole
    pixels of it, the same whatever the second tile is: equal positions mean the same point.
    sigma_px : standard deviation of a coordinate in the second image (pixels of the full image)
    quality : 0 … 1, higher for more precise ones, 0.5 at 0.1 px of the second tile; kind : ``corner``
    height_m : ellipsoidal height that the match stands for, by the RPCs and the bias found
    bias_px : (2,) offset in the second image, observed - predicted by the RPCs without ``PairGeometry.bias_px``; it is
    known across the epipolar lines only and is at right angles to them
    band : name in `MATCHING_BANDS` of the filter that fits both windows best, empty where too few matches tell
    """

    first_xy: np.ndarray
    second_xy: np.ndarray
    sigma_px: np.ndarray
    quality: np.ndarray
    kind: np.ndarray
    height_m: np.ndarray
    bias_px: np.ndarray = field(default_factory=lambda: np.zeros(2))
    band: str = ""

    def __len__(self) -> int:
        return len(self.first_xy)

    def select(self, keep: np.ndarray) -> TileMatches:
        """Return the chosen rows (mask or indices)."""
        columns = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name not in ("bias_px", "band")}
        return TileMatches(**columns, bias_px=self.bias_px, band=self.band)


def make_empty_matches() -> TileMatches:
    """Return a result without rows."""
    nothing = np.empty(0)
    return TileMatches(np.empty((0, 2)), np.empty((0, 2)), nothing, nothing, np.empty(0, "U9"), nothing)
