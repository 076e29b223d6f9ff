"""Reports for people other than a block's: one HTML file without any script, made from a template."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from typing import Any

import jinja2

from ..errors import OutputError
from .replacing import replacing
from .report import figure, json_ready


def write_page(path: str, template: str, report: Mapping[str, Any], **drawings: Any) -> None:
    """Write a report with a template of ``templates/`` in one step; ``drawings`` are SVG texts or data made from them.

    Raises `OutputError` where the file cannot be written.
    """
    text = _environment().get_template(template).render(report=json_ready(report), **drawings)
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
    return environment
