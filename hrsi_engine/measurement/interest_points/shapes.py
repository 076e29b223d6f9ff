"""Ellipses, rectangles and polygons fitted to many outlines together.

A shape is first fitted to the outline of its region. Ellipses and rectangles are then measured again: edges are
searched along the normals of the shape, at evenly distributed points, so that the result is independent of the region.
A rectangle is a parallelogram, as in satellite images: two pairs of parallel lines. Points away from the curve are
down-weighted (Geman and McClure 1985).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...foundation.pixel_filters import BLUR
from ...foundation.thresholds import EQUALITY, threshold, thresholds
from ..targets.ellipse import (
    compute_axes,
    compute_centre_covariances,
    compute_ellipse_distances,
    fit_direct_ellipses,
    iterate_ellipses,
)
from .corners import SIMULATED_OBJECTS
from .outlines import GradientImage, Outlines, find_edges_along


@thresholds
class SHAPE:
    """Conditions for an ellipse, rectangle or polygon to fit an outline."""

    closed_share: float = threshold(0.85, "", "smallest share of clear edge points on the shape", SIMULATED_OBJECTS)
    sigma_floor_px: float = threshold(0.02, "px", "added to the standard deviation of a centre (in squares)")
    correlation_length_px: float = threshold(4.0, "px", "correlation length of the edge", SIMULATED_OBJECTS)
    ellipse_tolerance: tuple[float, float] = threshold(
        (0.20, 0.012),
        "px, share",
        "largest RMS of edge points about an ellipse or a rectangle: constant and per size",
        SIMULATED_OBJECTS,
    )
    polygon_tolerance: tuple[float, float] = threshold(
        (0.5, 0.04),
        "px, share",
        "largest RMS of edge points about an outline: constant and per size",
        SIMULATED_OBJECTS,
    )
    independent_parts: int = threshold(8, "parts", "number of independent errors along a polygon's outline")
    fourfold: float = threshold(0.25, "", "smallest fourfold moment of a rectangle's normals", SIMULATED_OBJECTS)
    robust_px: tuple[float, ...] = threshold(
        (1.0, 0.5, 0.3, 0.3), "px", "residual with a quarter of the weight, in each step", SIMULATED_OBJECTS
    )
    on_shape_px: float = threshold(0.6, "px", "largest residual of an edge point on a shape or edge")
    ellipse_points: int = threshold(48, "points", "edge points measured around an ellipse")
    side_points: int = threshold(20, "points", "edge points measured along a side")
    corner_share: float = threshold(0.12, "", "share of a side that is not used at each end (rounded corner)")
    fine_reach_px: float = threshold(1.25, "px", "half length of the normals of a fitted shape")


class Shapes(NamedTuple):
    """Shapes of n outlines.

    good : (n,) mask of those that represent their outline, the other rows are undefined; xy : (n, 2) centre
    covariance_px2 : (n, 2, 2); size_px : (n, 2) longer and shorter diameter or side; azimuth_rad : (n,) of the longer
    rmse_px : (n,) of the edge points; closed : (n,) share of clear edge points on the shape; edges : (n, k, 2) edge
    points, found : (n, k) mask of those on the shape
    """

    good: np.ndarray
    xy: np.ndarray
    covariance_px2: np.ndarray
    size_px: np.ndarray
    azimuth_rad: np.ndarray
    rmse_px: np.ndarray
    closed: np.ndarray
    edges: np.ndarray
    found: np.ndarray

    def select(self, keep: np.ndarray) -> Shapes:
        """Return the selected shapes (mask or indices)."""
        return Shapes(*(column[keep] for column in self))


def compute_size_tolerance(limits: tuple[float, float], size_px: np.ndarray) -> np.ndarray:
    """Return the largest permitted RMSE ``(n,)`` of shapes of ``size_px (n, 2)``."""
    return np.asarray(limits[0] + limits[1] * np.sqrt(np.prod(size_px, axis=1)))


def _add_sigma_floor(covariance: np.ndarray) -> np.ndarray:
    """Return covariances ``(n, 2, 2)`` with the variance `SHAPE.sigma_floor_px` squared added."""
    return covariance + SHAPE.sigma_floor_px**2 * np.eye(2)


def _robust_weight(residual: np.ndarray, scale_px: float) -> np.ndarray:
    """Return weights 1 / (1 + (r / scale)²)² of residuals (Geman and McClure 1985)."""
    return 1.0 / (1.0 + (residual / scale_px) ** 2) ** 2


def _mean_of_rows(mask: np.ndarray, count: np.ndarray | float) -> np.ndarray:
    return np.asarray(mask.sum(axis=1) / np.maximum(count, 1.0))


# ---- ellipses --------------------------------------------------------------------------------------------------


def fit_ellipses(outlines: Outlines, slopes: GradientImage, sign: np.ndarray) -> Shapes:
    """Return the ellipses through outlines; ``sign (n,)`` is that of the outward gradient, 0 for any sign."""
    is_closed = _mean_of_rows(outlines.found, outlines.count) >= SHAPE.closed_share
    xy, weight = outlines.xy[is_closed], outlines.found[is_closed].astype(np.float64)
    centre, Q, valid = fit_direct_ellipses(xy, weight)
    valid &= np.linalg.det(Q) > 1e-12
    Q = np.where(valid[:, None, None], Q, np.eye(2))
    residual = compute_ellipse_distances(xy, centre, Q)
    rmse = np.sqrt(np.sum(weight * residual**2, axis=1) / np.maximum(weight.sum(axis=1), 1.0))
    valid &= rmse < 1.5 * compute_size_tolerance(
        SHAPE.ellipse_tolerance, 2.0 * compute_axes(Q)[0]
    )  # rejects most outlines early
    is_closed[is_closed] = valid
    return _expand_rows(_remeasure_ellipses(centre[valid], Q[valid], slopes, sign[is_closed]), is_closed)


def _remeasure_ellipses(centre: np.ndarray, Q: np.ndarray, slopes: GradientImage, sign: np.ndarray) -> Shapes:
    # Points on ellipses and outward normals, ``(n, points, 2)``
    """Return the ellipses of edge points that are measured again along their normals, with robust weights.

    Neighbouring edge points are correlated over `SHAPE.correlation_length_px`, by which the covariance is enlarged.

    centre, Q : (n, 2) and (n, 2, 2) of the outlines; sign : (n,) of the outward gradient
    """
    semi_axes, azimuth = compute_axes(Q)
    t = 2.0 * np.pi * np.arange(SHAPE.ellipse_points) / SHAPE.ellipse_points
    along, across = semi_axes[:, :1] * np.cos(t), semi_axes[:, 1:] * np.sin(t)
    cos, sin = np.cos(azimuth)[:, None], np.sin(azimuth)[:, None]
    d = np.stack([cos * along - sin * across, sin * along + cos * across], axis=-1)
    normal = d @ Q
    points, normals = centre[:, None] + d, normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    edges, is_edge = _measure_edges(slopes, points, normals, sign)
    weight = is_edge.astype(np.float64)
    for scale_px in SHAPE.robust_px:
        residual = compute_ellipse_distances(edges, centre, Q)
        weight = is_edge * _robust_weight(residual, scale_px)
        centre, Q = iterate_ellipses(edges, weight, centre, Q, 1)
    on_shape = is_edge & (np.abs(compute_ellipse_distances(edges, centre, Q)) < SHAPE.on_shape_px)
    weight = on_shape.astype(np.float64)
    centre, Q = iterate_ellipses(edges, weight, centre, Q, 1)
    residual = compute_ellipse_distances(edges, centre, Q)
    semi_axes, azimuth = compute_axes(Q)
    size = 2.0 * semi_axes
    spacing = np.pi * np.sqrt(np.prod(size, axis=1)) / SHAPE.ellipse_points
    covariance = (
        compute_centre_covariances(edges, weight, centre, Q)
        * np.maximum(SHAPE.correlation_length_px / spacing, 1.0)[:, None, None]
    )
    rmse = np.sqrt(np.sum(weight * residual**2, axis=1) / np.maximum(weight.sum(axis=1), 1.0))
    closed = _mean_of_rows(on_shape, SHAPE.ellipse_points)
    valid = (rmse <= compute_size_tolerance(SHAPE.ellipse_tolerance, size)) & (closed >= SHAPE.closed_share)
    return Shapes(
        valid,
        centre,
        _add_sigma_floor(covariance),
        size_px=size,
        azimuth_rad=azimuth,
        rmse_px=rmse,
        closed=closed,
        edges=edges,
        found=on_shape,
    )


def _measure_edges(
    slopes: GradientImage, points: np.ndarray, normals: np.ndarray, sign: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return edge points near points ``(n, k, 2)`` along their normals, and the mask of clear ones ``(n, k)``."""
    count = points.shape[1]
    edges, _, is_edge = find_edges_along(
        slopes, points.reshape(-1, 2), normals.reshape(-1, 2), np.repeat(sign, count), SHAPE.fine_reach_px
    )
    return edges.reshape(points.shape), is_edge.reshape(points.shape[:2])


