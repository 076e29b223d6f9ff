"""Imaging geometry: GSD, incidence and azimuth, convergence, B/H and overlap; sanity checks of an RPC.

Definitions, at a ground point on the terrain:

* incidence: angle between the ray to the satellite and the ellipsoid's vertical;
* azimuth: horizontal direction from the target to the satellite, clockwise from north;
* GSD along sample (line): length on a horizontal plane of a step of one sample (line);
* convergence: angle between the two rays of a pair;
* B/H: horizontal distance of the two rays at unit height above the point where they meet;
* overlap: share of an image's area on the terrain that the other image also shows. It depends on the height of the
  terrain: two oblique images can overlap at one height and not at another.

Footprints, outlines of images on the ground, are polygons in degrees of longitude and latitude. If an image crosses 180
degrees, its longitudes continue beyond 180, so that two polygons can differ by 360 degrees; the functions of this
module shift them together.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from shapely.affinity import translate
from shapely.errors import ShapelyDeprecationWarning
from shapely.geometry import MultiPoint, Polygon
from shapely.strtree import STRtree

from ..camera.rpc import RPC
from ..camera.rpc_fit import make_virtual_grid
from ..camera.rpc_stack import RPCStack
from ..foundation.errors import SolveError
from ..foundation.large_arrays import finite_rows
from ..foundation.thresholds import GRIDS, threshold, thresholds
from ..ground.geodesy import continuous_longitudes, ground_difference_m
from ..surface.dem import HeightSurface, Status, intersect_surface, surface_heights
from ..surface.grid_surface import ConstantHeight
from .block import Image, stack_rpcs

OUTLINE_PER_SIDE = 8


def compute_footprint(image: Image, height_m: float | np.ndarray) -> Polygon:
    """Return the outline of an image on the ground; empty if fewer than three of its points have a ground position.

    height_m : ellipsoidal height of the ground, one for all or one for each point of the outline
    """
    return make_polygon(image.rpc.localize(image.outline_px(OUTLINE_PER_SIDE), height_m).ground)


def compute_footprints(images: Sequence[Image], height_m: float | Sequence[float]) -> list[Polygon]:
    """Return the outlines of images on the ground at one height, or one for each; see `compute_footprint`."""
    if not images:
        return []
    outlines = np.concatenate([image.outline_px(OUTLINE_PER_SIDE) for image in images])
    owner = np.repeat(np.arange(len(images)), 4 * OUTLINE_PER_SIDE)
    heights = np.broadcast_to(np.asarray(height_m, dtype=np.float64), (len(images),))
    ground = stack_rpcs(images).localize(owner, outlines, heights[owner])
    return [make_polygon(ring) for ring in ground.reshape(len(images), -1, 3)]


def compute_footprint_hull(image: Image, low_m: float, high_m: float) -> Polygon:
    """Return a polygon that contains the footprints of an image at all heights between two heights."""
    outline = image.outline_px(3)
    heights_m = np.repeat([low_m, high_m], len(outline))
    hull = MultiPoint(_join(image.rpc.localize(np.tile(outline, (2, 1)), heights_m).ground)).convex_hull
    return hull if hull.geom_type == "Polygon" else Polygon()


def make_polygon(ground: np.ndarray) -> Polygon:
    """Return the polygon through ground points ``(k, 2)`` or ``(k, 3)``, without those that have no position.

    An outline that intersects itself, possibly because of a damaged RPC, is replaced by its convex hull.
    """
    ring = _join(ground)
    if len(ring) < 3:
        return Polygon()
    polygon = Polygon(ring)
    return polygon if polygon.is_valid else polygon.convex_hull


def _join(ground: np.ndarray) -> np.ndarray:
    """Return the finite lon, lat ``(k, 2)``, the longitudes without a jump at 180 degrees."""
    lonlat = ground[finite_rows(ground), :2]
    return np.column_stack([continuous_longitudes(lonlat[:, 0]), lonlat[:, 1]])


def list_corners(polygon: Polygon) -> np.ndarray:
    """Return the corners ``(k, 2)`` lon, lat of a polygon, the first one again at the end."""
    return np.asarray(polygon.exterior.coords, dtype=np.float64).reshape(-1, 2)


def intersect_footprints(first: Polygon, second: Polygon) -> Polygon:
    """Return the intersection of two footprints, empty if they are disjoint."""
    return first.intersection(_shift_to(second, first)) if not (first.is_empty or second.is_empty) else Polygon()


def compute_overlap(first: Polygon, second: Polygon) -> tuple[float, float]:
    """Return the overlap as a share (0 to 1) of the first and of the second footprint."""
    common = intersect_footprints(first, second).area
    return (common / first.area, common / second.area) if common > 0.0 else (0.0, 0.0)


def find_touching_pairs(polygons: Sequence[Polygon]) -> list[tuple[int, int]]:
    """Return the index pairs, first < second, of polygons that touch or overlap, in ascending order."""
    nonempty = [number for number, polygon in enumerate(polygons) if not polygon.is_empty]
    if not nonempty:
        return []
    tree_pairs = [_shift_to(polygons[number], polygons[nonempty[0]]) for number in nonempty]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ShapelyDeprecationWarning)  # of Shapely 1.8 on a change in 2, see below
        tree = STRtree(tree_pairs)
    place = {id(polygon): number for number, polygon in enumerate(tree_pairs)}
    pairs = []
    for number, polygon in enumerate(tree_pairs):
        for match in tree.query(polygon):
            # Shapely 1.8 returns the polygons themselves, 2 their indices
            second = int(match) if isinstance(match, np.integer) else place[id(match)]
            if second > number and polygon.intersects(tree_pairs[second]):
                pairs.append((nonempty[number], nonempty[second]))
    return sorted(pairs)


def _shift_to(polygon: Polygon, second: Polygon) -> Polygon:
    """Return a polygon shifted by multiples of 360 degrees to the longitude of another one."""
    turns = round((second.bounds[0] - polygon.bounds[0]) / 360.0)
    return translate(polygon, 360.0 * turns) if turns else polygon


@thresholds
class GEOMETRY:
    """Sampling of an image's terrain and RPC, and limits of a plausible RPC."""

    ray_reach_m: float = threshold(100.0, "m", "heights above and below the terrain, between which rays are computed")
    least_denominator: float = threshold(0.1, "", "smallest denominator of an RPC relative to its median")
    lowest_height_m: float = threshold(-600.0, "m", "lowest land, with a margin", "theory: Dead Sea shore, -430 m")
    highest_height_m: float = threshold(9500.0, "m", "highest land, with a margin", "theory: Mount Everest, 8849 m")


