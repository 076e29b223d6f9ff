"""Where lines of sight meet the terrain: the first intersection from above.

Over the few hundred metres of a scene's relief a ray is a curve over the chart, ``E(u), N(u)``, quadratic in the height
``h = middle + half u`` to less than a tenth of a millimetre; three exact intersections with heights give it. On it the
surface is met

* where the ground is too flat to hide anything (slope times tangent of the view angle below
  `INTERSECTION.occlusion_free`) by the iteration ``h <- surface(E(h), N(h))``, a contraction there;
* elsewhere by walking down from the highest post in steps of half a post on the ground, and halving the step in
  which the ray goes under.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .pushbroom import PushbroomCamera
from .terrain import TerrainSurface
from .world import constant, constants


@constants
class INTERSECTION:
    """Intersection of rays with the terrain."""

    occlusion_free: float = constant(
        0.7, "", "slope times tangent of the view angle below which nothing is hidden", "contraction < 1"
    )
    height_tolerance_m: float = constant(5e-4, "m", "height error at convergence")
    bisections: int = constant(14, "steps", "bisections of the last step")


class RayPaths(NamedTuple):
    """Rays over the chart: ``coefficients[k]`` is the factor of ``u**k``, ``(3, 2, …)`` for east and north.

    ``middle_m`` and ``half_m`` scale the height: ``h = middle_m + half_m * u``.
    """

    coefficients: np.ndarray
    middle_m: float
    half_m: float

    def position_at(self, height_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return east and north where the rays have given heights."""
        u = (height_m - self.middle_m) / self.half_m
        (e0, n0), (e1, n1), (e2, n2) = self.coefficients
        return e0 + u * (e1 + u * e2), n0 + u * (n1 + u * n2)

    def tangent(self) -> float:
        """Return the largest tangent of the angle between rays and the vertical."""
        return float(np.hypot(*self.coefficients[1]).max() / self.half_m)

    def select(self, rows: np.ndarray) -> RayPaths:
        """Return some of the rays (mask or indices)."""
        return self._replace(coefficients=self.coefficients[:, :, rows])


def compute_ray_paths(camera: PushbroomCamera, terrain: TerrainSurface, image: np.ndarray) -> RayPaths:
    """Return the paths of image points ``(n, 2)`` over the terrain's range of heights; coefficients ``(3, 2, n)``."""
    low, high = terrain.height_range
    middle, half = (low + high) / 2.0, (high - low) / 2.0 + 1.0
    lower, centre, above = (
        terrain.chart.from_ground(camera.image_to_ground(image, height)).T
        for height in (middle - half, middle, middle + half)
    )
    return RayPaths(
        np.stack([centre, (above - lower) / 2.0, (above + lower) / 2.0 - centre]), float(middle), float(half)
    )


def meet_surface(paths: RayPaths, terrain: TerrainSurface) -> np.ndarray:
    """Return the heights at which rays first meet the terrain from above, in the shape of the rays."""
    reach = paths.tangent() * paths.half_m
    east, north = paths.coefficients[0]
    low, high, slope = terrain.window_statistics(east, north, reach)
    if slope * paths.tangent() < INTERSECTION.occlusion_free:
        height = np.full(paths.coefficients.shape[2:], ((low + high) / 2.0))
        for _ in range(60):
            previous = height
            height = terrain.height(*paths.position_at(previous))
            if np.abs(height - previous).max() < INTERSECTION.height_tolerance_m:
                break
        return height
    return _walk_down(paths, terrain, low, high)


def _walk_down(paths: RayPaths, terrain: TerrainSurface, low: float, high: float) -> np.ndarray:
    """Return the heights where rays first go under, from the highest post ``high`` to the lowest ``low`` (metres)."""
    shape = paths.coefficients.shape[2:]
    flat = paths._replace(coefficients=paths.coefficients.reshape(3, 2, -1))
    step = 0.5 * terrain.post_m / max(paths.tangent(), 1e-9)
    lower = np.full(int(np.prod(shape)), low - INTERSECTION.height_tolerance_m)
    above = np.full(lower.size, high + INTERSECTION.height_tolerance_m)
    active, level = np.arange(lower.size), high + INTERSECTION.height_tolerance_m
    while level > low and active.size:
        level = max(level - step, low - INTERSECTION.height_tolerance_m)
        some = flat.select(active)
        is_below = level <= terrain.height(*some.position_at(np.full(active.size, level)))
        lower[active[is_below]] = level
        active = active[~is_below]
        above[active] = level
    for _ in range(INTERSECTION.bisections):
        middle = (lower + above) / 2.0
        is_below = middle <= terrain.height(*flat.position_at(middle))
        lower, above = np.where(is_below, middle, lower), np.where(is_below, above, middle)
    return ((lower + above) / 2.0).reshape(shape)


def locate_on_surface(camera: PushbroomCamera, terrain: TerrainSurface, image: np.ndarray) -> np.ndarray:
    """Return the ground points observed at image points.

    Parameters
    ----------
    camera : PushbroomCamera
        The camera.
    terrain : TerrainSurface
        The terrain.
    image : (n, 2) ndarray
        Sample, line in pixels.

    Returns
    -------
    (n, 3) ndarray
        Lon, lat in degrees, ellipsoidal height in metres.
    """
    return camera.image_to_ground(image, meet_surface(compute_ray_paths(camera, terrain, image), terrain))
