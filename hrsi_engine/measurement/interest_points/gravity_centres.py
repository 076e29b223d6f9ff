"""Gravity centres of closed regions: roundabouts, tanks, roofs, pools, ponds, trees, plots.

Every stable region gets a sub-pixel outline, and the simplest shape that explains it within its tolerance: an ellipse,
a rectangle (four lines), else the polygon of the edge points. The centre is the shape's; the grey-weighted centroid
must agree with it. Regions without closed outline, of weak contrast or irregular shape are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ...errors import SolveError
from ..ellipse import fit_ellipse
from ..line_corner import fit_line, intersect_lines
from .level_regions import Region, stable_regions
from .outlines import Outlines, measure_outlines
from .statistics import HALO_PX as STATISTICS_HALO_PX
from .statistics import ImageStatistics, normalised
from .windows import Window

CLOSED_SHARE = 0.85  # of the outline with a clear edge
LARGEST_GAP = 0.12  # of the outline without one
SMALLEST_SIGMA_PX = 0.02
OUTLIER_DEVIATIONS = 3.0
ELLIPSE_TOLERANCE = (0.20, 0.012)  # px, and share of the diameter: rmse of the outline about the shape
RECTANGLE_TOLERANCE = (0.25, 0.006)
FOURFOLD = 0.35  # how much the normals keep to four directions: 1 all of them, 0 as on a circle
SQUAREST_DEG = 55.0  # angle at the corners of a rectangle seen from aside, at least
POLYGON_TOLERANCE = (0.5, 0.04)  # of the outline about its own smoothed self
SOLIDITY = 0.88  # area of a polygon over that of its convex hull
CENTROID_AGREEMENT = (0.4, 0.05)  # weighted centroid and shape's centre: px, and share of the diameter
SAME_CENTRE = 0.1  # share of the diameter
GROWTH_OF_SCORE_0, LEVELS_OF_SCORE_1, CONTRAST_OF_SCORE_1 = 0.4, 4, 8.0


@dataclass(frozen=True)
class CentreOptions:
    """How gravity centres are found: diameters in px, the smallest contrast in local standard deviations, the quality.

    Of the centres of quality 0.6 and better nine in ten are found again in another view, of all only seven.
    """

    smallest_px: float = 5.0
    largest_px: float = 160.0
    contrast: float = 0.8
    quality: float = 0.6


class Centre(NamedTuple):
    """A gravity centre.

    xy : (2,) sample, line; covariance_px2 : (2, 2); kind : ``ellipse``, ``rectangle`` or ``region``
    size_px : (2,) longer and shorter diameter or side; azimuth_rad : of the longer one, +sample towards +line
    rmse_px : of the outline about the shape; contrast : grey values inside - outside; quality : 0 … 1
    outline : (k, 2) edge points
    """

    xy: np.ndarray
    covariance_px2: np.ndarray
    kind: str
    size_px: np.ndarray
    azimuth_rad: float
    rmse_px: float
    contrast: float
    quality: float
    outline: np.ndarray

    @property
    def sigma_px(self) -> float:
        """Standard deviation of a coordinate (mean of the two axes)."""
        return float(np.sqrt(np.trace(self.covariance_px2) / 2.0))


class Shape(NamedTuple):
    """A shape through edge points: its centre, covariance, size, azimuth, rmse and what rmse is tolerable."""

    xy: np.ndarray
    covariance_px2: np.ndarray
    size_px: np.ndarray
    azimuth_rad: float
    rmse_px: float
    tolerance_px: float


def halo_px(options: CentreOptions) -> int:
    """Return how far a window must reach beyond its core."""
    return STATISTICS_HALO_PX + int(np.ceil(options.largest_px))


def gravity_centres(window: Window, statistics: ImageStatistics, options: CentreOptions) -> list[Centre]:
    """Return the gravity centres in a window's core, in image pixels."""
    z = normalised(window, statistics)
    regions = stable_regions(z, window.usable, options.largest_px)
    outlines = measure_outlines(window.grey, regions, statistics.noise)
    bounds = np.searchsorted(outlines.region, np.arange(len(regions) + 1))
    found = []
    for index, region in enumerate(regions):
        if not window.core.contains(region.centre[None] + window.origin)[0] and _far_outside(window, region):
            continue
        part = _part(outlines, slice(bounds[index], bounds[index + 1]))
        centre = _measured(window, statistics, region, part, options)
        if centre is not None:
            found.append(centre)
    best = _without_repetitions(found)
    inside = window.core.contains(np.array([centre.xy for centre in best]).reshape(-1, 2))
    return [centre for centre, here in zip(best, inside, strict=True) if here]


