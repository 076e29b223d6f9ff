"""Plots as SVG: histograms of normalised residuals, bars, and the arrows of all drawings."""

import html
import math
from collections.abc import Mapping

import numpy as np

HISTOGRAM_WIDTH, HISTOGRAM_HEIGHT = 360.0, 230.0
LEFT, RIGHT, TOP, BOTTOM = 34.0, 10.0, 10.0, 26.0
SIGMAS_SHOWN = 5.0  # range of the axis, to both sides of 0


def draw_histogram(values: np.ndarray, label: str) -> str:
    """Return the density histogram of normalised residuals as SVG, with the standard normal curve.

    values : (n,) residuals divided by their standard deviations; label : text alternative
    """
    limits = -SIGMAS_SHOWN, SIGMAS_SHOWN
    counts, edges = np.histogram(np.clip(values, *limits), 40, limits)
    density = counts / max(len(values), 1) / (edges[1] - edges[0])
    middle = np.linspace(-SIGMAS_SHOWN, SIGMAS_SHOWN, 101)
    curve = np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi)
    top = 1.08 * max(float(density.max(initial=0.0)), float(curve.max()))
    parts = [_open_plot(label)]
    for low, high, value in zip(edges[:-1], edges[1:], density, strict=True):
        (x0, y), (x1, y1) = _place_point(low, value / top), _place_point(high, 0.0)
        if value > 0.0:
            parts.append(f'<rect class="bar" x="{x0:.1f}" y="{y:.1f}" width="{x1 - x0:.1f}" height="{y1 - y:.1f}"/>')
    points = (_place_point(x, y / top) for x, y in zip(middle, curve, strict=True))
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    parts.append(f'<polyline class="normal" points="{path}"/>')
    return "".join([*parts, "</svg>"])


def _open_plot(label: str) -> str:
    """Return the opening tag of a histogram, with its axes."""
    (x0, y0), (x1, y1) = _place_point(-SIGMAS_SHOWN, 0.0), _place_point(SIGMAS_SHOWN, 1.0)
    parts = [
        f'<svg class="plot" viewBox="0 0 {HISTOGRAM_WIDTH:.0f} {HISTOGRAM_HEIGHT:.0f}" role="img" '
        f'aria-label="{html.escape(label)}">',
        f'<path class="axis" d="M{x0:.1f},{y1:.1f}V{y0:.1f}H{x1:.1f}"/>',
    ]
    for tick in (-4, -2, 0, 2, 4):
        x, y = _place_point(tick, 0.0)
        parts.append(f'<text class="tick" x="{x:.1f}" y="{y + 15.0:.1f}" text-anchor="middle">{tick}</text>')
    return "".join(parts)


def _place_point(x: float, share: float) -> tuple[float, float]:
    """Return the drawing coordinates of a value in sigmas and a fraction of the height of the plot."""
    return (
        LEFT + (x + SIGMAS_SHOWN) / (2.0 * SIGMAS_SHOWN) * (HISTOGRAM_WIDTH - LEFT - RIGHT),
        HISTOGRAM_HEIGHT - BOTTOM - share * (HISTOGRAM_HEIGHT - TOP - BOTTOM),
    )


HEAD_UNITS, HEAD_SLOPE = 7.0, 0.45  # length of the head, and half its width relative to its length


def make_arrow_path(x: float, y: float, dx: float, dy: float, head: float = HEAD_UNITS) -> str:
    """Return the path (attribute ``d`` of SVG) of an arrow from x, y by dx, dy; empty if it is too short to be seen.

    ``head`` is the length of its head; the head of a short arrow is shorter.
    """
    length = math.hypot(dx, dy)
    if not length >= 0.5:  # would be only a dot
        return ""
    ux, uy = dx / length, dy / length
    head_length = min(head, 0.6 * length)
    tip_x, tip_y = x + dx, y + dy
    sides = [
        (tip_x - head_length * (ux + HEAD_SLOPE * s * uy), tip_y - head_length * (uy - HEAD_SLOPE * s * ux))
        for s in (1, -1)
    ]
    (left_x, left_y), (right_x, right_y) = sides
    return (
        f"M{x:.1f},{y:.1f}L{tip_x:.1f},{tip_y:.1f}L{left_x:.1f},{left_y:.1f}"
        f"M{tip_x:.1f},{tip_y:.1f}L{right_x:.1f},{right_y:.1f}"
    )


def choose_round_length(longest: float) -> float:
    """Return the largest number 1, 2 or 5 times a power of ten that does not exceed ``longest``, which is above 0."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= longest * 1.000001)


BARS_WIDTH = 560.0


def compute_typical_length(residual: np.ndarray) -> float:
    """Return the 90th percentile of the lengths of residuals (n, 2)."""
    return float(np.percentile(np.hypot(*residual.T), 90.0))


def draw_bars(values: Mapping[str, Mapping[str, float]], unit: str) -> str:
    """Return a bar chart as SVG, with one bar for each case and group (thesis figures 2.7 and 2.21).

    values : lengths of the bars, ``values[case][group]``; unit : unit of the values
    """
    rows = [(case, group, value) for case, groups in values.items() for group, value in groups.items()]
    largest = max((value for _, _, value in rows if math.isfinite(value)), default=1.0) or 1.0
    height = 26.0 * len(rows) + 10.0
    parts = [f'<svg class="bars" viewBox="0 0 {BARS_WIDTH:.0f} {height:.0f}" role="img" aria-label="Comparison">']
    for number, (case, group, value) in enumerate(rows):
        y = 26.0 * number + 6.0
        length = 0.0 if not math.isfinite(value) else (BARS_WIDTH - 320.0) * value / largest
        label = html.escape(f"{case}, {group}")
        parts.append(f'<text x="4" y="{y + 14.0:.1f}">{label}</text>')
        parts.append(f'<rect x="230" y="{y:.1f}" width="{length:.1f}" height="18" class="bar {html.escape(group)}"/>')
        told = f"{value:.2f} {html.escape(unit)}" if math.isfinite(value) else "–"
        parts.append(f'<text x="{236.0 + length:.1f}" y="{y + 14.0:.1f}">{told}</text>')
    return "".join([*parts, "</svg>"])
