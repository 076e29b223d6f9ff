"""Where the pixels of an orthoimage lie in the raw image: ground position, terrain height, RPC.

A chunk of the map grid is mapped at nodes every ``step`` pixels, and bilinearly between them. What changes smoothly
(map projection, place in the DEM, the RPC's dependence on the height as a parabola) is evaluated every `LATTICE`
pixels and interpolated; heights are taken at each node. The step is the largest power of two at which the middles of
all cells, where interpolation is worst, and random pixels of the chunk are right to the error asked for, compared with
map projection, terrain and RPC at these pixels; where the terrain is rough that is every pixel. At an error of 0
every pixel goes through all three by itself.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from ..dem import GridSurface, HeightSurface, surface_heights
from ..rpc import RPC
from .grid import MapGrid, Window

LATTICE = 32  # pixels between positions where the map projection is evaluated; also the largest step
CHECKED_PIXELS = 200  # of each chunk, at random
UNKNOWN_GRID = 65  # positions along each side of a chunk at which pixels without height are counted
WORTH_COMPILING = 25_000_000  # pixels of an orthoimage, below which loading numba takes longer than it saves
PART = 16384  # points whose intermediate results stay in the processor's cache


class ChunkMapping(NamedTuple):
    """Image positions of a chunk.

    positions : (2, rows, columns) sample, line of nodes every ``step`` pixels from the centre of the chunk's first
        pixel, one node beyond the last pixel; NaN where the terrain is not known
    errors_px : (k,) distances between interpolated and exact positions at random pixels
    unknown : pixels within the image without terrain height
    """

    positions: np.ndarray
    step: int
    errors_px: np.ndarray
    unknown: int


def _interpolated(values: np.ndarray, position: np.ndarray, axis: int) -> np.ndarray:
    """Return ``values``, given every `LATTICE` pixels along an axis, linearly interpolated at pixel positions."""
    left = np.minimum((position / LATTICE).astype(int), values.shape[axis] - 2)
    share = (position / LATTICE - left).reshape([-1 if k == axis else 1 for k in range(values.ndim)])
    result = np.take(np.diff(values, axis=axis), left, axis=axis)
    result *= share
    result += np.take(values, left, axis=axis)
    return np.asarray(result)


class _Terrain:
    """Heights under a chunk, bilinear like those of the surface, from one block of its cells."""

    def __init__(self, surface: HeightSurface, grid: np.ndarray) -> None:
        low, high = grid.min(axis=0) - 1.0, grid.max(axis=0) + 1.0
        self._surface = surface
        self.cells: np.ndarray | None = None
        if isinstance(surface, GridSurface) and surface.covers(np.array([low, high])).all():
            row, column, self.cells = surface.window(low, high)
            self.origin = float(row), float(column)
        self.range = surface.bounds(low, high) if self.cells is None else _range(self.cells)

    def heights(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Return heights ``(n,)`` at grid coordinates; NaN where there are none."""
        if self.cells is None:
            return self._surface.heights(np.column_stack([column, row]))
        width = self.cells.shape[1]
        right, down = column - self.origin[1], row - self.origin[0]
        j, i = right.astype(np.intp), down.astype(np.intp)
        right -= j
        down -= i
        i *= width
        i += j
        cells = self.cells.ravel()
        upper = _between(cells, i, right)
        i += width
        upper += down * (_between(cells, i, right) - upper)
        return upper


