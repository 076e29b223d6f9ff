"""The help panel of an algorithm's dialog, from its declaration."""

from html import escape

from ..processing_algorithms.interface.declare import Algorithm, Param
from ..processing_algorithms.interface.naming import spell_arguments
from .dependencies import absence_note
from .parameters import label_of
from .translation import tr


def short_help(declaration: Algorithm) -> str:
    """Return the help of an algorithm and of each of its parameters as HTML."""
    told = _name_options(declaration.help, declaration).split("\n\n")
    paragraphs = [part for part in told if part.strip()] or [declaration.summary]
    note = absence_note()
    text = "".join(f"<p>{_text(part)}</p>" for part in ([note] if note else []) + paragraphs)
    return (
        text
        + f"<h2>{tr('Parameters')}</h2>"
        + "".join(_parameter_help(param, declaration) for param in declaration.params)
    )


def _parameter_help(param: Param, declaration: Algorithm) -> str:
    # QGIS writes <b> in dark grey, which nobody reads with its dark theme
    return f"<p><strong>{_text(label_of(param))}</strong><br/>{_text(_name_options(param.help, declaration))}.</p>"


def _name_options(text: str, declaration: Algorithm) -> str:
    """Return a text with the arguments that it names as the dialog labels them."""
    return spell_arguments(text, declaration.params, label_of)


def as_rich_text(plain: str) -> str:
    """Return plain text for a place where Qt guesses from it whether it is HTML, such as a tool tip."""
    return f"<qt>{'<br/>'.join(map(escape, plain.splitlines()))}</qt>"


def _text(plain: str) -> str:
    """Return plain text on one line for HTML; quotes stay, for the places that show the source."""
    return escape(" ".join(plain.split()), quote=False)
