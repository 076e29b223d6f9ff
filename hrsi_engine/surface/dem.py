"""Height surfaces, and the first intersection of image rays with them.

A surface has grid coordinates ``(column, row)`` in units of its cells, (0, 0) the centre of the first cell, and
ellipsoidal heights that are interpolated bilinearly between cell centres. `intersect_surface` follows each ray from
above the highest terrain downwards in steps of at most half a cell, so that the first intersection is found (a mountain
occludes the valley behind it), and refines it iteratively with the RPC itself.
"""

from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np

from ..camera.rpc import RPC
from ..foundation.thresholds import ITERATIONS, MEMORY, threshold, thresholds
from ..ground.geodesy import metres_per_degree, wrap_degrees


class HeightSurface(Protocol):
    """Surface with ellipsoidal heights."""

    def grid_coordinates(self, lonlat: np.ndarray) -> np.ndarray:
        """Return column and row of positions.

        lonlat : (n, 2) lon, lat in degrees
        Result: (n, 2) in cells; (0, 0) is the centre of the first cell.
        """

    def heights(self, grid: np.ndarray) -> np.ndarray:
        """Return ellipsoidal heights ``(n,)`` at grid coordinates; NaN outside and for nodata.

        grid : (n, 2) column, row
        Result: (n,) metres.
        """

    def covers(self, grid: np.ndarray) -> np.ndarray:
        """Return for each grid position ``(n, 2)`` whether it is inside the area of the surface.

        grid : (n, 2) column, row
        Result: (n,) booleans.
        """

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
        """Return the lowest and highest height in a box of grid coordinates.

        low, high : (2,) column, row of two corners
        Result: metres; NaN if there is no height.
        """


def surface_heights(surface: HeightSurface, lonlat: np.ndarray) -> np.ndarray:
    """Return ellipsoidal heights ``(n,)`` (m) at lon, lat ``(n, 2)`` in degrees; NaN outside and for nodata."""
    return surface.heights(surface.grid_coordinates(lonlat))


def dem_sigma_m(cell_size_m: float) -> float:
    """Return the assumed standard deviation of a DEM's heights from the size of its cells, used if it is not stated.

    Agrees with the producers' figures: 0.4 m for 1 m (laser), 3 m for 30 m (TanDEM-X, GLO-30), 9 m for 90 m (SRTM).
    """
    return 0.3 + 0.1 * min(cell_size_m, 100.0)


def cell_size_m(surface: HeightSurface, ground: np.ndarray) -> float:
    """Return the mean side in metres of a surface's cells at a ground point ``(3,)``: the root of the cell area."""
    step_deg = 1e-4
    lonlat = ground[:2] + step_deg * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = np.diff(surface.grid_coordinates(lonlat)[[0, 1, 0, 2]], axis=0)[[0, 2]]
    metres = step_deg * metres_per_degree(ground[None])[0, :2]
    return float(np.sqrt(np.prod(metres) / abs(np.linalg.det(cells))))


@thresholds
class RAY_TRACING:
    """Steps and accuracy of the intersection of rays with a surface."""

    step: float = threshold(0.5, "cells", "step of a ray in plan between two heights of the surface")
    accuracy_m: float = threshold(1e-3, "m", "height error of the intersection at convergence")


class Status(IntEnum):
    """Result of following a ray."""

    FOUND = 0
    NODATA = 1  #: the ray intersects the ground, if at all, where the surface has nodata
    OUTSIDE = 2  #: the ray leaves the area of the surface above the ground
    NO_RAY = 3  #: the RPC has no ground position for the image point

    @property
    def label(self) -> str:
        return ("found", "nodata", "outside", "no ray")[self.value]


class SurfaceIntersection(NamedTuple):
    """Intersections of rays with a surface, and the status of each ray.

    ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres; NaN without intersection
    status : (n,) values of `Status`
    """

    ground: np.ndarray
    status: np.ndarray