def _far_outside(window: Window, region: Region, margin_px: float = 20.0) -> bool:
    x, y = region.centre + window.origin
    core = window.core
    return not (
        core.left - margin_px <= x < core.right + margin_px and core.top - margin_px <= y < core.bottom + margin_px
    )


def _part(outlines: Outlines, rows: slice) -> Outlines:
    return Outlines(
        outlines.xy[rows], outlines.normal[rows], outlines.slope[rows], outlines.found[rows], outlines.region[rows]
    )


def _measured(
    window: Window, statistics: ImageStatistics, region: Region, outline: Outlines, options: CentreOptions
) -> Centre | None:
    """Return a region's gravity centre, None where a test fails."""
    if not _is_closed(outline.found):
        return None
    weighted, contrast = weighted_centroid(window, region)
    relative = abs(contrast) / statistics.deviation_floor
    persistence = _persistence(region, relative) * float(outline.found.mean())
    if relative < options.contrast or persistence < options.quality:  # before the costly fits
        return None
    fitted = _simplest_shape(outline.xy[outline.found], outline.normal[outline.found])
    if fitted is None:
        return None
    kind, shape = fitted
    if shape.size_px[1] < options.smallest_px or shape.size_px[0] > options.largest_px:
        return None
    limit = CENTROID_AGREEMENT[0] + CENTROID_AGREEMENT[1] * float(np.sqrt(np.prod(shape.size_px)))
    if not np.hypot(*(weighted - shape.xy)) < limit:
        return None
    quality = persistence * _fit_score(shape)
    if quality < options.quality:
        return None
    return Centre(
        shape.xy + window.origin, shape.covariance_px2, kind, shape.size_px, shape.azimuth_rad, shape.rmse_px, contrast,
        quality, outline.xy[outline.found] + window.origin,
    )  # fmt: skip


def _is_closed(found: np.ndarray) -> bool:
    """Return whether enough of the outline has an edge and no gap is wide."""
    if found.mean() < CLOSED_SHARE:
        return False
    edges = np.flatnonzero(found)
    gaps = np.diff(np.r_[edges, edges[0] + len(found)]) - 1
    return bool(gaps.max() <= max(1.0, LARGEST_GAP * len(found)))


def _persistence(region: Region, contrast: float) -> float:
    """Return 0 … 1: how little a region grows to the next level, on how many it lasts, how much it stands out.

    Together with `_fit_score` it is the geometric mean of four scores, which on simulated pairs tell the centres that
    another view has too from those it has not.
    """
    scores = (
        1.0 - region.growth / GROWTH_OF_SCORE_0,
        (region.levels - 1.0) / (LEVELS_OF_SCORE_1 - 1.0),
        contrast / CONTRAST_OF_SCORE_1,
    )
    return float(np.prod(np.clip(scores, 0.0, 1.0)) ** 0.25)


def _fit_score(shape: Shape) -> float:
    """Return 0 … 1: how well the outline keeps to its shape."""
    return max(1.0 - shape.rmse_px / _tolerance(POLYGON_TOLERANCE, shape.size_px), 0.0) ** 0.25


# ---- shapes ----------------------------------------------------------------------------------------------------


def _simplest_shape(xy: np.ndarray, normal: np.ndarray) -> tuple[str, Shape] | None:
    """Return kind and shape of the first of `SHAPES` that explains the outline."""
    for kind, fit in SHAPES.items():
        try:
            shape = fit(xy, normal)
        except (SolveError, np.linalg.LinAlgError):
            continue
        if shape.rmse_px <= shape.tolerance_px:
            return kind, shape
    return None


def _tolerance(limits: tuple[float, float], size_px: np.ndarray) -> float:
    return limits[0] + limits[1] * float(np.sqrt(np.prod(size_px)))


def _floored(covariance: np.ndarray) -> np.ndarray:
    """Return a covariance of at least `SMALLEST_SIGMA_PX`: neighbouring edge points have common errors."""
    return covariance + SMALLEST_SIGMA_PX**2 * np.eye(2)


