"""What the figures of a block's report show: thinned, so that the page stays small however large the block is."""

from __future__ import annotations

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import Image
from ..block.points import ROLE_LABELS
from ..drawing.block_figures import ImageVectors, OutlierChip, ReportFigures
from ..drawing.target_chips import TargetChip
from .outliers import is_outlier, measurement_statistic
from .residuals import Residuals
from .statistics import normalised_residuals, tie_coverage

MOST_VECTORS = 250  # on one image
MOST_IMAGES = 24  # those with the largest residuals
MOST_COVERAGES = 60  # the emptiest
MOST_REPORT_CHIPS = 24
CHIP_HALF_PX = 24
MOST_VALUES = 400_000  # of a histogram


def report_figures(result: Adjustment, left: Residuals) -> ReportFigures:
    """Return the figures of an adjusted block."""
    residual, statistic = left.measured_px, np.nan_to_num(measurement_statistic(left))
    coverage = tie_coverage(result)
    has_ties = any(counts.any() for counts in coverage.values())
    emptiest = sorted(coverage, key=lambda name: int((coverage[name] > 0).sum()))[:MOST_COVERAGES]
    return ReportFigures(
        vectors=_vectors(result, residual, statistic),
        normalised={axis: _thin(values) for axis, values in normalised_residuals(result).items()},
        coverage={name: coverage[name] for name in emptiest} if has_ties else {},
        outliers=_outlier_chips(result, residual, statistic),
    )


def _thin(values: np.ndarray) -> np.ndarray:
    return values[:: max(1, len(values) // MOST_VALUES)]


def _vectors(result: Adjustment, residual: np.ndarray, statistic: np.ndarray) -> list[ImageVectors]:
    """Return the arrows of the images with the largest residuals: known points and outliers first, then some ties."""
    rows = result.block.measurements
    here = np.flatnonzero(np.isfinite(residual).all(axis=1))
    if not len(here):
        return []
    here = here[np.argsort(rows.image[here], kind="stable")]
    bounds = np.searchsorted(rows.image[here], np.arange(len(result.block.images) + 1))
    parts = {index: here[bounds[index] : bounds[index + 1]] for index in range(len(result.block.images))}
    size = {index: float(np.mean(np.sum(residual[part] ** 2, axis=1))) for index, part in parts.items() if len(part)}
    shown = sorted(sorted(size, key=lambda index: -size[index])[:MOST_IMAGES])
    return [_image_vectors(result, index, parts[index], residual, statistic) for index in shown]


def _image_vectors(
    result: Adjustment, index: int, part: np.ndarray, residual: np.ndarray, statistic: np.ndarray
) -> ImageVectors:
    rows, image = result.block.measurements, result.block.images[index]
    groups = ROLE_LABELS[result.block.points.role[rows.point[part]]].astype("U8")
    groups[is_outlier(statistic[part])] = "outlier"
    ties = np.flatnonzero(groups == "tie")
    others = np.flatnonzero(groups != "tie")[:MOST_VECTORS]
    room = max(MOST_VECTORS - len(others), 0)
    step = max(1, -(-len(ties) // room)) if room else len(ties) + 1
    chosen = np.concatenate([ties[::step], others])
    first_sample, last_sample, first_line, last_line = image.domain_px
    extent = np.array([[first_sample, first_line], [last_sample, last_line]])
    drawn = part[chosen]
    return ImageVectors(image.id, rows.xy[drawn], residual[drawn], groups[chosen], extent, len(part))


def _outlier_chips(result: Adjustment, residual: np.ndarray, statistic: np.ndarray) -> list[OutlierChip]:
    """Return chips of the worst measurements whose images have pixels."""
    rows = result.block.measurements
    worst = np.argsort(-statistic)[: 10 * MOST_REPORT_CHIPS]
    chips = []
    for row in worst[is_outlier(statistic[worst])].tolist():
        image = result.block.images[rows.image[row]]
        if image.raster is None:
            continue
        name = str(result.block.points.ids[rows.point[row]])
        chips.append(OutlierChip(name, image.id, _chip(image, rows.xy[row], residual[row])))
        if len(chips) == MOST_REPORT_CHIPS:
            break
    return chips


def _chip(image: Image, xy: np.ndarray, residual: np.ndarray) -> TargetChip:
    """Return the pixels around a measurement, wide enough for the computed position where that is near."""
    half = int(np.clip(1.5 * np.abs(residual).max(), CHIP_HALF_PX, 3 * CHIP_HALF_PX))
    low = np.round(xy).astype(int) - half
    grey, _ = image.pixels.read(int(low[0]), int(low[1]), 2 * half + 1, 2 * half + 1)
    nothing = np.empty((0, 2))
    line = np.array([xy, xy - residual])
    return TargetChip(grey, low.astype(np.float64), nothing, np.empty(0, dtype=bool), (line,), xy)
