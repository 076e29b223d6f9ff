"""Image positions of the pixels of an orthoimage: from the map to the ground, its height, and through the RPC.

A chunk of the map grid is mapped at nodes every ``step`` pixels, and interpolated bilinearly between them. Smooth
functions (map projection, coordinates in the DEM, the RPC as a parabola of the height) are evaluated on a lattice
(`ORTHO.lattice_px`) and interpolated; heights are interpolated in the DEM at each node. The step is the largest power
of two at which the centres of all cells, where interpolation is worst, and random pixels of the chunk agree within the
given error with the exact computation at these pixels; in rough terrain it is one pixel. With an error of 0 every pixel
is computed exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..block.jitter_curve import JitterCurve
from ..camera.rpc import RPC
from ..surface.dem import HeightSurface, surface_heights
from ..surface.grid_surface import GridSurface
from .grid import ORTHO, GridWindow, MapGrid


class ChunkMapping(NamedTuple):
    """Image positions of the pixels of a chunk.

    positions : (2, rows, columns) sample, line of nodes every ``step`` pixels, one node beyond the last pixel; NaN
        where the terrain has nodata
    errors_px : (k,) distances between interpolated and exact positions at random pixels
    unknown : number of pixels inside the image without terrain height
    first : column, row of the chunk's first pixel from the first node
    """

    positions: np.ndarray
    step: int
    errors_px: np.ndarray
    unknown: int
    first: tuple[int, int] = (0, 0)


class _Cells:
    """Cells of a grid surface under a chunk: the height inside a cell is ``a + x b + y (c + x d)``.

    Heights are relative to the middle of the chunk's heights, in units of half their range, as the parabolas need.
    """

    def __init__(self, cells: np.ndarray, middle_m: float, half_m: float) -> None:
        unit = (cells - middle_m) / half_m
        right, down = np.diff(unit, axis=1), np.diff(unit, axis=0)
        self._width = cells.shape[1] - 1
        self._terms = [
            np.ascontiguousarray(term).ravel() for term in (unit[:-1, :-1], right[:-1], down[:, :-1], np.diff(down))
        ]

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return heights at columns and rows from the first cell; both arguments are overwritten."""
        column, cell = x.astype(np.intp), y.astype(np.intp)
        x -= column
        y -= cell
        cell *= self._width
        cell += column
        a, b, c, d = (term.take(cell) for term in self._terms)
        d *= x
        d += c
        d *= y
        b *= x
        b += a
        b += d
        return np.asarray(b)


def _count_nodes(window: GridWindow, step: int) -> tuple[int, int]:
    """Return the numbers of nodes along a row and a column of a window."""
    return (window.columns - 1) // step + 2, (window.rows - 1) // step + 2


def _read_cells_below(
    surface: HeightSurface, grid: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray, tuple[float, float]]:
    """Return the cells under grid coordinates, the grid position of the first one, and the range of heights.

    The cells are None and the position is (0, 0) outside the area of a `GridSurface` and if there are too many cells.
    """
    low, high = grid.min(axis=0) - 1.0, grid.max(axis=0) + 1.0
    is_small = np.prod(high - low) <= ORTHO.most_cells
    if not (is_small and isinstance(surface, GridSurface) and surface.covers(np.array([low, high])).all()):
        return None, np.zeros(2), surface.bounds(low, high)
    row, column, cells = surface.window(low, high)
    finite = cells[np.isfinite(cells)]
    span = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    return cells, np.array([column, row], dtype=float), span


