"""The map grid of a block's orthoimages, and the footprint of an image in it.

The pixels of all orthoimages with the same CRS and resolution are in one lattice: pixel edges are integer multiples of
the resolution from the CRS's origin. Therefore any two of them register pixel to pixel, whatever their extents.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyproj

from ..block.block import Image
from ..foundation.errors import InputError
from ..foundation.thresholds import EQUALITY, GRIDS, threshold, thresholds
from ..ground.crs_operations import operations_of
from ..ground.geodesy import continuous_longitudes
from ..ground.map_crs import map_epsg_of
from ..ground.proj_operations import parse_crs, without_heights
from ..surface.dem import HeightSurface, Status, intersect_surface

#: Leading digits of the resolutions that are chosen automatically.
ROUND_STEPS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0)


@thresholds
class ORTHO:
    """Grid of orthoimages (rounding, extent), and nodes at which it is mapped exactly."""

    coarser: float = threshold(1.05, "", "largest rounded resolution over the image's ground sample distance")
    unknown_grid: int = threshold(65, "positions", "positions along each side of a chunk, for counting missing heights")
    outline_points: int = threshold(200, "points", "points along each side of an image's outline")
    margin_px: int = threshold(2, "px", "margin around the footprint of an image, and from hidden ground")
    straight: float = threshold(0.01, "", "part of the error up to which the curvature of rays is neglected")
    least_half_m: float = threshold(20.0, "m", "smallest half range of heights of the RPC's polynomial")


class GridWindow(NamedTuple):
    """A part of a grid: first column and row, columns and rows."""

    column: int
    row: int
    columns: int
    rows: int

    def parts(self, columns: int, rows: int) -> Iterator[GridWindow]:
        """Yield windows of the given size, smaller at the right and lower edge, that cover this one, row by row."""
        for row in range(0, self.rows, rows):
            for column in range(0, self.columns, columns):
                size = min(columns, self.columns - column), min(rows, self.rows - row)
                yield GridWindow(self.column + column, self.row + row, *size)


def round_resolution(gsd: float) -> float:
    """Return the largest round number not above 1.05 times a ground sample distance: 0.52 gives 0.5, 6.5 gives 6."""
    if not (math.isfinite(gsd) and gsd > 0.0):
        raise InputError(f"the images have a pixel size of {gsd} on the ground: give `resolution`")
    power = 10.0 ** math.floor(math.log10(gsd))
    candidates = [step * scale for scale in (power / 10.0, power) for step in ROUND_STEPS]
    return float(f"{max(value for value in candidates if value <= ORTHO.coarser * gsd):.6g}")


@dataclass(frozen=True)
class MapGrid:
    """Pixels of a map, with their position in the lattice that all grids of a CRS and resolution share.

    The upper left corner of the first pixel is at ``(left * resolution, top * resolution)``; rows run south.

    crs : the CRS as WKT; resolution : side of a pixel in the CRS's units
    left, top : columns and rows from the CRS's origin to the upper left corner of the first pixel
    columns, rows : size of the grid
    """

    crs: str
    resolution: float
    left: int
    top: int
    columns: int
    rows: int

    @classmethod
    def from_bounds(cls, crs: str, resolution: float, bounds: Sequence[float]) -> MapGrid:
        """Return the smallest grid that contains an area.

        crs : the CRS as WKT; resolution : side of a pixel in the CRS's units
        bounds : west, south, east, north in the CRS's units
        Result: the grid.
        Raises `InputError`: the bounds contain no pixel.
        """
        west, south, east, north = (value / resolution for value in bounds)
        left, top = math.floor(west + EQUALITY.written_px), math.ceil(north - EQUALITY.written_px)
        columns, rows = math.ceil(east - EQUALITY.written_px) - left, top - math.floor(south + EQUALITY.written_px)
        if columns < 1 or rows < 1:
            raise InputError(f"an extent of {columns} x {rows} pixels is empty: check `extent` and `resolution`")
        return cls(crs, resolution, left, top, columns, rows)

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """GDAL's geotransform."""
        return self.left * self.resolution, self.resolution, 0.0, self.top * self.resolution, 0.0, -self.resolution

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north in the CRS's units."""
        west, north = self.left * self.resolution, self.top * self.resolution
        return west, north - self.rows * self.resolution, west + self.columns * self.resolution, north

    def lonlat(self, pixels: np.ndarray) -> np.ndarray:
        """Return the positions of pixels.

        pixels : (n, 2) column, row; (0, 0) is the centre of the first pixel
        Result: (n, 2) lon, lat in degrees.
        """
        x = (self.left + 0.5 + pixels[:, 0]) * self.resolution
        y = (self.top - 0.5 - pixels[:, 1]) * self.resolution
        return operations_of(self.crs).to_wgs84(np.column_stack([x, y, np.zeros(len(x))]))[:, :2]

    def chunks(self, columns: int, rows: int | None = None) -> Iterator[GridWindow]:
        """Yield windows of the given size that cover the grid, row by row.

        columns : columns of a window; rows : rows of a window, by default equal to the columns
        Result: windows that cover the grid, row by row; those at its right and lower edge are smaller.
        """
        return GridWindow(0, 0, self.columns, self.rows).parts(columns, columns if rows is None else rows)


