"""Residuals of an image by its lines, with the fitted waves, and their amplitude spectrum, as SVG."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .plots import PlotFrame


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
    label: str, ticks: Mapping[str, float], top: float, bottom: float,
    curve: tuple[np.ndarray, np.ndarray], dots: tuple[np.ndarray, np.ndarray],
) -> str:  # fmt: skip
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
