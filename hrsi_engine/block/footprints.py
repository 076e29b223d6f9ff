"""Footprints: outlines of images on the ground as polygons, their overlap, and pairs that touch.

Polygons are in degrees of longitude and latitude. Longitudes go on beyond 180 where an image lies across it, so that
two polygons may be a whole turn apart; the functions of this module bring them together.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from shapely.affinity import translate
from shapely.errors import ShapelyDeprecationWarning
from shapely.geometry import MultiPoint, Polygon
from shapely.strtree import STRtree

from ..foundation.large_arrays import finite_rows
from ..ground.geodesy import continuous_longitudes
from .block import Image, stack_of

OUTLINE_PER_SIDE = 8


def compute_footprint(image: Image, height_m: float | np.ndarray, per_side: int = OUTLINE_PER_SIDE) -> Polygon:
    """Return the outline of an image on the ground; empty where fewer than three of its points have a position.

    height_m : of the ground (ellipsoidal), one for all or one for each point of ``image.outline_px(per_side)``
    """
    return make_polygon(image.rpc.localize(image.outline_px(per_side), height_m).ground)


def compute_footprints(images: Sequence[Image], height_m: float, per_side: int = OUTLINE_PER_SIDE) -> list[Polygon]:
    """Return the outlines of many images on the ground at one height, see `footprint`."""
    if not images:
        return []
    outlines = np.concatenate([image.outline_px(per_side) for image in images])
    which = np.repeat(np.arange(len(images)), 4 * per_side)
    ground = stack_of(images).localize(which, outlines, height_m)
    return [make_polygon(ring) for ring in ground.reshape(len(images), -1, 3)]


def compute_footprint_hull(image: Image, low_m: float, high_m: float) -> Polygon:
    """Return a polygon that contains the footprints of an image at all heights between two."""
    hull = MultiPoint(_join(_compute_outlines(image, np.array([low_m, high_m]), 3).reshape(-1, 3))).convex_hull
    return hull if hull.geom_type == "Polygon" else Polygon()


def _compute_outlines(image: Image, heights_m: np.ndarray, per_side: int) -> np.ndarray:
    """Return an image's outline on the ground at several heights, ``(heights, 4 * per_side, 3)``."""
    outline = image.outline_px(per_side)
    ground = image.rpc.localize(np.tile(outline, (len(heights_m), 1)), np.repeat(heights_m, len(outline))).ground
    return ground.reshape(len(heights_m), -1, 3)


def make_polygon(ground: np.ndarray) -> Polygon:
    """Return the polygon through ground points ``(k, 2)`` or ``(k, 3)``, those without a position left out.

    An outline that crosses itself, as that of a broken RPC may, is replaced by its convex hull.
    """
    ring = _join(ground)
    if len(ring) < 3:
        return Polygon()
    polygon = Polygon(ring)
    return polygon if polygon.is_valid else polygon.convex_hull


def _join(ground: np.ndarray) -> np.ndarray:
    """Return finite lon, lat ``(k, 2)``, the longitudes without a jump at 180."""
    lonlat = ground[finite_rows(ground), :2]
    return np.column_stack([continuous_longitudes(lonlat[:, 0]), lonlat[:, 1]])


def list_corners(polygon: Polygon) -> np.ndarray:
    """Return the corners ``(k, 2)`` lon, lat of a polygon, the first one again at the end."""
    return np.asarray(polygon.exterior.coords, dtype=np.float64).reshape(-1, 2)


def intersect_footprints(first: Polygon, second: Polygon) -> Polygon:
    """Return the intersection of two footprints, empty where they do not meet."""
    return first.intersection(_shift_to(second, first)) if not (first.is_empty or second.is_empty) else Polygon()


def compute_overlap(first: Polygon, second: Polygon) -> tuple[float, float]:
    """Return the overlap as a share (0 to 1) of the first and of the second footprint."""
    common = intersect_footprints(first, second).area
    return (common / first.area, common / second.area) if common > 0.0 else (0.0, 0.0)


def find_touching_pairs(polygons: Sequence[Polygon]) -> list[tuple[int, int]]:
    """Return the pairs of indices, first < second, of polygons that touch or overlap, in order."""
    known = [number for number, polygon in enumerate(polygons) if not polygon.is_empty]
    if not known:
        return []
    together = [_shift_to(polygons[number], polygons[known[0]]) for number in known]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ShapelyDeprecationWarning)  # 1.8 announces what 2 does otherwise: see below
        tree = STRtree(together)
    place = {id(polygon): number for number, polygon in enumerate(together)}
    pairs = []
    for number, polygon in enumerate(together):
        for found in tree.query(polygon):
            # Shapely 1.8 answers with the polygons themselves, 2 with their places.
            other = int(found) if isinstance(found, np.integer) else place[id(found)]
            if other > number and polygon.intersects(together[other]):
                pairs.append((known[number], known[other]))
    return sorted(pairs)


def _shift_to(polygon: Polygon, other: Polygon) -> Polygon:
    """Return a polygon shifted by multiples of 360 degrees to the longitude of another one."""
    turns = round((other.bounds[0] - polygon.bounds[0]) / 360.0)
    return translate(polygon, 360.0 * turns) if turns else polygon
