"""The ground of a simulated scene: a plane chart, and a fractal height surface over it.

The surface *is* the bilinear interpolation of its posts, which are regular in longitude and latitude and exact in
float32; so a DEM file of the posts contains the true surface, without loss.

The posts are white noise with spectral amplitudes falling as ``f ** -(1 + H)`` (spectral synthesis of fractional
Brownian relief; Saupe 1988, in Peitgen and Saupe, The Science of Fractal Images, section 2.4). Cliffs are steps of the
surface, one post wide, along the zero line of a second, smoother relief.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft

from ...ground.geodesy import metres_per_degree, wrap_degrees
from .world import constant, constants


@constants
class FRACTAL_RELIEF:
    """Shape of the fractal relief."""

    roughness: float = constant(0.95, "", "Hurst exponent H of the hills")
    cliff_roughness: float = constant(
        1.6, "", "Hurst exponent of the relief whose zero line is a cliff: few and long cliffs"
    )


@dataclass(frozen=True)
class Chart:
    """Plane metres east and north of an origin, proportional to longitude and latitude.

    Scale is true at the origin; at another latitude it differs by the ratio of the cosines. Everything drawn on
    the ground is drawn here, so that circles are circles to a ten-thousandth.
    """

    lon_deg: float
    lat_deg: float

    @cached_property
    def scale(self) -> np.ndarray:
        """Metres per degree of longitude and of latitude, ``(2,)``."""
        return metres_per_degree(np.array([[self.lon_deg, self.lat_deg, 0.0]]))[0, :2]

    def to_ground(self, east_north: np.ndarray, height_m: np.ndarray) -> np.ndarray:
        """Return lon, lat, height ``(n, 3)``."""
        lon, lat = (east_north / self.scale + [self.lon_deg, self.lat_deg]).T
        return np.column_stack([wrap_degrees(lon), lat, height_m])

    def from_ground(self, ground: np.ndarray) -> np.ndarray:
        """Return chart metres ``(n, 2)``."""
        lon, lat = wrap_degrees(ground[:, 0] - self.lon_deg), ground[:, 1] - self.lat_deg
        return np.column_stack([lon, lat]) * self.scale

    def geotransform(
        self, west_m: float, north_m: float, step_m: float
    ) -> tuple[float, float, float, float, float, float]:
        """Return GDAL's geotransform in degrees of a north-up raster of square pixels.

        ``west_m`` and ``north_m`` are the centre of its first pixel in chart metres, ``step_m`` is the pixels' side.
        """
        lon_step, lat_step = step_m / self.scale
        west = self.lon_deg + (west_m - step_m / 2.0) / self.scale[0]
        north = self.lat_deg + (north_m + step_m / 2.0) / self.scale[1]
        return float(west), float(lon_step), 0.0, float(north), 0.0, -float(lat_step)


@dataclass(frozen=True, eq=False)
class TerrainSurface:
    """Height posts over the chart: row 0 is the northern one, ``west_m`` and ``north_m`` its first post."""

    chart: Chart
    posts: np.ndarray
    west_m: float
    north_m: float
    post_m: float

    @cached_property
    def height_range(self) -> tuple[float, float]:
        """Lowest and highest post in metres."""
        return float(self.posts.min()), float(self.posts.max())

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """GDAL geotransform of the posts in degrees: each is the centre of its pixel."""
        return self.chart.geotransform(self.west_m, self.north_m, self.post_m)

    def height(self, east: np.ndarray, north: np.ndarray) -> np.ndarray:
        """Return heights (m) at chart positions of any shape; beyond the edge the outermost posts continue."""
        rows, columns = self.posts.shape
        x = np.clip((east - self.west_m) / self.post_m, 0.0, columns - 1.000001)
        y = np.clip((self.north_m - north) / self.post_m, 0.0, rows - 1.000001)
        column, row = x.astype(np.int64), y.astype(np.int64)
        x -= column
        y -= row
        index = row * columns + column
        flat = self.posts.ravel()
        upper = flat.take(index)  # float32: weights and results are float64
        upper = upper + x * (flat.take(index + 1) - upper)
        lower = flat.take(index + columns)
        lower = lower + x * (flat.take(index + columns + 1) - lower)
        return upper + y * (lower - upper)

    def height_at(self, ground: np.ndarray) -> np.ndarray:
        """Return the surface height ``(n,)`` at lon, lat(, height) points."""
        return self.height(*self.chart.from_ground(ground).T)

    def plane_around(self, positions_m: np.ndarray, radius_m: float) -> TerrainSurface:
        """Return the terrain made plane within a radius of chart positions ``(n, 2)``, as steep as it is there.

        A disc on the ground then has its centre's image in the middle of its own.
        """
        posts = self.posts.copy()
        for east, north in positions_m:
            columns = self._posts_between(east - radius_m - self.west_m, east + radius_m - self.west_m, 1)
            rows = self._posts_between(self.north_m - north - radius_m, self.north_m - north + radius_m, 0)
            right = self.west_m + self.post_m * np.arange(columns.start, columns.stop) - east
            ahead = self.north_m - self.post_m * np.arange(rows.start, rows.stop)[:, None] - north
            steps = radius_m * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
            middle, to_east, to_west, to_north, to_south = self.height(east + steps[:, 0], north + steps[:, 1])
            plane = middle + ((to_east - to_west) * right + (to_north - to_south) * ahead) / (2.0 * radius_m)
            is_inside = np.hypot(right, ahead) <= radius_m
            posts[rows, columns] = np.where(is_inside, plane, posts[rows, columns])
        return replace(self, posts=posts)

    def raise_rectangles(self, corners_m: np.ndarray, top_m: np.ndarray) -> TerrainSurface:
        """Return the terrain with the posts inside rectangles at given heights: buildings with flat roofs.

        Parameters
        ----------
        corners_m : (n, 4, 2) ndarray
            Chart metres, around each rectangle.
        top_m : (n,) ndarray
            Heights of the roofs.

        Returns
        -------
        TerrainSurface
            Their walls slope over one post.
        """
        posts = self.posts.copy()
        for corners, top in zip(corners_m, top_m.tolist(), strict=True):
            (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
            columns = self._posts_between(west - self.west_m, east - self.west_m, 1)
            rows = self._posts_between(self.north_m - north, self.north_m - south, 0)
            right = self.west_m + self.post_m * np.arange(columns.start, columns.stop) - corners[0, 0]
            ahead = self.north_m - self.post_m * np.arange(rows.start, rows.stop)[:, None] - corners[0, 1]
            sides = corners[[1, 3]] - corners[0]
            along = [(right * x + ahead * y) / (x * x + y * y) for x, y in sides]
            inside = np.logical_and.reduce([(share >= 0.0) & (share <= 1.0) for share in along])
            window = posts[rows, columns]
            posts[rows, columns] = np.where(inside, np.maximum(window, np.float32(top)), window)
        return replace(self, posts=posts)

    def window_statistics(self, east: np.ndarray, north: np.ndarray, margin_m: float) -> tuple[float, float, float]:
        """Return lowest and highest post and the steepest slope around chart positions."""
        reach = margin_m + 2.0 * self.post_m
        columns = self._posts_between(east.min() - reach - self.west_m, east.max() + reach - self.west_m, 1)
        rows = self._posts_between(self.north_m - north.max() - reach, self.north_m - north.min() + reach, 0)
        window = self.posts[rows, columns]
        steps = np.hypot(np.abs(np.diff(window, axis=0)).max(), np.abs(np.diff(window, axis=1)).max())
        return float(window.min()), float(window.max()), float(steps) / self.post_m

    def _posts_between(self, first_m: float, last_m: float, axis: int) -> slice:
        """Return the posts between two distances from the first one, two of them at least."""
        count = self.posts.shape[axis]
        first = int(np.clip(first_m / self.post_m, 0, count - 2))
        return slice(first, int(np.clip(last_m / self.post_m + 1, first + 2, count)))


def make_fractal_terrain(
    chart: Chart,
    half_extent_m: float,
    post_m: float,
    mean_height_m: float,
    relief_m: float,
    seed: int,
    cliff_m: float = 0.0,
) -> TerrainSurface:
    """Return a terrain reaching ``half_extent_m`` from the chart's origin in the four directions.

    ``relief_m`` is the range of the hills; ``cliff_m`` the height of cliffs on top of it, none where 0.
    """
    half = int(np.ceil(half_extent_m / post_m))
    count = 2 * half + 1
    heights = np.zeros((count, count), dtype=np.float32)
    if relief_m > 0.0:
        hills = make_fractal_relief(count, FRACTAL_RELIEF.roughness, np.random.default_rng([seed, 1]))
        heights += relief_m * (hills - hills.min()) / np.ptp(hills)
    if cliff_m > 0.0:
        heights += cliff_m * (
            make_fractal_relief(count, FRACTAL_RELIEF.cliff_roughness, np.random.default_rng([seed, 2])) > 0.0
        )
    heights += mean_height_m - heights.mean()
    return TerrainSurface(chart, heights.astype(np.float32), -half * post_m, half * post_m, post_m)


def make_fractal_relief(count: int, roughness: float, rng: np.random.Generator) -> np.ndarray:
    """Return ``(count, count)`` relief of zero mean and unit standard deviation; ``roughness`` is Hurst's exponent."""
    period = fft.next_fast_len(int(1.3 * count) + 1, real=True)  # larger than the scene: opposite edges do not match
    spectrum = fft.rfft2(rng.standard_normal((period, period), dtype=np.float32), workers=1, overwrite_x=True)
    by_row, by_column = (axis(period).astype(np.float32) * period for axis in (fft.fftfreq, fft.rfftfreq))
    amplitude = np.hypot(by_row[:, None], by_column[None, :])
    amplitude[0, 0] = np.inf
    np.power(amplitude, np.float32(-1.0 - roughness), out=amplitude)
    spectrum *= amplitude
    del amplitude
    window = fft.irfft2(spectrum, s=(period, period), workers=1, overwrite_x=True)[:count, :count]
    return (window - window.mean(dtype=np.float64)) / window.std(dtype=np.float64)
