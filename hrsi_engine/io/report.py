"""The report of a run: ``report.json`` for programs, ``report.html`` for people, in one file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..drawing.block_figures import ReportFigures, drawn
from ..foundation.json_values import json_text
from .code_pages import explained_codes
from .pages import write_page, write_text

__all__ = ["ReportFigures", "write_report_html", "write_report_json"]


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
    write_page(path, "report.html.j2", report, explained=explained, **drawn(figures or ReportFigures()))
