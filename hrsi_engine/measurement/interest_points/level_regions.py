"""Candidate regions: compact areas that are brighter, darker or more homogeneous than their surroundings.

Bright and dark regions are maximally stable extremal regions (Matas et al. 2002) of the image in local standard
deviations; large ones are also searched in the image reduced by 4. Homogeneous ("even") regions are those of the
gradient magnitude, with any surroundings: a grey roof between bright crowns and dark shadows has no closed grey level
but a closed edge. Only compact regions are kept: their second moments agree with the area of an ellipse or rectangle.

Stable regions are found by OpenCV, or without it from the component tree. A region is a connected component of the
pixels that are at least as bright as a level. As the level falls, regions grow and merge, which forms a tree: a node is
a region at the level of its darkest pixels, its parent the region that it grows into, its main part the largest of
those that it grew from. Its change is ``(outer - inner) / area``, with the areas ``delta`` levels further down the tree
and up its main parts. It is stable if it changes no more than its parent and than any region it grew from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ...foundation.pixel_filters import blur, reduce_by_area, reduce_mask, should_use_opencv, slopes
from ...foundation.thresholds import threshold, thresholds
from .corners import SIMULATED_OBJECTS, make_gaussian_kernels

BRIGHT, DARK, HOMOGENEOUS = 1, -1, 0


@thresholds
class REGION:
    """Limits for stable and compact regions of grey levels and gradients (MSER), candidates of objects."""

    scales: tuple[int, int] = threshold((1, 4), "", "reduction factors of the image for the search")
    smoothing_px: float = threshold(0.7, "px", "standard deviation of the smoothing filter")
    level_step: float = threshold(0.05, "sigma", "difference of the 256 grey levels, in local standard deviations")
    stable_steps: int = threshold(4, "levels", "difference of the levels compared", SIMULATED_OBJECTS)
    largest_change: float = threshold(0.7, "", "largest relative change of area between them", SIMULATED_OBJECTS)
    even_stable_steps: int = threshold(
        16, "levels", "difference of the compared gradient levels (even regions)", SIMULATED_OBJECTS
    )
    even_largest_change: float = threshold(1.0, "", "largest relative change of area between them", SIMULATED_OBJECTS)
    half_slope: float = threshold(0.5, "sigma/px", "gradient at half of the gradient levels")
    even_inset_px: float = threshold(1.5, "px", "distance of an even region's border from its edge")
    smallest_at_scale_px: int = threshold(12, "px", "smallest side of a region in reduced pixels")
    fewest_pixels: int = threshold(12, "px", "smallest area of a region")
    compactness: float = threshold(0.86, "", "smallest area over that of the inertial ellipse", SIMULATED_OBJECTS)
    largest_elongation: float = threshold(4.0, "", "largest ratio of the axes; longer regions are roads and shadows")


@dataclass(frozen=True, eq=False)
class LevelRegions:
    """Compact regions of a window.

    pixels : (k, 2) column, row of the pixels, sorted by region, in the window reduced by ``scale``
    bounds : (n + 1,) first pixel of each region; scale : (n,); sign : (n,) `BRIGHT`, `DARK` or `HOMOGENEOUS`
    """

    pixels: np.ndarray
    bounds: np.ndarray
    scale: np.ndarray
    sign: np.ndarray

    def __len__(self) -> int:
        return len(self.scale)

    def centres(self) -> np.ndarray:
        """Return the mean position of each region's pixels in full-resolution pixels of the window, ``(n, 2)``."""
        total = np.add.reduceat(self.pixels.astype(np.float64), self.bounds[:-1]) if len(self) else np.empty((0, 2))
        return (total / np.diff(self.bounds)[:, None] + 0.5) * self.scale[:, None] - 0.5

    def select(self, keep: np.ndarray) -> LevelRegions:
        """Return the selected regions (mask)."""
        counts = np.diff(self.bounds)
        bounds = np.r_[0, np.cumsum(counts[keep])]
        return LevelRegions(self.pixels[np.repeat(keep, counts)], bounds, self.scale[keep], self.sign[keep])


