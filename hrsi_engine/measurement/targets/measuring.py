"""Targets near approximate positions: the sub-pixel centre of a round or closed object, or the corner of two edges.

Every measurement has a covariance, or is refused with the reason: no result is returned if the feature is not visible.
Manually measured edge points are evaluated by the same fits.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...block.block import Raster
from ...foundation.errors import InputError, SolveError
from ...foundation.pixel_filters import BLUR
from ...foundation.thresholds import EQUALITY, MEMORY, threshold, thresholds
from ..interest_points.gravity_centres import CENTRE, find_gravity_centres
from ..interest_points.options import CentreOptions
from ..interest_points.shapes import SHAPE
from ..interest_points.windows import Area, DetectionWindow, ImageStatistics, estimate_image_statistics, read_window
from .ellipse import Ellipse, fit_ellipse, fit_ellipse_robust
from .line_corner import (
    EdgePoints,
    LineCorner,
    find_edge_points,
    find_straight_segments,
    fit_line,
    intersect_lines,
    split_into_lines,
)
from .options import TargetOptions

TARGET_CENTER, TARGET_CORNER = "center", "corner"


@thresholds
class TARGETS:
    """Limits for measured centres and corners, and part of an edge that is used."""

    largest_sigma_px: float = threshold(0.5, "px", "largest sigma of a coordinate, or RMS of edge points about edges")
    smallest_quality: float = threshold(0.4, "", "smallest quality of an object", "simulated targets, 2026-11-21")
    shortest_edge_px: float = threshold(3.0, "px", "smallest length of an edge in use")
    far_px: float = threshold(20.0, "px", "largest distance of edge points from the corner")
    end_px: float = threshold(4.0, "px", "largest distance of the end of an edge from the corner")


@dataclass(frozen=True, eq=False)
class TargetMeasurement:
    """Measured position of a target, or the reason for its refusal.

    Parameters
    ----------
    kind : str
        ``center`` or ``corner``.
    xy : (2,) ndarray
        Sample, line; NaN if refused.
    covariance_px2 : (2, 2) ndarray
        Covariance of the position.
    rmse_px : float
        RMSE of the edge points about the fitted curve.
    edges : (k, 2) ndarray
        The edge points.
    used : (k,) ndarray
        True for edge points used in the fit.
    curves : tuple of (m, 2) ndarray
        Polylines of the fitted curve, for drawing.
    quality : float
        0 … 1, NaN if unknown.
    refusal : str
        Reason for the refusal, empty if measured.
    """

    kind: str
    xy: np.ndarray
    covariance_px2: np.ndarray
    rmse_px: float
    edges: np.ndarray
    used: np.ndarray
    curves: tuple[np.ndarray, ...]
    quality: float = np.nan
    refusal: str = ""

    @property
    def sigma_px(self) -> float:
        """Standard deviation of a coordinate (quadratic mean of the two axes)."""
        return float(np.sqrt(np.trace(self.covariance_px2) / 2.0))


def make_refusal(kind: str, reason: str) -> TargetMeasurement:
    """Return a refused measurement."""
    nothing = np.empty((0, 2))
    return TargetMeasurement(
        kind,
        np.full(2, np.nan),
        np.full((2, 2), np.nan),
        rmse_px=np.nan,
        edges=nothing,
        used=np.empty(0, bool),
        curves=(),
        quality=np.nan,
        refusal=reason,
    )


def measure_target(
    raster: Raster, approximate: np.ndarray, kind: str = TARGET_CENTER, options: TargetOptions | None = None
) -> TargetMeasurement:
    """Measure the target nearest to an approximate position.

    A target that is not found is a refusal in the result.

    Parameters
    ----------
    raster : Raster
        The image's pixels.
    approximate : (2,) ndarray
        Sample, line in pixels.
    kind : str
        One of `MEASURES`.
    options : TargetOptions, optional
        Distance and size limits of the target.

    Returns
    -------
    TargetMeasurement
        The target, or the reason why it was not measured.

    Raises
    ------
    InputError
        The kind is unknown.
    """
    options = options or TargetOptions()
    if kind not in MEASURES:
        raise InputError(f"target kind {kind!r} is not one of {', '.join(MEASURES)}: correct it")
    x, y = (float(value) for value in approximate)
    if not (-0.5 <= x <= raster.size[0] - 0.5 and -0.5 <= y <= raster.size[1] - 0.5):
        return make_refusal(kind, f"the approximate position {x:.1f}, {y:.1f} is outside the image")
    try:
        return MEASURES[kind](raster, np.array([x, y]), options)
    except SolveError as error:
        return make_refusal(kind, str(error))


def _clip_square(raster: Raster, middle: np.ndarray, half: float) -> Area:
    """Return the square around a position, clipped to the image."""
    low = np.maximum(np.floor(middle - half), 0).astype(int)
    high = np.minimum(np.ceil(middle + half) + 1, raster.size).astype(int)
    return Area(int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def _read_window(
    raster: Raster, middle: np.ndarray, core: float, halo: float
) -> tuple[DetectionWindow, ImageStatistics]:
    statistics = estimate_image_statistics(raster, _clip_square(raster, middle, MEMORY.window_px // 2 - 1))
    window = read_window(raster, _clip_square(raster, middle, core), int(np.ceil(halo)), statistics.saturation)
    return window, statistics


# ---- centres ---------------------------------------------------------------------------------------------------


def measure_centre(raster: Raster, approximate: np.ndarray, options: TargetOptions) -> TargetMeasurement:
    """Return the gravity centre of the best closed region near a position; raises `SolveError` if there is none."""
    window, statistics = _read_window(
        raster, approximate, options.search_px, options.largest_px / 2.0 + 2.0 * MEMORY.border_px
    )
    if not window.usable.any():
        raise SolveError("the image has no valid pixels there")
    centre_options = CentreOptions(options.smallest_px, options.largest_px, quality=TARGETS.smallest_quality)
    candidates, worth = [], []
    for centre in find_gravity_centres(window, statistics, centre_options):
        # A weak object must cover the position, otherwise a neighbouring object is taken for an invisible target
        distance, is_strong = float(np.hypot(*(centre.xy - approximate))), centre.quality >= CENTRE.strong_quality
        limit = options.search_px if is_strong else min(options.search_px, float(centre.size_px[0]) / 2.0)
        if distance <= limit and centre.sigma_px <= TARGETS.largest_sigma_px:
            candidates.append(centre)
            worth.append(centre.quality + 0.2 * (centre.kind == "ellipse") - 0.7 * distance / options.search_px)
    if not candidates:
        raise SolveError(
            f"no clear closed object of {options.smallest_px:g} to {options.largest_px:g} px lies within "
            f"{options.search_px:g} px"
        )
    best = candidates[int(np.argmax(worth))]
    if best.kind == "ellipse":  # fitted again, robust against stray edge points
        return _report_ellipse(fit_ellipse_robust(best.outline), best.outline, best.quality)
    is_used = np.ones(len(best.outline), dtype=bool)
    return TargetMeasurement(
        TARGET_CENTER,
        best.xy,
        best.covariance_px2,
        rmse_px=best.rmse_px,
        edges=best.outline,
        used=is_used,
        curves=(_close_ring(best.outline),),
        quality=best.quality,
    )


def _report_ellipse(ellipse: Ellipse, edges: np.ndarray, quality: float) -> TargetMeasurement:
    return TargetMeasurement(
        TARGET_CENTER,
        ellipse.centre,
        ellipse.covariance_px2,
        rmse_px=ellipse.rmse_px,
        edges=edges,
        used=ellipse.used,
        curves=(_close_ring(ellipse.outline()),),
        quality=quality,
    )


def _close_ring(ring: np.ndarray) -> np.ndarray:
    return np.vstack([ring, ring[:1]])


# ---- corners ---------------------------------------------------------------------------------------------------


def measure_corner(raster: Raster, approximate: np.ndarray, options: TargetOptions) -> TargetMeasurement:
    """Return the corner of the two clearest straight edges near a position; raises `SolveError` if there is none."""
    window, statistics = _read_window(raster, approximate, options.search_px + TARGETS.far_px + 4.0, 0.0)
    if not window.usable.any():
        raise SolveError("the image has no valid pixels there")
    points = find_edge_points(window.grey, window.usable, statistics.noise)
    segments = find_straight_segments(points, TARGETS.shortest_edge_px)
    origin = window.origin
    candidates = []
    for first, second, rough in _find_crossings(
        points, segments, approximate - origin, options.search_px + TARGETS.end_px
    ):
        created = _rate_corner(points, first, second, rough, approximate - origin, options.search_px)
        if created is not None:
            candidates.append(created)
    if not candidates:
        raise SolveError(f"no two straight edges meet within {options.search_px:g} px")
    _, corner, edges = max(candidates, key=lambda candidate: candidate[0])
    return _report_corner(corner, edges, origin)


def _find_crossings(
    points: EdgePoints, segments: list[np.ndarray], approximate: np.ndarray, reach_px: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield the pairs of segments whose lines intersect within a radius of a position, and the crossing ``(2,)``."""
    if len(segments) < 2:
        return
    lines = [fit_line(points.xy[segment]) for segment in segments]
    normal = np.array([line.normal for line in lines])
    offset = np.array([line.normal @ (line.centroid - approximate) for line in lines])
    i, j = np.triu_indices(len(lines), 1)
    sine = normal[i, 0] * normal[j, 1] - normal[i, 1] * normal[j, 0]
    steep = np.abs(sine) > np.sin(np.radians(EQUALITY.direction_deg / 2.0))
    i, j, sine = i[steep], j[steep], sine[steep, None]
    across = np.column_stack([normal[:, 1], -normal[:, 0]])
    crossing = (offset[i, None] * across[j] - offset[j, None] * across[i]) / sine
    for k in np.flatnonzero(np.hypot(*crossing.T) <= reach_px):
        yield segments[i[k]], segments[j[k]], crossing[k] + approximate


