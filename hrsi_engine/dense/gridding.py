"""Heights of matched points in the cells of a map grid, and the fusion of the heights of several pairs.

A cell takes the points within its neighbourhood with Gaussian weights, but only those on the level of the point nearest
to its centre: at a wall a cell is roof or ground and not their mean. Pairs are fused by weights 1/sigma², iteratively
without those that contradict the others (three sigma). The sigma of a cell is enlarged where pairs scatter more than
their sigmas state; where as many pairs contradict as agree, all of them count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..foundation.pixel_filters import load_opencv
from ..foundation.thresholds import SIGNIFICANCE
from ..ortho.grid import GridWindow
from .disparity import DISPARITY

WIDTH_CELLS = 0.5  #: standard deviation of the Gaussian weights of points
LEAST_CELLS = 100  #: fewest common cells of two pairs whose bias is estimated
FUSION_ROUNDS = 2  #: iterations of the robust fusion


class FusedHeights(NamedTuple):
    """Heights (m), their standard deviations (m) and the number of pairs ``(rows, columns)``, float32; NaN, NaN, 0."""

    height: np.ndarray
    sigma: np.ndarray
    pairs: np.ndarray


def grid_heights(
    points: np.ndarray, sigma_m: np.ndarray, window: GridWindow, cell_m: float, metres_per_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return heights and standard deviations ``(rows, columns)`` of a window, float32, NaN in empty cells.

    points : (3, n) column, row of the grid, height (m); sigma_m : (n,) of the heights
    """
    rows, columns = window.rows, window.columns
    column, row = points[0] - window.column, points[1] - window.row
    inside = (column > -1.5) & (column < columns + 0.5) & (row > -1.5) & (row < rows + 0.5)
    column, row, height, sigma = column[inside], row[inside], points[2][inside], sigma_m[inside]
    # A border of one cell, whose points also belong to the cells at the edge
    i, j = np.rint(row).astype(np.int64) + 1, np.rint(column).astype(np.int64) + 1
    dx, dy = column + 1 - j, row + 1 - i
    wide = columns + 2
    cell, size = i * wide + j, (rows + 2) * wide
    level = np.full(size, np.nan)
    order = np.argsort(-(dx * dx + dy * dy), kind="stable")
    level[cell[order]] = height[order]  # the last assignment is that of the nearest point
    level = _close_holes(level.reshape(rows + 2, wide)).ravel()
    total, weighted, weighted_sigma = np.zeros((3, size))
    tolerance = DISPARITY.largest_sigma_px * metres_per_px + cell_m
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            distance = (dx - right) ** 2 + (dy - down) ** 2
            target = cell + down * wide + right
            use = (distance < 2.25) & (target >= 0) & (target < size)
            target = target[use]
            near = np.abs(height[use] - level[target]) < tolerance  # False for NaN
            target = target[near]
            weight = np.exp(-0.5 * distance[use][near] / WIDTH_CELLS**2)
            total += np.bincount(target, weight, size)
            weighted += np.bincount(target, weight * height[use][near], size)
            weighted_sigma += np.bincount(target, weight * sigma[use][near], size)
    with np.errstate(invalid="ignore", divide="ignore"):
        heights, sigmas = (
            (values / total).reshape(rows + 2, wide)[1:-1, 1:-1] for values in (weighted, weighted_sigma)
        )
    return heights.astype(np.float32), sigmas.astype(np.float32)


def _close_holes(level: np.ndarray) -> np.ndarray:
    """Return levels in which single empty cells have the mean of their neighbours."""
    empty = np.isnan(level)
    box = load_opencv().boxFilter
    count = box((~empty).astype(np.float64), -1, (3, 3), normalize=False)
    total = box(np.where(empty, 0.0, level), -1, (3, 3), normalize=False)
    return np.where(empty & (count >= 4), total / np.maximum(count, 1.0), level)


def measure_differences(heights: np.ndarray) -> np.ndarray:
    """Return ``(pairs, pairs, 2)``: median difference of the heights of two pairs (m), and the number of common cells.

    heights : (pairs, rows, columns), NaN where a pair has none
    """
    count = len(heights)
    result = np.zeros((count, count, 2))
    for i in range(count):
        for j in range(i + 1, count):
            difference = heights[i] - heights[j]
            difference = difference[np.isfinite(difference)]
            if len(difference) >= LEAST_CELLS:
                result[i, j] = np.median(difference), len(difference)
    return result


def estimate_pair_biases(differences: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
    """Return the height bias (m) of each pair against the weighted mean of all.

    differences : (tiles, pairs, pairs, 2) of `measure_differences`
    sigma_m : (pairs,) typical standard deviation of the heights of a pair
    """
    count = len(sigma_m)
    rows, values, weights = [1.0 / sigma_m**2], [0.0], [1.0]  # the weighted mean of all biases is 0
    rows[0] /= rows[0].sum()
    for i in range(count):
        for j in range(i + 1, count):
            median, cells = differences[:, i, j].T
            if cells.any():
                order = np.argsort(median)
                middle = np.searchsorted(np.cumsum(cells[order]), cells.sum() / 2.0)
                rows.append(np.eye(count)[i] - np.eye(count)[j])
                values.append(median[order][min(middle, len(order) - 1)])
                weights.append(float(np.sqrt(cells.sum()) / np.hypot(sigma_m[i], sigma_m[j])))
    design, scale = np.array(rows), np.array(weights)
    return np.asarray(np.linalg.lstsq(design * scale[:, None], np.array(values) * scale, rcond=None)[0])


def fuse_heights(heights: np.ndarray, sigmas: np.ndarray) -> FusedHeights:
    """Return the fused heights of several pairs ``(pairs, rows, columns)``, NaN where a pair has none."""
    use = np.isfinite(heights)
    weight = np.where(use, 1.0 / np.where(use, sigmas, 1.0) ** 2, 0.0)
    filled = np.where(use, heights, 0.0)
    # Start at the most accurate pair: a mean of contradicting pairs is the height of nothing
    best = np.argmax(weight, axis=0)
    height = np.take_along_axis(filled, best[None], 0)[0]
    smallest = np.take_along_axis(np.where(use, sigmas, np.inf), best[None], 0)[0]
    for _ in range(FUSION_ROUNDS):
        # Geman and McClure's weights: a surface has no steps where a pair begins to contradict
        deviation = (filled - height) / np.hypot(np.where(use, sigmas, 1.0), smallest)
        robust = weight / (1.0 + (deviation / SIGNIFICANCE.sigmas) ** 2) ** 2
        height = (robust * filled).sum(axis=0) / np.maximum(robust.sum(axis=0), 1e-30)
    agrees = use & (np.abs(deviation) <= SIGNIFICANCE.sigmas)
    count = agrees.sum(axis=0)
    # Where as many pairs contradict a height, their scatter is its standard deviation
    counted = agrees | (use & (2 * count <= use.sum(axis=0)))
    chi2 = (weight * counted * (filled - height) ** 2).sum(axis=0) / np.maximum(counted.sum(axis=0) - 1, 1)
    # Pairs that share images are not independent: their mean is taken as accurate as the best one alone
    sigma = smallest * np.sqrt(np.maximum(chi2, 1.0))
    exists = count > 0
    none = np.float32(np.nan)
    return FusedHeights(
        np.where(exists, height, none).astype(np.float32),
        np.where(exists, sigma, none).astype(np.float32),
        count.astype(np.float32),
    )