def intersect_surface(rpc: RPC, image: np.ndarray, surface: HeightSurface) -> SurfaceIntersection:
    """Return the first intersections of the rays of image points ``(n, 2)`` with a surface, from above.

    Heights are accurate to 1 mm. A peak may be missed if the part of the ray inside it is shorter than half a cell.
    Nodata cells along a ray may contain the intersection: the ray is followed further only if it is above the ground
    behind them; else its status is ``NODATA``.

    rpc : the camera; image : (n, 2) sample, line in pixels; surface : the terrain
    Result: ground points and status of each ray.
    """
    image = np.asarray(image, dtype=np.float64)
    ground = np.full((len(image), 3), np.nan)
    status = np.empty(len(image), dtype=np.int64)
    for start in range(0, len(image), MEMORY.rows):
        part = slice(start, start + MEMORY.rows)
        ground[part], status[part] = _intersect_part(rpc, image[part], surface)
    return SurfaceIntersection(ground, status)


def _intersect_part(rpc: RPC, image: np.ndarray, surface: HeightSurface) -> SurfaceIntersection:
    """Return the intersections of a part of the rays: enclose the terrain, march down, close in (see the module).

    image : (n, 2) sample, line
    """
    ends = _find_ray_ends(rpc, image, surface)
    ground = np.full((len(image), 3), np.nan)
    status = np.where(ends.converged, int(Status.OUTSIDE), int(Status.NO_RAY))
    rays = np.flatnonzero(ends.exists)
    if not rays.size:
        return SurfaceIntersection(ground, status)
    if np.isnan(ends.heights).any():  # no height near any ray
        status[rays] = np.where(surface.covers(ends.lower[rays]), Status.NODATA, Status.OUTSIDE)
        return SurfaceIntersection(ground, status)
    status[rays], bracket = _march_down(ends.upper[rays], ends.lower[rays], ends.heights, surface)
    hits = rays[status[rays] == Status.FOUND]
    ground[hits], valid = _close_in_on_surface(rpc, image[hits], surface, bracket[status[rays] == Status.FOUND])
    status[hits[~valid]] = Status.NODATA
    ground[hits[~valid]] = np.nan
    return SurfaceIntersection(ground, status)


class _RayEnds(NamedTuple):
    """Grid coordinates ``(n, 2)`` of rays at the upper and lower of two heights.

    ``exists``: both have grid coordinates; ``converged``: the RPC was inverted at both, inside the grid or not.
    """

    upper: np.ndarray
    lower: np.ndarray
    heights: tuple[float, float]
    exists: np.ndarray
    converged: np.ndarray


def _find_ray_ends(rpc: RPC, image: np.ndarray, surface: HeightSurface) -> _RayEnds:
    """Return the end points of rays at heights just above and below all terrain along them.

    The terrain along the rays depends on these heights: iterated, starting from the RPC's height range.

    image : (n, 2) sample, line
    """
    low, high = rpc.height_range
    for _ in range(ITERATIONS.most):
        ends = _localize_between(rpc, image, surface, low, high)
        if not ends.exists.any():
            return ends
        passed = np.concatenate([ends.upper[ends.exists], ends.lower[ends.exists]])
        lowest, highest = surface.bounds(passed.min(axis=0) - 1.0, passed.max(axis=0) + 1.0)
        if np.isnan(lowest):
            return ends._replace(heights=(np.nan, np.nan))
        enclosed = low <= lowest - RAY_TRACING.accuracy_m and high >= highest + RAY_TRACING.accuracy_m
        low, high = lowest - RAY_TRACING.accuracy_m, highest + RAY_TRACING.accuracy_m
        if enclosed:
            break
    return _localize_between(rpc, image, surface, low, high)


def _localize_between(rpc: RPC, image: np.ndarray, surface: HeightSurface, low: float, high: float) -> _RayEnds:
    """Return the ends of the rays of ``image (n, 2)`` at the heights ``low`` and ``high``, m."""
    upper, lower = rpc.localize(image, high), rpc.localize(image, low)
    lower.ground[:, 0] = upper.ground[:, 0] + wrap_degrees(lower.ground[:, 0] - upper.ground[:, 0])
    grid = [np.full((len(image), 2), np.nan) for _ in range(2)]
    converged = upper.converged & lower.converged
    for target, end in zip(grid, (upper, lower), strict=True):
        target[converged] = surface.grid_coordinates(end.ground[converged, :2])
    exists = converged & np.isfinite(grid[0]).all(axis=1) & np.isfinite(grid[1]).all(axis=1)
    return _RayEnds(grid[0], grid[1], (low, high), exists, converged)


