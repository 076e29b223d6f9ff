"""Sub-pixel edge points of a window, and the straight segments they form.

An edge point is where the slope of the grey values (Gaussian derivative) is largest along its own direction; the peak
of a parabola gives the position. Segments are runs of edge points along one line with the same direction of slope.
"""

from dataclasses import dataclass

import numpy as np

from ...foundation.pixel_filters import erode, slopes
from ...foundation.thresholds import threshold, thresholds
from ..interest_points.corners import make_gaussian_kernels
from ..interest_points.outlines import OUTLINE_SAMPLING, compute_slope_noise, interpolate_bilinear


@thresholds
class EDGES:
    """Which pixels are edge points, and which of them a straight segment."""

    slope_to_noise: float = threshold(5.0, "sigma", "smallest slope of an edge point")
    weakest_share: float = threshold(0.15, "", "likewise, as a share of the strongest slope of the window")
    line_distance_px: float = threshold(0.8, "px", "largest distance from the line of a segment")
    direction_deg: float = threshold(20.0, "°", "largest difference of the slope's direction in a segment")
    largest_gap_px: float = threshold(2.5, "px", "largest gap in a segment")


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Edge points of a window: ``xy (n, 2)`` in its pixels, unit slopes ``(n, 2)`` towards brighter, and strengths."""

    xy: np.ndarray
    direction: np.ndarray
    strength: np.ndarray

    def __len__(self) -> int:
        return len(self.xy)


def find_edge_points(grey: np.ndarray, usable: np.ndarray, noise: float) -> EdgePoints:
    """Return the sub-pixel edge points of grey values (float32) away from unusable pixels."""
    smooth, slope = make_gaussian_kernels(OUTLINE_SAMPLING.slope_px)
    by_x, by_y = slopes(grey, smooth, slope, "reflect")
    strength = np.hypot(by_x, by_y)
    clear = erode(usable, 5)
    threshold = max(
        EDGES.slope_to_noise * noise * compute_slope_noise(),
        EDGES.weakest_share * float(strength[clear].max(initial=0.0)),
    )
    rows, columns = np.nonzero(clear & (strength > threshold))
    inner = (rows > 1) & (columns > 1) & (rows < grey.shape[0] - 2) & (columns < grey.shape[1] - 2)
    rows, columns = rows[inner], columns[inner]
    at = strength[rows, columns]
    direction = np.column_stack([by_x[rows, columns], by_y[rows, columns]]) / at[:, None]
    before = interpolate_bilinear(strength, columns - direction[:, 0], rows - direction[:, 1])
    after = interpolate_bilinear(strength, columns + direction[:, 0], rows + direction[:, 1])
    bend = before - 2.0 * at + after
    peak = (at >= before) & (at > after) & (bend < 0.0)
    offset = 0.5 * (before - after)[peak] / bend[peak]
    xy = np.column_stack([columns, rows])[peak] + offset[:, None] * direction[peak]
    near = np.abs(offset) <= 0.7
    return EdgePoints(xy[near], direction[peak][near], at[peak][near])


def find_straight_segments(points: EdgePoints, shortest_px: float, most: int = 40) -> list[np.ndarray]:
    """Return the indices of the points of each straight segment, longest first; no point is in two segments."""
    free = np.ones(len(points), dtype=bool)
    segments: list[np.ndarray] = []
    for seed in np.argsort(-points.strength, kind="stable"):
        if not free[seed]:
            continue
        run = _grow_segment(points, int(seed), free)
        normal = points.direction[run].mean(axis=0)
        along = points.xy[run] @ np.array([-normal[1], normal[0]]) / max(float(np.hypot(*normal)), 1e-9)
        if len(run) >= 3 and np.ptp(along) >= shortest_px:
            segments.append(run)
            free[run] = False
            if len(segments) == most:
                break
        else:
            free[seed] = False
    return sorted(segments, key=len, reverse=True)


def _grow_segment(points: EdgePoints, seed: int, free: np.ndarray) -> np.ndarray:
    """Return the free points of the unbroken run along the line of a seed, refined once with all of its points."""
    centre, normal = points.xy[seed], points.direction[seed]
    run = np.array([seed])
    for _ in range(3):
        offset = points.xy - centre
        near = free & (np.abs(offset @ normal) < EDGES.line_distance_px)
        near &= points.direction @ normal > np.cos(np.radians(EDGES.direction_deg))
        candidates = np.flatnonzero(near)
        if len(candidates) < 3:
            return candidates
        along = offset[candidates] @ np.array([-normal[1], normal[0]])
        order = np.argsort(along)
        breaks = np.flatnonzero(np.diff(along[order]) > EDGES.largest_gap_px)
        middle = int(np.searchsorted(along[order], 0.0))
        start = int(breaks[breaks < middle][-1]) + 1 if np.any(breaks < middle) else 0
        end = int(breaks[breaks >= middle][0]) + 1 if np.any(breaks >= middle) else len(order)
        run = candidates[order[start:end]]
        if len(run) < 3:
            return run
        centre = points.xy[run].mean(axis=0)
        _, axes = np.linalg.eigh(np.cov((points.xy[run] - centre).T))
        normal = axes[:, 0] * np.sign(axes[:, 0] @ points.direction[run].mean(axis=0) or 1.0)
    return run