def find_compact_regions(z: np.ndarray, usable: np.ndarray, largest_px: float) -> LevelRegions:
    """Return the compact regions of a normalised image with sides up to ``largest_px``.

    Regions with pixels that are not ``usable``, or at the edge of the window, are excluded.
    """
    tables = []
    for scale in REGION.scales:
        if scale > 1 and largest_px < REGION.smallest_at_scale_px * scale:
            break
        size, reach = (z.shape[1] // scale, z.shape[0] // scale), largest_px / scale
        closed = reduce_mask(usable, size) if scale > 1 else usable
        reduced = blur(reduce_by_area(z, size) if scale > 1 else z, REGION.smoothing_px)
        # The normalised image in steps of `REGION.level_step`, 0 … 255
        level = np.rint(np.clip(reduced / REGION.level_step + 128.0, 0.0, 255.0)).astype(np.uint8)
        for sign, steps in ((BRIGHT, level), (DARK, 255 - level)):
            found = _find_stable_regions(steps, REGION.stable_steps, REGION.largest_change, reach)
            tables.append(_select_compact(found, closed, reach, scale, sign))
        if scale == REGION.scales[0]:
            # 255 where the smoothed image has no gradient, decreasing to 0 for very steep ones
            smooth, slope = make_gaussian_kernels(0.5)
            steepness = np.hypot(*slopes(reduced, smooth, slope, "reflect"))
            evenness = np.rint(255.0 * REGION.half_slope / (steepness + REGION.half_slope)).astype(np.uint8)
            even = _find_stable_regions(evenness, REGION.even_stable_steps, REGION.even_largest_change, reach)
            tables.append(_select_compact(even, closed, reach - 2.0 * REGION.even_inset_px, scale, HOMOGENEOUS))
    counts = np.concatenate([np.diff(table.bounds) for table in tables])
    return LevelRegions(
        np.concatenate([table.pixels for table in tables]), np.r_[0, np.cumsum(counts)],
        np.concatenate([table.scale for table in tables]), np.concatenate([table.sign for table in tables]),
    )  # fmt: skip


def _find_stable_regions(
    steps: np.ndarray, stable_steps: int, largest_change: float, reach: float
) -> tuple[list, np.ndarray]:
    """Return pixels and bounding boxes of the maximally stable regions that are brighter than their surroundings."""
    limits = MserLimits(stable_steps, REGION.fewest_pixels, int(reach**2), largest_change)
    find = find_mser_by_opencv if should_use_opencv() else find_mser_by_tree
    pixels = find(steps, limits)
    if not pixels:
        return pixels, np.empty((0, 4), dtype=np.int64)
    every, begin = np.concatenate(pixels), np.cumsum([0, *map(len, pixels[:-1])])
    low = np.minimum.reduceat(every, begin)
    return pixels, np.column_stack([low, np.maximum.reduceat(every, begin) - low + 1]).astype(np.int64)


def _select_compact(
    found: tuple[list, np.ndarray], usable: np.ndarray, reach: float, scale: int, sign: int
) -> LevelRegions:  # fmt: skip
    """Return the regions of usable pixels, away from the edges, whose moments agree with their area."""
    pixels, boxes = found
    left, top, width, height = boxes.T
    count = np.array([len(p) for p in pixels], dtype=np.int64)
    keep = (width <= reach) & (height <= reach) & (left > 0) & (top > 0)
    keep &= (left + width < usable.shape[1]) & (top + height < usable.shape[0])
    keep &= count > 0.3 * width * height  # an ellipse fills 0.785 of an upright box, a square on its corner 0.5
    if scale > REGION.scales[0]:
        keep &= count >= REGION.smallest_at_scale_px**2 // 2
    chosen = [pixels[k] for k in np.flatnonzero(keep)]
    if not chosen:
        nothing = np.empty(0, dtype=np.int64)
        return LevelRegions(np.empty((0, 2), dtype=np.int32), np.zeros(1, dtype=np.int64), nothing, nothing)
    regions = LevelRegions(
        np.concatenate(chosen), np.r_[0, np.cumsum(count[keep])], np.full(len(chosen), scale),
        np.full(len(chosen), sign),
    )  # fmt: skip
    # Ratio of the axes, for even regions that of their edge, which is ``within_px`` outside the region
    within_px = REGION.even_inset_px if sign == HOMOGENEOUS else 0.0
    starts, count = regions.bounds[:-1], np.diff(regions.bounds)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, starts) / count

    columns, rows = regions.pixels.astype(np.float64).T
    x, y = mean(columns), mean(rows)
    dx, dy = columns - np.repeat(x, count), rows - np.repeat(y, count)
    xx, yy, xy = mean(dx * dx) + 1.0 / 12.0, mean(dy * dy) + 1.0 / 12.0, mean(dx * dy)
    determinant, half_trace = xx * yy - xy * xy, (xx + yy) / 2.0
    root = np.sqrt(np.maximum(half_trace**2 - determinant, 0.0))
    longer, shorter = np.sqrt(half_trace + root), np.sqrt(np.maximum(half_trace - root, 1e-9))
    slender = (2.0 * longer + within_px) / (2.0 * shorter + within_px)
    good = (count >= REGION.compactness * 4.0 * np.pi * np.sqrt(determinant)) & (slender < REGION.largest_elongation)
    if not usable.all():
        free = usable[regions.pixels[:, 1], regions.pixels[:, 0]]
        good &= np.logical_and.reduceat(free, regions.bounds[:-1])
    return regions.select(good)


