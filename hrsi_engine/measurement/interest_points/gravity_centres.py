"""Gravity centres of closed regions: roundabouts, tanks, roofs, pools, ponds, trees, plots.

Every candidate region gets a sub-pixel outline, and the simplest shape that agrees with it within its tolerance: an
ellipse, a rectangle, else the polygon of the edge points. The gravity centre is that of the shape; the grey-weighted
centroid must agree with it. Regions without closed outline, with low contrast or irregular shape are rejected. An
object is usually found at many levels and scales: its best centre is used, and their number measures its stability.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ...foundation.pixel_filters import BLUR
from ...foundation.thresholds import MEMORY, threshold, thresholds
from .corners import SIMULATED_OBJECTS
from .level_regions import HOMOGENEOUS, find_compact_regions
from .options import CentreOptions
from .outlines import GradientImage, Outlines, interpolate_bilinear, measure_outlines
from .shapes import SHAPE, SHAPES, Shapes, compute_size_tolerance
from .windows import STATISTICS_HALO_PX, DetectionWindow, ImageStatistics, normalise


@thresholds
class CENTRE:
    """Conditions for gravity centres of closed regions, and their quality (0 to 1)."""

    centroid_agreement: tuple[float, float] = threshold(
        (0.4, 0.05), "px, share", "largest distance of centroid and centre: constant and per size", SIMULATED_OBJECTS
    )
    centroid_samples: int = threshold(13, "points", "side of the sample grid of the grey-weighted centroid")
    same_outline_px: float = threshold(0.75, "px", "largest distance of the centres of equal outlines")
    same_log_radius: float = threshold(0.06, "", "largest difference of the logs of the mean radii of equal outlines")
    same_centre: float = threshold(0.1, "", "largest distance of the centres of one object over its diameter")
    full_support: int = threshold(4, "regions", "number of regions with one outline for score 1", SIMULATED_OBJECTS)
    full_contrast: float = threshold(8.0, "sigma", "contrast for a score of 1", SIMULATED_OBJECTS)
    zero_sigma_px: float = threshold(0.25, "px", "sigma of the centre for a score of 0", SIMULATED_OBJECTS)
    zero_closed: float = threshold(0.65, "", "share of closed outline for a score of 0", SIMULATED_OBJECTS)
    strong_quality: float = threshold(0.75, "", "quality of an object that is certain", SIMULATED_OBJECTS)


class GravityCentre(NamedTuple):
    """A gravity centre.

    xy : (2,) sample, line; covariance_px2 : (2, 2); kind : ``ellipse``, ``rectangle`` or ``region``
    size_px : (2,) longer and shorter diameter or side; azimuth_rad : of the longer one, from +sample towards +line
    rmse_px : RMSE of the outline about the shape; contrast : grey values inside - outside; quality : 0 … 1
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
        """Standard deviation of a coordinate (quadratic mean of the two axes)."""
        return float(np.sqrt(np.trace(self.covariance_px2) / 2.0))


@dataclass(eq=False)
class _CentreCandidates:
    """Centres of a window before merging, columns of length n; ``row`` is the index in the shapes of its ``kind``."""

    xy: np.ndarray
    size_px: np.ndarray
    contrast: np.ndarray
    score: np.ndarray
    support: np.ndarray
    kind: np.ndarray
    row: np.ndarray


def compute_centre_halo_px(options: CentreOptions) -> int:
    """Return the distance by which a window must extend beyond its core."""
    return STATISTICS_HALO_PX + int(np.ceil(options.largest_px / 2.0)) + MEMORY.border_px


