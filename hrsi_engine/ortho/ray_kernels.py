"""Compiled loops of `mapping` (needs numba): rays from the pixels of an orthoimage to the sensor, over a surface.

A ray is a straight line in grid coordinates and height. It is followed from cell to cell (Amanatides and Woo 1987). The
surface is bilinear inside a cell, so that its height above the ray is a parabola there, whose maximum is exact. Blocks
of cells that are completely below the ray are crossed in one step (maximum mipmaps, Tevs et al. 2008).
"""

import math

import numpy as np
from numba import njit

from ..foundation.compiled_code import OPTIONS


@njit(**OPTIONS)
def _interpolate(cells: np.ndarray, column: int, row: int, u: float, v: float) -> float:
    above = cells[row, column] * (1.0 - u) + cells[row, column + 1] * u
    below = cells[row + 1, column] * (1.0 - u) + cells[row + 1, column + 1] * u
    return above * (1.0 - v) + below * v


@njit(**OPTIONS)
def _find_exit(position: float, slope: float, index: int, side: int) -> float:
    """Return the height at which a ray leaves a block of ``side`` cells along one axis; ``index`` is a cell of it."""
    if slope == 0.0:
        return math.inf
    first = index // side * side
    return ((first + side if slope > 0.0 else first) - position) / slope


@njit(**OPTIONS)
def _is_hidden(
    cells: np.ndarray,
    highest: np.ndarray,
    side: int,
    start: tuple[float, float],
    slope: tuple[float, float],
    clearance_m: float,
) -> bool:
    """Return whether the ray from a point of the surface meets the surface again; arguments as in `mark_occlusions`."""
    (x, y), (dx, dy) = start, slope
    rows, columns = cells.shape[0] - 1, cells.shape[1] - 1
    column, row = min(int(x), columns - 1), min(int(y), rows - 1)
    ground = _interpolate(cells, column, row, x - column, y - row)
    if math.isnan(ground) or (dx == 0.0 and dy == 0.0):
        return False
    rise = 0.0
    while 0 <= column < columns and 0 <= row < rows:
        is_free = ground + rise >= highest[row // side, column // side]
        step = side if is_free else 1
        exit_x, exit_y = _find_exit(x, dx, column, step), _find_exit(y, dy, row, step)
        end = min(exit_x, exit_y)
        if not is_free:
            middle = 0.5 * (rise + end)
            f0 = _interpolate(cells, column, row, x + dx * rise - column, y + dy * rise - row) - ground - rise
            f1 = _interpolate(cells, column, row, x + dx * middle - column, y + dy * middle - row) - ground - middle
            f2 = _interpolate(cells, column, row, x + dx * end - column, y + dy * end - row) - ground - end
            bend, slant = 2.0 * (f0 + f2 - 2.0 * f1), 4.0 * f1 - 3.0 * f0 - f2
            clearance = max(f0, f2)
            if bend < 0.0 < slant < -2.0 * bend:  # maximum inside the cell
                clearance = f0 - 0.25 * slant * slant / bend
            if clearance > clearance_m:
                return True
        # The next cell; along the other axis the ray stays in its block
        first_column, first_row = column // step * step, row // step * step
        if exit_x <= exit_y:
            column = first_column + step if dx > 0.0 else first_column - 1
            row = min(max(int(y + dy * end), first_row), first_row + step - 1)
        else:
            row = first_row + step if dy > 0.0 else first_row - 1
            column = min(max(int(x + dx * end), first_column), first_column + step - 1)
        rise = end
    return False


@njit(**OPTIONS)
def mark_occlusions(
    occlusion: np.ndarray,
    lattice: np.ndarray,
    spacing: int,
    first: tuple[int, int],
    cells: np.ndarray,
    highest: np.ndarray,
    side: int,
    clearance_m: float,
) -> None:
    """Set the pixels ``occlusion (rows, columns)`` whose line of sight meets the surface.

    lattice : (4, m, n) column and row in ``cells``, and their changes by a metre of height towards the sensor, at nodes
        every ``spacing`` pixels; first : column, row of the first pixel from the first node
    cells : heights of the surface (m), NaN for nodata; highest : largest height of each block of ``side`` cells
    clearance_m : height of the surface above the line of sight that is neglected
    """
    last_x, last_y = cells.shape[1] - 1.0, cells.shape[0] - 1.0
    at = np.empty(4)
    for row in range(occlusion.shape[0]):
        i, v = (first[1] + row) // spacing, (first[1] + row) % spacing / spacing
        for column in range(occlusion.shape[1]):
            j, u = (first[0] + column) // spacing, (first[0] + column) % spacing / spacing
            for k in range(4):
                at[k] = _interpolate(lattice[k], j, i, u, v)
            start = min(max(at[0], 0.0), last_x), min(max(at[1], 0.0), last_y)
            occlusion[row, column] = _is_hidden(cells, highest, side, start, (at[2], at[3]), clearance_m)
