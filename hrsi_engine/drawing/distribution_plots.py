"""Plots of distributions as SVG: histogram and Q-Q plot of normalised residuals."""

import html
from statistics import NormalDist

import numpy as np

HISTOGRAM_WIDTH, HISTOGRAM_HEIGHT = 360.0, 230.0
LEFT, RIGHT, TOP, BOTTOM = 34.0, 10.0, 10.0, 26.0
SIGMAS_SHOWN = 5.0  # sigmas shown
BINS = 40
QUANTILES = 160


def draw_histogram(values: np.ndarray, label: str) -> str:
    """Return the histogram of normalised values as density, with the standard normal curve over it.

    values : (n,) residuals over their standard deviations; label : text alternative
    """
    edges = np.linspace(-SIGMAS_SHOWN, SIGMAS_SHOWN, BINS + 1)
    counts, _ = np.histogram(np.clip(values, -SIGMAS_SHOWN, SIGMAS_SHOWN), edges)
    density = counts / max(len(values), 1) / (edges[1] - edges[0])
    middle = np.linspace(-SIGMAS_SHOWN, SIGMAS_SHOWN, 101)
    curve = np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi)
    top = 1.08 * max(float(density.max(initial=0.0)), float(curve.max()))
    parts = [_open_plot(label, [-4, -2, 0, 2, 4], [])]
    for low, high, value in zip(edges[:-1], edges[1:], density, strict=True):
        (x0, y), (x1, y1) = _place_point(low, value / top), _place_point(high, 0.0)
        if value > 0.0:
            parts.append(f'<rect class="bar" x="{x0:.1f}" y="{y:.1f}" width="{x1 - x0:.1f}" height="{y1 - y:.1f}"/>')
    points = [_place_point(x, y / top) for x, y in zip(middle, curve, strict=True)]
    parts.append(f'<polyline class="normal" points="{_format_path(points)}"/>')
    return "".join([*parts, "</svg>"])


def draw_qq_plot(values: np.ndarray, label: str) -> str:
    """Return the quantiles of normalised values against those of the normal distribution, with the line y = x.

    values : (n,) residuals over their standard deviations; label : text alternative
    """
    parts = [_open_plot(label, [-4, -2, 0, 2, 4], [-4, -2, 0, 2, 4])]
    ends = [_place_point(end, (end + SIGMAS_SHOWN) / (2.0 * SIGMAS_SHOWN)) for end in (-SIGMAS_SHOWN, SIGMAS_SHOWN)]
    parts.append(f'<polyline class="normal" points="{_format_path(ends)}"/>')
    if len(values):
        probability = (np.arange(min(len(values), QUANTILES)) + 0.5) / min(len(values), QUANTILES)
        expected, found = np.array([NormalDist().inv_cdf(p) for p in probability]), np.quantile(values, probability)
        for x, y in zip(expected, np.clip(found, -SIGMAS_SHOWN, SIGMAS_SHOWN), strict=True):
            at = _place_point(x, (y + SIGMAS_SHOWN) / (2.0 * SIGMAS_SHOWN))
            parts.append(f'<circle class="quantile" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="2"/>')
    return "".join([*parts, "</svg>"])


def _open_plot(label: str, x_ticks: list[int], y_ticks: list[int]) -> str:
    """Return the opening of a plot with its axes."""
    (x0, y0), (x1, y1) = _place_point(-SIGMAS_SHOWN, 0.0), _place_point(SIGMAS_SHOWN, 1.0)
    parts = [
        f'<svg class="plot" viewBox="0 0 {HISTOGRAM_WIDTH:.0f} {HISTOGRAM_HEIGHT:.0f}" role="img" '
        f'aria-label="{html.escape(label)}">',
        f'<path class="axis" d="M{x0:.1f},{y1:.1f}V{y0:.1f}H{x1:.1f}"/>',
    ]
    for tick in x_ticks:
        x, y = _place_point(tick, 0.0)
        parts.append(f'<text class="tick" x="{x:.1f}" y="{y + 15.0:.1f}" text-anchor="middle">{tick}</text>')
    for tick in y_ticks:
        x, y = _place_point(-SIGMAS_SHOWN, (tick + SIGMAS_SHOWN) / (2.0 * SIGMAS_SHOWN))
        parts.append(f'<text class="tick" x="{x - 5.0:.1f}" y="{y + 4.0:.1f}" text-anchor="end">{tick}</text>')
    return "".join(parts)


def _place_point(x: float, share: float) -> tuple[float, float]:
    """Return the drawing place of a value in sigmas and a share of the height."""
    return (
        LEFT + (x + SIGMAS_SHOWN) / (2.0 * SIGMAS_SHOWN) * (HISTOGRAM_WIDTH - LEFT - RIGHT),
        HISTOGRAM_HEIGHT - BOTTOM - share * (HISTOGRAM_HEIGHT - TOP - BOTTOM),
    )


def _format_path(points: list[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