class MserLimits(NamedTuple):
    """Number of levels over which a region must change little; its area limits in pixels; the largest change."""

    delta: int
    fewest: int
    most: int
    largest_change: float


def find_mser_by_opencv(image: np.ndarray, limits: MserLimits) -> list[np.ndarray]:
    """Return column and row ``(k, 2)`` of the pixels of each stable region that is brighter than its surroundings.

    Pixels at the edges of the image belong to no region.
    """
    import cv2

    finder = cv2.MSER_create(
        delta=limits.delta, min_area=limits.fewest, max_area=limits.most, max_variation=limits.largest_change
    )
    finder.setPass2Only(True)
    return list(finder.detectRegions(image)[0])


def find_mser_by_tree(image: np.ndarray, limits: MserLimits) -> list[np.ndarray]:
    """As `find_mser_by_opencv`, except for some regions with equal changes."""
    inside = np.ascontiguousarray(image[1:-1, 1:-1])
    if not inside.size:
        return []
    # Level by level, pixels are joined to the adjacent regions
    depth = (inside.max() - inside).ravel()
    pixel = np.arange(inside.size).reshape(inside.shape)  # pairs of adjacent pixels
    first = np.concatenate([pixel[:, :-1].ravel(), pixel[:-1].ravel()])
    second = np.concatenate([pixel[:, 1:].ravel(), pixel[1:].ravel()])
    later = depth[first] < depth[second]  # two neighbours are joined when the darker one is added
    first, second = np.where(later, second, first), np.where(later, first, second)
    order = np.argsort(depth[first], kind="stable")
    first, second = first[order], second[order]
    pixels = np.argsort(depth, kind="stable")
    levels = range(int(depth.max()) + 1)
    new_at = np.searchsorted(depth[pixels], np.arange(len(levels) + 1))
    pairs_at = np.searchsorted(depth[first], np.arange(len(levels) + 1))

    count, entered, place, slot = 0, np.full(depth.size, -1), *np.empty((2, depth.size), np.int64)
    regions = np.empty((5, depth.size), np.int64)  # upper limit; unused memory is not allocated
    level_of, area, parent, main, ancestor = regions  # ancestor: towards the largest region so far
    for level in levels:
        new, pairs = pixels[new_at[level] : new_at[level + 1]], slice(pairs_at[level], pairs_at[level + 1])
        place[new] = np.arange(len(new))
        beside = second[pairs]
        is_new = entered[beside] < 0
        old = _find_roots(ancestor, entered[beside[~is_new]])  # contains repetitions, which are joined with themselves
        slot[old] = np.arange(len(old))
        of_old = len(new) + np.arange(len(old))
        to = np.empty(len(beside), np.int64)
        to[is_new], to[~is_new] = place[beside[is_new]], of_old
        ends = np.concatenate([place[first[pairs]], of_old]), np.concatenate([to, len(new) + slot[old]])
        size = len(new) + len(old)
        joined = sparse.coo_matrix((np.ones(len(ends[0]), dtype=bool), ends), (size, size))
        made, region = csgraph.connected_components(joined, directed=False)
        is_once = slot[old] == np.arange(len(old))
        old = old[is_once]
        own, into = region[: len(new)], region[len(new) :][is_once] + count
        nodes = np.arange(count, count + made)
        entered[new] = count + own
        level_of[nodes], area[nodes] = level, np.bincount(own, minlength=made)
        np.add.at(area, into, area[old])
        parent[nodes] = main[nodes] = ancestor[nodes] = nodes
        parent[old] = ancestor[old] = into
        by_area = np.argsort(area[old], kind="stable")  # the largest part is written last
        main[into[by_area]] = old[by_area]
        count += made
    tree = _ComponentTree(level_of[:count], area[:count], parent[:count], main[:count], entered)
    pixels, begin = _sort_pixels_by_region(tree)
    found = []
    for region in np.flatnonzero(_is_stable(tree, limits)).tolist():
        place = pixels[begin[region] : begin[region] + tree.area[region]]
        row, column = np.divmod(place, inside.shape[1])
        found.append(np.column_stack([column + 1, row + 1]).astype(np.int32))
    return found


