"""Plots of a registration as SVG: residual vectors over the image, and bars that compare kinds of points."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping

import numpy as np

RESIDUALS_WIDTH, MARGIN = 560.0, 34.0
TYPICAL_ARROW = 32.0  # drawing units of the 90th percentile
PLOT_COLORS = {
    "center": "#1a7f4b", "corner": "#1565a8", "check": "#1a7f4b", "gcp": "#1565a8", "tie": "#78828c",
    "outlier": "#d7191c",
}  # fmt: skip
OTHER_COLOR = "#65707a"


def typical_length(residual: np.ndarray) -> float:
    """Return the 90th percentile of the lengths of residuals (n, 2)."""
    return float(np.percentile(np.hypot(*residual.T), 90.0))


def residual_vectors_svg(
    xy: np.ndarray,
    residual: np.ndarray,
    groups: np.ndarray,
    unit: str,
    extent: np.ndarray | None = None,
    typical: float | None = None,
) -> str:
    """Return residual arrows at the points' places (thesis figures 2.13, 2.14, 2.17 to 2.20).

    Parameters
    ----------
    xy, residual : (n, 2) ndarray
        Places and residuals, lines downwards.
    groups : (n,) ndarray of str
        They name the colour.
    unit : str
        Of the residuals, for the scale.
    extent : (2, 2) ndarray, optional
        Two corners of what is shown; by default the points' own.
    typical : float, optional
        Length that sets the scale of the arrows; by default their own.

    Returns
    -------
    str
        An SVG element.
    """
    low, high = (xy.min(axis=0), xy.max(axis=0)) if extent is None else extent
    scale = (RESIDUALS_WIDTH - 2.0 * MARGIN) / max(float((high - low).max()), 1e-9)
    height = float((high - low)[1]) * scale + 2.0 * MARGIN + 24.0
    typical = typical_length(residual) if typical is None else typical
    per_unit = TYPICAL_ARROW / typical if typical > 0.0 else 0.0
    parts = [f'<svg class="map" viewBox="0 0 {RESIDUALS_WIDTH:.0f} {height:.0f}" role="img" aria-label="Residuals">']
    if extent is not None:
        width, depth = (high - low) * scale
        frame = f'x="{MARGIN}" y="{MARGIN}" width="{width:.1f}" height="{depth:.1f}"'
        parts.append(f'<rect {frame} fill="none" stroke="#d9dee2"/>')
    for (x, y), (dx, dy), group in zip((xy - low) * scale + MARGIN, residual * per_unit, groups, strict=True):
        parts.append(_arrow(x, y, dx, dy, PLOT_COLORS.get(str(group), OTHER_COLOR)))
    if typical > 0.0:
        length = 10.0 ** math.floor(math.log10(1.5 * typical))
        length = next(step * length for step in (10.0, 5.0, 2.0, 1.0) if step * length <= 1.5 * typical)
        parts.append(_arrow(MARGIN, height - 14.0, length * per_unit, 0.0, "#1c2329"))
        x = MARGIN + length * per_unit + 8.0
        parts.append(f'<text x="{x:.1f}" y="{height - 10.0:.1f}">{length:g} {html.escape(unit)}</text>')
    return "".join([*parts, "</svg>"])


def _arrow(x: float, y: float, dx: float, dy: float, color: str) -> str:
    head, angle = 5.0, math.atan2(dy, dx)
    tips = "".join(
        f"M{x + dx:.1f},{y + dy:.1f}"
        f"L{x + dx - head * math.cos(angle + a):.1f},{y + dy - head * math.sin(angle + a):.1f}"
        for a in (0.45, -0.45)
    )
    path = f'<path d="M{x:.1f},{y:.1f}L{x + dx:.1f},{y + dy:.1f}{tips}" stroke="{color}" fill="none"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="{color}"/>{path}'


def bars_svg(values: Mapping[str, Mapping[str, float]], unit: str) -> str:
    """Return bars by case, one for each group (thesis figures 2.7 and 2.21).

    Parameters
    ----------
    values : mapping
        Heights of the bars, ``values[case][group]``.
    unit : str
        Of the values.

    Returns
    -------
    str
        An SVG element.
    """
    rows = [(case, group, value) for case, groups in values.items() for group, value in groups.items()]
    largest = max((value for _, _, value in rows if math.isfinite(value)), default=1.0) or 1.0
    height = 26.0 * len(rows) + 10.0
    parts = [f'<svg class="map" viewBox="0 0 {RESIDUALS_WIDTH:.0f} {height:.0f}" role="img" aria-label="Comparison">']
    for number, (case, group, value) in enumerate(rows):
        y = 26.0 * number + 6.0
        length = 0.0 if not math.isfinite(value) else (RESIDUALS_WIDTH - 320.0) * value / largest
        color = PLOT_COLORS.get(group, OTHER_COLOR)
        label = html.escape(f"{case}, {group}")
        parts.append(f'<text x="4" y="{y + 14.0:.1f}">{label}</text>')
        parts.append(f'<rect x="230" y="{y:.1f}" width="{length:.1f}" height="18" fill="{color}"/>')
        parts.append(f'<text x="{236.0 + length:.1f}" y="{y + 14.0:.1f}">{value:.2f} {html.escape(unit)}</text>')
    return "".join([*parts, "</svg>"])
