"""Formulas as MathML, so that the pages show them without any script from elsewhere (an extension of Sphinx)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from latex2mathml.converter import convert

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator


def setup(app: Sphinx) -> dict[str, Any]:
    """Make ``mathml`` a renderer that ``html_math_renderer`` can name."""
    app.add_html_math_renderer("mathml", (_visit("inline"), None), (_visit("block"), None))
    return {"parallel_read_safe": True}


def _visit(display: str) -> Any:
    def visit(translator: HTML5Translator, node: Element) -> None:
        from docutils.nodes import SkipNode

        translator.body.append(convert(node.astext(), display=display))
        raise SkipNode

    return visit
