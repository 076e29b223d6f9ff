"""Maximally stable extremal regions (Matas et al. 2002): by OpenCV, or where it is missing by a tree of all regions.

A region is a connected part of the pixels that are at least as bright as a level. As the level falls, regions grow and
merge, which makes a tree: a node is a region at the level of its darkest pixels, its parent the region that it grows
into, its main part the largest of those that it grew from. A region changes by ``(outer - inner) / area``: the areas,
up to so many levels further down the tree and up its main parts. It is stable where it changes no more than its parent
and than any of the regions that it grew from.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph


class MserLimits(NamedTuple):
    """Levels to both sides over which a region must change little; its area in pixels; the largest change."""

    delta: int
    fewest: int
    most: int
    largest_change: float


def find_mser_by_opencv(image: np.ndarray, limits: MserLimits) -> list[np.ndarray]:
    """Return column and row ``(k, 2)`` of the pixels of each stable region that is brighter than its surroundings.

    Pixels at the edges of the image belong to none.
    """
    import cv2

    finder = cv2.MSER_create(
        delta=limits.delta, min_area=limits.fewest, max_area=limits.most, max_variation=limits.largest_change
    )
    finder.setPass2Only(True)
    return list(finder.detectRegions(image)[0])


def find_mser_by_tree(image: np.ndarray, limits: MserLimits) -> list[np.ndarray]:
    """As `find_mser_by_opencv`, which decides otherwise here and there where two regions change alike."""
    inside = np.ascontiguousarray(image[1:-1, 1:-1])
    if not inside.size:
        return []
    tree = _build_tree(inside)
    pixels, begin = _sort_pixels_by_region(tree)
    found = []
    for region in np.flatnonzero(_is_stable(tree, limits)).tolist():
        place = pixels[begin[region] : begin[region] + tree.area[region]]
        row, column = np.divmod(place, inside.shape[1])
        found.append(np.column_stack([column + 1, row + 1]).astype(np.int32))
    return found


class _ComponentTree(NamedTuple):
    """All regions of an image, those at brighter levels first.

    depth : (n,) levels below the brightest; area : (n,) pixels; parent, main : (n,) the region itself where none;
    entered : (pixels,) the first region that holds each pixel
    """

    depth: np.ndarray
    area: np.ndarray
    parent: np.ndarray
    main: np.ndarray
    entered: np.ndarray


def _build_tree(image: np.ndarray) -> _ComponentTree:
    """Return the tree of an image of at most 256 levels: level by level, its pixels join the regions beside them."""
    depth = (image.max() - image).ravel()
    first, second = _list_neighbours(image.shape)
    later = depth[first] < depth[second]  # two neighbours are joined when the darker one enters
    first, second = np.where(later, second, first), np.where(later, first, second)
    order = np.argsort(depth[first], kind="stable")
    first, second = first[order], second[order]
    pixels = np.argsort(depth, kind="stable")
    levels = range(int(depth.max()) + 1)
    new_at = np.searchsorted(depth[pixels], np.arange(len(levels) + 1))
    pairs_at = np.searchsorted(depth[first], np.arange(len(levels) + 1))

    count, entered, place, slot = 0, np.full(depth.size, -1), *np.empty((2, depth.size), np.int64)
    regions = np.empty((5, depth.size), np.int64)  # not more than pixels; all but a few never used, and take no memory
    level_of, area, parent, main, ancestor = regions  # ancestor: leads to the largest region so far
    for level in levels:
        new, pairs = pixels[new_at[level] : new_at[level + 1]], slice(pairs_at[level], pairs_at[level + 1])
        place[new] = np.arange(len(new))
        beside = second[pairs]
        is_new = entered[beside] < 0
        old = _find_roots(ancestor, entered[beside[~is_new]])  # many times the same: it is joined with itself
        slot[old] = np.arange(len(old))
        of_old = len(new) + np.arange(len(old))
        to = np.empty(len(beside), np.int64)
        to[is_new], to[~is_new] = place[beside[is_new]], of_old
        made, region = _group_pairs(
            len(new) + len(old), np.r_[place[first[pairs]], of_old], np.r_[to, len(new) + slot[old]]
        )
        is_once = slot[old] == np.arange(len(old))
        old = old[is_once]
        own, into = region[: len(new)], region[len(new) :][is_once] + count
        nodes = np.arange(count, count + made)
        entered[new] = count + own
        level_of[nodes], area[nodes] = level, np.bincount(own, minlength=made)
        np.add.at(area, into, area[old])
        parent[nodes] = main[nodes] = ancestor[nodes] = nodes
        parent[old] = ancestor[old] = into
        by_area = np.argsort(area[old], kind="stable")  # the largest part comes last and stays
        main[into[by_area]] = old[by_area]
        count += made
    return _ComponentTree(level_of[:count], area[:count], parent[:count], main[:count], entered)


def _group_pairs(count: int, first: np.ndarray, second: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the number of connected components of ``count`` nodes joined by pairs, and the component of each node."""
    if len(first) > 500:  # a SciPy graph takes a third of a millisecond however small it is
        graph = sparse.coo_matrix((np.ones(len(first), np.int8), (first, second)), (count, count))
        return csgraph.connected_components(graph, directed=False)
    head = list(range(count))  # of each node one of its component with a number not larger
    for one, other in zip(first.tolist(), second.tolist(), strict=True):
        while head[one] != one:
            head[one] = one = head[head[one]]
        while head[other] != other:
            head[other] = other = head[head[other]]
        head[max(one, other)] = min(one, other)
    group: list[int] = []
    made = 0
    for node, before in enumerate(head):
        group.append(made if before == node else group[before])
        made += before == node
    return made, np.array(group, np.int64)


