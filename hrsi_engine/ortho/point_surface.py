"""Terrain surface from scattered points, for areas without a DEM: interpolated from the adjusted tie points.

Heights are moving least squares (Lancaster and Salkauskas 1981): at every node a plane is fitted to the nearest points.
The weights decrease with the distance, by a Gaussian as wide as the local point spacing, and with the variance of the
heights. The planes are fitted robustly, with weights ``1 / (1 + (v / s)²)²`` for the residual v of a point (Geman and
McClure 1987), where s decreases to the usual scatter of the points in several rounds (graduated non-convexity, Blake
and Zisserman 1987). At a wall, with points on the roof and on the ground, a plane is therefore one of the two and not
their mean. A triangulation would be a ramp between them, and contain the error of every single height.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, KDTree, QhullError

from ..foundation.errors import InputError
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import EQUALITY, GROUND, MEMORY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..ground.geodesy import LocalFrame, continuous_longitudes, metres_per_degree
from ..surface.grid_surface import GridSurface


@thresholds
class POINT_SURFACE:
    """Interpolation of a surface from scattered points, and rejection of outliers."""

    cells_per_spacing: float = threshold(5.0, "cells", "cells of the surface per mean spacing of points")
    margin: float = threshold(200.0, "spacings", "largest extrapolation of the surface around the points")
    fitted: int = threshold(20, "points", "number of points in the fit of a plane")
    nearest: int = threshold(5, "points", "number of nearest points that determine the weights' width")
    width: float = threshold(0.33, "", "sigma of the Gaussian weights over the distance of the farthest")
    scatters: tuple[float, ...] = threshold(
        (16.0, 8.0, 4.0, 2.0, 1.0, 1.0),
        "",
        "scales of the robust weights in turn, relative to the scatter",
        "Blake 1987",
    )


def surface_of_points(ground: np.ndarray, sigma_height_m: np.ndarray | None = None) -> tuple[GridSurface, int]:
    """Return a surface through points, and the number of points that were rejected.

    The surface has cells of a fifth of the mean point spacing; outside the convex hull of the points it has the height
    of the nearest one. Points are rejected if their height differs from the median of their neighbours and from nearly
    all of them (the adjustment detects wrong matches across the epipolar direction, but not those along it).

    ground : (n, 3) lon, lat in degrees, ellipsoidal height in metres
    sigma_height_m : (n,) standard deviations of the heights, NaN if unknown: points that are less accurate than
    their neighbours have lower weights
    Result: the surface, and the number of points that it does not use.
    Raises `InputError`: there are fewer than three points.
    """
    is_finite = np.isfinite(ground).all(axis=1)
    sigma = np.full(len(ground), np.nan) if sigma_height_m is None else np.asarray(sigma_height_m, dtype=np.float64)
    ground, sigma = ground[is_finite], sigma[is_finite]
    if len(ground) < 3:
        raise InputError(f"a surface needs 3 points with heights or more, there are {len(ground)}: use a DEM")
    ground = np.column_stack([continuous_longitudes(ground[:, 0]), ground[:, 1:]])
    frame = LocalFrame(*np.median(ground, axis=0).tolist())
    xy = frame.from_ground(np.column_stack([ground[:, :2], np.full(len(ground), frame.height_m)]))[:, :2]
    # Variance of each height ``(n,)`` above the smallest one of its neighbours
    is_finite = np.flatnonzero(np.isfinite(sigma))
    variance = np.zeros(len(xy))
    if len(is_finite):
        _, neighbours = KDTree(xy[is_finite]).query(
            xy[is_finite], k=np.arange(1, min(SAMPLES.fewest + 1, len(is_finite)) + 1)
        )
        variance[is_finite] = sigma[is_finite] ** 2 - (sigma[is_finite][neighbours] ** 2).min(axis=1)
    # Points that are kept: close to the median of their neighbours, or to the heights of some of them
    height = ground[:, 2]
    _, index = KDTree(xy).query(xy, k=min(SAMPLES.fewest + 1, len(xy)))
    middle = np.median(height[index], axis=1)
    deviation = np.abs(height - middle)
    spread = robust_sigma(height[index] - middle[:, None], axis=1)
    typical = max(float(robust_sigma(deviation)), EQUALITY.position_m)
    is_similar = np.abs(height[index] - height[:, None]) <= SIGNIFICANCE.certain * typical
    is_close = deviation <= SIGNIFICANCE.certain * np.sqrt(np.maximum(spread, typical) ** 2 + variance)
    keep = is_close | (is_similar.sum(axis=1) > SAMPLES.plane)
    scale = metres_per_degree(np.median(ground, axis=0)[None])[0, :2]
    points = _Points(ground[keep, :2] * scale, ground[keep, 2], variance[keep])
    # The surface on a grid of degrees; ``scale (2,)`` is metres per degree
    extent, spacing = np.ptp(points.xy, axis=0), points.spacing_m
    reach = np.minimum(POINT_SURFACE.margin * spacing, extent.max())
    cell_m = max(
        spacing / POINT_SURFACE.cells_per_spacing, float(np.sqrt(np.prod(extent + 2.0 * reach) / MEMORY.cells))
    )
    low, high = points.xy.min(axis=0) - reach, points.xy.max(axis=0) + reach
    columns, rows = (np.ceil((high - low) / cell_m).astype(int) + 1).tolist()
    x, y = low[0] + cell_m * np.arange(columns), high[1] - cell_m * np.arange(rows)
    # Planes inside the convex hull; outside it the height of the nearest point
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    heights = np.empty(len(nodes))
    try:
        hull = Delaunay(points.xy[ConvexHull(points.xy).vertices])
    except QhullError:
        raise InputError("a surface cannot be interpolated from points on a line: use a DEM") from None
    for start in range(0, len(nodes), MEMORY.rows):
        part = slice(start, start + MEMORY.rows)
        inside = hull.find_simplex(nodes[part]) >= 0
        node_heights = points.height[points.tree.query(nodes[part])[1]]
        node_heights[inside] = _fit_planes(points, nodes[part][inside])
        heights[part] = node_heights
    heights = heights.reshape(rows, columns)
    step = cell_m / scale
    grid_nodes = GridSurface.from_array(heights, (x[0] / scale[0], y[0] / scale[1]), (step[0], -step[1]))
    return grid_nodes, int(np.sum(~keep))


@dataclass(frozen=True, eq=False)
class _Points:
    """Plane coordinates ``xy (n, 2)`` of points in m, with heights (m) and their variances (m²), ``(n,)``."""

    xy: np.ndarray
    height: np.ndarray
    variance: np.ndarray

    @cached_property
    def tree(self) -> KDTree:
        return KDTree(self.xy)

    @cached_property
    def scatter_m(self) -> float:
        """Robust standard deviation of the points from planes through their neighbours (m)."""
        neighbours = self.tree.query(self.xy, k=np.arange(2, min(SAMPLES.fewest + 1, len(self.xy)) + 1))[1]
        A = np.concatenate(
            [np.ones_like(self.xy[neighbours][..., :1]), self.xy[neighbours] - self.xy[:, None]], axis=-1
        )
        plane = np.linalg.pinv(A) @ self.height[neighbours][..., None]
        return max(float(robust_sigma(self.height - plane[:, 0, 0])), EQUALITY.position_m)

    @property
    def spacing_m(self) -> float:
        return float(np.sqrt(np.prod(np.maximum(np.ptp(self.xy, axis=0), 1.0)) / len(self.xy)))


def _fit_planes(points: _Points, nodes: np.ndarray) -> np.ndarray:
    """Return the heights ``(m,)`` of robust planes at nodes ``(m, 2)``, within the range of the points' heights."""
    count = min(POINT_SURFACE.fitted, len(points.xy))
    distance, neighbours = points.tree.query(nodes, k=np.arange(1, count + 1))
    width = np.maximum(POINT_SURFACE.width * distance[:, min(POINT_SURFACE.nearest, count) - 1], 1e-3)[:, None]
    offset = (points.xy[neighbours] - nodes[:, None]) / width[..., None]
    height, scatter = points.height[neighbours], points.scatter_m
    nearness = np.exp(0.5 * ((distance[:, :1] / width) ** 2 - (distance / width) ** 2))  # 1 for the nearest
    P = nearness / (points.variance[neighbours] + (0.5 * scatter) ** 2)
    A = np.concatenate([np.ones_like(offset[..., :1]), offset], axis=-1)
    robust = np.ones_like(P)
    for tolerance in POINT_SURFACE.scatters:
        weighted = A * (P * robust)[..., None]
        N = np.swapaxes(A, 1, 2) @ weighted
        N[:, [1, 2], [1, 2]] += (GROUND.slope * width) ** -2
        x = np.linalg.solve(N, np.einsum("mki,mk->mi", weighted, height)[..., None])
        v = height - (A @ x)[..., 0]
        robust = (1.0 + (v / (tolerance * scatter)) ** 2) ** -2
    return np.clip(x[:, 0, 0], height.min(axis=1), height.max(axis=1))
