"""Image positions of the pixels of an orthoimage: from the map to the ground, its height, and through the RPC.

Smooth functions (map projection, coordinates in the DEM, the RPC as a polynomial of the height) are evaluated at nodes
every `GRIDS.spacing_px` pixels and interpolated bilinearly; the height is interpolated in the DEM at each pixel. Nodes
are counted from the origin of the CRS, and the polynomial is that of the complete image. Therefore a pixel has the same
position in every window: orthoimages of parts of an area have the pixels of that of the complete area. With an error of
0 every pixel is computed exactly.

Ground that a surface model hides from the sensor has no position. A line of sight is straight over the heights of a
scene. Its direction follows from the RPC, as the change of the ground position of one image point by height, at the
nodes. Ground is hidden if the surface is above the line from there to the sensor anywhere (`ray_kernels`). Cells
without height hide nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from typing import NamedTuple

import numpy as np

from ..block.jitter_curve import JitterCurve
from ..camera.rpc import RPC
from ..foundation.packages import require_package
from ..foundation.thresholds import GRIDS, ITERATIONS, MEMORY, SAMPLES, threshold, thresholds
from ..ground.crs_operations import operations_of
from ..surface.dem import HeightSurface, surface_heights
from ..surface.grid_surface import ConstantHeight, GridSurface
from .grid import ORTHO, GridWindow, MapGrid


@thresholds
class VISIBILITY:
    """Lines of sight over a surface."""

    clearance_m: float = threshold(0.01, "m", "height of the surface above a line of sight that is neglected")
    block: int = threshold(16, "cells", "side of the blocks of cells that a ray crosses in one step")


class ChunkMapping(NamedTuple):
    """Image positions of the pixels of a chunk.

    positions : (2, rows, columns) sample, line of nodes every ``step`` pixels, at least one pixel beyond the chunk on
        each side; NaN where the terrain has nodata
    first : column, row of the chunk's first pixel from the first node
    low, high : smallest and largest sample, line of the nodes; NaN without terrain
    is_complete : whether all nodes have a position
    errors_px : (k,) distances between interpolated and exact positions at random pixels
    unknown : number of pixels inside the image without terrain height
    hidden : number of pixels inside the image that the terrain hides; they have no position
    """

    positions: np.ndarray
    step: int
    first: tuple[int, int]
    low: np.ndarray
    high: np.ndarray
    is_complete: bool
    errors_px: np.ndarray = np.empty(0)
    unknown: int = 0
    hidden: int = 0

    def interpolate(self, pixels: np.ndarray) -> np.ndarray:
        """Return the image positions ``(n, 2)`` of whole pixels ``(n, 2)``, column and row from the chunk's first."""
        (column, row), share = divmod((np.asarray(pixels) + self.first).T, self.step)
        j, i, (u, v) = column.astype(int), row.astype(int), share / self.step
        if self.step == 1:
            return np.asarray(self.positions[:, i, j].T)
        upper = self.positions[:, i, j] * (1.0 - u) + self.positions[:, i, j + 1] * u
        lower = self.positions[:, i + 1, j] * (1.0 - u) + self.positions[:, i + 1, j + 1] * u
        return np.asarray((upper * (1.0 - v) + lower * v).T)


