"""The help of an algorithm, made from its declaration: for the panel of its dialog, and a page for *Help*."""

from functools import partial
from html import escape
from pathlib import Path

from qgis.core import QgsProcessingUtils
from qgis.PyQt.QtCore import QUrl

from ..hrsi_engine.foundation.version import VERSION
from ..processing_algorithms.interface.declare import Algorithm, Param, spell_arguments
from .dependencies import absence_note
from .parameters import field_choosers, label_of, qgis_name
from .translation import tr

#: Picture of the help by algorithm, in the folder ``pictures``.
HELP_PICTURES = {
    "triangulate": "residuals",
    "adjust": "residuals",
    "orthorectify": "registration",
    "ortho-check": "registration",
    "tie-points": "tie",
    "match": "tie",
    "measure-targets": "measuring",
    "evaluate": "leave_one_out",
}
#: Captions of the pictures.
_CAPTIONS = {
    "residuals": "Residuals in plan (surveyed minus computed) of a result: blue at GCPs, green at check points, which "
    "the adjustment does not use. The legend has the scale of the arrows.",
    "registration": "How far two orthoimages lie apart, with the RPCs as delivered (left) and with refined ones "
    "(right, arrows 20 times as long).",
    "tie": "A point in one image, and the place that matching finds for it on the epipolar line of another.",
    "measuring": "A target with a wrong measurement: the red line is its residual of 9 px.",
    "leave_one_out": "Leave-one-out: the point of two images is predicted in the third.",
}


def short_help(declaration: Algorithm) -> str:
    """Return the help of an algorithm and of each of its parameters as HTML."""
    # The arguments that a text names, with the labels of the dialog
    spell = partial(spell_arguments, params=declaration.params, spelling=label_of)
    paragraphs = [part for part in spell(declaration.help).split("\n\n") if part.strip()] or [declaration.summary]
    parts = [f"<p>{_text(part)}</p>" for part in (absence_note(), *paragraphs) if part]
    if name := HELP_PICTURES.get(declaration.name):
        url = QUrl.fromLocalFile(str(Path(__file__).parent / "pictures" / f"{name}.png")).toString()
        parts.insert(0, f'<p><img src="{escape(url)}" alt="" width="232"/><br/>{_CAPTIONS[name]}</p>')
    parts.append(f"<h2>{tr('Parameters')}</h2>")
    # QGIS writes <b> in dark grey, which is unreadable in its dark theme
    parts += [
        f"<p><strong>{_text(label_of(param))}</strong><br/>{_text(spell(param.help))}.</p>"
        for param in declaration.params
    ]
    return "".join(parts)


def as_rich_text(plain: str) -> str:
    """Return plain text as HTML for places where Qt guesses whether a text is HTML, such as tool tips."""
    return f"<qt>{'<br/>'.join(map(escape, plain.splitlines()))}</qt>"


def _text(plain: str) -> str:
    """Return plain text on one line for HTML; quotes are kept, for places that show the source."""
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
    """Write the page with help, parameters with names and defaults, and a command line; return its URL."""
    examples = "".join(f"<h2>On the command line</h2><pre>{escape(line)}</pre>" for line in declaration.examples[:1])
    page = Path(QgsProcessingUtils.tempFolder()) / f"hrsi-{declaration.name}.html"
    text = _PAGE.format(
        title=escape(declaration.title),
        help=short_help(declaration),
        version=VERSION,
        examples=examples,
        rows="".join(map(_row, declaration.params)),
    )
    page.write_text(text, encoding="utf-8")
    return QUrl.fromLocalFile(str(page)).toString()


def _row(param: Param) -> str:
    """Return the rows of a parameter, and of those that choose its fields, in the table of the page."""
    default = "required" if param.required else "" if param.default is None else str(param.default)
    rows = [(qgis_name(param), label_of(param), default, param.unit)]
    rows += [(one.name(), one.description(), "", "") for one in field_choosers(param).values()]
    return "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>" for cells in rows)