def _rate_corner(
    points: EdgePoints,
    first: np.ndarray,
    second: np.ndarray,
    rough: np.ndarray,
    approximate: np.ndarray,
    search_px: float,
) -> tuple[float, LineCorner, np.ndarray] | None:
    """Return score, corner and edge points of two segments that intersect at ``rough``, near the approximate position.

    None if they do not form a corner.
    """
    one, second_edge = (_select_edge_part(points.xy[segment], rough) for segment in (first, second))
    if one is None or second_edge is None:
        return None
    try:
        corner = intersect_lines(*(fit_line(part, tolerance_px=SHAPE.on_shape_px) for part in (one, second_edge)))
    except SolveError:
        return None
    distance = float(np.hypot(*(corner.position - approximate)))
    is_acceptable = corner.angle_deg >= EQUALITY.direction_deg and corner.rmse_px <= TARGETS.largest_sigma_px
    is_acceptable &= all(_measure_turn_deg(points, line, rough) < EQUALITY.direction_deg for line in (first, second))
    if distance > search_px or not is_acceptable or corner.sigma_px > TARGETS.largest_sigma_px:
        return None
    lengths = [min(np.ptp(line.reach_px), TARGETS.far_px) for line in corner.lines]
    strength = [float(np.median(points.strength[segment])) for segment in (first, second)]
    score = (
        min(lengths) / TARGETS.far_px
        + 0.5 * sum(strength) / (2.0 * float(points.strength.max()))
        - 1.2 * distance / search_px
    )
    return score, corner, np.concatenate([one, second_edge])