def _expand_rows(shapes: Shapes, rows: np.ndarray) -> Shapes:
    """Return the shapes of masked rows as a table of all rows."""
    table = [np.zeros((len(rows), *column.shape[1:]), dtype=column.dtype) for column in shapes]
    for full, column in zip(table, shapes, strict=True):
        full[rows] = column
    return Shapes(*table)


# ---- rectangles ------------------------------------------------------------------------------------------------


def fit_rectangles(outlines: Outlines, slopes: GradientImage, sign: np.ndarray) -> Shapes:
    """Return the parallelograms through outlines; normals of four directions belong to the four sides."""
    weight = outlines.found.astype(np.float64)
    angle = np.arctan2(outlines.normal[..., 1], outlines.normal[..., 0])
    fourfold = np.sum(weight * np.exp(4j * angle), axis=1) / np.maximum(weight.sum(axis=1), 1.0)
    has_corners = np.abs(fourfold) >= SHAPE.fourfold
    azimuth = np.angle(fourfold[has_corners]) / 4.0
    turn = angle[has_corners] - azimuth[:, None]
    sides = np.stack([np.cos(turn - k * np.pi / 2.0) > 0.85 for k in range(4)], axis=1)
    xy = np.broadcast_to(outlines.xy[has_corners][:, None], (*sides.shape, 2))
    lines = _fit_sides(xy, (sides & outlines.found[has_corners][:, None]).astype(np.float64), SHAPE.robust_px[:2])
    for _ in range(2):
        # Points on the sides and outward normals, and whether all sides are long enough
        c = lines.corners
        starts, ends = c[:, [3, 0, 1, 2]], c[:, [0, 1, 2, 3]]  # side k is between corners k - 1 and k
        length = np.linalg.norm(ends - starts, axis=-1)
        margin = np.clip(np.maximum(SHAPE.corner_share, BLUR.edge_px / np.maximum(length, 1e-6)), 0.0, 0.4)
        t = margin[..., None] + (1.0 - 2.0 * margin[..., None]) * np.linspace(0.0, 1.0, SHAPE.side_points)
        points = starts[:, :, None] + t[..., None] * (ends - starts)[:, :, None]
        normal = np.concatenate([lines.normal, lines.normal], axis=1)
        outwards = np.sum((0.5 * (starts + ends) - c.mean(axis=1)[:, None]) * normal, axis=-1)
        normal = normal * np.where(outwards < 0.0, -1.0, 1.0)[..., None]
        normals, usable = np.broadcast_to(normal[:, :, None], points.shape), (length > 3.0).all(axis=1)
        shape = points.shape[:3]
        flat = len(points), 4 * SHAPE.side_points, 2
        edges, is_edge = _measure_edges(slopes, points.reshape(flat), normals.reshape(flat), sign[has_corners])
        lines = _fit_sides(edges.reshape(*shape, 2), is_edge.reshape(shape).astype(np.float64), SHAPE.robust_px[1:])
        lines = lines._replace(good=lines.good & usable)
    return _expand_rows(_make_rectangles(lines, edges.reshape(*shape, 2), is_edge.reshape(shape)), has_corners)