def find_gravity_centres(
    window: DetectionWindow, statistics: ImageStatistics, options: CentreOptions
) -> list[GravityCentre]:
    """Return the gravity centres in a window's core, in image pixels."""
    regions = find_compact_regions(normalise(window, statistics), window.usable, options.largest_px)
    # Keep regions whose centre may be inside the core
    middle = regions.centres()
    low = np.array([window.core.left, window.core.top]) - window.origin - MEMORY.border_px
    high = np.array([window.core.right, window.core.bottom]) - window.origin + MEMORY.border_px
    near_core = np.asarray(np.all((middle >= low) & (middle < high), axis=1))
    regions = regions.select(near_core)
    if not len(regions):
        return []
    slopes = GradientImage(window.grey, window.usable, statistics.noise)
    outlines = measure_outlines(slopes, regions)
    closed = np.asarray(outlines.found.sum(axis=1) >= SHAPE.closed_share * outlines.count)
    outlines, sign, support = _merge_outlines(
        outlines.select(closed), -regions.sign[closed].astype(np.float64), window.origin
    )
    # The shapes of each of `SHAPES`, with the rows of the outlines for which it is the first suitable one
    open_rows = np.arange(len(sign))
    shapes = {}
    for kind, fit in SHAPES.items():
        trial_rows = open_rows if kind != "region" else open_rows[sign[open_rows] != HOMOGENEOUS]
        shape = fit(outlines.select(trial_rows), slopes, sign[trial_rows])
        shapes[kind] = shape.select(shape.good), trial_rows[shape.good]
        open_rows = np.setdiff1d(open_rows, trial_rows[shape.good])
    tables = [
        _score_shapes(
            kind, shape, sign[rows], support=support[rows], slopes=slopes, statistics=statistics, options=options
        )
        for kind, (shape, rows) in shapes.items()
    ]
    candidates = _CentreCandidates(
        *(np.concatenate([getattr(part, f.name) for part in tables]) for f in fields(_CentreCandidates))
    )
    best_rows, quality = _select_best_centres(candidates, options)
    centres = []
    for k, worth in zip(best_rows, quality, strict=True):
        kind, row = str(candidates.kind[k]), candidates.row[k]
        shape = shapes[kind][0]
        outline = shape.edges[row][shape.found[row]] + window.origin
        centres.append(
            GravityCentre(
                shape.xy[row] + window.origin,
                shape.covariance_px2[row],
                kind,
                size_px=shape.size_px[row],
                azimuth_rad=float(shape.azimuth_rad[row]),
                rmse_px=float(shape.rmse_px[row]),
                contrast=float(candidates.contrast[k]),
                quality=worth,
                outline=outline,
            )
        )
    is_inside = window.core.contains(np.array([centre.xy for centre in centres]).reshape(-1, 2))
    return [centre for centre, inside in zip(centres, is_inside, strict=True) if inside]


def _merge_outlines(
    outlines: Outlines, sign: np.ndarray, origin: np.ndarray
) -> tuple[Outlines, np.ndarray, np.ndarray]:
    """Return one of several equal outlines, with its sign and the number of regions with this outline.

    Regions of an object at neighbouring levels have the same edges; the most complete outline is selected.
    """
    count = np.maximum(outlines.found.sum(axis=1), 1)
    middle = np.sum(outlines.found[..., None] * outlines.xy, axis=1) / count[:, None]
    arm = np.where(outlines.found, np.linalg.norm(outlines.xy - middle[:, None], axis=-1), 0.0)
    radius = arm.sum(axis=1) / count
    place = np.rint((middle + origin) / CENTRE.same_outline_px)
    cell = np.column_stack([sign, place, np.rint(np.log(np.maximum(radius, 1.0)) / CENTRE.same_log_radius)])
    order = np.lexsort((*(middle.T), -(count / outlines.count), *cell.T))
    first = np.r_[True, np.any(cell[order][1:] != cell[order][:-1], axis=1)] if len(order) else np.empty(0, bool)
    support = np.diff(np.r_[np.flatnonzero(first), len(order)])
    representatives = order[first]
    return outlines.select(representatives), sign[representatives], support


# ---- assessment ------------------------------------------------------------------------------------------------


