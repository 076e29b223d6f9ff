"""Help: the page behind the Help button of every algorithm, and what a Python that is too old is told."""

import re
from html.parser import HTMLParser
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from make_plugin import plugin_files
from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QImage, QTextDocument
from qgis.PyQt.QtWidgets import QTextBrowser

import hrsi
from hrsi.plugin.help import HELP_PICTURES
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


@pytest.mark.parametrize("name", HELP_PICTURES)
def test_help_shows_a_small_picture(qgis_app, name: str):
    """The pane of the dialogs loads what the HTML names; it is 240 pixels wide when a dialog opens."""
    (url,) = re.findall(r'<img src="([^"]+)"', PluginAlgorithm(REGISTRY[name]).shortHelpString())
    pane = QTextBrowser()
    content = pane.loadResource(QTextDocument.ResourceType.ImageResource, QUrl(url))
    assert 1000 < len(content) <= 40_000
    picture = QImage.fromData(content)
    assert 200 <= picture.width() <= 232
    assert 100 <= picture.height() <= 330
    shades = {picture.pixel(x, y) for x in range(0, picture.width(), 3) for y in range(0, picture.height(), 3)}
    assert len(shades) > 16  # not a blank


def test_every_picture_is_of_a_help_and_in_the_zip():
    shipped = {path for path in plugin_files() if path.parent.name == "pictures"}
    assert {path.name for path in shipped} == {f"{name}.png" for name in HELP_PICTURES.values()}


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
