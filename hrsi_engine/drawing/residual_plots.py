"""Plots of a registration as SVG: residual vectors over the image, and bars that compare kinds of points."""

import html
import math
from collections.abc import Mapping

import numpy as np

from .arrows import choose_round_length, make_arrow_path

RESIDUALS_WIDTH, MARGIN = 560.0, 34.0
TYPICAL_ARROW = 32.0  # drawing units of the 90th percentile


def compute_typical_length(residual: np.ndarray) -> float:
    """Return the 90th percentile of the lengths of residuals (n, 2)."""
    return float(np.percentile(np.hypot(*residual.T), 90.0))


def draw_residual_vectors(
    xy: np.ndarray, residual: np.ndarray, groups: np.ndarray, unit: str, extent: np.ndarray | None = None,
    typical: float | None = None,
) -> str:  # fmt: skip
    """Return residual arrows at the points' places (thesis figures 2.13, 2.14, 2.17 to 2.20).

    xy, residual : (n, 2) places and residuals, lines downwards; groups : (n,) they name the colour
    unit : of the residuals, for the scale; extent : (2, 2) two corners of what is shown; by default the points' own
    typical : length that sets the scale of the arrows; by default their own
    """
    low, high = (xy.min(axis=0), xy.max(axis=0)) if extent is None else extent
    scale = (RESIDUALS_WIDTH - 2.0 * MARGIN) / max(float((high - low).max()), 1e-9)
    height = float((high - low)[1]) * scale + 2.0 * MARGIN + 24.0
    typical = compute_typical_length(residual) if typical is None else typical
    per_unit = TYPICAL_ARROW / typical if typical > 0.0 else 0.0
    parts = [f'<svg class="card" viewBox="0 0 {RESIDUALS_WIDTH:.0f} {height:.0f}" role="img" aria-label="Residuals">']
    if extent is not None:
        width, depth = (high - low) * scale
        frame = f'x="{MARGIN}" y="{MARGIN}" width="{width:.1f}" height="{depth:.1f}"'
        parts.append(f'<rect {frame} class="frame"/>')
    for (x, y), (dx, dy), group in zip((xy - low) * scale + MARGIN, residual * per_unit, groups, strict=True):
        parts.append(_draw_arrow(x, y, dx, dy, str(group)))
    if typical > 0.0:
        length = choose_round_length(1.5 * typical)
        parts.append(_draw_arrow(MARGIN, height - 14.0, length * per_unit, 0.0, "scale"))
        x = MARGIN + length * per_unit + 8.0
        parts.append(f'<text x="{x:.1f}" y="{height - 10.0:.1f}">{length:g} {html.escape(unit)}</text>')
    return "".join([*parts, "</svg>"])


def _draw_arrow(x: float, y: float, dx: float, dy: float, group: str) -> str:
    return f'<path class="v {html.escape(group)}" d="M{x:.1f},{y:.1f}h0{make_arrow_path(x, y, dx, dy, head=5.0)}"/>'


def draw_bars(values: Mapping[str, Mapping[str, float]], unit: str) -> str:
    """Return bars by case, one for each group (thesis figures 2.7 and 2.21).

    values : heights of the bars, ``values[case][group]``; unit : of the values
    """
    rows = [(case, group, value) for case, groups in values.items() for group, value in groups.items()]
    largest = max((value for _, _, value in rows if math.isfinite(value)), default=1.0) or 1.0
    height = 26.0 * len(rows) + 10.0
    parts = [f'<svg class="bars" viewBox="0 0 {RESIDUALS_WIDTH:.0f} {height:.0f}" role="img" aria-label="Comparison">']
    for number, (case, group, value) in enumerate(rows):
        y = 26.0 * number + 6.0
        length = 0.0 if not math.isfinite(value) else (RESIDUALS_WIDTH - 320.0) * value / largest
        label = html.escape(f"{case}, {group}")
        parts.append(f'<text x="4" y="{y + 14.0:.1f}">{label}</text>')
        parts.append(f'<rect x="230" y="{y:.1f}" width="{length:.1f}" height="18" class="bar {html.escape(group)}"/>')
        told = f"{value:.2f} {html.escape(unit)}" if math.isfinite(value) else "–"
        parts.append(f'<text x="{236.0 + length:.1f}" y="{y + 14.0:.1f}">{told}</text>')
    return "".join([*parts, "</svg>"])
