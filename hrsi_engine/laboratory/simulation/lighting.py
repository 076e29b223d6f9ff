"""Painting the ground as it looks under one sun: shading, cast shadows, and buildings above the ground.

A line of sight that reaches the ground at (E, N) passes (E, N) + h l at the height h above it, l being its lean in
metres per metre. So what reaches up to a height h is painted at the positions (E, N) + h l: its roof moves away from
its foot as the view is oblique, and between them lie the walls. A shadow is the outline of what casts it, moved away
from the sun by h cot(elevation); it takes away the direct light and leaves that of the sky. The terrain's own shadows
are found by walking from the ground towards the sun.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.special import ndtr

from .acquisitions import DATES, Acquisition
from .landscape import Objects
from .terrain import TerrainSurface
from .texture import COVERAGE, SNOW, compute_cover, compute_disc_cover
from .tiles import TilePainter
from .world import constant, constants


@constants
class LIGHT:
    """Light and snow on buildings and slopes."""

    wall_grey: float = constant(0.6, "", "grey value of a wall relative to its roof's")
    snow_on_roofs: float = constant(0.7, "", "snow on a roof relative to open land")
    wall_slope: float = constant(1.0, "", "smallest slope of the walls of a city without dates")
    sun_deg: tuple[float, float] = constant(
        (150.0, 45.0), "deg", "azimuth and elevation of the sun on the walls of a city without dates"
    )
    steepest_light: float = constant(1.8, "", "largest light on a slope that faces the sun, relative to flat ground")


@dataclass(frozen=True, eq=False)
class LitPainter(TilePainter):
    """Paints tiles of one image under the sun of its date.

    Parameters
    ----------
    terrain : what is shaded
    taken : the date
    height_m : (n,) of the objects above the ground
    """

    terrain: TerrainSurface
    taken: Acquisition
    height_m: np.ndarray

    @classmethod
    def from_painter(
        cls, painter: TilePainter, terrain: TerrainSurface, acquisition: Acquisition, height_m: np.ndarray, gsd_m: float
    ) -> LitPainter:
        """Return the painter of the same picture with light and heights; views lean by 45 degrees at most."""
        longest = height_m * (1.0 + 1.0 / np.tan(np.radians(acquisition.sun_elevation_deg)))
        reach = np.ceil(longest / gsd_m).astype(np.int64)[:, None] * np.array([-1, 1, -1, 1])
        values: dict[str, Any] = {name: getattr(painter, name) for name in ("size", "texture", "objects", "blur_m")}
        return cls(**values, boxes=painter.boxes + reach, terrain=terrain, taken=acquisition, height_m=height_m)

    def grey(
        self, row: int, column: int, east: np.ndarray, north: np.ndarray, lean: np.ndarray | None = None
    ) -> np.ndarray:
        """Return a tile's blurred grey values; ``lean (2, …)`` is by how much lines of sight move a metre up."""
        grey = self.texture.grey(east, north)
        touching = self.touching(row, column)
        lean = np.zeros((2, *east.shape)) if lean is None else lean
        light = self._terrain_light(east, north)
        flat = [item for item in touching if not self.height_m[item[0]]]
        raised = [item for item in touching if self.height_m[item[0]]]
        for index, part in flat:
            self.paint(index, grey[part], east[part], north[part])
        # Shadows fall on all that lies flat; where several fall, it is as dark as under one
        lit = np.ones_like(light)
        for index, part in raised:
            np.minimum(lit[part], 1.0 - self._shadow(index, east[part], north[part]), out=lit[part])
        grey *= (DATES.ambient + (1.0 - DATES.ambient) * light * lit).astype(np.float32)
        for index, part in raised:
            self._raise(index, grey[part], east[part], north[part], lean[:, part[0], part[1]])
        return grey

    def _terrain_light(self, east: np.ndarray, north: np.ndarray) -> np.ndarray:
        """Return the direct light on the ground relative to flat ground, 0 in the terrain's own shadow."""
        terrain, post = self.terrain, self.terrain.post_m
        sun_east, sun_north, sun_up = self.taken.sun
        ground = terrain.height(east, north)
        by_east = (terrain.height(east + post, north) - terrain.height(east - post, north)) / (2.0 * post)
        by_north = (terrain.height(east, north + post) - terrain.height(east, north - post)) / (2.0 * post)
        facing = (sun_up - by_east * sun_east - by_north * sun_north) / np.sqrt(1.0 + by_east**2 + by_north**2)
        light = np.clip(facing / sun_up, 0.0, LIGHT.steepest_light)
        # A shadow needs ground that rises more steeply than the sun's rays, within reach of the highest post
        plan = float(np.hypot(sun_east, sun_north))
        reach = (terrain.height_range[1] - float(ground.min())) * plan / sun_up
        _, highest, slope = terrain.window_statistics(east, north, reach)
        if slope < sun_up / plan:
            return light
        for distance in np.arange(post, (highest - float(ground.min())) * plan / sun_up + post, post):
            above = terrain.height(east + distance * sun_east / plan, north + distance * sun_north / plan)
            light = np.where(above > ground + distance * sun_up / plan + 0.05 * post, 0.0, light)
        return light

    def _shadow(self, index: int, east: np.ndarray, north: np.ndarray) -> np.ndarray:
        """Return the share of each pixel in the shadow of an object: its outline on the way to the shadow's end."""
        sun_east, sun_north, sun_up = self.taken.sun
        shadow_m = -self.height_m[index] / sun_up * np.array([sun_east, sun_north])
        return compute_swept_cover(self.objects, index, shadow_m, east, north, self.blur_m)

    def _raise(self, index: int, grey: np.ndarray, east: np.ndarray, north: np.ndarray, lean: np.ndarray) -> None:
        """Paint the walls and the roof of an object, in place."""
        if not grey.size:
            return
        height, roof = float(self.height_m[index]), float(self.objects.grey[index, self.texture.band])
        displacement_m = -height * lean.mean(axis=(1, 2))
        wall = compute_swept_cover(self.objects, index, displacement_m, east, north, self.blur_m)
        grey += wall * (np.float32(LIGHT.wall_grey * roof) - grey)
        snow = LIGHT.snow_on_roofs * (self.taken.snow > 0.0)
        top = np.float32(roof + snow * (SNOW.grey - roof))
        at = east + height * lean[0], north + height * lean[1]
        grey += compute_cover(self.objects, index, *at, self.blur_m) * (top - grey)