@dataclass(frozen=True)
class ViewGeometry:
    """Imaging geometry at the centre of an image.

    centre : (3,) lon, lat in degrees, ellipsoidal height in metres
    gsd_sample_m, gsd_line_m : ground distances of neighbouring samples and of neighbouring lines
    incidence_deg : angle between the line of sight and the vertical on the ground
    azimuth_deg : direction from the ground to the satellite, clockwise from north
    footprint : (k, 2) the image's outline as lon, lat in degrees
    """

    centre: np.ndarray
    gsd_sample_m: float
    gsd_line_m: float
    incidence_deg: float
    azimuth_deg: float
    footprint: np.ndarray


@dataclass(frozen=True)
class PairGeometry:
    """Imaging geometry of two images at the centre of their common ground.

    The angle and ratio are None if the images do not overlap.

    first, second : ids of the images
    overlap : common area as a share (0 to 1) of the first and of the second image
    convergence_deg : angle between the two lines of sight; base_to_height : base over height, without unit
    """

    first: str
    second: str
    overlap: tuple[float, float]
    convergence_deg: float | None
    base_to_height: float | None


class ViewDirection:
    """An image with its terrain, and quantities derived from both.

    image : the image; surface : the terrain
    """

    def __init__(self, image: Image, surface: HeightSurface) -> None:
        self.image, self.surface = image, surface

    @classmethod
    def at_heights(cls, images: Sequence[Image], heights_m: Sequence[float]) -> list[ViewDirection]:
        """Return views of horizontal ground at a height for each image, with all centres and footprints at once.

        Views of images whose centre has no position compute theirs, and raise the error, when asked.
        """
        views = [cls(image, ConstantHeight(height)) for image, height in zip(images, heights_m, strict=True)]
        middle = np.array([image.centre_px for image in images])
        centres = stack_rpcs(images).localize(np.arange(len(images)), middle, np.asarray(heights_m))
        for view, centre, footprint in zip(views, centres, compute_footprints(images, heights_m), strict=True):
            if np.isfinite(centre).all():
                view.centre, view.footprint = centre[None], footprint
        return views

    @property
    def is_sound(self) -> bool:
        """False if the image's centre has no position on the terrain: its RPC is damaged, or the DEM too small."""
        try:
            return bool(np.isfinite(self.centre).all())
        except SolveError:
            return False

    @cached_property
    def terrain(self) -> np.ndarray:
        """Ground points ``(n, 3)`` of a grid over the image, those that intersect the terrain."""
        ground, status = intersect_surface(self.image.rpc, self.image.grid_px(GRIDS.fine, GRIDS.fine), self.surface)
        return ground[status == Status.FOUND]

    @cached_property
    def centre(self) -> np.ndarray:
        """Ground position ``(1, 3)`` of the image's centre; raises `SolveError` if it has none on the terrain."""
        ground, status = intersect_surface(self.image.rpc, self.image.centre_px[None], self.surface)
        if status[0] != Status.FOUND:
            reason = Status(status[0]).label
            raise SolveError(
                f"image {self.image.id}: its centre has no position on the terrain ({reason}): check the RPC, use a "
                "DEM that covers the image, or give the `height` of the ground"
            )
        return ground

    @cached_property
    def footprint(self) -> Polygon:
        """The outline on the terrain; for points without terrain, at the height of the image's centre."""
        outline = self.image.outline_px(OUTLINE_PER_SIDE)
        ground, status = intersect_surface(self.image.rpc, outline, self.surface)
        unknown = status != Status.FOUND
        ground[unknown] = self.image.rpc.localize(outline[unknown], float(self.centre[0, 2])).ground
        return make_polygon(ground)

    def geometry(self) -> ViewGeometry:
        """Return the imaging geometry at the image's centre.

        Result: centre, GSD, incidence, azimuth and footprint.
        Raises `SolveError`: the image's centre has no position on the terrain.
        """
        return describe_views([self.image], self.centre, [self.footprint])[0]


