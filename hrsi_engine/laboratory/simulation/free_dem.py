"""A DEM as everybody can have it, with the errors of Copernicus GLO-30: cells of 30 m, trees and buildings in them.

GLO-30 is a surface seen by radar; it contains half of a wood's height or more. It is stated (Copernicus DEM Product
Handbook, AIRBUS 2022, accuracy) to 4 m absolutely in height (LE90) and 6 m in plan (CE90), and to 2 m from cell to
cell, 4 m on slopes above 20 %. So heights and place are displaced as a whole, and noise that is correlated over some
cells grows with the slope::

    z(E, N) = mean of the terrain over the cell about (E - e, N - n) + trees + u + s(slope) v,    v: exp(-distance / L)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import fft, ndimage

from .options import FreeDemSpec
from .terrain import TerrainSurface, make_fractal_relief
from .world import constant, constants


@constants
class CANOPY:
    """Heights of trees in a free DEM."""

    roughness: float = constant(0.2, "", "Hurst exponent of the field that determines where trees grow")
    edge_cells: float = constant(0.7, "cells", "standard deviation by which the edges of woods are smoothed")


@constants
class RADAR_NOISE:
    """Dependence of a free DEM's noise on the slope, and its correlation."""

    steep: float = constant(0.4, "m/m", "slope above which the noise does not increase")
    on_steep: float = constant(
        3.0, "", "noise on such slopes relative to flat ground", "GLO-30: 1 m on flat ground, 3 m on slopes"
    )
    period_lengths: float = constant(8.0, "correlation lengths", "margin of the synthesised noise around the DEM")


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
    shift_m : tuple of float
        East, north, up by which all of it is displaced.
    """

    heights_m: np.ndarray
    first_deg: tuple[float, float]
    cell_deg: tuple[float, float]
    shift_m: tuple[float, float, float]

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """As GDAL's, of the outer corner of the first cell."""
        (lon, lat), (east, south) = self.first_deg, self.cell_deg
        return lon - 0.5 * east, east, 0.0, lat - 0.5 * south, 0.0, south


def simulate_free_dem(terrain: TerrainSurface, half_extent_m: float, spec: FreeDemSpec, seed: list[int]) -> FreeDem:
    """Return a free DEM of a terrain.

    Parameters
    ----------
    terrain : TerrainSurface
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
    shift = np.array([spec.place_m, spec.place_m, spec.common_m]) * rng.standard_normal(3)
    half = max(int(half_extent_m / cell), 2)
    axis = np.arange(-half, half + 1) * cell
    east, north = np.meshgrid(axis - shift[0], axis[::-1] - shift[1])
    inner = (np.arange(5) - 2.0) * cell / 5.0
    heights = np.mean([terrain.height(east + x, north + y) for x in inner for y in inner], axis=0)
    slope = np.hypot(*np.gradient(heights, cell)) / RADAR_NOISE.steep
    sigma = spec.noise_m * (1.0 + (RADAR_NOISE.on_steep - 1.0) * np.minimum(slope, 1.0))
    wood = make_fractal_relief(len(axis), CANOPY.roughness, rng)
    trees = (wood > np.quantile(wood, 1.0 - spec.trees)).astype(np.float64) if spec.trees else np.zeros_like(heights)
    heights += spec.tree_m * ndimage.gaussian_filter(trees, CANOPY.edge_cells)
    heights += sigma * draw_correlated_noise(len(axis), spec.correlation_m / cell, rng) + shift[2]
    corners = terrain.chart.to_ground(np.array([[axis[0], axis[-1]], [axis[1], axis[-2]]]), np.zeros(2))
    step = corners[1, :2] - corners[0, :2]
    return FreeDem(heights, tuple(corners[0, :2].tolist()), tuple(step.tolist()), tuple(shift.tolist()))


def draw_correlated_noise(count: int, length_cells: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise ``(count, count)`` of zero mean and unit variance with the autocorrelation exp(-r / length).

    By its spectrum, the two-dimensional Fourier transform of that: ``(1 + (2 pi f length)^2)^(-3/2)``.
    """
    period = fft.next_fast_len(int(count + RADAR_NOISE.period_lengths * length_cells) + 1, real=True)
    frequency = np.hypot(fft.fftfreq(period)[:, None], fft.rfftfreq(period)[None, :])
    density = (1.0 + (2.0 * np.pi * frequency * length_cells) ** 2) ** -1.5
    variance = float(fft.irfft2(density, s=(period, period))[0, 0])
    spectrum = fft.rfft2(rng.standard_normal((period, period))) * np.sqrt(density / variance)
    return np.asarray(fft.irfft2(spectrum, s=(period, period))[:count, :count])
