"""A DEM as everybody can have it: cells of 30 m, with trees and buildings smoothed into it, and errors of its own.

Copernicus GLO-30 and its like are surfaces seen by radar: half of a wood's height or more stands in them. Its errors
are those of cells (white), and those of a scene it was made from (one for all).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ...foundation.thresholds import threshold, thresholds
from .options import FreeDemSpec
from .terrain import TerrainSurface, make_fractal_relief


@thresholds
class CANOPY:
    """Where trees stand on a free DEM."""

    roughness: float = threshold(0.2, "", "Hurst exponent of what decides where trees stand")
    edge_cells: float = threshold(0.7, "cells", "standard deviation by which the edges of woods are smoothed")


class FreeDem(NamedTuple):
    """A DEM over a scene.

    Parameters
    ----------
    heights_m : (rows, columns) ndarray
        Ellipsoidal, row 0 in the north.
    first_deg : tuple of float
        Lon, lat of the first cell's centre.
    cell_deg : tuple of float
        Step to the next column and row; the latter below zero.
    """

    heights_m: np.ndarray
    first_deg: tuple[float, float]
    cell_deg: tuple[float, float]

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """As GDAL's, of the outer corner of the first cell."""
        (lon, lat), (east, south) = self.first_deg, self.cell_deg
        return lon - 0.5 * east, east, 0.0, lat - 0.5 * south, 0.0, south


def simulate_free_dem(terrain: TerrainSurface, half_extent_m: float, spec: FreeDemSpec, seed: list[int]) -> FreeDem:
    """Return a free DEM of a terrain.

    Parameters
    ----------
    terrain : SimulatedTerrain
        The ground.
    half_extent_m : float
        How far it reaches from the middle.
    spec : FreeDemSpec
        Cells, trees and errors.
    seed : list of int
        The same seed gives the same DEM.

    Returns
    -------
    FreeDem
        Ellipsoidal heights.
    """
    rng, cell = np.random.default_rng(seed), spec.cell_m
    half = max(int(half_extent_m / cell), 2)
    axis = np.arange(-half, half + 1) * cell
    east, north = np.meshgrid(axis, axis[::-1])
    inner = (np.arange(5) - 2.0) * cell / 5.0
    heights = np.mean([terrain.height(east + x, north + y) for x in inner for y in inner], axis=0)
    wood = make_fractal_relief(len(axis), CANOPY.roughness, rng)
    trees = (wood > np.quantile(wood, 1.0 - spec.trees)).astype(np.float64) if spec.trees else np.zeros_like(heights)
    heights += spec.tree_m * ndimage.gaussian_filter(trees, CANOPY.edge_cells)
    heights += rng.normal(0.0, spec.noise_m, heights.shape) + rng.normal(0.0, spec.common_m)
    corners = terrain.chart.to_ground(np.array([[axis[0], axis[-1]], [axis[1], axis[-2]]]), np.zeros(2))
    step = corners[1, :2] - corners[0, :2]
    return FreeDem(heights, (float(corners[0, 0]), float(corners[0, 1])), (float(step[0]), float(step[1])))
