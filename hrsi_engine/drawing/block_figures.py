"""The figures of a block's report besides its map, drawn as SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .distribution_plots import coverage_svg, histogram_svg, qq_svg
from .residual_plots import residual_vectors_svg, typical_length
from .target_chips import TargetChip, chip_svg


@dataclass(frozen=True, eq=False)
class ImageVectors:
    """Residuals on one image: xy, residual_px (n, 2); groups (n,) gcp, check, tie or outlier; extent: its corners."""

    image: str
    xy: np.ndarray
    residual_px: np.ndarray
    groups: np.ndarray
    extent: np.ndarray
    total: int  #: measurements there are, of which these are drawn


@dataclass(frozen=True, eq=False)
class OutlierChip:
    """An outlier's surroundings; ``chip.curves`` lead from the measured to the computed position."""

    id: str
    image: str
    chip: TargetChip


@dataclass(frozen=True, eq=False)
class ReportFigures:
    """What the figures show: normalised residuals by axis, tie points by cell (lines first) and image, and more."""

    vectors: Sequence[ImageVectors] = ()
    normalised: Mapping[str, np.ndarray] = field(default_factory=dict)
    coverage: Mapping[str, np.ndarray] = field(default_factory=dict)
    outliers: Sequence[OutlierChip] = ()


def drawn(figures: ReportFigures) -> dict[str, object]:
    """Return the drawings for the page's template; arrows have one scale for all images."""
    typical = typical_length(np.vstack([one.residual_px for one in figures.vectors])) if figures.vectors else 0.0
    return {
        "vectors": [
            (one.image, len(one.xy), one.total, residual_vectors_svg(
                one.xy, one.residual_px, one.groups, "px", extent=one.extent, typical=typical
            ))
            for one in figures.vectors
        ],
        "distributions": [
            (axis, histogram_svg(values, f"Histogram, {axis}"), qq_svg(values, f"Q-Q, {axis}"))
            for axis, values in figures.normalised.items()
            if len(values)
        ],
        "coverage": [
            (image, coverage_svg(counts, f"Tie points of {image}")) for image, counts in figures.coverage.items()
        ],
        "outlier_chips": [(one.id, one.image, chip_svg(one.chip)) for one in figures.outliers],
    }  # fmt: skip