def find_terrain_points(image: Image, surface: HeightSurface) -> np.ndarray:
    """Return the ground points ``(n, 3)`` of a coarse grid of image points, those that intersect the terrain."""
    ground, status = intersect_surface(image.rpc, image.grid_px(GRIDS.nodes, GRIDS.nodes), surface)
    return ground[status == Status.FOUND]


def compute_ground_sample_m(image: Image, ground: np.ndarray) -> float:
    """Return the side of a square with the ground area of an image pixel (m), at the middle one of ground points."""
    return float(1.0 / image.rpc.px_per_m(ground[len(ground) // 2][None])[0])


def choose_map_crs(ground: np.ndarray, name: str | None = None) -> str:
    """Return the WKT of a named CRS without heights, or of the UTM or UPS projection at the middle of ground points.

    Raises `InputError`: the CRS is unknown, or neither projected nor geographic.
    """
    crs = pyproj.CRS.from_epsg(map_epsg_of(ground)) if name is None else without_heights(parse_crs(name, "`crs`: "))
    if not (crs.is_projected or crs.is_geographic):
        raise InputError(f"`crs` {name!r} is neither projected nor geographic: choose another")
    return str(crs.to_wkt())


def compute_footprint_bounds(image: Image, surface: HeightSurface, crs: str, resolution: float) -> tuple[float, ...]:
    """Return west, south, east, north of an image's footprint on the terrain, in a CRS.

    The outline is intersected with the terrain; where the DEM has nodata, the lowest and highest heights of the image
    are used. Raises `InputError` if the DEM has no height in the image at all.
    """
    outline = image.outline_px(ORTHO.outline_points)
    ground, status = intersect_surface(image.rpc, outline, surface)
    has_no_terrain = status != Status.FOUND
    if has_no_terrain.any():
        terrain = find_terrain_points(image, surface)
        if not len(terrain):
            raise InputError(f"{image.id}: the DEM has no height in the image: use a DEM that covers it")
        for height in (terrain[:, 2].min(), terrain[:, 2].max()):
            ground = np.vstack([ground, image.rpc.localize(outline[has_no_terrain], height).ground])
    ground = ground[np.isfinite(ground).all(axis=1)]
    operations = operations_of(crs)
    x, y = operations.from_wgs84(ground).T
    if operations.crs.is_geographic:
        x = continuous_longitudes(x)
    margin = ORTHO.margin_px * resolution
    return x.min() - margin, y.min() - margin, x.max() + margin, y.max() + margin