def _measure_turn_deg(points: EdgePoints, segment: np.ndarray, corner: np.ndarray) -> float:
    """Return the change of gradient direction along an edge near its corner, which is large for chords of a circle."""
    distance = np.hypot(*(points.xy[segment] - corner).T)
    is_near = distance <= TARGETS.far_px
    direction = points.direction[segment][is_near]
    if len(direction) < 4:
        return 0.0
    mean = direction.mean(axis=0)
    angle = np.degrees(np.arctan2(mean[0] * direction[:, 1] - mean[1] * direction[:, 0], direction @ mean))
    return float(abs(np.polyfit(distance[is_near], angle, 1)[0]) * np.ptp(distance[is_near]))


def _select_edge_part(xy: np.ndarray, corner: np.ndarray) -> np.ndarray | None:
    """Return the points of a segment at usable distances from the corner, None if it does not end there."""
    distance = np.hypot(*(xy - corner).T)
    if distance.min() > TARGETS.end_px:
        return None
    direction = xy[np.argmax(distance)] - corner
    one_side = (xy - corner) @ direction > 0.0
    if np.sum(~one_side & (distance > TARGETS.end_px)) > 0.3 * len(xy):  # the edge continues: a crossing
        return None
    selected = one_side & (distance >= BLUR.edge_px) & (distance <= TARGETS.far_px)
    part = xy[selected]
    return part if len(part) >= 3 and np.ptp(distance[selected]) >= TARGETS.shortest_edge_px - BLUR.edge_px else None


