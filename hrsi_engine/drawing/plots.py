"""Plots as SVG: histograms of normalised residuals, bars, and the arrows of all drawings.

Residuals of an image by its lines, with the fitted waves, and their amplitude spectrum, as SVG.
"""

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

PLOT_WIDTH, RIGHT, TOP, BOTTOM = 360.0, 10.0, 10.0, 26.0  # of all plots with axes, and their margins
SIGMAS_SHOWN = 5.0  # range of the axis of a histogram, to both sides of 0


class PlotFrame(NamedTuple):
    """A plot with axes: its height, its left margin, and the ranges of x and y."""

    height: float
    left: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def place(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the drawing coordinates of values."""
        (first, last), (bottom, top), low = self.x_range, self.y_range, self.height - BOTTOM
        across = self.left + (x - first) / (last - first) * (PLOT_WIDTH - RIGHT - self.left)
        return across, low - (y - bottom) / (top - bottom) * (low - TOP)

    def draw(self, label: str, ticks: Mapping[str, float], curve: tuple[Any, Any], parts: Iterable[str]) -> str:
        """Return the plot as SVG: axes with ``ticks`` along x, ``parts``, and a curve over them."""
        low = self.height - BOTTOM
        lines = [
            f'<svg class="plot" viewBox="0 0 {PLOT_WIDTH:.0f} {self.height:.0f}" role="img" '
            f'aria-label="{html.escape(label)}">',
            f'<path class="axis" d="M{self.left},{TOP}V{low}H{PLOT_WIDTH - RIGHT}"/>',
        ]
        for text, x in ticks.items():
            across = min(self.place(x, 0.0)[0], PLOT_WIDTH - 4.0 * len(text))  # keeps the text inside the plot
            lines.append(f'<text class="tick" x="{across:.1f}" y="{low + 15.0}" text-anchor="middle">{text}</text>')
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(*self.place(*curve), strict=True))
        return "".join([*lines, *parts, f'<polyline class="normal" points="{points}"/></svg>'])


def draw_histogram(values: np.ndarray, label: str) -> str:
    """Return the density histogram of normalised residuals as SVG, with the standard normal curve.

    values : (n,) residuals divided by their standard deviations; label : text alternative
    """
    limits = -SIGMAS_SHOWN, SIGMAS_SHOWN
    counts, edges = np.histogram(np.clip(values, *limits), 40, limits)
    density = counts / max(len(values), 1) / (edges[1] - edges[0])
    middle = np.linspace(*limits, 101)
    curve = np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi)
    frame = PlotFrame(230.0, 34.0, limits, (0.0, 1.08 * max(float(density.max(initial=0.0)), float(curve.max()))))
    bars = []
    for low, high, value in zip(edges[:-1], edges[1:], density, strict=True):
        (x0, y), (x1, y1) = frame.place(low, value), frame.place(high, 0.0)
        if value > 0.0:
            bars.append(f'<rect class="bar" x="{x0:.1f}" y="{y:.1f}" width="{x1 - x0:.1f}" height="{y1 - y:.1f}"/>')
    return frame.draw(label, {str(tick): tick for tick in (-4, -2, 0, 2, 4)}, (middle, curve), bars)


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


def draw_line_profile(image: str, axis: str, entry: Mapping[str, Any], waves: Sequence[Mapping[str, Any]]) -> str:
    """Return two plots of an axis: mean displacement by line with the fitted waves, and amplitude by period.

    entry : entry of the axis in the report's ``line_profiles``; waves : the waves found on this axis
    """
    line, shift = np.array(entry["lines"]), np.array(entry["shift_px"]) - np.median(entry["shift_px"])
    dense, curve = np.linspace(line[0], line[-1], 400), np.zeros(400)
    for wave in waves:
        curve += wave["amplitude_px"] * np.sin(2.0 * np.pi * dense / wave["period_lines"] + wave["phase_rad"])
    reach = 1.1 * max(float(np.abs(shift).max()), float(np.abs(curve).max()), 0.1)
    ticks = {f"{value:.0f}": value for value in np.linspace(line[0], line[-1], 4)}
    profile = _draw_plot(f"{image}, {axis}: px by line", ticks, reach, -reach, (dense, curve), (line, shift))
    # Periods have a logarithmic axis; the horizontal line is the limit of significant amplitudes
    period, amplitude = np.log10(entry["period_lines"]), np.array(entry["amplitude_px"])
    limit = entry["significant_px"] if np.isfinite(entry["significant_px"]) else float(amplitude.max())
    rounds = [base * 10.0**power for power in range(1, 6) for base in (1, 2, 5)]
    ticks = {f"{x:.0f}": float(np.log10(x)) for x in rounds if period.min() <= np.log10(x) <= period.max()}
    top, ends = 1.1 * max(float(amplitude.max()), limit), np.array([period.min(), period.max() + 1e-6])
    straight = ends, np.array([limit, limit])
    return profile + _draw_plot(f"{image}, {axis}: px by period", ticks, top, 0.0, straight, (period, amplitude))


def _draw_plot(
    label: str,
    ticks: Mapping[str, float],
    top: float,
    bottom: float,
    curve: tuple[np.ndarray, np.ndarray],
    dots: tuple[np.ndarray, np.ndarray],
) -> str:
    """Return a curve and dots with axes as SVG: ``ticks`` along x, values near both ends along y."""
    frame = PlotFrame(150.0, 40.0, (float(curve[0][0]), float(curve[0][-1])), (bottom, top))
    parts = []
    for y in (bottom / 1.1, top / 1.1):
        down = frame.place(curve[0][0], y)[1] + 4.0
        parts.append(f'<text class="tick" x="{frame.left - 4.0}" y="{down:.1f}" text-anchor="end">{y:.2g}</text>')
    parts += [
        f'<circle class="bar" cx="{x:.1f}" cy="{y:.1f}" r="2"/>' for x, y in zip(*frame.place(*dots), strict=True)
    ]
    return frame.draw(label, ticks, curve, parts)
