"""The plugin in German: every text is collected and translated, the compiled file has them, widgets show them."""

import ast
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest
from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, QEvent, Qt
from qgis.PyQt.QtWidgets import QLabel

from hrsi.plugin.points_panel.dialogs import NewBlockDialog
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.plugin.translation import FOLDER, install_translator, tr
from hrsi.processing_algorithms import REGISTRY

ROOT = Path(__file__).resolve().parents[2]
#: Calls that show a text, and which of their arguments is it.
SHOWING = {
    "setText": 0, "setToolTip": 0, "setWindowTitle": 0, "setPrefix": 0, "tell": 0, "QLabel": 0, "QPushButton": 0,
    "addRow": 0, "createMessage": 1, "setSpecialValueText": 0,
}  # fmt: skip
WORD = re.compile(r"[A-Za-z]{3,}")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_translations", ROOT / "scripts" / "make_translations.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def german(qgis_app):
    translator = install_translator("de_AT")
    assert translator is not None
    yield translator
    QCoreApplication.removeTranslator(translator)


def test_every_text_is_translated(script: ModuleType) -> None:
    """After a change of texts: ``make translations``, and fill in what it marks as unfinished."""
    known, texts = script.translations(FOLDER / "hrsi_de.ts"), script.all_texts()
    assert len(texts) > 300
    assert [text for text in texts if text not in known] == []
    assert [text for text in known if text not in texts] == []
    for text, translated in known.items():
        assert sorted(re.findall(r"\{[^}]*\}", text)) == sorted(re.findall(r"\{[^}]*\}", translated)), text


def test_compiled_file_is_up_to_date(script: ModuleType, german) -> None:
    known = script.translations(FOLDER / "hrsi_de.ts")
    assert {text: tr(text) for text in known} == known


def test_no_text_escapes_translation() -> None:
    """Literals with words in calls that show a text stand in ``tr``."""
    found = []
    for path in sorted((ROOT / "plugin").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = getattr(node.func, "attr", getattr(node.func, "id", ""))
                place = SHOWING.get(name, -1)
                if 0 <= place < len(node.args) and _has_words(node.args[place]):
                    found.append(f"{path.name}:{node.lineno} {name}")
    assert found == []


def _has_words(node: ast.expr) -> bool:
    if isinstance(node, ast.Constant):
        return isinstance(node.value, str) and bool(WORD.search(node.value)) and node.value != "HRSI"
    if isinstance(node, ast.JoinedStr):
        return any(_has_words(part) for part in node.values if isinstance(part, ast.Constant))
    if isinstance(node, ast.IfExp):
        return _has_words(node.body) or _has_words(node.orelse)
    return False


def test_panel_and_dialogs_are_german(german, tmp_path: Path) -> None:
    panel = PointsDock(None, None, str(tmp_path))
    assert panel.windowTitle() == "HRSI Punkte"
    assert (panel.ui.adjust.text(), panel.ui.tie.text()) == ("Ausgleichen", "Verknüpfungspunkt")
    assert "neu ausgleichen" in panel.ui.live.toolTip()
    assert panel.ui.empty.text().startswith("Neu… beginnt einen Block")
    titles = [panel.measurements_model.headerData(k, Qt.Orientation.Horizontal) for k in range(3)]
    assert titles == ["Bild", "Spalte", "Zeile"]
    dialog = NewBlockDialog(panel)
    assert {"Bodenpunkte", "Höhenbezug"} <= {label.text() for label in dialog.findChildren(QLabel)}
    algorithm = PluginAlgorithm(REGISTRY["triangulate"])
    algorithm.initAlgorithm()
    labels = {param.name(): param.description() for param in algorithm.parameterDefinitions()}
    assert labels["GCPS"] == "Passpunkte" and labels["CHECK_IDS"] == "Namen der Kontrollpunkte"
    assert labels["SIGMA_IMAGE"] == "Standardabweichung der Bildkoordinaten (px)"
    assert labels["GCPS_SIGMA_H"] == "Passpunktfeld: Standardabweichung Höhe"
    assert algorithm.displayName() == "Block triangulieren"
    panel.shut_down()
    panel.deleteLater()
    QgsApplication.sendPostedEvents(panel, QEvent.Type.DeferredDelete)


def test_other_languages_stay_english(qgis_app) -> None:
    assert install_translator("xx") is None
    assert tr("Adjust") == "Adjust"
