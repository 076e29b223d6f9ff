"""Runs through Processing: options, progress, cancel, errors, result layers. The tiny algorithm says what it got."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import processing
import pytest
from qgis.core import Qgis, QgsApplication, QgsProcessingException, QgsProcessingFeedback, QgsProject
from qgis.gui import QgsMessageBar
from qgis.PyQt.QtCore import QTimer
from qgis.PyQt.QtWidgets import QPushButton

from hrsi.plugin.provider import PluginAlgorithm, describe_remaining, keep_columns
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.interface.declare import fill_options, settings_of
from hrsi.tests.qgis import answer
from hrsi.tests.qgis.panels import run_in_background, wait_for
from hrsi.tests.qgis.profile import REPOSITORY
from hrsi.tests.qgis.tiny import TINY, TinyFields

CANCEL_S = 1.0


class Listener(QgsProcessingFeedback):
    """Keeps what an algorithm says."""

    def __init__(self) -> None:
        super().__init__(False)
        self.lines: list[str] = []
        self.errors: list[str] = []
        self.warnings: list[str] = []

    def pushInfo(self, info: str) -> None:
        self.lines.append(info)

    def setProgressText(self, text: str) -> None:
        self.lines.append(text)

    def pushConsoleInfo(self, info: str) -> None:
        self.lines.append(info)

    def pushWarning(self, warning: str) -> None:
        self.warnings.append(warning)

    def reportError(self, error: str, fatalError: bool = False) -> None:
        self.lines.append(error)
        self.errors.append(error)


def test_defaults_reach_the_engine(run_tiny, tmp_path: Path) -> None:
    given = {"images": ("a_RPC.TXT",), "output_dir": str(tmp_path / "out")}
    assert run_tiny() == settings_of(fill_options(TINY.options, TINY.defaults() | given))


def test_given_values_reach_the_engine(run_tiny) -> None:
    options = run_tiny(
        IMAGES=["a_RPC.TXT", "b.tif"], MODEL="shift", MAX_ITERATIONS="7", SIGMA_IMAGE=0.25, REPORT=False,
        GCP_IDS="H003, H022", STRIPS="a+b,c", SCALE="0.5,2", GEOID="/grids/geoid", TIE_POINTS="none", OVERWRITE=True,
    )  # fmt: skip
    expected = {
        "images": ["a_RPC.TXT", "b.tif"], "model": "shift", "max_iterations": 7, "sigma_image": 0.25,
        "report": False, "gcp_ids": ["H003", "H022"], "strips": ["a+b", "c"], "scale": [0.5, 2.0],
        "geoid": "/grids/geoid", "tie_points": "none",
        "overwrite": True,
    }  # fmt: skip
    assert {name: options[name] for name in expected} == expected


def test_images_as_one_text(run_tiny) -> None:
    assert run_tiny(IMAGES="a_RPC.TXT;b.tif")["images"] == ["a_RPC.TXT", "b.tif"]


def test_remaining_time_and_columns() -> None:
    """From the first tenth on; columns of tables in the log are kept by spaces that it does not join."""
    assert describe_remaining(0.05, 60.0) == ""
    assert describe_remaining(0.25, 20.0) == "(about 60 s left)"
    assert describe_remaining(0.5, 600.0) == "(about 10 min left)"
    assert keep_columns("a    b c") == "a\u00a0\u00a0\u00a0\u00a0b c"


def test_progress_and_messages(run_tiny, tmp_path: Path) -> None:
    listener, fractions = Listener(), []
    listener.progressChanged.connect(fractions.append)
    processing.run(
        "hrsi:tinytest", {"IMAGES": ["a"], "WAIT": 0.2, "OUTPUT_DIR": str(tmp_path / "out")}, feedback=listener
    )
    assert listener.lines[:3] == ["waiting", "waited", "algorithm tiny-test"]
    assert fractions == sorted(fractions)
    assert len(fractions) >= 5


def test_temporary_output(run_tiny) -> None:
    assert Path(run_tiny(OUTPUT_DIR="TEMPORARY_OUTPUT")["output_dir"]).is_dir()


def test_report_of_an_algorithm_without_output_folder(qgis_processing) -> None:
    no_folder = replace(TINY, options=TinyFields, module=answer.__name__)
    result = processing.run(PluginAlgorithm(no_folder).create(), {"IMAGES": ["a"]})
    assert json.loads(Path(result["REPORT"]).read_text(encoding="utf-8"))["answer"] == 42


def run_tiny_in_background(parameters: dict[str, Any], feedback: QgsProcessingFeedback) -> tuple[bool, dict[str, Any]]:
    algorithm = QgsApplication.processingRegistry().createAlgorithmById("hrsi:tinytest")
    return run_in_background(algorithm, parameters, feedback)


def test_cancel_within_a_second(tiny_provider, tmp_path: Path) -> None:
    listener, cancelled_at = Listener(), []
    listener.canceled.connect(lambda: cancelled_at.append(time.monotonic()))
    QTimer.singleShot(300, listener.cancel)
    parameters = {"IMAGES": ["a"], "WAIT": 60.0, "OUTPUT_DIR": str(tmp_path / "out")}
    successful, results = run_tiny_in_background(parameters, listener)
    assert time.monotonic() - cancelled_at[0] < CANCEL_S
    assert not successful
    assert results == {}
    assert not (tmp_path / "out").exists()
    assert listener.lines[-1] == "Cancelled; nothing was written"


def test_input_error_is_its_one_line(run_tiny) -> None:
    with pytest.raises(QgsProcessingException, match="no field 'id'") as caught:
        run_tiny(TEXT="input error")
    message = str(caught.value)
    assert "Traceback" not in message
    assert len(message.strip().splitlines()) == 1


def test_missing_package_is_offered(run_tiny, monkeypatch) -> None:
    """The error names the package and the menu; above the map there is a button, with the command as its tip."""
    bar, desktop = QgsMessageBar(), MagicMock()
    desktop.messageBar.return_value, desktop.mainWindow.return_value = bar, None
    monkeypatch.setattr("hrsi.plugin.package_offer.iface", desktop)
    monkeypatch.setattr("hrsi.plugin.package_offer.list_missing_packages", lambda: ["opencv-python-headless"])
    with pytest.raises(QgsProcessingException, match=r"need opencv-python-headless.*Packages for matching"):
        run_tiny(TEXT="no opencv")
    wait_for(lambda: bar.currentItem() is not None)
    (button,) = (one for one in bar.currentItem().findChildren(QPushButton) if one.text() == "Install")
    assert f"--target {QgsApplication.qgisSettingsDirPath()}" in button.toolTip()
    assert "opencv-python-headless" in button.toolTip()


def test_provider_loads_without_heavy_packages() -> None:
    """OpenCV, SciPy, Shapely and PROJ's bindings may be missing: the algorithms are listed all the same."""
    script = (
        "import sys; sys.modules |= dict.fromkeys(('cv2', 'scipy', 'pyproj', 'shapely'));"
        "from hrsi.plugin.provider import HrsiProvider; provider = HrsiProvider(); provider.refreshAlgorithms();"
        "print(len(provider.algorithms()))"
    )
    finished = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    models = len(list((REPOSITORY / "plugin" / "models").glob("*.model3")))
    assert finished.stdout.strip() == str(len(REGISTRY) + models), finished.stderr