def fit_ellipse_shape(xy: np.ndarray, normal: np.ndarray) -> Shape:
    """Return the ellipse through the edge points; points beyond three robust deviations are left out."""
    ellipse = fit_ellipse(xy, "direct")  # quick, and good enough to see that there is no ellipse
    size = 2.0 * ellipse.semi_axes
    if ellipse.rmse_px > 2.0 * _tolerance(ELLIPSE_TOLERANCE, size):
        raise SolveError("the outline is no ellipse")
    deviation = 1.4826 * float(np.median(np.abs(ellipse.residual_px)))
    near = np.abs(ellipse.residual_px) <= OUTLIER_DEVIATIONS * max(deviation, 0.03)
    ellipse = fit_ellipse(xy[near] if near.mean() >= CLOSED_SHARE else xy)
    size = 2.0 * ellipse.semi_axes
    return Shape(
        ellipse.centre, _floored(ellipse.covariance_px2), size, ellipse.azimuth_rad, ellipse.rmse_px,
        _tolerance(ELLIPSE_TOLERANCE, size),
    )  # fmt: skip


def fit_rectangle_shape(xy: np.ndarray, normal: np.ndarray) -> Shape:
    """Return the four-sided shape through the edge points; the centre is the mean of its corners.

    The normals fall into four directions; a line goes through the points of each, without those near the corners.
    """
    fourfold = np.mean(np.exp(4j * np.arctan2(normal[:, 1], normal[:, 0])))
    if abs(fourfold) < FOURFOLD:
        raise SolveError("the outline has no four directions")
    azimuth = float(np.angle(fourfold)) / 4.0
    turn = np.array([[np.cos(azimuth), np.sin(azimuth)], [-np.sin(azimuth), np.cos(azimuth)]])
    turned, directions = (xy - xy.mean(axis=0)) @ turn.T, normal @ turn.T
    low, high = np.percentile(turned, 3.0, axis=0), np.percentile(turned, 97.0, axis=0)
    margin = 0.15 * (high - low)
    lines = []
    for axis, sign in ((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0)):
        other = 1 - axis
        inner = (turned[:, other] > low[other] + margin[other]) & (turned[:, other] < high[other] - margin[other])
        lines.append(fit_line(xy[inner & (sign * directions[:, axis] > 0.8)], tolerance_px=0.4))
    corners = [intersect_lines(lines[k], lines[(k + 1) % 4]) for k in range(4)]
    if min(corner.angle_deg for corner in corners) < SQUAREST_DEG:
        raise SolveError("the four sides are no rectangle")
    positions = np.array([corner.position for corner in corners])
    sides = np.hypot(*(positions - np.roll(positions, 1, axis=0)).T).reshape(2, 2).mean(axis=0)
    on_sides = np.concatenate([line.used for line in lines])
    if on_sides.mean() < CLOSED_SHARE:
        raise SolveError("the sides are not straight")
    residuals = np.concatenate([line.residual_px for line in lines])[on_sides]
    longer = int(np.argmax(sides))
    edge = positions[longer] - positions[longer - 1]
    covariance = sum(corner.covariance_px2 for corner in corners) / 16.0 * 2.0  # each line takes part in two corners
    angle = float((np.arctan2(edge[1], edge[0]) + np.pi / 2.0) % np.pi - np.pi / 2.0)
    size = np.sort(sides)[::-1]
    return Shape(
        positions.mean(axis=0), _floored(np.asarray(covariance)), size, angle,
        float(np.sqrt(np.mean(residuals**2))), _tolerance(RECTANGLE_TOLERANCE, size),
    )  # fmt: skip


def fit_polygon_shape(xy: np.ndarray, normal: np.ndarray) -> Shape:
    """Return the polygon of the edge points: its centroid, and the diameters of the ellipse with its moments."""
    area, centroid, moments = polygon_moments(xy)
    if area < SOLIDITY * cv2.contourArea(cv2.convexHull(xy.astype(np.float32))):
        raise SolveError("the outline has deep bays")
    values, axes = np.linalg.eigh(moments)
    size = 4.0 * np.sqrt(np.maximum(values[::-1], 1e-12))
    rough = xy - (np.roll(xy, 1, axis=0) + np.roll(xy, -1, axis=0)) / 2.0
    rmse = float(np.sqrt(np.mean(np.sum(rough * normal, axis=1) ** 2) / 1.5))  # of white errors: variance 1 + 2/4
    covariance = np.eye(2) * 4.0 * rmse**2 / len(xy)  # of a circle: 2; the errors of neighbouring points are alike
    azimuth = float((np.arctan2(axes[1, 1], axes[0, 1]) + np.pi / 2.0) % np.pi - np.pi / 2.0)
    return Shape(centroid, _floored(covariance), size, azimuth, rmse, _tolerance(POLYGON_TOLERANCE, size))