class _Sides(NamedTuple):
    """Four sides of n parallelograms; 0 and 2, 1 and 3 are opposite.

    normal : (n, 2, 2) of the two pairs; offset : (n, 4) of each side along its pair's normal
    residual : (n, 4, k) of the points; weight : (n, 4, k); corners : (n, 4, 2), between sides k and k + 1
    """

    normal: np.ndarray
    offset: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    corners: np.ndarray
    good: np.ndarray


def _fit_sides(xy: np.ndarray, is_edge: np.ndarray, robust_px: tuple[float, ...]) -> _Sides:
    """Return two pairs of parallel lines through the points of four sides.

    A pair's common direction is the principal axis of the scatter of both sides about their own middles.

    xy : (n, 4, k, 2); is_edge : (n, 4, k) 1 for edge points, 0 for others
    robust_px : scales of the weights of successive fits
    """
    weight = is_edge
    for scale_px in (*robust_px, 0.0):
        total = np.maximum(weight.sum(axis=2), 1e-9)
        middle = np.sum(weight[..., None] * xy, axis=2) / total[..., None]
        d = xy - middle[:, :, None]
        scatter = np.swapaxes(weight[..., None] * d, 2, 3) @ d
        normal = np.linalg.eigh(scatter[:, :2] + scatter[:, 2:])[1][..., 0]
        side_normal = np.concatenate([normal, normal], axis=1)
        residual = np.sum(d * side_normal[:, :, None], axis=-1)
        if scale_px:
            weight = is_edge * _robust_weight(residual, scale_px)
    offset = np.sum(middle * side_normal, axis=-1)
    valid = (is_edge.sum(axis=2) >= 3.0).all(axis=1)
    cross = normal[:, 0, 0] * normal[:, 1, 1] - normal[:, 0, 1] * normal[:, 1, 0]
    valid &= np.abs(cross) > EQUALITY.rounding
    inverse = np.linalg.inv(np.where(valid[:, None, None], normal, np.eye(2)))
    ends = np.stack([offset[:, [0, 2, 2, 0]], offset[:, [1, 1, 3, 3]]], axis=-1)  # sides 0&1, 2&1, 2&3, 0&3
    corners = ends @ np.swapaxes(inverse, 1, 2)
    return _Sides(normal, offset, residual, weight, corners, valid)