def test_bug_keeps_its_traceback(run_tiny) -> None:
    with pytest.raises(Exception, match="a bug") as caught:
        run_tiny(TEXT="bug")
    assert "_fail_as_asked" in str(caught.value) or caught.traceback[-1].name == "_fail_as_asked"


def test_images_are_required(run_tiny) -> None:
    with pytest.raises(QgsProcessingException, match="IMAGES"):
        run_tiny(IMAGES=[])


class MessageBar:
    """A desktop that keeps what is shown above its map."""

    def __init__(self) -> None:
        self.shown: list[tuple[str, str, str, int, int]] = []

    def messageBar(self) -> MessageBar:
        return self

    def pushMessage(self, title: str, text: str, more: str, level: int, duration: int) -> None:
        self.shown.append((title, text, more, level, duration))


@pytest.mark.parametrize(
    ("level", "signal"), [("ok", Qgis.MessageLevel.Success), ("doubtful", Qgis.MessageLevel.Warning),
                          ("unusable", Qgis.MessageLevel.Critical)],
)  # fmt: skip
def test_verdict_is_seen_and_layers_are_loaded(
    level, signal, tiny_provider, qgis_new_project, tmp_path: Path, monkeypatch
) -> None:
    """What cannot be used is red in the log and stays above the map, and its layers can be looked at."""
    desktop, listener = MessageBar(), Listener()
    monkeypatch.setattr("hrsi.plugin.results.iface", desktop)
    given = {"IMAGES": ["a"], "OUTPUT_DIR": str(tmp_path / "out"), "TEXT": level}
    result = processing.runAndLoadResults("hrsi:tinytest", given, feedback=listener)
    assert result["VERDICT"] == level
    assert [layer.name() for layer in QgsProject.instance().mapLayers().values()] == ["points"]
    ((_title, text, more, shown, duration),) = desktop.shown
    assert shown == signal
    assert text.startswith(f"Verdict: {level}. ")
    assert (duration == 0) == (level == "unusable")
    assert [line.partition(";")[0] for line in listener.errors] == ([text] if level == "unusable" else [])
    assert [line.partition(";")[0] for line in listener.warnings] == ([text] if level == "doubtful" else [])
    if level == "unusable":
        assert text == "Verdict: unusable. all is wrong" and "look at GCPs" in more


def test_hostile_ids_are_text_in_the_message_bar_and_in_tips(monkeypatch) -> None:
    """Both take texts for HTML; Qt itself reads them back here."""
    from qgis.PyQt.QtGui import QTextDocument

    from hrsi.plugin.help import as_rich_text
    from hrsi.plugin.results import show_in_message_bar

    desktop, evil = MessageBar(), '<img src="http://x/y.png"><b>P1</b> & <a href="file:///etc">GCP</a>'
    monkeypatch.setattr("hrsi.plugin.results.iface", desktop)
    reason = {"level": "doubtful", "message": evil, "code": "x", "advice": evil}
    show_in_message_bar({"level": "doubtful", "reasons": [reason], "sentence": "2 images"}, "Adjust", str)
    _, text, more, *_ = desktop.shown[0]
    for shown, wanted in ((text, f"Verdict: doubtful. {evil}"), (more, evil), (as_rich_text(evil), evil)):
        document = QTextDocument()
        document.setHtml(shown)
        assert wanted in document.toPlainText()
