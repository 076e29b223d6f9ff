"""The help panel of an algorithm's dialog, from its declaration."""

from __future__ import annotations

from html import escape

from ..processing_algorithms.interface.declare import Algorithm, Param
from .dependencies import absence_note
from .parameters import label_of


def short_help(declaration: Algorithm) -> str:
    """Return the help of an algorithm and of each of its parameters as HTML."""
    paragraphs = [part for part in declaration.help.split("\n\n") if part.strip()] or [declaration.summary]
    note = absence_note(declaration.packages)
    text = "".join(f"<p>{_text(part)}</p>" for part in ([note] if note else []) + paragraphs)
    return text + "<h2>Parameters</h2>" + "".join(map(_parameter_help, declaration.params))


def _parameter_help(param: Param) -> str:
    return f"<p><b>{_text(label_of(param))}</b><br/>{_text(param.help)}.</p>"


def _text(plain: str) -> str:
    """Return plain text on one line for HTML; quotes stay, for the places that show the source."""
    return escape(" ".join(plain.split()), quote=False)