def _between(cells: np.ndarray, left: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return values between each cell and the next one."""
    start = cells.take(left)
    step = cells.take(left + 1)
    step -= start
    step *= share
    step += start
    return np.asarray(step)


def _range(cells: np.ndarray) -> tuple[float, float]:
    known = cells[np.isfinite(cells)]
    return (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)


class _Chunk:
    """What does not change within a chunk, every `LATTICE` pixels.

    ``values (8, rows, columns)`` are the surface's grid coordinates and, for sample and line, the coefficients a, b, c
    of a + b t + c t² with the height t in half ranges from the middle of the chunk's heights.
    """

    def __init__(self, mapping: OrthoMapping, window: Window) -> None:
        self.window, self._use_compiled = window, mapping.compiled
        columns, rows = ((size + LATTICE) // LATTICE + 1 for size in (window.columns, window.rows))
        column, row = LATTICE * np.arange(columns) + window.column, LATTICE * np.arange(rows) + window.row
        lonlat = mapping.grid.lonlat(np.stack(np.meshgrid(column, row), axis=-1).reshape(-1, 2))
        grid = mapping.surface.grid_coordinates(lonlat)
        self.terrain = _Terrain(mapping.surface, grid)
        low, high = self.terrain.range
        self.known = bool(np.isfinite(low))
        self.middle_m, self.half_m = (low + high) / 2.0, max((high - low) / 2.0, 1.0)
        below, at, above = (
            mapping.rpc.project(np.column_stack([lonlat, np.full(len(lonlat), self.middle_m + t * self.half_m)])).T
            for t in (-1.0, 0.0, 1.0)
        )
        terms = np.stack([at, (above - below) / 2.0, (above + below) / 2.0 - at], axis=1).reshape(6, -1)
        self.values = np.concatenate([grid.T, terms]).reshape(8, rows, columns)

    def cells_per_pixel(self) -> float:
        """Return how many cells of the surface a step of one pixel passes at most."""
        return max(float(np.abs(np.diff(self.values[:2], axis=axis)).max()) for axis in (1, 2)) / LATTICE

    def nodes(self, step: int, offset: float = 0.0) -> np.ndarray:
        """Return image positions ``(2, rows, columns)`` of nodes every ``step`` pixels, one beyond the last pixel."""
        columns, rows = (np.arange((size - 1) // step + 2) * step + offset for size in self.window[2:])
        positions = np.empty((2, len(rows), len(columns)))
        if self.terrain.cells is not None and self._use_compiled:
            self._compiled(columns, rows, positions)
            return positions
        across = _interpolated(self.values, columns, axis=2)
        lines = max(1, PART // len(columns))
        for first in range(0, len(rows), lines):
            part = _interpolated(across, rows[first : first + lines], axis=1)
            column, row, a, b, c, d, e, f = part.reshape(8, -1)
            t = self.terrain.heights(column, row)
            t -= self.middle_m
            t /= self.half_m
            positions[0, first : first + lines] = _quadratic(a, b, c, t).reshape(part.shape[1:])
            positions[1, first : first + lines] = _quadratic(d, e, f, t).reshape(part.shape[1:])
        return positions

    def _compiled(self, columns: np.ndarray, rows: np.ndarray, positions: np.ndarray) -> None:
        from .compiled_nodes import fill_nodes

        terrain = self.terrain
        assert terrain.cells is not None
        fill_nodes(
            self.values, float(LATTICE), columns.astype(float), rows.astype(float), terrain.cells, terrain.origin,
            self.middle_m, self.half_m, positions,
        )  # fmt: skip

    def middle_error(self, nodes: np.ndarray, step: int) -> float:
        """Return the largest error of interpolation in the middles of the cells between nodes."""
        error = self.nodes(step, offset=step / 2.0)[:, :-1, :-1]
        across = nodes[:, :, :-1] + nodes[:, :, 1:]
        error -= 0.25 * (across[:, :-1] + across[:, 1:])
        largest = float(np.hypot(error[0], error[1]).max())
        return np.inf if np.isnan(largest) else largest


def _quadratic(a: np.ndarray, b: np.ndarray, c: np.ndarray, t: np.ndarray) -> np.ndarray:
    result = c * t
    result += b
    result *= t
    result += a
    return np.asarray(result)


@dataclass(frozen=True, eq=False)
class OrthoMapping:
    """The mapping of a whole orthoimage; chunks may be asked for by several threads."""

    rpc: RPC
    size: tuple[int, int]
    surface: HeightSurface
    grid: MapGrid
    error_px: float = 0.05

    @cached_property
    def compiled(self) -> bool:
        """Whether nodes are computed by compiled code (numba, the extra ``fast``); HRSI_COMPILED says 0 or 1."""
        setting = os.environ.get("HRSI_COMPILED")
        if setting == "0" or find_spec("numba") is None:
            return False
        return setting == "1" or self.grid.columns * self.grid.rows >= WORTH_COMPILING

    def exact(self, pixels: np.ndarray) -> np.ndarray:
        """Return image positions ``(n, 2)`` of the grid's pixels ``(n, 2)``; NaN where the terrain is not known."""
        lonlat = self.grid.lonlat(pixels)
        return self.rpc.project(np.column_stack([lonlat, surface_heights(self.surface, lonlat)]))

    def chunk(self, window: Window) -> ChunkMapping | None:
        """Return the mapping of a window of the grid; None where the image shows nothing of it."""
        if self.error_px == 0.0:
            return self._every_pixel(window)
        chunk = _Chunk(self, window)
        if not chunk.known:
            count = self._count_unknown(window, np.zeros((2, 2), dtype=bool))
            return ChunkMapping(np.full((2, 2, 2), np.nan), LATTICE, np.empty(0), count) if count else None
        checks = _random_pixels(window)
        truth = self.exact(checks + (window.column, window.row))
        step = _first_step(chunk.cells_per_pixel())
        while True:
            nodes = chunk.nodes(step)
            known = np.isfinite(nodes[0])
            if not self._touches(nodes, float(step)):
                return None if known.all() else self._empty(window, known)
            errors = np.hypot(*(_bilinear(nodes, checks / step) - truth).T)
            errors = errors[np.isfinite(errors)]
            if step == 1 or (known.all() and self._good(chunk, nodes, step, errors)):
                break
            step = step // 2 if known.all() else 1
        return ChunkMapping(nodes, step, errors, 0 if known.all() else self._count_unknown(window, known))

    def _good(self, chunk: _Chunk, nodes: np.ndarray, step: int, errors: np.ndarray) -> bool:
        """Tell whether interpolation between nodes is good enough."""
        if len(errors) and errors.max() > self.error_px:
            return False
        return chunk.middle_error(nodes, step) <= self.error_px

    def _empty(self, window: Window, known: np.ndarray) -> ChunkMapping | None:
        """Return the mapping of a chunk of which the image shows nothing but what has no terrain height."""
        count = self._count_unknown(window, known)
        return ChunkMapping(np.full((2, 2, 2), np.nan), LATTICE, np.empty(0), count) if count else None

    def _every_pixel(self, window: Window) -> ChunkMapping | None:
        column, row = np.arange(window.columns + 1.0), np.arange(window.rows + 1.0)
        pixels = np.stack(np.meshgrid(column + window.column, row + window.row), axis=-1).reshape(-1, 2)
        nodes = self.exact(pixels).T.reshape(2, len(row), len(column))
        known = np.isfinite(nodes[0])
        if not self._touches(nodes, 1.0):
            return None if known.all() else self._empty(window, known)
        return ChunkMapping(nodes, 1, np.zeros(1), 0 if known.all() else self._count_unknown(window, known))

    def _touches(self, nodes: np.ndarray, margin: float) -> bool:
        """Tell whether the nodes' bounding box meets the image."""
        flat = nodes.reshape(2, -1)
        low, high = np.fmin.reduce(flat, axis=1), np.fmax.reduce(flat, axis=1)
        return bool((high + margin > -0.5).all() and (low - margin < np.array(self.size) - 0.5).all())

    def _count_unknown(self, window: Window, known: np.ndarray) -> int:
        """Return about how many pixels without height lie in the image, at the RPC's mean height."""
        side = np.linspace(0.0, 1.0, UNKNOWN_GRID)
        column, row = side * (window.columns - 1), side * (window.rows - 1)
        pixels = np.stack(np.meshgrid(column + window.column, row + window.row), axis=-1).reshape(-1, 2)
        lonlat = self.grid.lonlat(pixels)
        sample, line = self.rpc.project(np.column_stack([lonlat, np.full(len(lonlat), self._height_m)])).T
        inside = (sample > -0.5) & (line > -0.5) & (sample < self.size[0] - 0.5) & (line < self.size[1] - 0.5)
        i, j = (np.rint(side * (count - 2)).astype(int) for count in known.shape)
        share = float(np.mean(inside.reshape(len(row), len(column)) & ~known[np.ix_(i, j)]))
        return round(share * window.columns * window.rows)

    @property
    def _height_m(self) -> float:
        return sum(self.rpc.height_range) / 2.0

    def source_pixels_per_pixel(self) -> float:
        """Return how many pixels of the image, along each axis, one pixel of the map covers in the map's middle."""
        middle = np.array([[self.grid.columns / 2.0, self.grid.rows / 2.0]]) + np.array([[0, 0], [1, 0], [0, 1]])
        lonlat = self.grid.lonlat(middle)
        heights = surface_heights(self.surface, lonlat)
        height = float(np.nanmean(heights)) if np.isfinite(heights).any() else self._height_m
        at = self.rpc.project(np.column_stack([lonlat, np.full(3, height)]))
        return float(np.sqrt(abs(np.linalg.det(at[1:] - at[0]))))


def _first_step(cells_per_pixel: float) -> int:
    """Return the largest step that does not pass over whole cells of the surface."""
    step = LATTICE
    while step > 1 and step * cells_per_pixel > 1.0:
        step //= 2
    return step


def _random_pixels(window: Window) -> np.ndarray:
    """Return pixels of a window, the same ones every time."""
    rng = np.random.default_rng([window.column, window.row])
    return rng.integers(0, [window.columns, window.rows], (CHECKED_PIXELS, 2)).astype(np.float64)


def _bilinear(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return nodes interpolated at column, row ``(n, 2)`` in steps."""
    j, i = at.astype(int).T
    u, v = (at - at.astype(int)).T
    upper = nodes[:, i, j] * (1.0 - u) + nodes[:, i, j + 1] * u
    lower = nodes[:, i + 1, j] * (1.0 - u) + nodes[:, i + 1, j + 1] * u
    on_node = (u == 0.0) & (v == 0.0)  # a neighbour without height does not matter there
    return np.where(on_node, nodes[:, i, j], upper * (1.0 - v) + lower * v).T