def _score_shapes(
    kind: str,
    shapes: Shapes,
    sign: np.ndarray,
    support: np.ndarray,
    slopes: GradientImage,
    statistics: ImageStatistics,
    options: CentreOptions,
) -> _CentreCandidates:
    """Return the centres of one kind that pass all tests, with their scores."""
    # Median grey values half-way to the edge and outside it, ``(n,)``
    arm = shapes.edges - shapes.xy[:, None]
    length = np.maximum(np.linalg.norm(arm, axis=-1, keepdims=True), 1e-9)
    values = []
    for points in (shapes.xy[:, None] + 0.5 * arm, shapes.edges + BLUR.end_px * arm / length):
        grey = interpolate_bilinear(slopes.grey, points[..., 0], points[..., 1])
        # The (lower) median of the valid values of each row
        ordered = np.sort(np.where(shapes.found, grey, np.inf), axis=1)
        middle = np.maximum((shapes.found.sum(axis=1) - 1) // 2, 0)
        values.append(np.asarray(ordered[np.arange(len(grey)), middle], dtype=np.float64))
    inside, outside = values[0], values[1]
    contrast = inside - outside
    relative = np.abs(contrast) / statistics.deviation_floor
    keep = (shapes.size_px[:, 1] >= options.smallest_px) & (shapes.size_px[:, 0] <= options.largest_px)
    keep &= (relative >= options.contrast) & ((sign == HOMOGENEOUS) | (sign * contrast < 0.0))
    limit = CENTRE.centroid_agreement[0] + CENTRE.centroid_agreement[1] * np.sqrt(np.prod(shapes.size_px, axis=1))
    # Grey-weighted centroids (n, 2) over the rotated bounding boxes of the shapes
    step = np.linspace(-0.5, 0.5, CENTRE.centroid_samples)
    along, across = (a.ravel() for a in np.meshgrid(step, step))
    box = shapes.size_px + 2.0 * BLUR.edge_px
    along, across = box[:, :1] * along, box[:, 1:] * across
    cos, sin = np.cos(shapes.azimuth_rad)[:, None], np.sin(shapes.azimuth_rad)[:, None]
    x, y = shapes.xy[:, :1] + cos * along - sin * across, shapes.xy[:, 1:] + sin * along + cos * across
    difference = np.where(inside == outside, np.inf, inside - outside)
    weight = np.clip((interpolate_bilinear(slopes.grey, x, y) - outside[:, None]) / difference[:, None], 0.0, 1.0)
    total = np.maximum(weight.sum(axis=1), 1e-9)
    offset = np.stack([(weight * x).sum(axis=1) / total, (weight * y).sum(axis=1) / total], axis=1) - shapes.xy
    keep &= (sign == HOMOGENEOUS) | (np.hypot(offset[:, 0], offset[:, 1]) < limit)
    # Scores 0 … 1: contrast, closed share of the outline, its fit to the shape, accuracy of the centre
    sigma = np.sqrt(np.trace(shapes.covariance_px2, axis1=1, axis2=2) / 2.0)
    scores = (
        relative / CENTRE.full_contrast,
        (shapes.closed - CENTRE.zero_closed) / (1.0 - CENTRE.zero_closed),
        1.0 - shapes.rmse_px / compute_size_tolerance(SHAPE.polygon_tolerance, shapes.size_px),
        1.0 - sigma / CENTRE.zero_sigma_px,
    )
    score = np.asarray(np.prod(np.clip(scores, 0.0, 1.0), axis=0))
    index = np.flatnonzero(keep)
    return _CentreCandidates(
        shapes.xy[index],
        shapes.size_px[index],
        contrast[index],
        score=score[index],
        support=support[index],
        kind=np.full(len(index), kind),
        row=index,
    )


# ---- one centre per object -------------------------------------------------------------------------------------


def _select_best_centres(candidates: _CentreCandidates, options: CentreOptions) -> tuple[list[int], list[float]]:
    """Return the best centre of each object and its quality; centres of equal position and similar size are merged."""
    if not len(candidates.xy):
        return [], []
    size = np.sqrt(np.prod(candidates.size_px, axis=1))
    pairs = cKDTree(candidates.xy).query_pairs(max(CENTRE.same_centre * float(size.max()), 1.0), output_type="ndarray")
    first, second = pairs.T
    is_close = np.hypot(*(candidates.xy[first] - candidates.xy[second]).T) < np.maximum(
        CENTRE.same_centre * np.minimum(size[first], size[second]), 1.0
    )
    is_close &= np.abs(np.log(size[first] / size[second])) < np.log(1.6)
    neighbours: list[list[int]] = [[] for _ in size]
    for a, b in pairs[is_close].tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    free = np.ones(len(size), dtype=bool)
    best_rows, quality = [], []
    for row in np.lexsort((candidates.xy[:, 0], candidates.xy[:, 1], -candidates.score)).tolist():
        if not free[row]:
            continue
        group = [row, *(neighbour for neighbour in neighbours[row] if free[neighbour])]
        free[group] = False
        support = min(float(candidates.support[group].sum()) / CENTRE.full_support, 1.0)
        worth = float((candidates.score[row] * support) ** 0.2)
        if worth >= options.quality:
            best_rows.append(row)
            quality.append(worth)
    return best_rows, quality
