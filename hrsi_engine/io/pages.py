"""Reports as files: text, and pages for people, one HTML file without any script."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import jinja2
from markupsafe import Markup

from ..foundation.errors import OutputError
from ..foundation.json_values import json_ready
from .replacing import replacing


def write_page(path: str, template: str, report: Mapping[str, Any], **drawings: Any) -> None:
    """Write a report with a template of ``templates/`` in one step; ``drawings`` are SVG texts or data made from them.

    Raises `OutputError` where the file cannot be written.
    """
    write_text(path, _environment().get_template(template).render(report=json_ready(report), **drawings))


def write_text(path: str, text: str) -> None:
    """Write a text file in one step; raise `OutputError` where it cannot be written."""
    try:
        with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except UnicodeEncodeError as error:
        raise OutputError(f"{path}: cannot be written as UTF-8 ({error}): rename the file or point") from None


@cache
def _environment() -> jinja2.Environment:
    folder = os.path.join(os.path.dirname(__file__), "templates")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder), autoescape=True, undefined=jinja2.ChainableUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["figure"] = figure
    environment.filters["coded"] = mark_code
    return environment


def mark_code(text: str) -> Markup:
    """Return a message as HTML; the arguments that it names in backticks are code.

    Parameters
    ----------
    text : str
        The message.

    Returns
    -------
    Markup
        The message, escaped.
    """
    parts = re.split(r"`([^`]+)`", text)  # what is in backticks comes second, fourth, …
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(part) if place % 2 else part for place, part in enumerate(parts))


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