def _make_rectangles(lines: _Sides, edges: np.ndarray, is_edge: np.ndarray) -> Shapes:
    """Return the parallelograms of fitted sides, with the covariances of their centres.

    The centre is the intersection of the two centre lines, each with the variance of the mean of its two sides; edge
    points of one side are independent beyond `SHAPE.correlation_length_px`.

    edges, is_edge : (n, 4, k, 2) and (n, 4, k) measured points and mask of the clear ones
    """
    on_side = is_edge & (np.abs(lines.residual) < SHAPE.on_shape_px)
    counted = np.maximum(on_side.sum(axis=2), 1.0)
    variance = np.sum(on_side * lines.residual**2, axis=2) / np.maximum(counted - 1.5, 1.0)
    variance /= np.maximum(on_side.mean(axis=2), 0.1) ** 4  # many outliers: the others are less accurate
    length = np.linalg.norm(lines.corners - np.roll(lines.corners, 1, axis=1), axis=-1)
    independent = np.clip(length / SHAPE.correlation_length_px, 1.0, counted)
    offset_variance = variance / independent
    pair_variance = (offset_variance[:, :2] + offset_variance[:, 2:]) / 4.0  # of the centre line between two sides
    inverse = np.linalg.inv(np.where(lines.good[:, None, None], lines.normal, np.eye(2)))
    covariance = (inverse * pair_variance[:, None, :]) @ np.swapaxes(inverse, 1, 2)
    sides = (length[:, :2] + length[:, 2:]) / 2.0
    edge = lines.corners[:, 0:2] - lines.corners[:, [3, 0]]
    along = edge[np.arange(len(edge)), np.argmax(sides, axis=1)]
    azimuth = (np.arctan2(along[:, 1], along[:, 0]) + np.pi / 2.0) % np.pi - np.pi / 2.0
    size = np.sort(sides, axis=1)[:, ::-1]
    rmse = np.sqrt(np.sum(on_side * lines.residual**2, axis=(1, 2)) / counted.sum(axis=1))
    closed = on_side.mean(axis=(1, 2))
    valid = lines.good & (closed >= SHAPE.closed_share)
    valid &= rmse <= compute_size_tolerance(SHAPE.ellipse_tolerance, size)
    count = edges.shape[1] * edges.shape[2]
    return Shapes(
        valid,
        lines.corners.mean(axis=1),
        _add_sigma_floor(covariance),
        size_px=size,
        azimuth_rad=azimuth,
        rmse_px=rmse,
        closed=closed,
        edges=edges.reshape(-1, count, 2),
        found=on_side.reshape(-1, count),
    )