class _ComponentTree(NamedTuple):
    """All regions of an image, in the order of decreasing brightness of their levels.

    depth : (n,) levels below the brightest; area : (n,) pixels; parent, main : (n,) the region itself if it has none;
    entered : (pixels,) the first region that contains each pixel
    """

    depth: np.ndarray
    area: np.ndarray
    parent: np.ndarray
    main: np.ndarray
    entered: np.ndarray


def _find_roots(ancestor: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Return the largest regions so far that contain the given ones (union-find with path compression)."""
    at = region
    while not ((further := ancestor[at]) == at).all():
        ancestor[at] = ancestor[further]
        at = further
    ancestor[region] = at
    return at


def _is_stable(tree: _ComponentTree, limits: MserLimits) -> np.ndarray:
    """Return which regions are maximally stable ``(n,)``."""
    itself = np.arange(len(tree.area))
    inner = outer = itself
    for _ in range(limits.delta):  # one step of the tree is at least one level
        further = tree.main[inner]
        inner = np.where(tree.depth - tree.depth[further] <= limits.delta, further, inner)
        further = tree.parent[outer]
        outer = np.where(tree.depth[further] - tree.depth <= limits.delta, further, outer)
    change = (tree.area[outer] - tree.area[inner]) / tree.area
    has_parent, large = tree.parent != itself, tree.area >= limits.fewest
    before = np.full(len(change), np.inf)  # smallest change of the regions that it grew from
    np.minimum.at(before, tree.parent[has_parent & large], change[has_parent & large])
    stable = large & (tree.area <= limits.most) & (change <= limits.largest_change)
    return stable & (change <= before) & (change <= change[tree.parent])


def _sort_pixels_by_region(tree: _ComponentTree) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels in an order in which those of each region are contiguous, and their first position ``(n,)``."""
    begin = np.zeros(len(tree.area), np.int64)
    taken = np.bincount(tree.entered, minlength=len(tree.area))  # the region's own pixels are first
    by_level = np.split(np.arange(len(tree.area)), np.flatnonzero(np.diff(tree.depth)) + 1)
    for nodes in reversed(by_level):  # parents before their parts
        parts = nodes[tree.parent[nodes] != nodes]
        parts = parts[np.argsort(tree.parent[parts], kind="stable")]
        parents = tree.parent[parts]
        before = np.cumsum(tree.area[parts]) - tree.area[parts]
        _, first, which = np.unique(parents, return_index=True, return_inverse=True)
        begin[parts] = begin[parents] + taken[parents] + before - before[first][which]
        np.add.at(taken, parents, tree.area[parts])  # parts from other levels follow
    return np.argsort(begin[tree.entered], kind="stable"), begin
