"""Reports as files: ``report.json`` for programs, and pages for people, each a single HTML file.

A page loads no other files and runs only HRSI's scripts; small pictures of images are embedded as text. Since a page
is passed on alone, it contains explanations of the verdict's codes, taken from ``docs/verdict.md``, where the headings
``### code`` are the codes. Of Markdown, paragraphs, lists, code, bold words and the text of links are converted.
"""

import base64
import hashlib
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pyproj
from markupsafe import Markup
from osgeo import gdal

from ...drawing.block_figures import Picture
from ...drawing.plots import draw_line_profile
from ...drawing.target_chips import encode_grey_png, stretch_grey
from ...foundation.errors import OutputError
from ...foundation.json_values import json_lines, json_ready
from ...foundation.thresholds import threshold, thresholds
from ..opening.datasets import gdal_messages, read_virtual
from ..rasters.images import GdalRaster
from ..safety.replacing import replacing
from ..templates import make_environment

__all__ = ["write_report_html", "write_report_json"]


def write_report_json(path: str, report: Mapping[str, Any]) -> None:
    """Write a report as JSON in one step, one line per image; NumPy values become plain ones, NaN and infinity null.

    path : the file; report : the report
    Raises `OutputError`: the file cannot be written.
    """
    write_text(path, json_lines(report) + "\n")


def write_report_html(path: str, report: Mapping[str, Any], drawings: Mapping[str, Any] = MappingProxyType({})) -> None:
    """Write a report as one HTML file in one step, with a map of the block and the other drawings.

    path : the file; report : the report; drawings : those of `drawing.block_figures.draw_figures`
    Raises `OutputError`: the file cannot be written.
    """
    explained = explain_codes(reason["code"] for reason in (report.get("verdict") or {}).get("reasons", []))
    # Plots of both axes of the images with profiles along the lines, images with waves first
    profiles_sorted = sorted(report.get("line_profiles", {}).items(), key=lambda item: not item[1]["waves"])
    profiles = [
        (name, axis, draw_line_profile(name, axis, entry[axis], [w for w in entry["waves"] if w["axis"] == axis]))
        for name, entry in profiles_sorted
        for axis in ("across", "along")
        if axis in entry
    ]
    write_page(path, "report.html.j2", report, explained=explained, line_profiles=profiles, **drawings)


PAGE = Path(__file__).resolve().parents[3] / "docs" / "verdict.md"


def explain_codes(codes: Iterable[str]) -> dict[str, str]:
    """Return the documentation of codes of reasons as HTML, by code, in their order; empty if none is installed."""
    try:
        text = PAGE.read_text(encoding="utf-8")
    except OSError:  # installed without documentation
        return {}
    sections = dict(re.findall(r"^### ([a-z0-9-]+)\n(.*?)(?=^#{1,3} |\Z)", text, re.MULTILINE | re.DOTALL))
    return {code: _write_blocks(sections[code]) for code in dict.fromkeys(codes) if code in sections}


def _write_blocks(markdown: str) -> str:
    """Return Markdown paragraphs and lists as HTML."""
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


TEMPLATES = os.path.join(os.path.dirname(__file__), "templates")
#: Most rows of a page's tables; for a block of thousands of images, report.json has all figures.
LIMITS = {"most_printed": 12, "most_rows": 1000, "most_parameters": 100, "most_inputs": 200}


@thresholds
class PAGE_NUMBERS:
    """Decimals of numbers in reports, and quality of their pictures."""

    decimals: int = threshold(5, "digits", "most decimals; smaller numbers get a power of ten")


