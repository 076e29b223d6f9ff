"""The help of an algorithm, from its declaration: in the panel of its dialog, and the page behind *Help*."""

from functools import partial
from html import escape
from pathlib import Path

from qgis.core import QgsProcessingUtils
from qgis.PyQt.QtCore import QUrl

from ..hrsi_engine.foundation.version import VERSION
from ..processing_algorithms.interface.declare import Algorithm, Param, spell_arguments
from .dependencies import absence_note, speed_note
from .parameters import label_of, qgis_name
from .translation import tr


def short_help(declaration: Algorithm) -> str:
    """Return the help of an algorithm and of each of its parameters as HTML."""
    # The arguments that a text names, as the dialog labels them
    spell = partial(spell_arguments, params=declaration.params, spelling=label_of)
    paragraphs = [part for part in spell(declaration.help).split("\n\n") if part.strip()] or [declaration.summary]
    notes = [note for note in (absence_note(), *paragraphs, speed_note()) if note]
    parts = [f"<p>{_text(part)}</p>" for part in notes]
    parts.append(f"<h2>{tr('Parameters')}</h2>")
    # QGIS writes <b> in dark grey, which nobody reads with its dark theme
    parts += [
        f"<p><strong>{_text(label_of(param))}</strong><br/>{_text(spell(param.help))}.</p>"
        for param in declaration.params
    ]
    return "".join(parts)


def as_rich_text(plain: str) -> str:
    """Return plain text for a place where Qt guesses from it whether it is HTML, such as a tool tip."""
    return f"<qt>{'<br/>'.join(map(escape, plain.splitlines()))}</qt>"


def _text(plain: str) -> str:
    """Return plain text on one line for HTML; quotes stay, for the places that show the source."""
    return escape(" ".join(plain.split()), quote=False)


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>body {{ font: 16px/1.5 sans-serif; max-width: 48em; margin: 2em auto; padding: 0 1em }}
table {{ border-collapse: collapse }} td, th {{ border-bottom: 1px solid #8888; padding: .3em .6em; text-align: left;
vertical-align: top }} code, pre {{ font-size: 14px; white-space: pre-wrap }}</style></head>
<body><h1>{title}</h1>{help}
<h2>Parameters of models, scripts and qgis_process</h2>
<table><tr><th>Name</th><th>Label</th><th>Default</th><th>Unit</th></tr>{rows}</table>
{examples}<p>HRSI {version}</p></body></html>
"""


def help_url(declaration: Algorithm) -> str:
    """Write help, parameters with names and defaults, and a command line; return the URL that a browser opens."""
    examples = "".join(f"<h2>On the command line</h2><pre>{escape(line)}</pre>" for line in declaration.examples[:1])
    page = Path(QgsProcessingUtils.tempFolder()) / f"hrsi-{declaration.name}.html"
    text = _PAGE.format(
        title=escape(declaration.title), help=short_help(declaration), version=VERSION, examples=examples,
        rows="".join(_row(param) for param in declaration.params),
    )  # fmt: skip
    page.write_text(text, encoding="utf-8")
    return QUrl.fromLocalFile(str(page)).toString()


def _row(param: Param) -> str:
    default = "required" if param.required else "" if param.default is None else str(param.default)
    cells = qgis_name(param), label_of(param), default, param.unit
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
