"""The report of a run: ``report.json`` for programs, ``report.html`` for people, in one file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..drawing.block_figures import ReportFigures, drawn
from ..drawing.residual_plots import bars_svg
from ..foundation.json_values import json_text
from .code_pages import explained_codes
from .pages import write_page, write_text

__all__ = ["ReportFigures", "write_report_html", "write_report_json"]
MOST_BARS = 12  # images


def write_report_json(path: str, report: Mapping[str, Any]) -> None:
    """Write a report as JSON in one step; NumPy values become plain ones, NaN and infinity become null.

    Parameters
    ----------
    path : str
        The file.
    report : mapping
        The report.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    write_text(path, json_text(report, indent=1, ascii_only=False) + "\n")


def write_report_html(path: str, report: Mapping[str, Any], figures: ReportFigures | None = None) -> None:
    """Write a report as one HTML file in one step, with a map of the block and other figures where they are given.

    Parameters
    ----------
    path : str
        The file.
    report : mapping
        The report.
    figures : ReportFigures, optional
        The figures.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    reasons = (report.get("verdict") or {}).get("reasons", [])
    explained = explained_codes(reason["code"] for reason in reasons)
    drawings = drawn(figures or ReportFigures())
    write_page(path, "report.html.j2", report, explained=explained, before_after=_before_after(report), **drawings)


def _before_after(report: Mapping[str, Any]) -> str:
    """Return bars of what the refinement did, of tie points and of the images that were farthest off; empty without."""
    rmse = {
        name: [_length(entry, f"{state}rmse_sample_px", f"{state}rmse_line_px") for state in ("before_", "")]
        for name, entry in report.get("images", {}).items()
    }
    farthest = sorted(
        (name for name, pair in rmse.items() if None not in pair), key=lambda name: -(rmse[name][0] or 0.0)
    )
    ties = report.get("ties") or {}
    if ties.get("points"):
        rmse["tie points"] = [ties.get("before_rmse_px"), ties.get("rmse_px")]
    shown = [*(["tie points"] if None not in rmse.get("tie points", [None]) else []), *farthest[:MOST_BARS]]
    if not shown:
        return ""
    return bars_svg({name: dict(zip(("before", "after"), rmse[name], strict=True)) for name in shown}, "px")


def _length(entry: Mapping[str, Any], *axes: str) -> float | None:
    values = [entry.get(axis) for axis in axes]
    return None if None in values else math.hypot(*values)
