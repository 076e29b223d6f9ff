"""The page behind an algorithm's *Help* button: its declaration as HTML, in QGIS's temporary folder."""

from html import escape
from pathlib import Path

from qgis.core import QgsProcessingUtils
from qgis.PyQt.QtCore import QUrl

from ..hrsi_engine.foundation.version import VERSION
from ..processing_algorithms.interface.declare import Algorithm, Param
from .help_text import short_help
from .parameters import label_of, qgis_name

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
    """Write the page of an algorithm; return the URL that QGIS opens in a browser."""
    page = Path(QgsProcessingUtils.tempFolder()) / f"hrsi-{declaration.name}.html"
    page.write_text(help_page(declaration), encoding="utf-8")
    return QUrl.fromLocalFile(str(page)).toString()


def help_page(declaration: Algorithm) -> str:
    """Return help, parameters with names and defaults, and command lines of an algorithm as a page of its own."""
    examples = "".join(f"<h2>On the command line</h2><pre>{escape(line)}</pre>" for line in declaration.examples[:1])
    return _PAGE.format(
        title=escape(declaration.title), help=short_help(declaration), version=VERSION, examples=examples,
        rows="".join(_row(param) for param in declaration.params),
    )  # fmt: skip


def _row(param: Param) -> str:
    default = "required" if param.required else "" if param.default is None else str(param.default)
    cells = qgis_name(param), label_of(param), default, param.unit
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