def write_page(
    path: str, template: str, report: Mapping[str, Any], script_data: Mapping[str, Any] | None = None, **drawings: Any
) -> None:
    """Write a report with a template of ``templates/`` in one step; ``drawings`` are SVG texts or data made from them.

    ``script_data`` are the data of the map's script. Raises `OutputError` if the file cannot be written.
    """
    names = ["page.js", *(["map_controls.js"] if script_data else [])]
    scripts = [Path(TEMPLATES, name).read_text(encoding="utf-8") for name in names]
    page = _make_environment().get_template(template)
    # The page's content policy: it loads nothing, and runs only HRSI's scripts, identified by their hashes
    hashes = [base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii") for script in scripts]
    allowed = " ".join(f"'sha256-{value}'" for value in hashes)
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {allowed}"
    write_text(
        path,
        page.render(
            report=json_ready(report),
            script_data=json_ready(script_data),
            scripts=scripts,
            policy=policy,
            **LIMITS,
            **drawings,
        ),
    )


def write_text(path: str, text: str) -> None:
    """Write a text file in one step; raise `OutputError` if it cannot be written."""
    try:
        with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except UnicodeEncodeError as error:
        raise OutputError(f"{path}: cannot be written as UTF-8 ({error}): rename the file or point") from None


@cache
def _make_environment() -> Any:
    return make_environment(
        TEMPLATES,
        {
            "figure": figure,
            "coded": mark_code,
            "by_sigma": digits_by_sigma,
            "duration": duration,
            "basename": os.path.basename,
            "crs_name": name_crs,
            "crs_unit": name_crs_unit,
            "at": find_entry,
            "filled": select_used_columns,
        },
    )


def name_crs(code: str) -> str:
    """Return a CRS's name with its code; the code alone if PROJ does not know it."""
    try:
        return f"{pyproj.CRS(code).name} ({code})"
    except pyproj.exceptions.CRSError:
        return code


def name_crs_unit(code: str) -> str:
    """Return the unit of a CRS's axes; empty if PROJ does not know the code."""
    try:
        return {"metre": "m"}.get(unit := pyproj.CRS(code).axis_info[0].unit_name, unit)
    except pyproj.exceptions.CRSError:
        return ""


def find_entry(entry: Any, part: str) -> Any:
    """Return the value at ``part``, names joined by dots, of an entry of the report; None if there is none."""
    for name in part.split("."):
        entry = (entry or {}).get(name)
    return entry


def select_used_columns(columns: Iterable[tuple[str, str, int | None]], rows: Sequence[Any]) -> list[Any]:
    """Return the columns (title, part, digits) of a table in which at least one row (name, key, entry) has a value."""
    return [column for column in columns if any(find_entry(row[2], column[1]) is not None for row in rows)]


def mark_code(text: str) -> Markup:
    """Return a message as escaped HTML, with the arguments that it names in backticks as code."""
    parts = re.split(r"`([^`]+)`", text)  # every second part was in backticks
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(part) if place % 2 else part for place, part in enumerate(parts))


def figure(value: Any, digits: int = 3, unit: str = "") -> str:
    """Return a number with fixed decimals; a dash for None.

    With four decimals or more, a positive number that would be written as 0 is written as smaller than the last digit.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        from jinja2 import Undefined

        return "–" if value is None or isinstance(value, Undefined) else str(value)
    if isinstance(value, int) or abs(value) >= 1e15:
        text = f"{value:,.0f}"
    else:
        text = f"{value:,.{digits}f}"
        if float(text.replace(",", "")) == 0.0:
            small = digits >= 4 and value > 0.0
            text = f"<\N{NARROW NO-BREAK SPACE}{10.0**-digits:.{digits}f}" if small else f"{0.0:.{digits}f}"
    text = text.replace(",", "\N{NARROW NO-BREAK SPACE}").replace("-", "\N{MINUS SIGN}")
    return f"{text}\N{NO-BREAK SPACE}{unit}" if unit else text


def digits_by_sigma(value: Any, sigma: Any) -> str:
    """Return an estimate rounded to two digits of its standard deviation; very small ones with a power of ten."""
    if not isinstance(value, (int, float)):
        return figure(value)
    if not isinstance(sigma, (int, float)) or not 0.0 < sigma < math.inf:
        return figure(value)
    decimals = 1 - math.floor(math.log10(sigma))
    if decimals <= PAGE_NUMBERS.decimals:
        return figure(float(value), max(decimals, 0))
    power = math.floor(math.log10(max(abs(value), sigma)))
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{figure(value / 10.0**power, max(decimals + power, 0))}·10{raised}"


def duration(seconds: Any) -> str:
    """Return a time as seconds, or minutes and seconds, with the unit."""
    if not isinstance(seconds, (int, float)) or seconds < 60.0:
        return figure(seconds, 1, "s")
    return f"{int(seconds // 60.0)} min {int(seconds % 60.0)} s"


def read_picture(raster: GdalRaster, image: str, number: int, side_px: int) -> Picture | None:
    """Return a picture of an image, at most ``side_px`` along its longer side; None if no pixel is valid.

    ``number`` is part of the name of its element on the page.
    """
    step = max(1, -(-max(raster.size) // side_px))
    grey, valid = raster.read_means(step)
    if not valid.any():
        return None
    size, covers = (int(grey.shape[1]), int(grey.shape[0])), (raster.size[0] / step, raster.size[1] / step)
    # Grey values of any type, where valid, as a data: URI: JPEG, or PNG if this GDAL has no JPEG driver
    content = _encode_jpeg(np.where(valid, stretch_grey(grey, valid), np.uint8(255)))
    uri = (
        f"data:image/png;base64,{encode_grey_png(grey, valid)}"
        if content is None
        else f"data:image/jpeg;base64,{base64.b64encode(content).decode('ascii')}"
    )
    return Picture(f"picture-{number}", image, size, covers, uri)


def _encode_jpeg(grey: np.ndarray) -> bytes | None:
    driver = gdal.GetDriverByName("JPEG")
    if driver is None:
        return None
    name = "/vsimem/hrsi/picture.jpg"
    lines, samples = grey.shape
    with gdal_messages():
        memory = gdal.GetDriverByName("MEM").Create("", samples, lines, 1, gdal.GDT_Byte)
        memory.GetRasterBand(1).WriteArray(grey)
        copy = driver.CreateCopy(name, memory)
        del copy
        content = read_virtual(name)
        gdal.Unlink(name)
        gdal.Unlink(f"{name}.aux.xml")
    return content