def _report_corner(corner: LineCorner, edges: np.ndarray, origin: np.ndarray) -> TargetMeasurement:
    inliers, curves = np.concatenate([line.used for line in corner.lines]), []
    for line in corner.lines:  # from the corner to the far end of the used part of the line
        ends = line.centroid + np.outer(line.reach_px, line.direction)
        curves.append(
            np.array([corner.position, max(ends, key=lambda end: np.hypot(*(end - corner.position)))]) + origin
        )
    quality = 1.0 / (1.0 + corner.rmse_px / 0.2)
    return TargetMeasurement(
        TARGET_CORNER,
        corner.position + origin,
        corner.covariance_px2,
        rmse_px=corner.rmse_px,
        edges=edges + origin,
        used=inliers,
        curves=tuple(curves),
        quality=quality,
    )


Measure = Callable[[Raster, np.ndarray, TargetOptions], TargetMeasurement]
#: The measuring function for each kind of target.
MEASURES: dict[str, Measure] = {TARGET_CENTER: measure_centre, TARGET_CORNER: measure_corner}


# ---- manually measured edge points -----------------------------------------------------------------------------


def fit_centre_to_edges(edges: np.ndarray, method: str = "direct") -> TargetMeasurement:
    """Return the ellipse centre of manually measured edge points; raises `SolveError` if they do not determine it."""
    return _report_ellipse(fit_ellipse(edges, method), edges, np.nan)


def fit_corner_to_edges(edges: np.ndarray) -> TargetMeasurement:
    """Return the intersection of the two lines of manually measured edge points; raises `SolveError`."""
    first, second = split_into_lines(edges)
    corner = intersect_lines(fit_line(edges[first]), fit_line(edges[second]))
    return _report_corner(corner, np.concatenate([edges[first], edges[second]]), np.zeros(2))


EDGE_FITS: dict[str, Callable[[np.ndarray], TargetMeasurement]] = {
    TARGET_CENTER: fit_centre_to_edges,
    TARGET_CORNER: fit_corner_to_edges,
}


def measure_edges(edges: np.ndarray, kind: str = TARGET_CENTER) -> TargetMeasurement:
    """Measure the target given by manually measured edge points.

    Parameters
    ----------
    edges : (n, 2) ndarray
        Sample, line in pixels.
    kind : str
        One of `MEASURES`.

    Returns
    -------
    TargetMeasurement
        The target, or a refusal with the reason.

    Raises
    ------
    InputError
        The kind is unknown.
    """
    if kind not in EDGE_FITS:
        raise InputError(f"target kind {kind!r} is not one of {', '.join(EDGE_FITS)}: correct it")
    try:
        return EDGE_FITS[kind](np.asarray(edges, dtype=np.float64))
    except SolveError as error:
        return make_refusal(kind, str(error))