def describe_views(images: Sequence[Image], centres: np.ndarray, footprints: Sequence[Polygon]) -> list[ViewGeometry]:
    """Return the imaging geometry of images at their centres ``(n, 3)`` on the ground."""
    if not images:
        return []
    stack, owner = stack_rpcs(images), np.arange(len(images))
    _, by_ground = stack.project_with_metric_jacobian(owner, centres)
    steps = np.linalg.inv(by_ground[:, :, :2])  # columns: metres east and north of one sample, one line
    east, north, up = _find_stacked_directions(stack, owner, centres).T
    angles = np.degrees([np.arctan2(np.hypot(east, north), up), np.arctan2(east, north) % (2.0 * np.pi)])
    return [
        ViewGeometry(centre, step[0], step[1], angle[0], angle[1], list_corners(footprint))
        for centre, step, angle, footprint in zip(
            centres, np.hypot(steps[:, 0], steps[:, 1]).tolist(), angles.T.tolist(), footprints, strict=True
        )
    ]


def measure_pixel_m(rpc: RPC, ground: np.ndarray) -> tuple[float, float]:
    """Return the ground distances in metres of neighbouring samples and of neighbouring lines at a point ``(1, 3)``."""
    _, by_ground = rpc.project_with_metric_jacobian(ground)
    steps = np.linalg.inv(by_ground[0, :, :2])  # columns: metres east and north of one sample, one line
    return float(np.hypot(*steps[:, 0])), float(np.hypot(*steps[:, 1]))


def compute_view_directions(rpc: RPC, ground: np.ndarray) -> np.ndarray:
    """Return unit vectors ``(n, 3)`` east, north, up from ground points to the satellite."""
    image = rpc.project(ground)
    return _find_directions(ground, lambda height_m: rpc.localize(image, height_m).ground)


