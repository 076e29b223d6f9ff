"""Terrain from scattered points, for places without a DEM: a triangulated surface through the adjusted tie points."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import KDTree

from ..dem import GridSurface
from ..errors import InputError
from ..geodesy import LocalFrame, metres_per_degree, wrap_degrees

NEIGHBOURS = 12  # points around each, whose median height it is compared with
BLUNDER_NMAD = 6.0
CELLS_PER_SPACING = 2.0
MOST_CELLS = 4_000_000
MARGIN_SPACINGS = 200.0  # how far the surface goes on around the points, at the height of the nearest ones


def surface_of_points(ground: np.ndarray) -> tuple[GridSurface, int]:
    """Return a surface through points ``(n, 3)`` (lon, lat, ellipsoidal height), and how many were left out.

    The surface is linear within Delaunay triangles, sampled at half the points' mean spacing; outside the points it
    takes the height of the nearest point. Left out are points far from the median height of their neighbours (a wrong
    match of a tie point across the epipolar direction is found by the adjustment, one along it is not).

    Raises `InputError` with fewer than three points.
    """
    ground = ground[np.isfinite(ground).all(axis=1)]
    if len(ground) < 3:
        raise InputError(f"a surface needs 3 points with heights or more, there are {len(ground)}: use a DEM")
    middle = float(np.median(ground[:, 0]))
    ground = np.column_stack([middle + wrap_degrees(ground[:, 0] - middle), ground[:, 1:]])
    frame = LocalFrame(middle, float(np.median(ground[:, 1])), float(np.median(ground[:, 2])))
    xy = frame.from_ground(np.column_stack([ground[:, :2], np.full(len(ground), frame.height_m)]))[:, :2]
    keep = _plausible(xy, ground[:, 2])
    return _gridded(ground[keep], xy[keep]), int(np.sum(~keep))


def _plausible(xy: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return which points do not stand out from their neighbours."""
    count = min(NEIGHBOURS + 1, len(xy))
    _, index = KDTree(xy).query(xy, k=count)
    away = np.abs(height - np.median(height[index], axis=1))
    spread = 1.4826 * np.median(np.abs(height[index] - np.median(height[index], axis=1)[:, None]), axis=1)
    typical = max(1.4826 * float(np.median(away)), 0.1)
    return np.asarray(away <= BLUNDER_NMAD * np.maximum(spread, typical))


def _gridded(ground: np.ndarray, xy: np.ndarray) -> GridSurface:
    """Return the triangulated surface sampled on a grid of degrees."""
    area = np.prod(np.maximum(np.ptp(xy, axis=0), 1.0))
    spacing = float(np.sqrt(area / len(xy)))
    reach = np.minimum(MARGIN_SPACINGS * spacing, np.ptp(xy, axis=0).max())
    cell_m = max(spacing / CELLS_PER_SPACING, float(np.sqrt(np.prod(np.ptp(xy, axis=0) + 2.0 * reach) / MOST_CELLS)))
    scale = metres_per_degree(np.median(ground, axis=0)[None])[0, :2]
    low, high = ground[:, :2].min(axis=0) - reach / scale, ground[:, :2].max(axis=0) + reach / scale
    columns, rows = (np.ceil((high - low) * scale / cell_m).astype(int) + 1).tolist()
    step = cell_m / scale
    lon, lat = low[0] + step[0] * np.arange(columns), high[1] - step[1] * np.arange(rows)
    nodes = np.stack(np.meshgrid(lon, lat), axis=-1).reshape(-1, 2)
    heights = LinearNDInterpolator(ground[:, :2] * scale, ground[:, 2])(nodes * scale)
    outside = np.isnan(heights)
    _, nearest = KDTree(ground[:, :2] * scale).query(nodes[outside] * scale)
    heights[outside] = ground[nearest, 2]
    return GridSurface.from_array(heights.reshape(rows, columns), (lon[0], lat[0]), (step[0], -step[1]))
