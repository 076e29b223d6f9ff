"""PROJ's choice among the coordinate operations of a CRS, for all points of an array at once.

``cs2cs`` and GDAL choose point by point (``proj_create_crs_to_crs``, ``pj_get_suggested_operation``): of the operations
whose area of use, as a rectangle in the source CRS, holds the point they take the one of best accuracy, where two are
equal that of the smaller area, and an operation for land before one for the sea.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pyproj

from .operation_uses import WORLD, CrsOperation

EDGE_NODES = 21  # along each side of an area of use, to find its rectangle in the source CRS, as PROJ does
OFFSHORE = "- offshore"
Rectangle = tuple[float, float, float, float]  # low x, low y, high x, high y


def choose_operations(
    xy: np.ndarray, operations: Sequence[CrsOperation], areas: Sequence[Sequence[Rectangle]],
    without: Mapping[int, np.ndarray],
) -> np.ndarray:  # fmt: skip
    """Return the number of the operation for each point ``(n,)`` by PROJ's rule, -1 where none is left.

    ``xy (n, 2 or 3)`` and the ``areas`` where each of the ``operations`` can be used are in the same coordinates;
    ``without`` are masks ``(n,)`` of the points for which an operation is out. Where one is chosen for all points, the
    stride is 0.
    """
    if len(areas) == 1 and not without:
        return np.broadcast_to(0, len(xy))
    if not len(xy):
        return np.zeros(0, dtype=np.int64)
    x, y = xy[:, 0], xy[:, 1]
    # Where each area holds all points or none, what is chosen for one holds for all
    low_x, low_y, high_x, high_y = np.fmin.reduce(x), np.fmin.reduce(y), np.fmax.reduce(x), np.fmax.reduce(y)
    met = [
        (one, r)
        for one, rectangles in enumerate(areas)
        for r in rectangles
        if not (high_x < r[0] or low_x > r[2] or high_y < r[1] or low_y > r[3])
    ]
    whole = all(r[0] <= low_x and r[1] <= low_y and r[2] >= high_x and r[3] >= high_y for _, r in met)
    if whole and not without:
        x, y = np.array([low_x]), np.array([low_y])
    best, accuracy = np.full(len(x), -1), np.full(len(x), np.inf)
    within = np.tile([-np.inf, -np.inf, np.inf, np.inf], (len(x), 1))
    for one, r in met:
        operation = operations[one]
        inside = (x >= r[0]) & (y >= r[1]) & (x <= r[2]) & (y <= r[3])
        if one in without:
            inside &= ~without[one]
        better = best < 0
        if operation.accuracy_m is not None and OFFSHORE not in operation.area:
            smaller = (within[:, :2] <= r[:2]).all(axis=1) & (within[:, 2:] >= r[2:]).all(axis=1)
            smaller &= (within != r).any(axis=1)
            same = accuracy == operation.accuracy_m
            better |= (operation.accuracy_m < accuracy) | (same & smaller)
        here = inside & better
        best[here], within[here] = one, r
        accuracy[here] = -1.0 if operation.accuracy_m is None else operation.accuracy_m
    for one, operation in enumerate(operations):  # outside all areas: the first that needs no grid
        if not operation.grids:
            best[(best < 0) & ~without.get(one, np.zeros(len(x), dtype=bool))] = one
    return best if len(best) == len(xy) else np.broadcast_to(best, len(xy))


def split_at_180(bounds: Rectangle) -> tuple[Rectangle, ...]:
    """Return an area (west, south, east, north) as one rectangle in degrees, two where it lies across 180 degrees."""
    west, south, east, north = bounds
    return (bounds,) if west <= east else ((west, south, 180.0, north), (-180.0, south, east, north))


def find_rectangles(flat: pyproj.CRS, areas: Sequence[Rectangle]) -> list[tuple[Rectangle, ...]]:
    """Return areas of use (west, south, east, north) as rectangles in a CRS; none where it cannot show an area.

    As PROJ does it: by `EDGE_NODES` nodes along each side, on the CRS's ellipsoid, without a datum.
    """
    everywhere = (-np.inf, -np.inf, np.inf, np.inf)
    if flat.is_geocentric or flat.ellipsoid is None:
        return [(everywhere,)] * len(areas)
    axis, inverse = flat.ellipsoid.semi_major_metre, flat.ellipsoid.inverse_flattening
    shape = f"+rf={inverse!r}" if inverse else f"+b={axis!r}"
    degrees = pyproj.CRS.from_user_input(f"+proj=longlat +a={axis!r} {shape} +no_defs +type=crs")
    to_flat = pyproj.Transformer.from_crs(degrees, flat, always_xy=True)
    found = []
    for area in areas:
        rectangles = []
        for west, south, east, north in split_at_180(area):
            if (west, south, east, north) == WORLD:
                rectangles.append(everywhere)
                continue
            lon, lat = np.linspace(west, east, EDGE_NODES), np.linspace(south, north, EDGE_NODES)
            x, y = to_flat.transform(
                np.concatenate([lon, lon, np.full(EDGE_NODES, west), np.full(EDGE_NODES, east)]),
                np.concatenate([np.full(EDGE_NODES, south), np.full(EDGE_NODES, north), lat, lat]),
            )
            known = np.isfinite(x) & np.isfinite(y)
            if known.any():
                x, y = x[known], y[known]
                rectangles.append((float(x.min()), float(y.min()), float(x.max()), float(y.max())))
        found.append(tuple(rectangles))
    return found
