"""The offer of packages for speed: what a bare QGIS shows is installed by one click, and used after the next start."""

from __future__ import annotations

from pathlib import Path

import pytest

pytestmark = pytest.mark.programs
INSTALL_S = 900.0  # pip loads 100 MB
FIND = "from importlib.util import find_spec"
PLACES = "[find_spec(name).origin if find_spec(name) else None for name in ('numba', 'cv2', 'numpy')]"


def test_one_click_installs_packages(start, tmp_path: Path) -> None:
    """Into the user's folder of a fresh profile; NumPy stays that of QGIS."""
    home = tmp_path / "home"
    home.mkdir()
    desktop = start(HOME=str(home))
    desktop.ask(FIND)
    before = desktop.ask(PLACES)
    if before[:2] != [None, None]:
        pytest.skip("the Python of this QGIS has numba or OpenCV already")
    choose = "[action.trigger() for action in plugins['hrsi']._actions if action.text() == 'Packages for speed']"
    desktop.ask(choose)
    desktop.wait("any('packages for speed' in title for title in windows())")
    desktop.picture("offer")
    offered = desktop.ask("QApplication.activeModalWidget().informativeText()")
    print(offered)
    if "apt-get" in offered:
        pytest.skip("this system has no pip: its own packages are offered")
    desktop.click("button_named('Install')")
    told = "[label.toPlainText() for label in iface.messageBar().findChildren(QTextBrowser)]"
    desktop.wait(f"any('Installed. Restart' in text or 'not installed' in text for text in {told})", INSTALL_S)
    desktop.picture("installed")
    assert any("Installed. Restart" in text for text in desktop.ask(told)), desktop.ask(told)
    desktop.kill()
    desktop = start(HOME=str(home))
    desktop.ask(FIND)
    numba, opencv, numpy = desktop.ask(PLACES)
    assert numba.startswith(str(home)) and opencv.startswith(str(home)) and numpy == before[2]
    desktop.ask(
        "from hrsi.hrsi_engine.foundation import compiled_code, pixel_filters\n"
        "from hrsi.plugin.dependencies import speed_note\nimport cv2, numba"
    )
    assert desktop.ask("speed_note()") == ""
    desktop.ask(choose)
    desktop.wait(f"any('Matching is fast' in text for text in {told})")
    desktop.picture("fast")