class _Cells:
    """Cells of a grid surface under a chunk: the height inside a cell is ``a + x b + y (c + x d)``.

    unit : (rows, columns) heights relative to those of the image, as its `HeightModel` has them
    first : column, row of the first cell
    """

    def __init__(self, unit: np.ndarray, first: tuple[int, int]) -> None:
        right, down = np.diff(unit, axis=1), np.diff(unit, axis=0)
        self._width = unit.shape[1] - 1
        self._first = first[1] * self._width + first[0]
        self._terms = [
            np.ascontiguousarray(term).ravel() for term in (unit[:-1, :-1], right[:-1], down[:, :-1], np.diff(down))
        ]

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return heights at columns and rows of the surface; both arguments are overwritten."""
        column, cell = x.astype(np.intp), y.astype(np.intp)
        x -= column
        y -= cell
        cell *= self._width
        cell += column
        cell -= self._first
        a, b, c, d = (term.take(cell) for term in self._terms)
        d *= x
        d += c
        d *= y
        b *= x
        b += a
        b += d
        return np.asarray(b)


class HeightModel(NamedTuple):
    """Sample and line of a ground position as polynomials of t = (height - middle_m) / half_m, for a complete image."""

    middle_m: float
    half_m: float
    degree: int

    def to_unit(self, heights: np.ndarray) -> np.ndarray:
        """Return t of heights."""
        return np.asarray((heights - self.middle_m) / self.half_m)

    def fit(self, rpc: RPC, lonlat: np.ndarray) -> np.ndarray:
        """Return coefficients ``(degree + 1, 2, n)`` of sample and line at ``lonlat (n, 2)``, lowest power first."""
        levels, to_powers = _invert_powers(self.degree)
        heights = np.repeat(self.middle_m + self.half_m * levels, len(lonlat))
        images = rpc.project(np.column_stack([np.tile(lonlat, (len(levels), 1)), heights]))
        images = images.reshape(len(levels), -1, 2).swapaxes(1, 2)
        # No matrix product: its rounding depends on the number of positions
        return np.array([sum(weight * image for weight, image in zip(row, images, strict=True)) for row in to_powers])


@cache
def _invert_powers(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return levels from -1 to 1, and the matrix from values there to the coefficients of their polynomial."""
    levels = np.linspace(-1.0, 1.0, degree + 1)
    return levels, np.linalg.inv(np.vander(levels, increasing=True))