# ---- polygons --------------------------------------------------------------------------------------------------


def fit_polygons(outlines: Outlines, slopes: GradientImage, sign: np.ndarray) -> Shapes:
    """Return the polygons of the edge points: centroid, and the diameters of the ellipse with equal moments."""
    count = outlines.found.sum(axis=1)
    order = np.argsort(~outlines.found, axis=1, kind="stable")
    xy = np.take_along_axis(outlines.xy, order[..., None], axis=1)
    normal = np.take_along_axis(outlines.normal, order[..., None], axis=1)
    column = np.arange(xy.shape[1])
    is_vertex = column < count[:, None]
    next_column = np.where(column + 1 < count[:, None], column + 1, 0)
    previous_column = np.where(column > 0, column - 1, np.maximum(count - 1, 0)[:, None])
    following, preceding = (
        np.take_along_axis(xy, index[..., None], axis=1) for index in (next_column, previous_column)
    )
    # Areas (n,), centroids (n, 2) and central second moments of the area (n, 2, 2), by Green's theorem
    origin = np.sum(is_vertex[..., None] * xy, axis=1) / np.maximum(is_vertex.sum(axis=1), 1)[:, None]
    x, y = np.moveaxis(np.where(is_vertex[..., None], xy - origin[:, None], 0.0), -1, 0)
    x1, y1 = np.moveaxis(np.where(is_vertex[..., None], following - origin[:, None], 0.0), -1, 0)
    cross = x * y1 - x1 * y
    area = cross.sum(axis=1) / 2.0
    safe = np.where(np.abs(area) > 1e-6, area, 1.0)
    centre = np.stack([((x + x1) * cross).sum(axis=1), ((y + y1) * cross).sum(axis=1)], axis=1) / (6.0 * safe[:, None])
    xx = ((x * x + x * x1 + x1 * x1) * cross).sum(axis=1) / (12.0 * safe)
    yy = ((y * y + y * y1 + y1 * y1) * cross).sum(axis=1) / (12.0 * safe)
    mixed = ((x * y1 + 2.0 * x * y + 2.0 * x1 * y1 + x1 * y) * cross).sum(axis=1) / (24.0 * safe)
    moments = np.stack([xx, mixed, mixed, yy], axis=1).reshape(-1, 2, 2) - centre[:, :, None] * centre[:, None, :]
    area, centroid = np.abs(area), centre + origin
    values, axes = np.linalg.eigh(moments)
    size = 4.0 * np.sqrt(np.maximum(values[:, ::-1], 1e-12))
    rough = np.sum((xy - (following + preceding) / 2.0) * normal, axis=-1)
    rmse = np.sqrt(np.sum(is_vertex * rough**2, axis=1) / np.maximum(count, 1) / 1.5)  # white noise: 1 + 2/4
    variance = 2.0 * rmse**2 / SHAPE.independent_parts  # as for a circle
    azimuth = (np.arctan2(axes[:, 1, 1], axes[:, 0, 1]) + np.pi / 2.0) % np.pi - np.pi / 2.0
    closed = count / np.maximum(outlines.count, 1)
    fits = rmse <= compute_size_tolerance(SHAPE.polygon_tolerance, size)
    valid = (closed >= SHAPE.closed_share) & (area > 1.0) & fits
    covariance = _add_sigma_floor(variance[:, None, None] * np.eye(2))
    return Shapes(
        valid,
        centroid,
        covariance,
        size_px=size,
        azimuth_rad=azimuth,
        rmse_px=rmse,
        closed=closed,
        edges=outlines.xy,
        found=outlines.found,
    )


ShapeFit = Callable[[Outlines, GradientImage, np.ndarray], Shapes]
#: Shapes in the order in which they are tried; the keys are the kinds of points.
SHAPES: dict[str, ShapeFit] = {"ellipse": fit_ellipses, "rectangle": fit_rectangles, "region": fit_polygons}