def light_walls(terrain: TerrainSurface, east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Return the light on walls of a city, relative to that on its roofs, at chart positions; 1 on roofs and ground.

    Walls are steep faces of the terrain. In images they are darker than the roof, each by its angle to the sun.
    """
    azimuth, elevation = np.radians(LIGHT.sun_deg)
    step = 0.02 * terrain.post_m  # within one face of the bilinear surface
    by_east = (terrain.height(east + step, north) - terrain.height(east - step, north)) / (2.0 * step)
    by_north = (terrain.height(east, north + step) - terrain.height(east, north - step)) / (2.0 * step)
    slope = np.hypot(by_east, by_north)
    towards_sun = -(by_east * np.sin(azimuth) + by_north * np.cos(azimuth)) / np.maximum(slope, LIGHT.wall_slope)
    direct = np.maximum(towards_sun, 0.0) / np.tan(elevation)
    light = LIGHT.wall_grey * (DATES.ambient + (1.0 - DATES.ambient) * direct)
    return np.where(slope > LIGHT.wall_slope, light, 1.0).astype(np.float32)


def compute_swept_cover(
    objects: Objects, index: int, sweep_m: np.ndarray, east: np.ndarray, north: np.ndarray, blur_m: float
) -> np.ndarray:
    """Return the share of each pixel that an object's outline passes when it is moved by ``sweep_m (2,)``.

    A disc passes what lies within its radius of a segment, a rectangle the convex hull of both its places.
    """
    if COVERAGE[str(objects.kind[index])] is compute_disc_cover:
        offset = np.stack([east, north]) - objects.position_m[index][:, None, None]
        length2 = max(float(sweep_m @ sweep_m), 1e-12)
        along = np.clip(np.einsum("kij,k->ij", offset, sweep_m) / length2, 0.0, 1.0)
        distance_m = np.hypot(*(offset - sweep_m[:, None, None] * along))
        return ndtr(((objects.size_m[index, 0] / 2.0 - distance_m) / blur_m).astype(np.float32))
    corners = objects.select(np.array([index])).corners_m()[0]
    cover = np.ones(east.shape, dtype=np.float32)
    for right, ahead, offset in ConvexHull(np.concatenate([corners, corners + sweep_m])).equations:
        inside = -(right * east + ahead * north + offset)
        np.minimum(cover, ndtr((inside / blur_m).astype(np.float32)), out=cover)
    return cover