def _list_neighbours(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of pixels that share a side."""
    pixel = np.arange(shape[0] * shape[1]).reshape(shape)
    first = np.concatenate([pixel[:, :-1].ravel(), pixel[:-1].ravel()])
    return first, np.concatenate([pixel[:, 1:].ravel(), pixel[1:].ravel()])


def _find_roots(ancestor: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Return the largest regions so far that contain some; paths are shortened on the way (union-find)."""
    at = region
    while not np.array_equal(further := ancestor[at], at):
        ancestor[at] = ancestor[further]
        at = further
    ancestor[region] = at
    return at


def _is_stable(tree: _ComponentTree, limits: MserLimits) -> np.ndarray:
    """Return which regions are stable ``(n,)``."""
    itself = np.arange(len(tree.area))
    inner = outer = itself
    for _ in range(limits.delta):  # a step of the tree is a level at least
        further = tree.main[inner]
        inner = np.where(tree.depth - tree.depth[further] <= limits.delta, further, inner)
        further = tree.parent[outer]
        outer = np.where(tree.depth[further] - tree.depth <= limits.delta, further, outer)
    change = (tree.area[outer] - tree.area[inner]) / tree.area
    has_parent, large = tree.parent != itself, tree.area >= limits.fewest
    before = np.full(len(change), np.inf)  # the least change of those that it grew from
    np.minimum.at(before, tree.parent[has_parent & large], change[has_parent & large])
    stable = large & (tree.area <= limits.most) & (change <= limits.largest_change)
    return stable & (change <= before) & (change <= change[tree.parent])


def _sort_pixels_by_region(tree: _ComponentTree) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels in an order in which those of each region stand together, and where they begin ``(n,)``."""
    begin = np.zeros(len(tree.area), np.int64)
    taken = np.bincount(tree.entered, minlength=len(tree.area))  # a region's own pixels come first
    by_level = np.split(np.arange(len(tree.area)), np.flatnonzero(np.diff(tree.depth)) + 1)
    for nodes in reversed(by_level):  # parents before their parts
        parts = nodes[tree.parent[nodes] != nodes]
        parts = parts[np.argsort(tree.parent[parts], kind="stable")]
        parents = tree.parent[parts]
        before = np.cumsum(tree.area[parts]) - tree.area[parts]
        _, first, which = np.unique(parents, return_index=True, return_inverse=True)
        begin[parts] = begin[parents] + taken[parents] + before - before[first][which]
        np.add.at(taken, parents, tree.area[parts])  # parts from other levels come behind
    return np.argsort(begin[tree.entered], kind="stable"), begin
