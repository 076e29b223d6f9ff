"""Corners as intersections of two straight edges, each fitted to three edge points or more (thesis section 2.3).

A line is ``n · x = p`` with the unit normal ``n``; it minimises the distances of the points (total least squares): it
passes through their centroid in the direction of the eigenvector of their scatter matrix with the larger eigenvalue.
The standard deviation of its offset at the centroid is sigma / sqrt(n), that of its direction sigma / sqrt(sum t^2),
t being the distances of the points from the centroid along it. Both are propagated to the intersection.

An edge point is a maximum of the gradient of the grey values (Gaussian derivative) in its own direction, interpolated
by a parabola. Segments are runs of edge points along one line with the same gradient direction.
"""

from dataclasses import dataclass

import numpy as np

from ...foundation.errors import SolveError
from ...foundation.pixel_filters import BLUR, erode, slopes
from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import EQUALITY, SAMPLES
from ..interest_points.corners import make_gaussian_kernels
from ..interest_points.outlines import compute_slope_noise, interpolate_bilinear
from ..interest_points.shapes import SHAPE


@dataclass(frozen=True, eq=False)
class Line:
    """A line fitted to edge points.

    centroid, direction, normal : (2,); cofactor : (2, 2) of the offset at the centroid and of the direction (radians)
    residual_px : (n,) signed distances; used : (n,) mask of points used in the fit; reach_px : positions of the first
    and last used point along the direction, from the centroid
    """

    centroid: np.ndarray
    direction: np.ndarray
    cofactor: np.ndarray
    residual_px: np.ndarray
    used: np.ndarray
    reach_px: tuple[float, float]

    @property
    def normal(self) -> np.ndarray:
        """Unit normal, the direction rotated by +90 degrees."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def rmse_px(self) -> float:
        """Root mean square distance of the used points."""
        return float(np.sqrt(np.mean(self.residual_px[self.used] ** 2)))


@dataclass(frozen=True, eq=False)
class LineCorner:
    """Intersection of two lines: position (2,), covariance (2, 2) from their residuals, angle between them."""

    position: np.ndarray
    covariance_px2: np.ndarray
    angle_deg: float
    lines: tuple[Line, Line]

    @property
    def sigma_px(self) -> float:
        """Standard deviation of a coordinate (quadratic mean of the two axes)."""
        return float(np.sqrt(np.trace(self.covariance_px2) / 2.0))

    @property
    def rmse_px(self) -> float:
        """Root mean square distance of all used points from their lines."""
        return float(np.sqrt(np.mean(np.concatenate([line.residual_px[line.used] ** 2 for line in self.lines]))))


def fit_line(xy: np.ndarray, tolerance_px: float | None = None) -> Line:
    """Return the line through edge points ``(n, 2)``; points farther away than ``tolerance_px`` are not used.

    Raises `SolveError` for fewer than three points, or points that coincide.
    """
    xy = np.asarray(xy, dtype=np.float64)
    inliers = np.ones(len(xy), dtype=bool)
    line = _fit_points(xy, inliers)
    for _ in range(5 if tolerance_px is not None else 0):
        is_near = np.abs(line.residual_px) < max(float(tolerance_px or 0.0), 1.5 * np.median(np.abs(line.residual_px)))
        if is_near.sum() < SAMPLES.plane or np.array_equal(is_near, inliers):
            break
        inliers = is_near
        line = _fit_points(xy, inliers)
    return line


def _fit_points(xy: np.ndarray, inliers: np.ndarray) -> Line:
    """Return the line of least squared distances through ``inliers (n,)`` of points; raise `SolveError` without one.

    It passes through the centroid along the larger principal axis; residuals are those of all points.
    """
    if inliers.sum() < SAMPLES.plane:
        raise SolveError(f"a line needs {SAMPLES.plane} edge points or more, {inliers.sum()} were given: measure more")
    centroid = xy[inliers].mean(axis=0)
    spread, axes = np.linalg.eigh(np.cov((xy[inliers] - centroid).T, bias=True))
    if not spread[1] > 0.0:
        raise SolveError("the edge points coincide: measure points along the edge")
    direction = axes[:, 1]
    along = (xy - centroid) @ direction
    residual = (xy - centroid) @ np.array([-direction[1], direction[0]])
    cofactor = np.diag([1.0 / inliers.sum(), 1.0 / np.sum(along[inliers] ** 2)])
    reach = float(along[inliers].min()), float(along[inliers].max())
    return Line(centroid, direction, cofactor, residual, inliers, reach)


def intersect_lines(first: Line, second: Line) -> LineCorner:
    """Return the intersection of two lines; raises `SolveError` if they are nearly parallel.

    The variance of an edge point is estimated from the residuals of both lines together.
    """
    angle = float(np.degrees(np.arccos(np.clip(abs(first.direction @ second.direction), 0.0, 1.0))))
    if angle < EQUALITY.direction_deg:
        raise SolveError(f"the two edges meet at {angle:.0f} degrees only: no corner can be measured there")
    normals = np.array([first.normal, second.normal])
    position = np.linalg.solve(normals, [line.normal @ line.centroid for line in (first, second)])
    redundancy = sum(int(line.used.sum()) - 2 for line in (first, second))
    squares = sum(float(np.sum(line.residual_px[line.used] ** 2)) for line in (first, second))
    # The cofactor of the offset of each line at the corner
    along = [float((position - line.centroid) @ line.direction) for line in (first, second)]
    offsets = [line.cofactor[0, 0] + t**2 * line.cofactor[1, 1] for line, t in zip((first, second), along, strict=True)]
    to_position = np.linalg.inv(normals)
    covariance = squares / redundancy * to_position @ np.diag(offsets) @ to_position.T
    return LineCorner(position, covariance, angle, (first, second))


def split_into_lines(xy: np.ndarray, tolerance_px: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Return the masks of the points on the two lines that contain most edge points ``(n, 2)``.

    Lines through pairs of points are candidates for the first line, and through pairs of the remaining points for the
    second; a point close to both belongs to the nearer one. Raises `SolveError` if no two lines have three points each.
    """
    xy = np.asarray(xy, dtype=np.float64)
    best: tuple[tuple[int, float], np.ndarray, np.ndarray] | None = None
    for first in _list_candidate_lines(xy):
        on_first = np.abs(_compute_distance(xy, first)) < tolerance_px
        if on_first.sum() < SAMPLES.plane or (~on_first).sum() < SAMPLES.plane:
            continue
        for second in _list_candidate_lines(xy[~on_first]):
            on_second = np.abs(_compute_distance(xy, second)) < tolerance_px
            nearer = np.abs(_compute_distance(xy, first)) <= np.abs(_compute_distance(xy, second))
            a, b = on_first & (nearer | ~on_second), on_second & ~(on_first & nearer)
            if min(a.sum(), b.sum()) < SAMPLES.plane:
                continue
            misfit = float(np.sum(_compute_distance(xy[a], first) ** 2) + np.sum(_compute_distance(xy[b], second) ** 2))
            score = (int(a.sum() + b.sum()), -misfit)
            if best is None or score > best[0]:
                best = score, a, b
    if best is None:
        raise SolveError(f"the edge points do not lie on two lines with {SAMPLES.plane} points each: measure more")
    return best[1], best[2]


