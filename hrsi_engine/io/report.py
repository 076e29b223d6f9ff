"""The report of a run: ``report.json`` for programs, ``report.html`` for people, in one file without any script."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from enum import Enum
from functools import cache
from typing import Any

import jinja2
import numpy as np

from ..errors import OutputError
from .block_map import BlockMap, block_map_svg
from .replacing import replacing

__all__ = ["BlockMap", "json_ready", "write_report_html", "write_report_json"]


def write_report_json(path: str, report: Mapping[str, Any]) -> None:
    """Write a report as JSON in one step; NumPy values become plain ones, NaN and infinity become null.

    Raises `OutputError` where the file cannot be written.
    """
    _write(path, json.dumps(json_ready(report), indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def write_report_html(path: str, report: Mapping[str, Any], map_data: BlockMap | None = None) -> None:
    """Write a report as one HTML file in one step, with a map of the block where ``map_data`` is given.

    Raises `OutputError` where the file cannot be written.
    """
    drawing = None if map_data is None else block_map_svg(map_data)
    _write(path, _template().render(report=json_ready(report), block_map=drawing))


def json_ready(value: Any) -> Any:
    """Return a value made of dicts, lists, texts, numbers, bools and None only."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return json_ready(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [json_ready(item) for item in value]
    if isinstance(value, Enum):
        return json_ready(value.value)
    if isinstance(value, np.generic):
        return json_ready(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (str, int, bool)) else str(value)


def _write(path: str, text: str) -> None:
    try:
        with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except UnicodeEncodeError as error:
        raise OutputError(f"{path}: cannot be written as UTF-8 ({error}): rename the file or point") from None


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(os.path.join(os.path.dirname(__file__), "templates")),
        autoescape=True, undefined=jinja2.ChainableUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["figure"] = figure
    return environment.get_template("report.html.j2")


def figure(value: Any, digits: int = 3, unit: str = "") -> str:
    """Return a number with fixed digits; a dash where there is none.

    Where three digits or more are asked for, very small numbers get an exponent, so that they do not read as 0.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "–" if value is None or isinstance(value, jinja2.Undefined) else str(value)
    if isinstance(value, int):
        text = f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    elif digits >= 3 and value != 0.0 and not 10.0 ** (1 - digits) <= abs(value) < 1e7:
        text = f"{value:.2e}"
    else:
        text = f"{value:.{digits}f}"
    return f"{text}\N{NO-BREAK SPACE}{unit}" if unit else text