def _find_stacked_directions(stack: RPCStack, index: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return `compute_view_directions` of ground points, each for its camera ``index (n,)`` of a stack."""
    image = stack.project(index, ground)
    return _find_directions(ground, lambda height_m: stack.localize(index, image, height_m))


def _find_directions(ground: np.ndarray, ray_at: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the unit vectors ``(n, 3)`` of rays, from their positions ``(n, 3)`` at heights ``(n,)``."""
    ray = ground_difference_m(
        *(ray_at(ground[:, 2] + reach) for reach in (GEOMETRY.ray_reach_m, -GEOMETRY.ray_reach_m))
    )
    return np.asarray(ray / np.linalg.norm(ray, axis=1, keepdims=True))


def compute_pair_geometries(views: Sequence[ViewDirection], pairs: Sequence[tuple[int, int]]) -> list[PairGeometry]:
    """Return overlap, convergence and base-to-height ratio of pairs of views (indices)."""
    middles, overlaps = np.full((len(pairs), 3), np.nan), list[tuple[float, float]]()
    numbers = sorted({number for pair in pairs for number in pair if not views[number].footprint.is_empty})
    outlines = [_shift_to(views[number].footprint, views[numbers[0]].footprint) for number in numbers]
    footprints = dict(zip(numbers, outlines, strict=True))
    areas = {number: footprint.area for number, footprint in footprints.items()}
    for middle, (first, second) in zip(middles, pairs, strict=True):
        common = footprints.get(first, Polygon()).intersection(footprints.get(second, Polygon()))
        area = common.area
        overlaps.append((area / areas[first], area / areas[second]) if area > 0.0 else (0.0, 0.0))
        if area > 0.0:
            middle[:2] = common.centroid.coords[0]
            height = float(surface_heights(views[first].surface, middle[None, :2])[0])
            middle[2] = height if np.isfinite(height) else views[first].centre[0, 2]
    # Rays of both images at the middle of their common ground
    meeting = np.flatnonzero(np.isfinite(middles[:, 2]))
    angles, bases = np.full(len(pairs), np.nan), np.full(len(pairs), np.nan)
    if len(meeting):
        stack = stack_rpcs([view.image for view in views])
        rays = [_find_stacked_directions(stack, images, middles[meeting]) for images in np.array(pairs)[meeting].T]
        cross, dot = np.cross(rays[0], rays[1]), np.einsum("nk,nk->n", *rays)
        angles[meeting] = np.degrees(np.arctan2(np.linalg.norm(cross, axis=1), dot))
        bases[meeting] = np.linalg.norm(rays[0] / rays[0][:, 2:] - rays[1] / rays[1][:, 2:], axis=1)
    return [
        PairGeometry(
            views[first].image.id,
            views[second].image.id,
            overlap,
            *((angle, base) if np.isfinite(angle) else (None,) * 2),
        )
        for (first, second), overlap, angle, base in zip(pairs, overlaps, angles.tolist(), bases.tolist(), strict=True)
    ]


def compute_all_pairs(views: list[ViewDirection]) -> list[PairGeometry]:
    """Return the geometry of all pairs of images; pairs whose footprints do not touch get an overlap of 0.

    views : the images with their terrain
    Result: one for each pair, in the order of the images.
    """
    touching = find_touching_pairs([view.footprint for view in views])
    result = dict(zip(touching, compute_pair_geometries(views, touching), strict=True))
    ids = [view.image.id for view in views]
    return [
        result.get((i, j)) or PairGeometry(ids[i], ids[j], (0.0, 0.0), None, None)
        for i, j in combinations(range(len(views)), 2)
    ]


# ---- sanity ----------------------------------------------------------------------------------------------------


def find_rpc_warnings(image: Image, terrain_m: tuple[float, float] | None = None) -> list[str]:
    """Return warnings about an image's RPC, with advice; empty for a plausible RPC.

    ``terrain_m`` is the lowest and highest height at which the RPC is used, None if unknown.
    """
    rpc, warnings = image.rpc, []
    if abs(rpc.lat_off) > 90.0:
        warnings.append(f"LAT_OFF is {rpc.lat_off:g}: latitude and longitude are swapped; exchange them in the RPC")
    scales = {"LINE": rpc.line_scale, "SAMP": rpc.samp_scale, "LAT": rpc.lat_scale, "LONG": rpc.long_scale}
    warnings += [f"{name}_SCALE is {value:g}, it must be above 0" for name, value in scales.items() if not value > 0.0]
    low, high = rpc.height_range
    if rpc.height_scale <= 0.0:
        warnings.append(f"HEIGHT_SCALE is {rpc.height_scale:g}, it must be above 0")
    if high < GEOMETRY.lowest_height_m or low > GEOMETRY.highest_height_m:
        warnings.append(f"the height range of the RPC is {low:.0f} to {high:.0f} m, where there is no land")
    if terrain_m is not None and (terrain_m[0] < low or terrain_m[1] > high):
        warnings.append(
            f"the terrain ({terrain_m[0]:.0f} to {terrain_m[1]:.0f} m) exceeds the height range of the RPC ({low:.0f} "
            f"to {high:.0f} m), which extrapolates there; check the height datum"
        )
    _, (ground, converged) = make_virtual_grid(
        image.rpc, image.domain_px, image.rpc.height_range, (GRIDS.nodes, GRIDS.nodes, GRIDS.coarse)
    )
    if not converged.all():
        share = 1.0 - np.mean(converged)
        warnings.append(
            f"{share:.0%} of the image has no ground position within the RPC's height range: "
            "check that image size and RPC belong together"
        )
    if converged.any():
        # Denominators over the image and height range, relative to their median
        for name, denominators in zip(("sample", "line"), image.rpc.denominators(ground[converged]), strict=True):
            lowest = float(np.min(denominators / np.median(denominators)))
            if lowest <= 0.0:
                warnings.append(
                    f"the {name} denominator becomes zero within the image: the RPC is damaged; obtain it again"
                )
            elif lowest < GEOMETRY.least_denominator:
                warnings.append(f"the {name} denominator falls to {lowest:.2g} of its usual value within the image")
        _, by_ground = rpc.project_with_metric_jacobian(ground[converged][converged.sum() // 2][None])
        if np.linalg.det(by_ground[0, :, :2]) > 0.0:
            warnings.append(
                "the image lies mirrored on the ground: latitude and longitude may be swapped in the RPC, or lines "
                "reversed"
            )
    return [f"{image.id}: {text}" for text in warnings]
