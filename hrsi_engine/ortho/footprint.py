"""The part of the map that an image shows."""

import numpy as np
import pyproj

from ..block.block import Image
from ..foundation.errors import InputError
from ..ground.crs_operations import operations_of
from ..ground.geodesy import continuous_longitudes
from ..ground.map_crs import map_epsg_of
from ..surface.dem import HeightSurface, Status, intersect_surface, surface_heights
from .grid import ORTHO


def find_terrain_points(image: Image, surface: HeightSurface) -> np.ndarray:
    """Return ground points ``(n, 3)`` of an image, those of a coarse grid that meet the terrain."""
    ground, status = intersect_surface(image.rpc, image.grid_px(ORTHO.grid_points, ORTHO.grid_points), surface)
    return ground[status == Status.FOUND]


def compute_ground_sample_m(image: Image, ground: np.ndarray) -> float:
    """Return the geometric mean of an image's ground sample distances at the middle one of ground points."""
    middle = ground[len(ground) // 2][None]
    return float(1.0 / image.rpc.px_per_m(middle)[0])


def choose_map_crs(ground: np.ndarray) -> str:
    """Return the WKT of the map of the middle of ground points."""
    return str(pyproj.CRS.from_epsg(map_epsg_of(ground)).to_wkt())


def compute_footprint_bounds(image: Image, surface: HeightSurface, crs: str, resolution: float) -> tuple[float, ...]:
    """Return west, south, east, north in a CRS of all that an image shows of the terrain.

    The outline is followed to the terrain; where that is not known, it is taken at the heights nearby. Raises
    `InputError` where the terrain is not known anywhere in the image.
    """
    outline = image.outline_px(ORTHO.outline_points)
    ground, status = intersect_surface(image.rpc, outline, surface)
    lost = status != Status.FOUND
    if lost.any():
        known = find_terrain_points(image, surface)
        if not len(known):
            raise InputError(f"{image.id}: the terrain is not known anywhere in the image: use a DEM that covers it")
        for height in (known[:, 2].min(), known[:, 2].max()):
            ground = np.vstack([ground, image.rpc.localize(outline[lost], height).ground])
    ground = ground[np.isfinite(ground).all(axis=1)]
    operations = operations_of(crs)
    x, y = operations.from_wgs84(ground).T
    if operations.crs.is_geographic:
        x = continuous_longitudes(x)
    margin = ORTHO.margin_px * resolution
    return x.min() - margin, y.min() - margin, x.max() + margin, y.max() + margin


def compute_covered_share(image: Image, surface: HeightSurface) -> float:
    """Return the share of an image whose ground has a height in the surface, 0 to 1."""
    grid = image.grid_px(ORTHO.grid_points, ORTHO.grid_points)
    height = sum(image.rpc.height_range) / 2.0
    ground = image.rpc.localize(grid, height).ground
    return float(np.mean(np.isfinite(surface_heights(surface, np.nan_to_num(ground[:, :2])))))
