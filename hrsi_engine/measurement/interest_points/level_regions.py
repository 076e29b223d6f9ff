"""Closed bright or dark regions at many grey levels and several scales: candidates for gravity centres.

A region is a connected component of ``z >= t`` (bright) or ``-z >= t`` (dark) of the normalised image z. From level to
level regions shrink and are nested in each other; the one that shrinks least is the most stable (Matas et al. 2002).
Large regions are looked for in the image reduced by 2 and 4. Only compact regions are kept: the second moments of an
ellipse or a rectangle fit their area.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

LEVELS = np.arange(-0.8, 3.61, 0.2)
SCALES = (1, 2, 4)
SMOOTHING_PX = 0.7
LARGEST_AT_SCALE_PX = 48  # side of a region in the pixels of its scale
SMALLEST_AT_SCALE_PX = 12  # smaller ones are found at the finer scale
FEWEST_PIXELS = 12
COMPACTNESS = 0.86  # area over the area of the ellipse with the same moments: 1 ellipse, 0.955 rectangle
LARGEST_GROWTH = 0.35  # of the area, to the next level outwards
SLENDEREST = 4.0  # longer regions are roads and shadows


@dataclass(frozen=True, eq=False)
class Region:
    """A compact region: its pixels ``(k, 2)`` column, row in the window reduced by ``scale``.

    bright : brighter than its surroundings; levels : how many neighbouring levels it persists on
    growth : relative increase of the area to the next level outwards
    """

    pixels: np.ndarray
    scale: int
    bright: bool
    levels: int
    growth: float

    @property
    def centre(self) -> np.ndarray:
        """Mean of the pixels in full-resolution pixels of the window, ``(2,)``."""
        return (self.pixels.mean(axis=0) + 0.5) * self.scale - 0.5

    @property
    def area_px(self) -> float:
        """Area in full-resolution pixels."""
        return float(len(self.pixels) * self.scale**2)


@dataclass(eq=False)
class _Level:
    """Components of one level: ``labels`` of the image; rows of kept components in `_Tree`, -1 for others."""

    labels: np.ndarray
    areas: np.ndarray
    row: np.ndarray


@dataclass(eq=False)
class _Tree:
    """Kept components of all levels: area, growth to the next level outwards, row of the parent (-1), pixels."""

    area: list[int]
    growth: list[float]
    parent: list[int]
    pixels: list[np.ndarray]


def stable_regions(z: np.ndarray, usable: np.ndarray, largest_px: float) -> list[Region]:
    """Return the most stable compact regions of a normalised image with sides up to ``largest_px``.

    ``usable`` masks pixels: regions that touch others, or the edge of the image, are left out.
    """
    found: list[Region] = []
    for scale in SCALES:
        if scale > 1 and largest_px < SMALLEST_AT_SCALE_PX * scale:
            break
        reduced, closed = _reduced(z, usable, scale)
        reach = min(LARGEST_AT_SCALE_PX if scale < SCALES[-1] else np.inf, largest_px / scale)
        for bright in (True, False):
            signed = reduced if bright else -reduced
            found += _regions_of(np.where(closed, signed, np.float32(99.0)), closed, reach, scale, bright)
    return found


def _reduced(z: np.ndarray, usable: np.ndarray, scale: int) -> tuple[np.ndarray, np.ndarray]:
    """Return image and mask reduced by averaging ``scale`` x ``scale`` pixels, slightly smoothed."""
    if scale > 1:
        size = z.shape[1] // scale, z.shape[0] // scale
        z = cv2.resize(z, size, interpolation=cv2.INTER_AREA)
        usable = cv2.resize(usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST).astype(bool)
    return cv2.GaussianBlur(z, (0, 0), SMOOTHING_PX), usable


def _regions_of(signed: np.ndarray, usable: np.ndarray, largest: float, scale: int, bright: bool) -> list[Region]:
    """Return the stable regions ``signed >= t`` of all levels; unusable pixels belong to everything and spoil it."""
    tree = _Tree([], [], [], [])
    outer: _Level | None = None
    spoilt = _spoilt(usable)
    smallest = FEWEST_PIXELS if scale == SCALES[0] else SMALLEST_AT_SCALE_PX**2 // 2
    for level in LEVELS:
        outer = _add_level(tree, signed >= np.float32(level), outer, spoilt, smallest, largest)
    return [Region(tree.pixels[row], scale, bright, levels, tree.growth[row]) for row, levels in _most_stable(tree)]


def _spoilt(usable: np.ndarray) -> np.ndarray:
    """Return the flat indices of pixels that no region may contain: unusable ones and the border."""
    wrong = ~usable
    wrong[[0, -1], :] = True
    wrong[:, [0, -1]] = True
    return np.flatnonzero(wrong)


def _add_level(
    tree: _Tree, above: np.ndarray, outer: _Level | None, spoilt: np.ndarray, smallest: float, largest: float
) -> _Level:
    """Enter a level's compact components into the tree, linked to those of the level outwards."""
    count, labels, box, _ = cv2.connectedComponentsWithStats(above.astype(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    areas = box[:, cv2.CC_STAT_AREA]
    keep = (areas >= smallest) & (box[:, cv2.CC_STAT_WIDTH] <= largest) & (box[:, cv2.CC_STAT_HEIGHT] <= largest)
    # an ellipse fills 0.785 of an upright box, a square on its corner 0.5, a slender slanted region less
    keep &= areas > 0.3 * box[:, cv2.CC_STAT_WIDTH] * box[:, cv2.CC_STAT_HEIGHT]
    keep[0] = False
    keep[labels.ravel()[spoilt]] = False
    level = _Level(labels, areas, np.full(count, -1))
    pixel = np.flatnonzero(keep[labels].ravel())
    if not len(pixel):
        return level
    order = np.argsort(labels.ravel()[pixel], kind="stable")
    pixel = pixel[order]
    label = labels.ravel()[pixel]
    starts = np.flatnonzero(np.r_[True, label[1:] != label[:-1]])
    rows, columns = np.divmod(pixel, labels.shape[1])
    compact = _compact(columns, rows, starts)
    parents = outer.labels.ravel()[pixel[starts]] if outer is not None else np.zeros(len(starts), dtype=int)
    ends = np.r_[starts[1:], len(pixel)]
    for k in np.flatnonzero(compact):
        level.row[label[starts[k]]] = len(tree.area)
        tree.area.append(int(ends[k] - starts[k]))
        tree.growth.append(float(outer.areas[parents[k]] / tree.area[-1] - 1.0) if outer is not None else np.inf)
        tree.parent.append(int(outer.row[parents[k]]) if outer is not None else -1)
        tree.pixels.append(np.column_stack([columns[starts[k] : ends[k]], rows[starts[k] : ends[k]]]))
    return level


def _compact(columns: np.ndarray, rows: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the mask of components, given by their first pixel in sorted order, whose moments fit their area."""
    count = np.diff(np.r_[starts, len(columns)])

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values.astype(np.float64), starts) / count

    x, y = mean(columns), mean(rows)
    group = np.repeat(np.arange(len(starts)), count)
    dx, dy = columns - x[group], rows - y[group]
    xx, yy, xy = mean(dx * dx) + 1.0 / 12.0, mean(dy * dy) + 1.0 / 12.0, mean(dx * dy)
    determinant, half_trace = xx * yy - xy * xy, (xx + yy) / 2.0
    root = np.sqrt(np.maximum(half_trace**2 - determinant, 0.0))
    slender = np.sqrt((half_trace + root) / np.maximum(half_trace - root, 1e-9))
    return (count >= COMPACTNESS * 4.0 * np.pi * np.sqrt(determinant)) & (slender < SLENDEREST)


def _most_stable(tree: _Tree) -> list[tuple[int, int]]:
    """Return rows of regions whose growth is smallest along their chain, and how many levels the chain has nearby."""
    growth, parent = np.array(tree.growth), np.array(tree.parent, dtype=int)
    if not len(growth):
        return []
    child_growth = np.full(len(growth), np.inf)
    inner, outer = np.flatnonzero(parent >= 0), parent[parent >= 0]
    np.minimum.at(child_growth, outer, growth[inner])
    parent_growth = np.where(parent >= 0, growth[parent], np.inf)
    stable = (growth <= LARGEST_GROWTH) & (growth <= parent_growth) & (growth < child_growth)
    depth = np.ones(len(growth), dtype=int)  # levels outwards with small growth
    for row in range(len(growth)):  # parents stand before their children
        if parent[row] >= 0 and growth[row] <= LARGEST_GROWTH:
            depth[row] = depth[parent[row]] + 1
    deepest = depth.copy()
    for row in range(len(growth) - 1, -1, -1):
        if parent[row] >= 0 and growth[row] <= LARGEST_GROWTH:
            deepest[parent[row]] = max(deepest[parent[row]], deepest[row])
    return [(int(row), int(deepest[row])) for row in np.flatnonzero(stable & (deepest >= 2))]
