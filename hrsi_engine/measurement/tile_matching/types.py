"""Input and output of the matching of two windows: plain arrays, which can be sent to other processes.

Positions are always (sample, line) of the full-resolution image, (0, 0) the centre of its first pixel.

The second image is resampled into the geometry of the first (`TileFrame`), as predicted by RPCs, heights and bias.
In this frame (columns and rows of the first tile) points still have displacements: the remaining bias, and the parallax
due to the error of the height, which at each place has one direction, that of the epipolar line.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage

from ...foundation.pixel_filters import blur, interpolate
from ...foundation.thresholds import GRIDS, GROUND, MEMORY
from ..window_matching.windows import ResultCache
from .epipolar import EPIPOLAR, LocalizingCamera, transfer


@dataclass(frozen=True, eq=False)
class ImageTile(ResultCache):
    """A window of an image, possibly of a pyramid level.

    pixels : (rows, cols) float32 grey values; valid : (rows, cols) bool, False for nodata, clouds, saturated areas
    origin_px : (sample, line) of the centre of the first pixel, in full-resolution coordinates
    step : full-resolution pixels per pixel of the tile; pixel (column, row) of the tile is at
    ``origin_px + step * (column, row)``
    noise : standard deviation of the noise of the grey values; None: estimated from the tile
    """

    pixels: np.ndarray
    valid: np.ndarray
    origin_px: tuple[float, float] = (0.0, 0.0)
    step: float = 1.0
    noise: float | None = None
    _results: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False)

    def times(self, contrast: int) -> ImageTile:
        """Return the tile, or its negative if ``contrast`` is -1."""
        return self if contrast == 1 else replace(self, pixels=contrast * self.pixels.astype(np.float32))

    def to_tile(self, xy: np.ndarray) -> np.ndarray:
        """Return tile columns and rows ``(n, 2)`` of full-resolution positions."""
        return (np.asarray(xy, dtype=np.float64) - self.origin_px) / self.step

    def to_image(self, column_row: np.ndarray) -> np.ndarray:
        """Return full-resolution positions ``(n, 2)`` of tile columns and rows."""
        return np.asarray(column_row, dtype=np.float64) * self.step + self.origin_px


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """Ellipsoidal heights (m) of the ground in the first image, on a regular grid of its full-resolution positions.

    heights_m : (rows, cols), finite; node (column, row) is at ``origin_px + spacing_px * (column, row)``; bilinear
    interpolation between nodes, constant outside
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
    """Prediction of points of the first image in the second.

    bias_px : (2,) known offset (sample, line) in the second image, observed - predicted by the RPCs
    margin_px : largest error (px of the second image) of the prediction along and across the epipolar line, in addition
    to the effect of heights between ``lowest_m`` and ``highest_m``
    heights : approximate heights over the first image; None: the mean of lowest and highest
    height_sigma_m : standard deviation of ``heights``; None: any height between lowest and highest is possible
    seeds : (n, 4) sample and line in the first image, then in the second, of matches that are already known
    contrasts : signs of the grey values of the second image relative to the first: -1 if bright objects of the first
    are dark in the second, both signs if this is true for some objects only, as for another band
    """

    first: LocalizingCamera
    second: LocalizingCamera
    lowest_m: float
    highest_m: float
    bias_px: tuple[float, float] = (0.0, 0.0)
    margin_px: tuple[float, float] = (64.0, 64.0)
    heights: HeightGrid | None = None
    height_sigma_m: float | None = None
    contrasts: tuple[int, ...] = (1,)
    seeds: np.ndarray | None = None

    def heights_at(self, xy: np.ndarray) -> np.ndarray:
        """Return approximate heights ``(n,)`` at positions of the first image."""
        if self.heights is None:
            return np.full(len(xy), 0.5 * (self.lowest_m + self.highest_m))
        return self.heights.interpolate(xy)