@dataclass(frozen=True, eq=False)
class OrthoMapping:
    """The mapping of a complete orthoimage; safe for use by several threads.

    rpc : RPC of the image; size : samples and lines of the image; surface : the terrain
    terrain : (n, 3) ground points all over the image, `grid.find_terrain_points`
    grid : pixels of the orthoimage
    error_px : largest error of a position; with 0 every pixel is computed exactly
    jitter : displacement of the image's lines that its RPC does not model; None without jitter
    masks_occlusions : whether pixels that the surface hides from the sensor have no position; the surface is a grid
    """

    rpc: RPC
    size: tuple[int, int]
    surface: HeightSurface
    terrain: np.ndarray
    grid: MapGrid
    error_px: float
    jitter: JitterCurve | None = None
    masks_occlusions: bool = False

    @cached_property
    def _height_model(self) -> HeightModel:
        """The polynomials of the lowest degree that follow the RPC within a share of the error."""
        low, high = self.terrain[:, 2].min(), self.terrain[:, 2].max()
        middle_m, half_m = float(low + high) / 2.0, max(float(high - low), ORTHO.least_half_m)
        ground, levels = self.terrain.copy(), np.linspace(-1.0, 1.0, GRIDS.nodes)
        for model in (HeightModel(middle_m, half_m, degree) for degree in (1, 2, 3)):
            terms, errors = model.fit(self.rpc, ground[:, :2]), []
            for t in levels:
                ground[:, 2] = middle_m + half_m * t
                errors.append(np.polynomial.polynomial.polyval(t, terms).T - self.rpc.project(ground))
            if np.abs(errors).max() <= ORTHO.straight * self.error_px:
                break
        return model

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
        step, first = 1, (1, 1)
        if self.error_px == 0.0:
            positions = self._map_every_pixel(window)
        else:
            lattice, first = self._map_lattice(window)
            if isinstance(self.surface, ConstantHeight) and self.jitter is None:  # no height between the nodes
                positions, step = lattice[2:4], GRIDS.spacing_px
            else:
                positions, first = self._map_pixels(window, lattice, first), (1, 1)
        flat = positions.reshape(2, -1)
        low, high = flat.min(axis=1), flat.max(axis=1)
        is_complete = not np.isnan(low).any()
        if not is_complete:
            low, high = np.fmin.reduce(flat, axis=1), np.fmax.reduce(flat, axis=1)
        unknown = 0 if is_complete else self._count_unknown(window, np.isfinite(positions[0, 1:-1, 1:-1]))
        mapping = ChunkMapping(positions, step, first, low, high, is_complete, unknown=unknown)
        if not ((high + step > -0.5).all() and (low - step < np.array(self.size) - 0.5).all()):  # outside the image
            return mapping if unknown else None
        if self.masks_occlusions and isinstance(self.surface, GridSurface):
            mapping = self._mask_occlusions(mapping, window, self.surface)
        # Random pixels of the window, equal in every run
        rng = np.random.default_rng([window.column, window.row])
        checks = rng.integers(0, [window.columns, window.rows], (SAMPLES.large, 2))
        errors = np.hypot(*(mapping.interpolate(checks) - self.exact(checks + window[:2])).T)
        return mapping._replace(errors_px=errors[np.isfinite(errors)])

    def _mask_occlusions(self, mapping: ChunkMapping, window: GridWindow, surface: GridSurface) -> ChunkMapping:
        """Return the mapping of a window, at every pixel, without the positions of hidden ones."""
        lonlat, shape, (column, row) = self._find_nodes(window)
        middle_m, half_m, _ = self._height_model
        slopes = compute_sight_slopes(self.rpc, surface, lonlat, (middle_m - half_m, middle_m + half_m))
        lattice = np.concatenate([surface.grid_coordinates(lonlat).T, slopes.T]).reshape(4, *shape)
        positions = mapping.positions
        occlusion = find_occlusions(surface, lattice, GRIDS.spacing_px, (column - 1, row - 1), positions.shape[1:])
        limits = np.array(self.size)[:, None, None] - 0.5
        with np.errstate(invalid="ignore"):
            occlusion &= ((positions > -0.5) & (positions < limits)).all(axis=0)
        positions[:, occlusion] = np.nan
        is_complete = mapping.is_complete and not occlusion.any()
        return mapping._replace(is_complete=is_complete, hidden=int(np.count_nonzero(occlusion[1:-1, 1:-1])))

    def _map_every_pixel(self, window: GridWindow) -> np.ndarray:
        """Return the positions of all pixels of a window and of those around it, each computed by the RPC."""
        column, row = np.arange(-1, window.columns + 1), np.arange(-1, window.rows + 1)
        pixels = np.stack(np.meshgrid(column + window.column, row + window.row), axis=-1).reshape(-1, 2)
        return self.exact(pixels).T.reshape(2, len(row), len(column))

    def _map_lattice(self, window: GridWindow) -> tuple[np.ndarray, tuple[int, int]]:
        """Return the smooth functions at nodes around a window, and its first pixel from the first node.

        Result: (k, rows, columns) column and row in the surface, then the terms of the height model, sample and line
        of each power; the nodes begin at least one pixel before the window and end at least one beyond it.
        """
        lonlat, shape, first = self._find_nodes(window)
        terms = self._height_model.fit(self.rpc, lonlat).reshape(-1, len(lonlat))
        return np.concatenate([self.surface.grid_coordinates(lonlat).T, terms]).reshape(-1, *shape), first

    def _find_nodes(self, window: GridWindow) -> tuple[np.ndarray, tuple[int, int], tuple[int, int]]:
        """Return lon, lat ``(n, 2)`` of the nodes around a window, their rows and columns, and the first pixel."""
        spacing = GRIDS.spacing_px
        column, row = (self.grid.left + window.column - 1) % spacing + 1, (window.row - self.grid.top - 1) % spacing + 1
        columns, rows = (column + window.columns) // spacing + 2, (row + window.rows) // spacing + 2
        pixels = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) * spacing
        return self.grid.lonlat(pixels + (window.column - column, window.row - row)), (rows, columns), (column, row)

    def _map_pixels(self, window: GridWindow, lattice: np.ndarray, first: tuple[int, int]) -> np.ndarray:
        """Return the positions of all pixels of a window and of those around it, from the nodes of the lattice."""
        heights = self._open_heights(lattice[:2])
        shares = np.arange(GRIDS.spacing_px) / GRIDS.spacing_px
        left, top, columns, rows = first[0] - 1, first[1] - 1, window.columns + 2, window.rows + 2
        # Interpolate along the rows of the lattice: ``(k, rows, m)`` to ``(k, rows, n)``
        result = np.diff(lattice, axis=2)[..., None] * shares
        result += lattice[:, :, :-1, None]
        across = np.ascontiguousarray(result.reshape(*lattice.shape[:2], -1)[:, :, left : left + columns])
        positions = np.empty((2, rows, columns))
        batch = max(1, MEMORY.rows // columns)  # number of rows in a batch, all between the same nodes
        row = 0
        while row < rows:
            # Interpolate along its columns
            node, begin = divmod(top + row, len(shares))
            end = min(begin + batch, len(shares), begin + rows - row)
            values = (across[:, node + 1] - across[:, node])[:, None] * shares[begin:end, None]
            values += across[:, node, None]
            values = values.reshape(len(values), -1)
            t, found = heights(values[0], values[1]), values[-2:]
            for power in range(len(values) - 4, 0, -2):
                found *= t
                found += values[power : power + 2]
            if self.jitter is not None:
                found += self.jitter.evaluate(found[1]).T
            positions[:, row : row + end - begin] = found.reshape(2, -1, columns)
            row += end - begin
        return positions

    def _open_heights(self, grid: np.ndarray) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """Return a function of columns and rows of the surface that returns t of the heights there.

        grid : (2, rows, columns) grid coordinates around the positions

        The cells of the surface are read at once, unless they are too many or do not cover the positions.
        """
        model, surface = self._height_model, self.surface
        low, high = grid.min(axis=(1, 2)) - 1.0, grid.max(axis=(1, 2)) + 1.0
        is_small = np.prod(high - low) <= MEMORY.values
        if is_small and isinstance(surface, GridSurface) and surface.covers(np.array([low, high])).all():
            row, column, cells = surface.window(low, high)
            return _Cells(model.to_unit(cells), (column, row)).heights
        return lambda x, y: model.to_unit(surface.heights(np.column_stack([x, y])))

    def _count_unknown(self, window: GridWindow, has_height: np.ndarray) -> int:
        """Return the approximate number of pixels without height inside the image, at the RPC's mean height.

        has_height : (rows, columns) of the window's pixels
        """
        side = np.linspace(0.0, 1.0, ORTHO.unknown_grid)
        column, row = (np.rint(side * (count - 1)).astype(int) for count in (window.columns, window.rows))
        pixels = np.stack(np.meshgrid(column + window.column, row + window.row), axis=-1).reshape(-1, 2)
        lonlat = self.grid.lonlat(pixels)
        height = np.full(len(lonlat), sum(self.rpc.height_range) / 2.0)
        sample, line = self.rpc.project(np.column_stack([lonlat, height])).T
        inside = (sample > -0.5) & (line > -0.5) & (sample < self.size[0] - 0.5) & (line < self.size[1] - 0.5)
        share = float(np.mean(inside.reshape(len(row), len(column)) & ~has_height[np.ix_(row, column)]))
        return round(share * window.columns * window.rows)

    def source_pixels_per_pixel(self) -> float:
        """Return the number of image pixels, along each axis, per pixel of the map in the middle of the image.

        Result: without unit; above 1 the orthoimage has a lower resolution than the image.
        """
        middle = self.terrain[len(self.terrain) // 2]
        x, y = operations_of(self.grid.crs).from_wgs84(middle[None])[0, :2] / self.grid.resolution
        pixel = np.rint([x - self.grid.left, self.grid.top - y])
        lonlat = self.grid.lonlat(pixel + np.array([[0, 0], [1, 0], [0, 1]]))
        image_xy = self.rpc.project(np.column_stack([lonlat, np.full(3, middle[2])]))
        return float(np.sqrt(abs(np.linalg.det(image_xy[1:] - image_xy[0]))))


def compute_sight_slopes(
    rpc: RPC, surface: GridSurface, lonlat: np.ndarray, heights: tuple[float, float]
) -> np.ndarray:
    """Return the change of grid coordinates ``(n, 2)`` by a metre of height along lines of sight towards the sensor.

    lonlat : (n, 2) positions in degrees; heights : lowest and highest of the terrain (m)
    """
    image = rpc.project(np.column_stack([lonlat, np.full(len(lonlat), sum(heights) / 2.0)]))
    lower, upper = (surface.grid_coordinates(rpc.localize(image, height).ground[:, :2]) for height in heights)
    return np.asarray((upper - lower) / (heights[1] - heights[0]))


def find_occlusions(
    surface: GridSurface, lattice: np.ndarray, spacing: int, first: tuple[int, int], shape: tuple[int, ...]
) -> np.ndarray:
    """Return a mask of the pixels ``(rows, columns)`` that something between ground and sensor hides.

    lattice : (4, m, n) column and row in the surface, and their changes by a metre of height towards the sensor, at
        nodes every ``spacing`` pixels; first : column, row of the first pixel from the first node
    Raises `MissingPackageError`: numba is not installed.
    """
    require_package("numba")
    kernels = import_module(".ray_kernels", __package__)
    occlusion = np.zeros(shape, dtype=bool)
    nodes = lattice.reshape(4, -1)
    low, high = nodes[:2].min(axis=1) - 1.0, nodes[:2].max(axis=1) + 1.0
    if np.isnan(low).any():
        return occlusion
    bottom, top = surface.bounds(low, high)
    # What can hide the ground lies towards the sensor, at most as far as the ray to the highest point there
    for _ in range(ITERATIONS.most):
        reach = nodes[2:] * max(top - bottom, 0.0)
        box = np.minimum(low, low + reach.min(axis=1)), np.maximum(high, high + reach.max(axis=1))
        previous, (_, top) = top, surface.bounds(*box)
        if not top > previous:
            break
    if not top > bottom:  # level ground, or none
        return occlusion
    if np.prod(box[1] - box[0]) > MEMORY.cells and min(shape) > spacing:
        _find_in_quarters(occlusion, surface, lattice, spacing, first)
        return occlusion
    row, column, cells = surface.window(*box)
    local = lattice - np.array([column, row, 0.0, 0.0])[:, None, None]
    highest = _find_highest(cells, VISIBILITY.block)
    kernels.mark_occlusions(
        occlusion,
        local,
        spacing,
        first=first,
        cells=cells,
        highest=highest,
        side=VISIBILITY.block,
        clearance_m=VISIBILITY.clearance_m,
    )
    return occlusion


def _find_in_quarters(
    occlusion: np.ndarray, surface: GridSurface, lattice: np.ndarray, spacing: int, first: tuple[int, int]
) -> None:
    """Set the mask ``occlusion`` by its quarters, each with its part of the lattice and of the surface."""
    rows, columns = occlusion.shape
    for top, bottom in ((0, rows // 2), (rows // 2, rows)):
        for left, right in ((0, columns // 2), (columns // 2, columns)):
            (j, x), (i, y) = divmod(first[0] + left, spacing), divmod(first[1] + top, spacing)
            nodes = lattice[:, i : i + (y + bottom - top) // spacing + 2, j : j + (x + right - left) // spacing + 2]
            shape = bottom - top, right - left
            occlusion[top:bottom, left:right] = find_occlusions(surface, nodes, spacing, (x, y), shape)


def _find_highest(cells: np.ndarray, side: int) -> np.ndarray:
    """Return the largest height of each block of ``side`` cells, with the posts at its right and lower edge."""
    rows, columns = (-(-(count - 1) // side) for count in cells.shape)
    known = np.where(np.isnan(cells), -np.inf, cells)
    padded = np.full((rows * side + 1, columns * side + 1), -np.inf)
    padded[: known.shape[0], : known.shape[1]] = known
    peaks = np.maximum(np.maximum(padded[:-1, :-1], padded[1:, :-1]), np.maximum(padded[:-1, 1:], padded[1:, 1:]))
    return np.asarray(peaks.reshape(rows, side, columns, side).max(axis=(1, 3)))
