"""No text of the panel is cut in English, in German, and in languages with words longer by a quarter and by 40 %."""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication
from qgis.PyQt.QtGui import QFont
from qgis.PyQt.QtWidgets import QAbstractButton, QLabel

from hrsi.plugin.points_panel import dialogs, dock, image_view, layout, table_models
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.plugin.translation import install_translator, tr
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import files
from hrsi.tests.qgis.panels import close, wait_for

PICTURES = Path(__file__).resolve().parents[2] / "build" / "widths"  #: to be looked at
SCREEN_PX = (1920, 1050)  # a common screen, without its task bar
FONT_PT = 9  # of QGIS on Windows and Linux; that of tests is larger
GERMAN = "de"


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("widths") / "block"
    run("simulate", output_dir=str(folder), images=3, size=400, gcps=8, checks=4, ties=0, seed=5)
    with (folder / "image_points.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    rows[0]["sample"] = str(float(rows[0]["sample"]) + 9.0)  # a suspicious one has a mark before its name
    with (folder / "image_points.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return folder


@pytest.fixture(params=["en", GERMAN, "1.25", "1.40"])
def language(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, qgis_app) -> Iterator[str]:
    """A language of the panel; a number stands for words that are so much longer."""
    name = request.param
    translator = install_translator(name) if name == GERMAN else None
    assert (translator is not None) == (name == GERMAN)
    if name[0].isdigit():
        longer: Callable[[str], str] = lambda text: tr(text) + "m" * round((float(name) - 1.0) * len(text))  # noqa: E731
        for module in (dialogs, dock, image_view, layout, table_models):
            monkeypatch.setattr(module, "tr", longer)
    yield name
    if translator is not None:
        QCoreApplication.removeTranslator(translator)


def test_no_text_is_cut(language: str, block: Path, qgis_new_project, tmp_path: Path) -> None:
    """Buttons, labels and columns are as wide as their texts, and no button is pushed out of its bar."""
    panel = PointsDock(None, None, str(tmp_path / "unsaved"))
    panel.setFont(QFont(panel.font().family(), FONT_PT))
    panel.resize(*SCREEN_PX)
    panel.show()
    images = [str(path) for path in sorted(block.glob("image_?.tif"))]
    panel.show_session(files.new_session(images, str(block / "ground_points.csv"), str(block / "image_points.csv")))
    ended: list[bool] = []
    panel.adjusted.connect(ended.append)
    panel.adjust()
    wait_for(lambda: bool(ended) and not any(view.canvas.isDrawing() for view in panel.ui.grid.list_views()))
    QgsApplication.processEvents()
    cut = []
    for tab in range(panel.ui.tabs.count()):
        panel.ui.tabs.setCurrentIndex(tab)
        QgsApplication.processEvents()
        PICTURES.mkdir(parents=True, exist_ok=True)
        panel.grab().save(str(PICTURES / f"{language}_{tab}.png"))
        for widget in [*panel.ui.findChildren(QAbstractButton), *panel.ui.findChildren(QLabel)]:
            wraps = isinstance(widget, QLabel) and widget.wordWrap()
            if widget.isVisible() and widget.text() and not wraps and widget.width() < widget.sizeHint().width():
                cut.append((tab, widget.text(), widget.width(), widget.sizeHint().width()))
        for table in (panel.ui.points, panel.ui.measurements, panel.ui.residuals):
            header = table.horizontalHeader()
            for column in range(table.model().columnCount()) if table.isVisible() else ():
                needed = max(table.sizeHintForColumn(column), header.sectionSizeHint(column))
                if header.sectionSize(column) < needed:
                    cut.append((tab, table.model().headerData(column, 1), header.sectionSize(column), needed))
    tabs = panel.ui.tabs.tabBar()
    if tabs.width() < tabs.sizeHint().width():
        cut.append((0, "tabs", tabs.width(), tabs.sizeHint().width()))
    for bar in (panel.ui.bar, panel.ui.second_bar):
        cut += [
            (bar.actions().index(action), action.text(), 0, 0)
            for action in bar.actions()
            if not action.isSeparator() and not bar.widgetForAction(action).isVisible()
        ]
    panel.discard_edits()
    close(panel)
    assert cut == []