def _list_candidate_lines(xy: np.ndarray, limit: int = 200) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return point and unit normal ``(2,)`` of lines through pairs of points, of at most ``limit`` pairs."""
    i, j = np.triu_indices(len(xy), 1)
    if len(i) > limit:
        sampled = np.linspace(0, len(i) - 1, limit).astype(int)
        i, j = i[sampled], j[sampled]
    step = xy[j] - xy[i]
    length = np.hypot(step[:, 0], step[:, 1])
    distinct = length > 0.0
    normal = np.column_stack([-step[distinct, 1], step[distinct, 0]]) / length[distinct, None]
    return list(zip(xy[i[distinct]], normal, strict=True))


def _compute_distance(xy: np.ndarray, line: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the signed distances ``(n,)`` of points from a line (point, unit normal), px."""
    return (xy - line[0]) @ line[1]


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Edge points of a window: ``xy (n, 2)`` in its pixels, unit gradients ``(n, 2)``, gradient magnitudes ``(n,)``."""

    xy: np.ndarray
    direction: np.ndarray
    strength: np.ndarray

    def __len__(self) -> int:
        return len(self.xy)


def find_edge_points(grey: np.ndarray, usable: np.ndarray, noise: float) -> EdgePoints:
    """Return the sub-pixel edge points of grey values, where the gradient magnitude is largest along its direction.

    The maximum is that of a parabola through the magnitudes one pixel before and behind (Devernay 1995).

    grey, usable : (rows, columns) float32, and mask of usable pixels, from which edges keep a distance
    noise : standard deviation of the grey values
    """
    smooth, slope = make_gaussian_kernels(BLUR.sigma_px)
    by_x, by_y = slopes(grey, smooth, slope, "reflect")
    strength = np.hypot(by_x, by_y)
    rows, columns = np.nonzero(erode(usable, 5) & (strength > ROBUST.rejected * noise * compute_slope_noise()))
    inner = (rows > 1) & (columns > 1) & (rows < grey.shape[0] - 2) & (columns < grey.shape[1] - 2)
    rows, columns = rows[inner], columns[inner]
    edge_strength = strength[rows, columns]
    direction = np.column_stack([by_x[rows, columns], by_y[rows, columns]]) / edge_strength[:, None]
    previous_strength = interpolate_bilinear(strength, columns - direction[:, 0], rows - direction[:, 1])
    next_strength = interpolate_bilinear(strength, columns + direction[:, 0], rows + direction[:, 1])
    bend = previous_strength - 2.0 * edge_strength + next_strength
    peak = (edge_strength >= previous_strength) & (edge_strength > next_strength) & (bend < 0.0)
    offset = 0.5 * (previous_strength - next_strength)[peak] / bend[peak]
    xy = np.column_stack([columns, rows])[peak] + offset[:, None] * direction[peak]
    is_subpixel = np.abs(offset) <= 0.7
    return EdgePoints(xy[is_subpixel], direction[peak][is_subpixel], edge_strength[peak][is_subpixel])


def find_straight_segments(points: EdgePoints, shortest_px: float, limit: int = 40) -> list[np.ndarray]:
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
            if len(segments) == limit:
                break
        else:
            free[seed] = False
    return sorted(segments, key=len, reverse=True)


def _grow_segment(points: EdgePoints, seed: int, free: np.ndarray) -> np.ndarray:
    """Return the indices of the run of free points without gaps along a seed's line, which is refined iteratively.

    free : (n,) mask of points that are in no segment yet
    """
    centre, normal = points.xy[seed], points.direction[seed]
    run = np.array([seed])
    for _ in range(3):
        offset = points.xy - centre
        is_near = free & (np.abs(offset @ normal) < SHAPE.on_shape_px)
        is_near &= points.direction @ normal > np.cos(np.radians(EQUALITY.direction_deg))
        candidates = np.flatnonzero(is_near)
        if len(candidates) < 3:
            return candidates
        along = offset[candidates] @ np.array([-normal[1], normal[0]])
        order = np.argsort(along)
        breaks = np.flatnonzero(np.diff(along[order]) > BLUR.end_px)
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
