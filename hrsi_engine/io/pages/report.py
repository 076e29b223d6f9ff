"""The report of a run: ``report.json`` for programs, ``report.html`` for people, in one file.

A page that travels alone brings its own explanations of a verdict's codes: ``docs/verdict.md`` is the one place where
that is written; its headings ``### code`` are the codes. Of Markdown, paragraphs, lists, code, bold words and the words
of links are understood.
"""

import math
import re
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ...drawing.block_figures import ReportFigures, draw_figures
from ...drawing.plots import draw_bars
from ...foundation.json_values import json_lines
from .page import PAGE_NUMBERS, write_page, write_text

__all__ = ["ReportFigures", "write_report_html", "write_report_json"]


def write_report_json(path: str, report: Mapping[str, Any]) -> None:
    """Write a report as JSON in one step, a line an image; NumPy values become plain ones, NaN and infinity null.

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
    write_text(path, json_lines(report) + "\n")


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
    explained = explain_codes(reason["code"] for reason in reasons)
    drawings = draw_figures(figures or ReportFigures())
    write_page(path, "report.html.j2", report, explained=explained, before_after=_before_after(report), **drawings)


def _before_after(report: Mapping[str, Any]) -> str:
    """Return bars of what the refinement did, of tie points and of the images that were farthest off; empty without."""
    images = {
        name: {
            "before": _vector_length(entry, "before_rmse_sample_px", "before_rmse_line_px"),
            "after": _vector_length(entry, "rmse_sample_px", "rmse_line_px"),
        }
        for name, entry in report.get("images", {}).items()
    }
    farthest = sorted(images, key=lambda name: -np.nan_to_num(images[name]["before"]))
    ties = report.get("ties") or {}
    bars = {"tie points": {"before": _vector_length(ties, "before_rmse_px"), "after": _vector_length(ties, "rmse_px")}}
    bars |= {name: images[name] for name in farthest}
    known = {name: pair for name, pair in bars.items() if not any(map(math.isnan, pair.values()))}
    return draw_bars(dict(list(known.items())[: PAGE_NUMBERS.bars + 1]), "px") if known else ""


def _vector_length(entry: Mapping[str, Any], *axes: str) -> float:
    """Return the length of the vector of some figures; NaN where one does not exist."""
    return math.hypot(*(math.nan if entry.get(axis) is None else float(entry[axis]) for axis in axes))


PAGE = Path(__file__).resolve().parents[3] / "docs" / "verdict.md"


def explain_codes(codes: Iterable[str]) -> dict[str, str]:
    """Return the documentation of codes of reasons as HTML, by code in their order; empty where none is installed."""
    try:
        text = PAGE.read_text(encoding="utf-8")
    except OSError:  # installed without documentation
        return {}
    sections = dict(re.findall(r"^### ([a-z0-9-]+)\n(.*?)(?=^#{1,3} |\Z)", text, re.MULTILINE | re.DOTALL))
    return {code: _write_blocks(sections[code]) for code in dict.fromkeys(codes) if code in sections}


def _write_blocks(markdown: str) -> str:
    """Return paragraphs and lists as HTML."""
    parts = []
    for block in re.split(r"\n\s*\n", markdown.strip()):
        items = re.split(r"^[*-] ", block, flags=re.MULTILINE)
        if len(items) > 1 and not items[0].strip():
            parts.append("<ul>" + "".join(f"<li>{_write_inline(item)}</li>" for item in items[1:]) + "</ul>")
        else:
            parts.append(f"<p>{_write_inline(block)}</p>")
    return "".join(parts)


def _write_inline(text: str) -> str:
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(" ".join(text.split()), quote=False))
    return re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", text))
