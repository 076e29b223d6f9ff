"""The help panel of an algorithm's dialog, from its declaration."""

from __future__ import annotations

from html import escape

from ..processing_algorithms.declare import Algorithm, Param
from .parameters import label


def short_help(declaration: Algorithm) -> str:
    """Return the help of an algorithm and of each of its parameters as HTML."""
    paragraphs = [part for part in declaration.help.split("\n\n") if part.strip()] or [declaration.summary]
    text = "".join(f"<p>{escape(' '.join(part.split()))}</p>" for part in paragraphs)
    return text + "<h2>Parameters</h2>" + "".join(map(_parameter_help, declaration.params))


def _parameter_help(param: Param) -> str:
    return f"<p><b>{escape(label(param))}</b><br/>{escape(param.help)}.</p>"
