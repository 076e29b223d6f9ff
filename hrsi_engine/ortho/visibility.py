"""Ground that an image does not show, because a surface model hides it: lines of sight against the surface.

A line of sight is straight over the heights of a scene. Its direction follows from the RPC, as the change of the ground
position of one image point by height, at the nodes of the orthoimage's lattice, which are counted from the origin of
the CRS: the result for a pixel does not depend on the window. Ground is hidden if the surface is above the line from
there to the sensor anywhere (`ray_kernels`). Cells without height hide nothing.
"""

from importlib import import_module

import numpy as np

from ..camera.rpc import RPC
from ..foundation.packages import require_package
from ..foundation.thresholds import ITERATIONS, MEMORY, threshold, thresholds
from ..surface.grid_surface import GridSurface


@thresholds
class VISIBILITY:
    """Lines of sight over a surface."""

    clearance_m: float = threshold(0.01, "m", "height of the surface above a line of sight that is neglected")
    block: int = threshold(16, "cells", "side of the blocks of cells that a ray crosses in one step")


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
    kernels.mark_occlusions(occlusion, local, spacing, first, cells, highest, VISIBILITY.block, VISIBILITY.clearance_m)
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