def polygon_moments(xy: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return area, centroid (2,) and central second moments over the area (2, 2) of a polygon's inside.

    Green's formulas; raises `SolveError` for a polygon without area.
    """
    origin = xy.mean(axis=0)
    x, y = (xy - origin).T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y1 - x1 * y
    area = float(cross.sum()) / 2.0
    if abs(area) < 1e-6:
        raise SolveError("the outline encloses no area")
    centre = np.array([np.sum((x + x1) * cross), np.sum((y + y1) * cross)]) / (6.0 * area)
    xx = np.sum((x * x + x * x1 + x1 * x1) * cross) / (12.0 * area)
    yy = np.sum((y * y + y * y1 + y1 * y1) * cross) / (12.0 * area)
    xy_moment = np.sum((x * y1 + 2.0 * x * y + 2.0 * x1 * y1 + x1 * y) * cross) / (24.0 * area)
    moments = np.array([[xx, xy_moment], [xy_moment, yy]]) - np.outer(centre, centre)
    return abs(area), centre + origin, moments


ShapeFit = Callable[[np.ndarray, np.ndarray], Shape]
#: Shapes in the order in which they are tried; the key is the point's kind.
SHAPES: dict[str, ShapeFit] = {
    "ellipse": fit_ellipse_shape,
    "rectangle": fit_rectangle_shape,
    "region": fit_polygon_shape,
}


def weighted_centroid(window: Window, region: Region) -> tuple[np.ndarray, float]:
    """Return the grey-weighted centroid (2,) of a region in the window, and its contrast inside - outside.

    Weights rise from 0 at the grey value of the surroundings to 1 at that of the region.
    """
    scale = region.scale
    low = region.pixels.min(axis=0) - 3
    high = region.pixels.max(axis=0) + 4
    inside = np.zeros((high[1] - low[1], high[0] - low[0]), dtype=np.uint8)
    inside[region.pixels[:, 1] - low[1], region.pixels[:, 0] - low[0]] = 1
    near, far = _dilated(inside, 1), _dilated(inside, 3)
    top, left = max(int(low[1]) * scale, 0), max(int(low[0]) * scale, 0)
    grey = window.grey[top : int(high[1]) * scale, left : int(high[0]) * scale]
    masks = [np.kron(m, np.ones((scale, scale), np.uint8)) for m in (inside, near, far)]
    cut = np.s_[top - int(low[1]) * scale :, left - int(low[0]) * scale :]
    inner, near_px, far_px = (m[cut][: grey.shape[0], : grey.shape[1]].astype(bool) for m in masks)
    ring = far_px & ~near_px
    background = float(np.median(grey[ring])) if ring.any() else float(np.median(grey))
    contrast = float(np.median(grey[inner])) - background
    if contrast == 0.0:
        return np.full(2, np.nan), 0.0
    weight = np.clip((grey - background) / contrast, 0.0, 1.0) * near_px
    rows, columns = np.indices(grey.shape)
    total = max(float(weight.sum()), 1e-9)
    return np.array([(weight * columns).sum() / total + left, (weight * rows).sum() / total + top]), contrast


def _dilated(mask: np.ndarray, times: int) -> np.ndarray:
    return cv2.dilate(mask, np.ones((3, 3), np.uint8), iterations=times)


def _without_repetitions(centres: list[Centre]) -> list[Centre]:
    """Return the best of the centres that mark the same object: same place, similar size, found twice."""
    if not centres:
        return []
    order = np.argsort([-centre.quality for centre in centres], kind="stable")
    xy = np.array([centre.xy for centre in centres])
    size = np.array([np.sqrt(np.prod(centre.size_px)) for centre in centres])
    kept: list[int] = []
    for row in order.tolist():
        if kept:
            away = np.hypot(*(xy[kept] - xy[row]).T)
            ratio = size[kept] / size[row]
            alike = (ratio > 0.6) & (ratio < 1.6)
            if np.any((away < np.maximum(SAME_CENTRE * np.minimum(size[kept], size[row]), 1.0)) & alike):
                continue
        kept.append(row)
    return [centres[row] for row in sorted(kept)]
