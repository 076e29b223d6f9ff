"""Height surfaces, and where the rays of an image first meet them.

A surface has grid coordinates ``(column, row)`` in units of its cells, (0, 0) the centre of the first cell, and
ellipsoidal heights that are interpolated bilinearly between cell centres. `intersect_surface` follows each ray from
above the highest terrain downwards in steps of at most half a cell, so that the first hit counts (a mountain hides the
valley behind it), and closes in on it with the RPC itself.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np

from ..camera.rpc import RPC
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import longitudes_near, metres_per_degree, wrap_degrees
from ..ground.operation_uses import OperationUse


@thresholds
class SurfaceThresholds:
    """How rays are followed down to a surface, and what of it is kept in memory."""

    tile: int = threshold(256, "cells", "side of a part that is kept in memory")
    tiles: int = threshold(128, "tiles", "kept in memory: 68 MB")
    batch: int = threshold(16384, "rays", "followed at a time: memory")
    step: float = threshold(0.5, "cells", "that a ray passes from height to height")
    accuracy_m: float = threshold(1e-3, "m", "of the height at which a ray meets the surface")
    margin_m: float = threshold(1.0, "m", "above the highest and below the lowest cell on a ray's way")
    most_iterations: int = threshold(60, "iterations", "of regula falsi")
    bound_rounds: int = threshold(4, "rounds", "in which the range of heights follows the terrain passed")


SURFACE = SurfaceThresholds()


class Status(IntEnum):
    """What became of a ray."""

    FOUND = 0
    NODATA = 1  #: the ray meets the ground, if at all, where the surface has no heights
    OUTSIDE = 2  #: the ray leaves the surface's area before it meets it
    NO_RAY = 3  #: the RPC has no ground position for the image point

    @property
    def label(self) -> str:
        return ("found", "nodata", "outside", "no ray")[self.value]


class SurfaceIntersection(NamedTuple):
    """Where rays meet a surface, and what became of each.

    Parameters
    ----------
    ground : (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres; NaN unless found.
    status : (n,) ndarray
        Values of `Status`.
    """

    ground: np.ndarray
    status: np.ndarray


class HeightSurface(Protocol):
    """Ellipsoidal heights over an area."""

    def grid_coordinates(self, lonlat: np.ndarray) -> np.ndarray:
        """Return column and row of positions.

        Parameters
        ----------
        lonlat : (n, 2) ndarray
            Lon, lat in degrees.

        Returns
        -------
        (n, 2) ndarray
            In cells; (0, 0) is the centre of the first.
        """

    def heights(self, grid: np.ndarray) -> np.ndarray:
        """Return ellipsoidal heights ``(n,)`` at grid coordinates; NaN outside and where there is no data.

        Parameters
        ----------
        grid : (n, 2) ndarray
            Column, row.

        Returns
        -------
        (n,) ndarray
            Metres.
        """

    def covers(self, grid: np.ndarray) -> np.ndarray:
        """Tell for each grid position ``(n, 2)`` whether it lies in the surface's area.

        Parameters
        ----------
        grid : (n, 2) ndarray
            Column, row.

        Returns
        -------
        (n,) ndarray
            Booleans.
        """

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
        """Return the lowest and highest height in a box of grid coordinates.

        Parameters
        ----------
        low, high : (2,) ndarray
            Column, row of two corners.

        Returns
        -------
        tuple of float
            Metres; NaN where there is no height.
        """


def surface_heights(surface: HeightSurface, lonlat: np.ndarray) -> np.ndarray:
    """Return ellipsoidal heights ``(n,)`` at lon, lat points ``(n, 2)``; NaN outside and where there is no data.

    Parameters
    ----------
    surface : HeightSurface
        The terrain.
    lonlat : (n, 2) ndarray
        Lon, lat in degrees.

    Returns
    -------
    (n,) ndarray
        Metres; NaN outside and where there is no data.
    """
    return surface.heights(surface.grid_coordinates(lonlat))


def dem_sigma_m(cell_size_m: float) -> float:
    """Return a standard deviation of a DEM's heights from the size of its cells, where nobody says more.

    0.4 m for 1 m (laser scanning), 3 m for 30 m (TanDEM-X, Copernicus), 9 m for 90 m (SRTM): what their makers state.
    """
    return 0.3 + 0.1 * min(cell_size_m, 100.0)


def cell_size_m(surface: HeightSurface, ground: np.ndarray) -> float:
    """Return the side in metres of a surface's cells (mean of both) at a ground point ``(3,)``."""
    step_deg = 1e-4
    lonlat = ground[:2] + step_deg * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = np.diff(surface.grid_coordinates(lonlat)[[0, 1, 0, 2]], axis=0)[[0, 2]]
    metres = step_deg * metres_per_degree(ground[None])[0, :2]
    return float(np.sqrt(np.prod(metres) / abs(np.linalg.det(cells))))


@dataclass(frozen=True)
class ConstantHeight:
    """A surface of one height everywhere.

    Parameters
    ----------
    height_m : float
        The ellipsoidal height.
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
ToGrid = Callable[[np.ndarray], np.ndarray]


class GridSurface:
    """A regular grid of heights, read tile by tile: of a DEM of a continent only the part in use is in memory.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns.
    read : callable
        ``read(row, column, rows, columns)`` returns that window's ellipsoidal heights, NaN where there are none.
    to_grid : callable
        Column, row ``(n, 2)`` of lon, lat points ``(n, 2)``.
    operations : tuple of OperationUse
        How it came to WGS84.
    """

    def __init__(
        self, shape: tuple[int, int], read: ReadCells, to_grid: ToGrid, operations: tuple[OperationUse, ...] = ()
    ) -> None:
        if min(shape) < 2:
            raise ValueError(f"a grid of {shape} cells has no area; 2 x 2 are needed")
        self.shape, self.operations = shape, operations
        self._read, self._to_grid = read, to_grid
        self._tiles: OrderedDict[tuple[int, int], np.ndarray] = OrderedDict()
        self._ranges: dict[tuple[int, int], tuple[float, float]] = {}
        self._lock = threading.Lock()

    @classmethod
    def from_array(
        cls, heights_m: np.ndarray, origin_deg: tuple[float, float], cell_deg: tuple[float, float]
    ) -> GridSurface:
        """Return the surface of an array in memory whose rows and columns follow parallels and meridians.

        Parameters
        ----------
        heights_m : (rows, columns) ndarray
            Ellipsoidal heights, NaN where there are none.
        origin_deg : tuple of float
            Lon, lat of the first cell's centre.
        cell_deg : tuple of float
            The step to the next column and row; the latter below zero where the first row is the northernmost.

        Returns
        -------
        GridSurface
            The surface.
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
        )

    def grid_coordinates(self, lonlat: np.ndarray) -> np.ndarray:
        """As `HeightSurface.grid_coordinates`."""
        return self._to_grid(lonlat)

    def covers(self, grid: np.ndarray) -> np.ndarray:
        """As `HeightSurface.covers`: half a cell around the outermost centres belongs to the area."""
        last = np.array([self.shape[1] - 0.5, self.shape[0] - 0.5])
        return np.asarray(((grid >= -0.5) & (grid <= last)).all(axis=1))

    def heights(self, grid: np.ndarray) -> np.ndarray:
        """As `HeightSurface.heights`: bilinearly interpolated; NaN where one of the four cells has no data.

        In the outer half of a border cell its height is taken as it is.
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
            here = np.flatnonzero(tile == number)
            place = int(top[here[0]]) // SURFACE.tile, int(left[here[0]]) // SURFACE.tile
            i, j = top[here] - place[0] * SURFACE.tile, left[here] - place[1] * SURFACE.tile
            result[inside[here]] = _interpolate_cells(
                self._read_tile(place), i, j, row[here] - top[here], column[here] - left[here]
            )
        return result

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
        """As `HeightSurface.bounds`: of all tiles that touch the box."""
        (column0, row0), (column1, row1) = self._find_tile(low), self._find_tile(high)
        ranges = [
            self._find_range((row, column)) for row in range(row0, row1 + 1) for column in range(column0, column1 + 1)
        ]
        lowest, highest = np.array(ranges).T
        if np.isnan(lowest).all():
            return np.nan, np.nan
        return float(np.nanmin(lowest)), float(np.nanmax(highest))

    def window(self, low: np.ndarray, high: np.ndarray) -> tuple[int, int, np.ndarray]:
        """Return first row, first column and the cells around a box of grid coordinates, NaN where there are none.

        The box is cut to the surface; at least 2 x 2 cells come back.

        Parameters
        ----------
        low, high : (2,) ndarray
            Column, row of two corners.

        Returns
        -------
        tuple of int, int and (rows, columns) ndarray
            First row, first column, and ellipsoidal heights in metres.
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
        """Return a tile with the first row and column of its neighbours, from the cache or read now."""
        with self._lock:
            tile = self._tiles.pop(place, None)
            if tile is None:
                row, column = place[0] * SURFACE.tile, place[1] * SURFACE.tile
                rows, columns = (
                    min(SURFACE.tile + 1, self.shape[0] - row),
                    min(SURFACE.tile + 1, self.shape[1] - column),
                )
                tile = np.asarray(self._read(row, column, rows, columns), dtype=np.float64)
            self._tiles[place] = tile
            while len(self._tiles) > SURFACE.tiles:
                self._tiles.popitem(last=False)
            return tile


