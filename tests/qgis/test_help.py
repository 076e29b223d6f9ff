"""Help: the page behind the Help button of every algorithm, and what a Python that is too old is told."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from qgis.PyQt.QtCore import QUrl

import hrsi
from hrsi.plugin.parameters import qgis_name
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.processing_algorithms import REGISTRY


class Tags(HTMLParser):
    """The tags of a page that are open."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag, _attributes):
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag, _attributes):
        """Nothing is left open."""

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", REGISTRY)
def test_help_button_opens_a_page_with_every_parameter(qgis_app, name: str):
    declaration = REGISTRY[name]
    url = QUrl(PluginAlgorithm(declaration).helpUrl())
    assert url.isLocalFile()
    page = Path(url.toLocalFile()).read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(page)
    assert not tags.open
    assert f"<title>{declaration.title}</title>" in page
    for param in declaration.params:
        assert f"<td>{qgis_name(param)}</td>" in page
    assert not re.search(r"(?<![\w-])--[a-z]", page.partition("On the command line")[0])  # QGIS has labels


def test_a_python_that_is_too_old_is_named(qgis_app, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hrsi, "OLDEST_PYTHON", (99, 0))
    iface = MagicMock()
    plugin = hrsi.classFactory(iface)
    plugin.initGui()
    title, message, *_ = iface.messageBar().pushMessage.call_args.args
    assert title == "HRSI"
    assert "needs Python 3.11 or later" in message
    assert "3.34.6" in message
    plugin.unload()
    assert len(iface.method_calls) == 2  # the message bar, asked for in the plugin and here: no panel, no provider