def _march_down(
    upper: np.ndarray, lower: np.ndarray, heights: tuple[float, float], surface: HeightSurface
) -> tuple[np.ndarray, np.ndarray]:
    """Follow straight rays down in equal steps to the first sample below the terrain.

    upper, lower : (n, 2) grid coordinates of the rays at the higher and the lower of ``heights``, m
    Result: values of `Status` ``(n,)``, and the heights ``(n, 2)`` just before and after the hit, NaN without one.
    """
    low, high = heights
    steps = max(1, int(np.ceil(float(np.abs(upper - lower).max()) / RAY_TRACING.step)))
    count = len(upper)
    status, bracket = np.full(count, int(Status.OUTSIDE)), np.full((count, 2), np.nan)
    going, in_gap = np.arange(count), np.zeros(count, dtype=bool)
    for step in range(steps + 1):
        share = step / steps
        height = high - share * (high - low)
        position = upper[going] + share * (lower[going] - upper[going])
        terrain = surface.heights(position)
        unknown = np.isnan(terrain)
        reached = ~unknown & (height <= terrain)
        reached_rows, gap_rows = going[reached & ~in_gap[going]], going[reached & in_gap[going]]
        status[reached_rows], status[gap_rows] = Status.FOUND, Status.NODATA
        bracket[reached_rows] = height + (high - low) / steps, height
        in_gap[going] = unknown & surface.covers(position)
        status[going[in_gap[going]]] = Status.NODATA
        status[going[unknown & ~in_gap[going]]] = Status.OUTSIDE
        going = going[~reached]
        if not going.size:
            break
    return status, bracket


def _close_in_on_surface(
    rpc: RPC, image: np.ndarray, surface: HeightSurface, bracket: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ground points where rays intersect the surface within height brackets, and a mask of those found.

    Regula falsi in the Illinois variant (Dowell and Jarratt 1971), with a bisection in every fourth iteration, since
    the surface is continuous but not smooth.

    image : (n, 2) sample, line; bracket : (n, 2) heights above and below the intersection, m
    Result: ``(n, 3)`` lon, lat, height, and ``(n,)`` bool.
    """

    def find_height_above(rows: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the ground points of some rays at heights ``(k,)``, and how far above the surface they are, m."""
        point = rpc.localize(image[rows], height).ground
        return point, height - surface_heights(surface, point[:, :2])

    rays = np.arange(len(image))
    upper, lower = bracket.T.copy()
    (_, f_upper), (ground, f_lower) = find_height_above(rays, upper), find_height_above(rays, lower)
    valid = np.isfinite(f_upper) & np.isfinite(f_lower)
    # The real ray differs by millimetres from the straight one: where this changes a sign, the end is the intersection.
    going = rays[valid & (f_upper > 0.0) & (f_lower < 0.0)]
    at_top = rays[valid & (f_upper <= 0.0)]
    ground[at_top] = find_height_above(at_top, upper[at_top])[0]
    below_before = np.full(len(image), -1)  # end that was moved last: 1 the lower, 0 the upper
    for iteration in range(ITERATIONS.most):
        if not going.size:
            break
        a, b, fa, fb = upper[going], lower[going], f_upper[going], f_lower[going]
        middle = 0.5 * (a + b) if iteration % 4 == 3 else (a * fb - b * fa) / (fb - fa)
        ground[going], f = find_height_above(going, middle)
        is_below = f < 0.0
        damping = np.where(
            is_below == below_before[going], 0.5, 1.0
        )  # weight of the end that remains for a second time
        upper[going], f_upper[going] = np.where(is_below, a, middle), np.where(is_below, damping * fa, f)
        lower[going], f_lower[going] = np.where(is_below, middle, b), np.where(is_below, f, damping * fb)
        below_before[going] = is_below
        valid[going[~np.isfinite(f)]] = False
        narrow = upper[going] - lower[going] < RAY_TRACING.accuracy_m
        going = going[np.isfinite(f) & ~narrow & (np.abs(f) > 0.1 * RAY_TRACING.accuracy_m)]
    return ground, valid