def _interpolate_cells(
    cells: np.ndarray, i: np.ndarray, j: np.ndarray, down: np.ndarray, right: np.ndarray
) -> np.ndarray:
    upper = cells[i, j] * (1.0 - right) + cells[i, j + 1] * right
    lower = cells[i + 1, j] * (1.0 - right) + cells[i + 1, j + 1] * right
    return np.asarray(upper * (1.0 - down) + lower * down)


# ---- intersection ----------------------------------------------------------------------------------------------


def intersect_surface(rpc: RPC, image: np.ndarray, surface: HeightSurface) -> SurfaceIntersection:
    """Return where the rays of image points ``(n, 2)`` first meet a surface, coming from above.

    Heights are right to 1 mm. A spike that a ray passes within less than half a cell may be missed. Where the
    surface has no heights along a ray the ground may hide there: such a ray is found only when it comes out of the
    gap above the ground; else its status is ``NODATA``.

    Parameters
    ----------
    rpc : RPC
        The camera.
    image : (n, 2) ndarray
        Sample, line in pixels.
    surface : HeightSurface
        The terrain.

    Returns
    -------
    SurfaceIntersection
        Ground points and a status for each ray.
    """
    image = np.asarray(image, dtype=np.float64)
    ground = np.full((len(image), 3), np.nan)
    status = np.empty(len(image), dtype=np.int64)
    for start in range(0, len(image), SURFACE.batch):
        part = slice(start, start + SURFACE.batch)
        ground[part], status[part] = _intersect_part(rpc, image[part], surface)
    return SurfaceIntersection(ground, status)


