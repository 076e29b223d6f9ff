"""Surfaces of constant height, and of rasters whose cells are read tile by tile."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..foundation.thresholds import MEMORY, threshold, thresholds
from ..ground.geodesy import longitudes_near
from ..ground.operation_uses import OperationUse


@thresholds
class SURFACE:
    """Tiles of a surface in memory."""

    tile: int = threshold(256, "cells", "side of a tile that is kept in memory")


@dataclass(frozen=True)
class ConstantHeight:
    """A horizontal surface.

    height_m : the ellipsoidal height
    """

    height_m: float

    def grid_coordinates(self, lonlat: np.ndarray) -> np.ndarray:
        """As `HeightSurface.grid_coordinates`."""
        return lonlat

    def heights(self, grid: np.ndarray) -> np.ndarray:
        """As `HeightSurface.heights`."""
        return np.full(len(grid), self.height_m)

    def covers(self, grid: np.ndarray) -> np.ndarray:
        """As `HeightSurface.covers`."""
        return np.ones(len(grid), dtype=bool)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
        """As `HeightSurface.bounds`."""
        return self.height_m, self.height_m


ReadCells = Callable[[int, int, int, int], np.ndarray]


Convert = Callable[[np.ndarray], np.ndarray]


class GridSurface:
    """A regular grid of heights, read tile by tile, so that only the part in use of a large DEM is in memory.

    shape : rows and columns
    read : ``read(row, column, rows, columns)`` returns the ellipsoidal heights of this window, NaN for nodata
    to_grid : returns column, row ``(n, 2)`` of lon, lat points ``(n, 2)``; to_lonlat : the inverse, for `fill_from`
    operations : its conversions to WGS84
    """

    def __init__(
        self,
        shape: tuple[int, int],
        read: ReadCells,
        to_grid: Convert,
        to_lonlat: Convert | None = None,
        operations: tuple[OperationUse, ...] = (),
    ) -> None:
        if min(shape) < 2:
            raise ValueError(f"a grid of {shape} cells has no area; 2 x 2 are needed")
        self.shape, self.operations = shape, operations
        self._read, self._to_grid, self.to_lonlat = read, to_grid, to_lonlat
        self._tiles: OrderedDict[tuple[int, int], np.ndarray] = OrderedDict()
        self._ranges: dict[tuple[int, int], tuple[float, float]] = {}
        self._lock = threading.Lock()

    @classmethod
    def from_array(
        cls, heights_m: np.ndarray, origin_deg: tuple[float, float], cell_deg: tuple[float, float]
    ) -> GridSurface:
        """Return the surface of an array in memory whose rows and columns follow parallels and meridians.

        heights_m : (rows, columns) ellipsoidal heights, NaN for nodata
        origin_deg : lon, lat of the centre of the first cell
        cell_deg : step to the next column and to the next row; the latter is negative if the first row is northernmost
        Result: the surface.
        """
        cells = np.asarray(heights_m, dtype=np.float64)
        half_width = 0.5 * cell_deg[0] * (cells.shape[1] - 1)

        def to_grid(lonlat: np.ndarray) -> np.ndarray:
            lon = longitudes_near(lonlat[:, 0], origin_deg[0] + half_width, abs(half_width))
            return np.column_stack([(lon - origin_deg[0]) / cell_deg[0], (lonlat[:, 1] - origin_deg[1]) / cell_deg[1]])

        return cls(
            (cells.shape[0], cells.shape[1]),
            lambda row, column, rows, columns: cells[row : row + rows, column : column + columns],
            to_grid,
            lambda grid: np.asarray(origin_deg) + grid * cell_deg,
        )

    def grid_coordinates(self, lonlat: np.ndarray) -> np.ndarray:
        """As `HeightSurface.grid_coordinates`."""
        return self._to_grid(lonlat)

    def covers(self, grid: np.ndarray) -> np.ndarray:
        """As `HeightSurface.covers`: the area extends half a cell beyond the outermost cell centres."""
        last = np.array([self.shape[1] - 0.5, self.shape[0] - 0.5])
        return np.asarray(((grid >= -0.5) & (grid <= last)).all(axis=1))

    def heights(self, grid: np.ndarray) -> np.ndarray:
        """As `HeightSurface.heights`: bilinear interpolation; NaN if one of the four cells has nodata.

        In the outer half of a border cell the height is constant.
        """
        result = np.full(len(grid), np.nan)
        inside = np.flatnonzero(self.covers(grid))
        if not inside.size:
            return result
        column = np.clip(grid[inside, 0], 0.0, self.shape[1] - 1.0)
        row = np.clip(grid[inside, 1], 0.0, self.shape[0] - 1.0)
        left, top = np.minimum(column.astype(int), self.shape[1] - 2), np.minimum(row.astype(int), self.shape[0] - 2)
        tile = (top // SURFACE.tile) * (1 + self.shape[1] // SURFACE.tile) + left // SURFACE.tile
        for number in np.unique(tile):
            in_tile = np.flatnonzero(tile == number)
            place = int(top[in_tile[0]]) // SURFACE.tile, int(left[in_tile[0]]) // SURFACE.tile
            i, j = top[in_tile] - place[0] * SURFACE.tile, left[in_tile] - place[1] * SURFACE.tile
            result[inside[in_tile]] = _interpolate_cells(
                self._read_tile(place), i, j, row[in_tile] - top[in_tile], column[in_tile] - left[in_tile]
            )
        return result

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
        """As `HeightSurface.bounds`: of all tiles that intersect the box, so that the range can be too wide."""
        (column0, row0), (column1, row1) = self._find_tile(low), self._find_tile(high)
        ranges = [self._find_range((i, j)) for i in range(row0, row1 + 1) for j in range(column0, column1 + 1)]
        lowest, highest = np.array(ranges).T
        if np.isnan(lowest).all():
            return np.nan, np.nan
        return float(np.nanmin(lowest)), float(np.nanmax(highest))

    def window(self, low: np.ndarray, high: np.ndarray) -> tuple[int, int, np.ndarray]:
        """Return the first row, the first column and the cells of the window around a box of grid coordinates.

        The box is clipped to the surface; the window has at least 2 x 2 cells.

        low, high : (2,) column, row of two corners
        Result: int, int and (rows, columns) first row, first column, and ellipsoidal heights in metres, NaN for nodata.
        """
        last = np.array(self.shape[::-1]) - 2
        column0, row0 = np.clip(np.floor(low), 0, last).astype(int).tolist()
        column1, row1 = np.clip(np.floor(high), [column0, row0], last).astype(int).tolist()
        cells = np.empty((row1 - row0 + 2, column1 - column0 + 2))
        for tile_row in range(row0 // SURFACE.tile, row1 // SURFACE.tile + 1):
            for tile_column in range(column0 // SURFACE.tile, column1 // SURFACE.tile + 1):
                tile = self._read_tile((tile_row, tile_column))
                top, left = tile_row * SURFACE.tile - row0, tile_column * SURFACE.tile - column0
                part = tile[max(0, -top) : len(cells) - top, max(0, -left) : cells.shape[1] - left]
                top, left = max(0, top), max(0, left)
                cells[top : top + part.shape[0], left : left + part.shape[1]] = part
        return row0, column0, cells

    def fill_from(self, base: GridSurface) -> GridSurface:
        """Return this surface with the heights of another one in cells without height, and around it.

        base : also surfaces of the complete area, such as terrain between points; both have a ``to_lonlat``
        Result: cells of this surface, over the area of both.
        """
        to_lonlat, base_lonlat = self.to_lonlat, base.to_lonlat
        if to_lonlat is None or base_lonlat is None:
            raise ValueError("both surfaces need `to_lonlat`")
        columns, rows = np.array(base.shape[::-1]) - 1.0
        corners = self._to_grid(base_lonlat(np.array([[0.0, 0.0], [columns, 0.0], [0.0, rows], [columns, rows]])))
        first = np.floor(np.minimum(corners.min(axis=0), 0.0)).astype(int)
        last = np.ceil(np.maximum(corners.max(axis=0), np.array(self.shape[::-1]) - 1.0)).astype(int)

        def read(row: int, column: int, rows: int, columns: int) -> np.ndarray:
            heights, begin = np.full((rows, columns), np.nan), np.array([column, row]) + first
            low, high = np.maximum(begin, 0), np.minimum(begin + [columns, rows], self.shape[::-1])
            if np.all(low < high):
                top, left, cells = self.window(low, high - 1)
                inside = np.s_[low[1] - begin[1] : high[1] - begin[1], low[0] - begin[0] : high[0] - begin[0]]
                heights[inside] = cells[low[1] - top : high[1] - top, low[0] - left : high[0] - left]
            i, j = np.nonzero(np.isnan(heights))
            lonlat = to_lonlat(np.column_stack([j, i]) + begin.astype(np.float64))
            heights[i, j] = base.heights(base.grid_coordinates(lonlat))
            return heights

        size = last - first + 1
        return GridSurface(
            (int(size[1]), int(size[0])),
            read,
            lambda lonlat: self._to_grid(lonlat) - first,
            lambda grid: to_lonlat(grid + first),
            self.operations,
        )

    def _find_tile(self, grid: np.ndarray) -> tuple[int, int]:
        cell = np.clip(np.nan_to_num(grid), 0, np.array([self.shape[1] - 2, self.shape[0] - 2])).astype(int)
        return int(cell[0]) // SURFACE.tile, int(cell[1]) // SURFACE.tile

    def _find_range(self, place: tuple[int, int]) -> tuple[float, float]:
        if place not in self._ranges:
            tile = self._read_tile(place)
            empty = np.isnan(tile).all()
            self._ranges[place] = (np.nan, np.nan) if empty else (float(np.nanmin(tile)), float(np.nanmax(tile)))
        return self._ranges[place]

    def _read_tile(self, place: tuple[int, int]) -> np.ndarray:
        """Return a tile with the first row and column of its neighbours, from the cache or by reading it."""
        with self._lock:
            tile = self._tiles.pop(place, None)
            if tile is None:
                row, column = place[0] * SURFACE.tile, place[1] * SURFACE.tile
                rows = min(SURFACE.tile + 1, self.shape[0] - row)
                columns = min(SURFACE.tile + 1, self.shape[1] - column)
                tile = np.asarray(self._read(row, column, rows, columns), dtype=np.float64)
            self._tiles[place] = tile
            while len(self._tiles) > (MEMORY.values // SURFACE.tile**2):
                self._tiles.popitem(last=False)
            return tile


def _interpolate_cells(
    cells: np.ndarray, i: np.ndarray, j: np.ndarray, down: np.ndarray, right: np.ndarray
) -> np.ndarray:
    upper = cells[i, j] * (1.0 - right) + cells[i, j + 1] * right
    lower = cells[i + 1, j] * (1.0 - right) + cells[i + 1, j + 1] * right
    return np.asarray(upper * (1.0 - down) + lower * down)
