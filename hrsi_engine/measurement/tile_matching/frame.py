"""The second image in the geometry of the first: windows resampled to where RPCs, heights and bias predict them.

In this frame - columns and rows of the first tile - a point is displaced by what is not known yet: the rest of the
bias, and the parallax of the rest of the height, which has one direction per place, that of the epipolar lines.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...foundation.pixel_filters import blur, interpolate
from .epipolar import EPIPOLAR, transfer
from .options import TILE_MATCH
from .types import ImageTile, TilePairGeometry

NOWHERE_PX = -1e4  # outside any tile


@dataclass(frozen=True, eq=False)
class TileFrame:
    """Prediction from a first into a second tile; positions ``(n, 2)`` are columns, rows of the tiles."""

    first: ImageTile
    second: ImageTile
    geometry: TilePairGeometry

    def predict(self, points: np.ndarray, raised_m: float = 0.0, heights_m: np.ndarray | None = None) -> np.ndarray:
        """Return columns and rows in the second tile of points of the first.

        The points are at the heights given, else at those of the geometry, + ``raised_m``.
        """
        xy = self.first.to_image(points)
        height = (self.geometry.heights_at(xy) if heights_m is None else heights_m) + raised_m
        positions = transfer(self.geometry.first, self.geometry.second, xy, height) + self.geometry.bias_px
        return self.second.to_tile(positions)

    def compute_jacobians(self, points: np.ndarray) -> np.ndarray:
        """Return second by first at constant height, ``(n, 2, 2)``."""
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
        """Return unit direction ``(n, 2)`` and size ``(n,)`` (px per metre) of what a height does in this frame."""
        moved = (self.predict(points, EPIPOLAR.height_step_m) - self.predict(points, -EPIPOLAR.height_step_m)) / (
            2.0 * EPIPOLAR.height_step_m
        )
        slope = np.linalg.solve(self.compute_jacobians(points), moved[..., None])[..., 0]
        stretch = np.linalg.norm(slope, axis=1)
        flat = stretch < EPIPOLAR.least_stretch
        return np.where(
            flat[:, None], (1.0, 0.0), slope / np.maximum(stretch, EPIPOLAR.least_stretch)[:, None]
        ), stretch

    def compute_displacements(self, points: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Return how far positions in the second tile are from their prediction, in this frame, ``(n, 2)``."""
        return np.linalg.solve(self.compute_jacobians(points), (found - self.predict(points))[..., None])[..., 0]

    @cached_property
    def scale(self) -> float:
        """Pixels of the second tile per pixel of the first, mean of both directions."""
        rows, columns = self.first.pixels.shape
        jacobian = self.compute_jacobians(np.array([[0.5 * columns, 0.5 * rows]]))[0]
        return float(np.sqrt(abs(np.linalg.det(jacobian))))

    @cached_property
    def reach_px(self) -> tuple[float, float]:
        """How far a point may be displaced along and across the epipolar line."""
        rows, columns = self.first.pixels.shape
        corners = np.array([[x, y] for x in (0.0, columns - 1.0) for y in (0.0, rows - 1.0)])
        _, stretch = self.parallax(corners)
        along, across = (margin / (self.second.step * self.scale) for margin in self.geometry.margin_px)
        height, sigma = self.geometry.heights_at(self.first.to_image(corners)), self.geometry.height_sigma_m
        room = np.maximum(self.geometry.highest_m - height, height - self.geometry.lowest_m).max()
        return along + float(stretch.max()) * (float(room) if sigma is None else 3.0 * sigma), across

    @cached_property
    def pad_px(self) -> int:
        """By how much the resampled window reaches beyond the first tile on each side."""
        return int(np.ceil(min(max(self.reach_px), TILE_MATCH.widest_pad_px))) + 2

    @cached_property
    def resampled(self) -> ImageTile:
        """The second tile in this frame: origin ``(-pad, -pad)``, step 1, both counted in pixels of the first tile."""
        rows, columns = (length + 2 * self.pad_px for length in self.first.pixels.shape)
        count = [max(2, -(-(length - 1) // TILE_MATCH.node_px) + 1) for length in (columns, rows)]
        nodes = np.stack(np.meshgrid(*(np.arange(n) * float(TILE_MATCH.node_px) for n in count)), -1).reshape(-1, 2)
        positions = self.predict(nodes - self.pad_px).reshape(count[1], count[0], 2).astype(np.float32)
        if not np.isfinite(positions).all():
            positions = np.full_like(positions, NOWHERE_PX)
        by_row, by_column = _make_interpolation_matrix(rows, count[1]), _make_interpolation_matrix(columns, count[0])
        x, y = (by_row @ positions[..., k] @ by_column.T for k in (0, 1))
        grey = self.second.pixels
        if self.scale > 1.2:  # the second image is finer: smooth away what the first cannot show
            grey = blur(grey, 0.5 * float(np.sqrt(self.scale**2 - 1.0)))
        known = interpolate(self.second.valid.view(np.uint8), x, y, order=0, outside=0) > 0
        return ImageTile(interpolate(grey, x, y, order=3), known, (-self.pad_px, -self.pad_px), 1.0)


def _make_interpolation_matrix(length: int, nodes: int) -> np.ndarray:
    """Return the matrix of linear interpolation from nodes ``TILE_MATCH.node_px`` apart to every pixel."""
    position = np.arange(length) / TILE_MATCH.node_px
    node = np.minimum(position.astype(np.int64), nodes - 2)
    weights = np.zeros((length, nodes), dtype=np.float32)
    weights[np.arange(length), node] = 1.0 - (position - node)
    weights[np.arange(length), node + 1] = position - node
    return weights