def _intersect_part(rpc: RPC, image: np.ndarray, surface: HeightSurface) -> SurfaceIntersection:
    ends = _find_ray_ends(rpc, image, surface)
    ground = np.full((len(image), 3), np.nan)
    status = np.where(ends.converged, int(Status.OUTSIDE), int(Status.NO_RAY))
    rays = np.flatnonzero(ends.exists)
    if not rays.size:
        return SurfaceIntersection(ground, status)
    if np.isnan(ends.heights).any():  # no height near any ray
        status[rays] = np.where(surface.covers(ends.lower[rays]), Status.NODATA, Status.OUTSIDE)
        return SurfaceIntersection(ground, status)
    status[rays], bracket = _march_down(ends.upper[rays], ends.lower[rays], ends.heights, surface)
    hits = rays[status[rays] == Status.FOUND]
    ground[hits], valid = _close_in_on_surface(rpc, image[hits], surface, bracket[status[rays] == Status.FOUND])
    status[hits[~valid]] = Status.NODATA
    ground[hits[~valid]] = np.nan
    return SurfaceIntersection(ground, status)


class _RayEnds(NamedTuple):
    """Grid coordinates ``(n, 2)`` of rays at the upper and lower of two heights.

    ``exists`` tells which rays have both, ``converged`` which have both on the ground, if not in the grid's reach.
    """

    upper: np.ndarray
    lower: np.ndarray
    heights: tuple[float, float]
    exists: np.ndarray
    converged: np.ndarray


def _find_ray_ends(rpc: RPC, image: np.ndarray, surface: HeightSurface) -> _RayEnds:
    """Return the rays between heights just above and below all terrain that they pass.

    The terrain passed depends on these heights: they start at the RPC's height range and follow the terrain.
    """
    low, high = rpc.height_range
    for _ in range(SURFACE.bound_rounds):
        ends = _localize_between(rpc, image, surface, low, high)
        if not ends.exists.any():
            return ends
        passed = np.concatenate([ends.upper[ends.exists], ends.lower[ends.exists]])
        lowest, highest = surface.bounds(passed.min(axis=0) - 1.0, passed.max(axis=0) + 1.0)
        if np.isnan(lowest):
            return ends._replace(heights=(np.nan, np.nan))
        enclosed = low <= lowest - SURFACE.margin_m and high >= highest + SURFACE.margin_m
        low, high = lowest - SURFACE.margin_m, highest + SURFACE.margin_m
        if enclosed:
            break
    return _localize_between(rpc, image, surface, low, high)