@dataclass(frozen=True, eq=False)
class TileMatches:
    """Matched positions as columns of length n.

    first_xy, second_xy : (n, 2) full-resolution positions. ``first_xy`` are interest points of the first tile, whole
    pixels, independent of the second tile: equal positions are of the same point.
    sigma_px : standard deviation of a coordinate in the second image (pixels of the full image)
    quality : 0 … 1, higher for more precise matches, 0.5 at 0.1 px of the second tile; kind : ``corner``
    height_m : ellipsoidal height of the match by the RPCs and the bias found
    bias_px : (2,) offset in the second image, observed - predicted by the RPCs alone: `TilePairGeometry.bias_px` and
    the median deviation across the epipolar lines; along the lines it is not determined
    band : name in `MATCHING_BANDS` of the most suitable filter, empty if there were too few matches to select it
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
        """Return the selected rows (mask or indices)."""
        columns = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name not in ("bias_px", "band")}
        return TileMatches(**columns, bias_px=self.bias_px, band=self.band)


def make_empty_matches() -> TileMatches:
    """Return a table without rows."""
    nothing = np.empty(0)
    return TileMatches(np.empty((0, 2)), np.empty((0, 2)), nothing, nothing, np.empty(0, "U9"), nothing)


NOWHERE_PX = -1e4  # outside any tile


@dataclass(frozen=True, eq=False)
class TileFrame:
    """Prediction from a first into a second tile; positions ``(n, 2)`` are columns and rows of the tiles."""

    first: ImageTile
    second: ImageTile
    geometry: TilePairGeometry

    def predict(self, points: np.ndarray, raised_m: float = 0.0, heights_m: np.ndarray | None = None) -> np.ndarray:
        """Return columns and rows ``(n, 2)`` in the second tile of points of the first.

        points : (n, 2) columns, rows; heights_m : (n,), by default those of the geometry; raised_m is added to them
        """
        xy = self.first.to_image(points)
        height = (self.geometry.heights_at(xy) if heights_m is None else heights_m) + raised_m
        positions = transfer(self.geometry.first, self.geometry.second, xy, height) + self.geometry.bias_px
        return self.second.to_tile(positions)

    def compute_jacobians(self, points: np.ndarray) -> np.ndarray:
        """Return derivatives of positions in the second tile by those in the first, at constant height, (n, 2, 2)."""
        xy, reach = self.first.to_image(points), 8.0 * self.first.step
        height = self.geometry.heights_at(xy)
        columns = []
        for axis in ((reach, 0.0), (0.0, reach)):
            ends = [
                transfer(self.geometry.first, self.geometry.second, xy + sign * np.array(axis), height)
                for sign in (1.0, -1.0)
            ]
            columns.append((ends[0] - ends[1]) / (2.0 * reach))
        return np.stack(columns, axis=-1) * (self.first.step / self.second.step)

    def parallax(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return unit direction ``(n, 2)`` and size ``(n,)`` (px per metre) of the parallax of height in this frame."""
        up_m = GROUND.margin_m
        parallax_px = (self.predict(points, up_m) - self.predict(points, -up_m)) / (2.0 * up_m)
        slope = np.linalg.solve(self.compute_jacobians(points), parallax_px[..., None])[..., 0]
        stretch = np.linalg.norm(slope, axis=1)
        unit = slope / np.maximum(stretch, EPIPOLAR.least_stretch)[:, None]
        return np.where((stretch < EPIPOLAR.least_stretch)[:, None], (1.0, 0.0), unit), stretch

    def compute_displacements(self, points: np.ndarray, matched_xy: np.ndarray) -> np.ndarray:
        """Return the differences of positions in the second tile from their prediction, in this frame, ``(n, 2)``."""
        return np.linalg.solve(self.compute_jacobians(points), (matched_xy - self.predict(points))[..., None])[..., 0]

    @cached_property
    def scale(self) -> float:
        """Pixels of the second tile per pixel of the first, geometric mean of both directions."""
        rows, columns = self.first.pixels.shape
        return float(np.sqrt(abs(np.linalg.det(self.compute_jacobians(np.array([[0.5 * columns, 0.5 * rows]]))[0]))))

    @cached_property
    def reach_px(self) -> tuple[float, float]:
        """Largest displacements of a point along and across the epipolar line."""
        rows, columns = self.first.pixels.shape
        corners = np.array([[x, y] for x in (0.0, columns - 1.0) for y in (0.0, rows - 1.0)])
        _, stretch = self.parallax(corners)
        along, across = (margin / (self.second.step * self.scale) for margin in self.geometry.margin_px)
        height, sigma = self.geometry.heights_at(self.first.to_image(corners)), self.geometry.height_sigma_m
        room = np.maximum(self.geometry.highest_m - height, height - self.geometry.lowest_m).max()
        return along + float(stretch.max()) * (float(room) if sigma is None else 3.0 * sigma), across

    @cached_property
    def pad_px(self) -> int:
        """Width of the border of the resampled window around the first tile."""
        return int(np.ceil(min(max(self.reach_px), MEMORY.window_px))) + 2

    @cached_property
    def resampled(self) -> ImageTile:
        """The second tile in this frame: origin ``(-pad, -pad)``, step 1, both in pixels of the first tile."""
        rows, columns = (length + 2 * self.pad_px for length in self.first.pixels.shape)
        count = [max(2, -(-(length - 1) // GRIDS.spacing_px) + 1) for length in (columns, rows)]
        nodes = np.stack(np.meshgrid(*(np.arange(n) * float(GRIDS.spacing_px) for n in count)), -1).reshape(-1, 2)
        positions = self.predict(nodes - self.pad_px).reshape(count[1], count[0], 2).astype(np.float32)
        if not np.isfinite(positions).all():
            positions = np.full_like(positions, NOWHERE_PX)
        by_row, by_column = _make_interpolation_matrix(rows, count[1]), _make_interpolation_matrix(columns, count[0])
        x, y = (by_row @ positions[..., k] @ by_column.T for k in (0, 1))
        grey = self.second.pixels
        if self.scale > 1.2:  # the second image is finer: low-pass filter against aliasing
            grey = blur(grey, 0.5 * float(np.sqrt(self.scale**2 - 1.0)))
        is_valid = interpolate(self.second.valid.view(np.uint8), x, y, order=0, outside=0) > 0
        return ImageTile(interpolate(grey, x, y, order=3), is_valid, (-self.pad_px, -self.pad_px), 1.0)


def _make_interpolation_matrix(length: int, nodes: int) -> np.ndarray:
    """Return the matrix ``(length, nodes)`` of linear interpolation from nodes ``GRIDS.spacing_px`` apart to pixels."""
    position = np.arange(length) / GRIDS.spacing_px
    node = np.minimum(position.astype(np.int64), nodes - 2)
    weights = np.zeros((length, nodes), dtype=np.float32)
    weights[np.arange(length), node] = 1.0 - (position - node)
    weights[np.arange(length), node + 1] = position - node
    return weights