class _Chunk:
    """The smooth functions of a chunk, sampled every `ORTHO.lattice_px` pixels, and the terrain under it.

    ``lattice (k, rows, columns)`` contains the surface's grid coordinates and, for sample and line, the coefficients of
    a + b t + c t², where t is the height relative to the middle of the chunk's heights in units of half their range: a,
    a, b, b and, if the curvature is not negligible, c, c.
    """

    def __init__(self, mapping: OrthoMapping, window: GridWindow) -> None:
        self.window, self._surface, self._jitter = window, mapping.surface, mapping.jitter
        columns, rows = (-(-size // ORTHO.lattice_px) + 2 for size in window[2:])
        column, row = (ORTHO.lattice_px * np.arange(n) + k for n, k in zip((columns, rows), window[:2], strict=True))
        lonlat = mapping.grid.lonlat(np.stack(np.meshgrid(column, row), axis=-1).reshape(-1, 2))
        grid = mapping.surface.grid_coordinates(lonlat)
        cells, origin, (low, high) = _read_cells_below(mapping.surface, grid)
        self.known = bool(np.isfinite(low))
        self.middle_m, self.half_m = (low + high) / 2.0, max((high - low) / 2.0, 1.0)
        self._cells = None if cells is None else _Cells(cells, self.middle_m, self.half_m)
        heights = np.repeat([self.middle_m - self.half_m, self.middle_m, self.middle_m + self.half_m], len(lonlat))
        images = mapping.rpc.project(np.column_stack([np.tile(lonlat, (3, 1)), heights]))
        lower, middle, above = images.reshape(3, -1, 2).swapaxes(1, 2)
        terms = [middle, (above - lower) / 2.0, (above + lower) / 2.0 - middle]
        if np.abs(terms[2]).max() <= ORTHO.straight * mapping.error_px:
            del terms[2]
        self.lattice = np.concatenate([(grid - origin).T, *terms]).reshape(-1, rows, columns)

    def cells_per_pixel(self) -> float:
        """Return the largest number of cells of the surface per step of one pixel."""
        return max(float(np.abs(np.diff(self.lattice[:2], axis=axis)).max()) for axis in (1, 2)) / ORTHO.lattice_px

    def nodes(self, step: int) -> np.ndarray:
        """Return image positions ``(2, rows, columns)`` of nodes every ``step`` pixels, one beyond the last pixel."""
        columns, rows = _count_nodes(self.window, step)
        positions = np.empty((2, rows, columns))
        for part, values in self._node_rows(step):
            positions[:, part] = values
        return positions

    def _node_rows(self, step: int, offset: float = 0.0) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield the positions ``(2, rows, columns)`` of successive batches of node rows, and their rows."""
        columns, rows = _count_nodes(self.window, step)
        shares = (np.arange(0, ORTHO.lattice_px, step) + offset) / ORTHO.lattice_px
        # Interpolate along the rows of the lattice: ``(k, rows, m)`` to ``(k, rows, n)``
        result = np.diff(self.lattice, axis=2)[..., None] * shares
        result += self.lattice[:, :, :-1, None]
        across = result.reshape(*self.lattice.shape[:2], -1)[:, :, :columns]
        lines = max(1, ORTHO.batch // (columns * len(shares)))  # number of lattice rows in a batch
        for top in range(0, -(-rows // len(shares)), lines):
            part = slice(top * len(shares), min((top + lines) * len(shares), rows))
            # Interpolate along its columns
            rows_here = across[:, top : top + lines + 1]
            down = np.diff(rows_here, axis=1)[:, :, None] * shares[:, None]
            down += rows_here[:, :-1, None]
            values = down.reshape(len(down), -1, columns)[:, : part.stop - part.start]
            values = values.reshape(len(values), -1)
            t, positions = self._heights(values[0], values[1]), values[4:6]
            if len(values) == 8:
                values[6:] *= t
                positions += values[6:]
            positions *= t
            positions += values[2:4]
            if self._jitter is not None:
                positions += self._jitter.evaluate(positions[1]).T
            yield part, positions.reshape(2, -1, columns)

    def _heights(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        if self._cells is not None:
            return self._cells.heights(column, row)
        return (self._surface.heights(np.column_stack([column, row])) - self.middle_m) / self.half_m

    def is_interpolation_accurate(self, error_px: float, nodes: np.ndarray, step: int) -> bool:
        """Return whether interpolation at the centres of all cells between nodes is accurate to ``error_px``."""
        for rows, middles in self._node_rows(step, offset=step / 2.0):
            upper = nodes[:, rows.start : rows.stop + 1]
            error = middles[:, : upper.shape[1] - 1, :-1]
            across = upper[:, :, :-1] + upper[:, :, 1:]
            error -= 0.25 * (across[:, :-1] + across[:, 1:])
            error *= error
            if not np.all(error[0] + error[1] <= error_px**2):  # also False for NaN, without a height
                return False
        return True


@dataclass(frozen=True, eq=False)
class OrthoMapping:
    """The mapping of a complete orthoimage; safe for use by several threads.

    rpc : RPC of the image; size : samples and lines of the image; surface : the terrain
    grid : pixels of the orthoimage
    error_px : largest error of interpolation between nodes; with 0 every pixel is computed exactly
    jitter : displacement of the image's lines that its RPC does not model; None without jitter
    """

    rpc: RPC
    size: tuple[int, int]
    surface: HeightSurface
    grid: MapGrid
    error_px: float
    jitter: JitterCurve | None = None

    def exact(self, pixels: np.ndarray) -> np.ndarray:
        """Return the image positions of the grid's pixels.

        pixels : (n, 2) column, row
        Result: (n, 2) sample, line in pixels; NaN where the terrain has nodata.
        """
        lonlat = self.grid.lonlat(pixels)
        positions = self.rpc.project(np.column_stack([lonlat, surface_heights(self.surface, lonlat)]))
        return positions if self.jitter is None else positions + self.jitter.evaluate(positions[:, 1])

    def chunk(self, window: GridWindow) -> ChunkMapping | None:
        """Return the mapping of a window of the grid.

        window : the window
        Result: None if no pixel of the window is inside the image.
        """
        if self.error_px == 0.0:  # every pixel
            column, row = np.arange(window.columns + 1.0), np.arange(window.rows + 1.0)
            pixels = np.stack(np.meshgrid(column + window.column, row + window.row), axis=-1).reshape(-1, 2)
            nodes = self.exact(pixels).T.reshape(2, len(row), len(column))
            has_height = np.isfinite(nodes[0])
            if not self._touches_image(nodes, 1.0):
                return None if has_height.all() else self._make_empty_mapping(window, has_height)
            return ChunkMapping(
                nodes, 1, np.zeros(1), 0 if has_height.all() else self._count_unknown(window, has_height)
            )
        # Nodes are on the lattice of the map, so that orthoimages of parts of an area have the same ones
        first = np.array([self.grid.left + window.column, window.row - self.grid.top]) % ORTHO.lattice_px
        chunk = _Chunk(self, GridWindow(*(window[:2] - first).tolist(), *(window[2:] + first).tolist()))
        if not chunk.known:
            return self._make_empty_mapping(window, np.zeros((2, 2), dtype=bool))
        # Random pixels of the window, equal in every run
        rng = np.random.default_rng([window.column, window.row])
        checks = rng.integers(0, [window.columns, window.rows], (ORTHO.checked_pixels, 2)).astype(np.float64)
        truth = self.exact(checks + (window.column, window.row))
        # The largest step that is not longer than a cell of the surface
        cells_per_pixel = chunk.cells_per_pixel()
        step = ORTHO.lattice_px
        while step > 1 and step * cells_per_pixel > 1.0:
            step //= 2
        while True:
            nodes = chunk.nodes(step)
            has_height = np.isfinite(nodes[0, first[1] // step :, first[0] // step :])
            if not self._touches_image(nodes, float(step)):
                return None if has_height.all() else self._make_empty_mapping(window, has_height)
            errors = np.hypot(*(_interpolate_nodes(nodes, (checks + first) / step) - truth).T)
            errors = errors[np.isfinite(errors)]
            is_accurate = has_height.all() and errors.max(initial=0.0) <= self.error_px
            if step == 1 or (is_accurate and chunk.is_interpolation_accurate(self.error_px, nodes, step)):
                break
            step = step // 2 if has_height.all() else 1
        unknown = 0 if has_height.all() else self._count_unknown(window, has_height)
        part = nodes[:, first[1] // step :, first[0] // step :]
        column, row = (first % step).tolist()
        return ChunkMapping(part, step, errors, unknown, (column, row))

    def _make_empty_mapping(self, window: GridWindow, has_height: np.ndarray) -> ChunkMapping | None:
        """Return the mapping of a chunk whose pixels inside the image have no height; None if it has no such pixels."""
        count = self._count_unknown(window, has_height)
        return ChunkMapping(np.full((2, 2, 2), np.nan), ORTHO.lattice_px, np.empty(0), count) if count else None

    def _touches_image(self, nodes: np.ndarray, margin: float) -> bool:
        """Return whether the bounding box of the nodes intersects the image."""
        flat = nodes.reshape(2, -1)
        low, high = np.fmin.reduce(flat, axis=1), np.fmax.reduce(flat, axis=1)
        return bool((high + margin > -0.5).all() and (low - margin < np.array(self.size) - 0.5).all())

    def _count_unknown(self, window: GridWindow, has_height: np.ndarray) -> int:
        """Return the approximate number of pixels without height inside the image, at the RPC's mean height."""
        side = np.linspace(0.0, 1.0, ORTHO.unknown_grid)
        column, row = side * (window.columns - 1), side * (window.rows - 1)
        pixels = np.stack(np.meshgrid(column + window.column, row + window.row), axis=-1).reshape(-1, 2)
        lonlat = self.grid.lonlat(pixels)
        sample, line = self.rpc.project(
            np.column_stack([lonlat, np.full(len(lonlat), sum(self.rpc.height_range) / 2.0)])
        ).T
        inside = (sample > -0.5) & (line > -0.5) & (sample < self.size[0] - 0.5) & (line < self.size[1] - 0.5)
        i, j = (np.rint(side * (count - 2)).astype(int) for count in has_height.shape)
        share = float(np.mean(inside.reshape(len(row), len(column)) & ~has_height[np.ix_(i, j)]))
        return round(share * window.columns * window.rows)

    def source_pixels_per_pixel(self) -> float:
        """Return the number of image pixels, along each axis, per pixel of the map at its centre.

        Result: without unit; above 1 the orthoimage has a lower resolution than the image.
        """
        middle = np.array([[self.grid.columns / 2.0, self.grid.rows / 2.0]]) + np.array([[0, 0], [1, 0], [0, 1]])
        lonlat = self.grid.lonlat(middle)
        heights = surface_heights(self.surface, lonlat)
        height = float(np.nanmean(heights)) if np.isfinite(heights).any() else sum(self.rpc.height_range) / 2.0
        image_xy = self.rpc.project(np.column_stack([lonlat, np.full(3, height)]))
        return float(np.sqrt(abs(np.linalg.det(image_xy[1:] - image_xy[0]))))


def _interpolate_nodes(nodes: np.ndarray, node_xy: np.ndarray) -> np.ndarray:
    """Return the values of nodes, interpolated bilinearly at column, row ``(n, 2)`` in steps."""
    j, i = node_xy.astype(int).T
    u, v = (node_xy - node_xy.astype(int)).T
    upper = nodes[:, i, j] * (1.0 - u) + nodes[:, i, j + 1] * u
    lower = nodes[:, i + 1, j] * (1.0 - u) + nodes[:, i + 1, j + 1] * u
    on_node = (u == 0.0) & (v == 0.0)  # exactly at a node, neighbours without height are not used
    return np.where(on_node, nodes[:, i, j], upper * (1.0 - v) + lower * v).T