def _localize_between(rpc: RPC, image: np.ndarray, surface: HeightSurface, low: float, high: float) -> _RayEnds:
    upper, lower = rpc.localize(image, high), rpc.localize(image, low)
    lower.ground[:, 0] = upper.ground[:, 0] + wrap_degrees(lower.ground[:, 0] - upper.ground[:, 0])
    grid = [np.full((len(image), 2), np.nan) for _ in range(2)]
    converged = upper.converged & lower.converged
    for target, end in zip(grid, (upper, lower), strict=True):
        target[converged] = surface.grid_coordinates(end.ground[converged, :2])
    exists = converged & np.isfinite(grid[0]).all(axis=1) & np.isfinite(grid[1]).all(axis=1)
    return _RayEnds(grid[0], grid[1], (low, high), exists, converged)


def _march_down(
    upper: np.ndarray, lower: np.ndarray, heights: tuple[float, float], surface: HeightSurface
) -> tuple[np.ndarray, np.ndarray]:
    """Go down straight rays; return each one's status and the heights ``(n, 2)`` above and below its first hit."""
    low, high = heights
    longest = float(np.abs(upper - lower).max())
    steps = max(1, int(np.ceil(longest / SURFACE.step)))
    count = len(upper)
    status, bracket = np.full(count, int(Status.OUTSIDE)), np.full((count, 2), np.nan)
    going, in_gap = np.arange(count), np.zeros(count, dtype=bool)
    for step in range(steps + 1):
        share = step / steps
        height = high - share * (high - low)
        position = upper[going] + share * (lower[going] - upper[going])
        terrain = surface.heights(position)
        unknown = np.isnan(terrain)
        reached = ~unknown & (height <= terrain)
        found, hidden = going[reached & ~in_gap[going]], going[reached & in_gap[going]]
        status[found], status[hidden] = Status.FOUND, Status.NODATA
        bracket[found] = height + (high - low) / steps, height
        in_gap[going] = unknown & surface.covers(position)
        status[going[in_gap[going]]] = Status.NODATA
        status[going[unknown & ~in_gap[going]]] = Status.OUTSIDE
        going = going[~reached]
        if not going.size:
            break
    return status, bracket


def _close_in_on_surface(
    rpc: RPC, image: np.ndarray, surface: HeightSurface, bracket: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ground points where rays meet the surface within height brackets, and where they could be found.

    Regula falsi in the Illinois variant (Dowell and Jarratt 1971), with bisection every fourth time: the surface is
    continuous but has edges.
    """

    def find_height_above(rows: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point = rpc.localize(image[rows], height).ground
        return point, height - surface_heights(surface, point[:, :2])

    every = np.arange(len(image))
    upper, lower = bracket.T.copy()
    (_, f_upper), (ground, f_lower) = find_height_above(every, upper), find_height_above(every, lower)
    valid = np.isfinite(f_upper) & np.isfinite(f_lower)
    # The real ray is bent by millimetres against the straight one: where that flips a sign, the end is the hit.
    going = every[valid & (f_upper > 0.0) & (f_lower < 0.0)]
    at_top = every[valid & (f_upper <= 0.0)]
    ground[at_top] = find_height_above(at_top, upper[at_top])[0]
    below_before = np.full(len(image), -1)  # which end moved last: 1 the lower, 0 the upper
    for iteration in range(SURFACE.most_iterations):
        if not going.size:
            break
        a, b, fa, fb = upper[going], lower[going], f_upper[going], f_lower[going]
        middle = 0.5 * (a + b) if iteration % 4 == 3 else (a * fb - b * fa) / (fb - fa)
        ground[going], f = find_height_above(going, middle)
        below = f < 0.0
        damping = np.where(below == below_before[going], 0.5, 1.0)  # for the end that stays a second time
        upper[going], f_upper[going] = np.where(below, a, middle), np.where(below, damping * fa, f)
        lower[going], f_lower[going] = np.where(below, middle, b), np.where(below, f, damping * fb)
        below_before[going] = below
        valid[going[~np.isfinite(f)]] = False
        narrow = upper[going] - lower[going] < SURFACE.accuracy_m
        going = going[np.isfinite(f) & ~narrow & (np.abs(f) > 0.1 * SURFACE.accuracy_m)]
    return ground, valid
