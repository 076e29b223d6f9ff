"""Packages for matching: what a bare QGIS lacks is installed into its profile by one click, and used at once."""

from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import run_in_dialog

pytestmark = pytest.mark.programs
INSTALL_S = 900.0  # pip loads 100 MB
FIND = "from importlib.util import find_spec"
PLACES = "[find_spec(name).origin if find_spec(name) else None for name in ('numba', 'cv2', 'numpy')]"


def test_one_click_installs_packages(start, block: Path, tmp_path: Path) -> None:
    """Matching asks for them by a button; then it works, now and after the next start, with the NumPy of QGIS."""
    desktop = start(packages=False)
    desktop.ask(FIND)
    before = desktop.ask(PLACES)
    if before[:2] != [None, None]:
        pytest.skip("the Python of this QGIS has numba or OpenCV already")
    desktop.ask("plugins['hrsi']._steps.show_in_front()")
    desktop.click("button_named('Load the example')")  # its second step measures in an image
    desktop.wait("any('packages for matching' in title for title in windows())")
    desktop.picture("offer_in_tour")
    desktop.ask("[one.close() for one in QApplication.topLevelWidgets() if 'packages for' in one.windowTitle()]")
    desktop.wait("len(panel().session.images)")
    desktop.ask("plugins['hrsi']._steps.close(), panel().hide()")
    choose = "[action.trigger() for action in plugins['hrsi']._actions if action.text() == 'Packages for matching']"
    desktop.ask(choose)
    desktop.wait("any('packages for matching' in title for title in windows())")
    desktop.picture("offer")
    offered = desktop.ask("QApplication.activeModalWidget().informativeText()")
    print(offered)
    desktop.click("button_named('Close')")
    images = [str(path) for path in sorted(block.glob("image_?.tif"))]
    given = {"IMAGES": images, "OUTPUT_DIR": str(tmp_path / "ties"), "CELLS": 3}
    run_in_dialog(desktop, "hrsi:tiepoints", given)
    desktop.picture("asked")
    if "apt-get" in offered:
        pytest.skip("this system has no pip: its own packages are offered")
    visible = "[one for one in QApplication.allWidgets() if isinstance(one, QAbstractButton) and one.isVisible()]"
    desktop.wait(f"any(one.text() == 'Install' for one in {visible})")
    desktop.click("button_named('Install')")
    text = "[label.toPlainText() for label in iface.messageBar().findChildren(QTextBrowser)]"
    desktop.wait(f"any('Installed. Matching' in text or 'not installed' in text for text in {text})", INSTALL_S)
    desktop.picture("installed")
    assert any("Installed. Matching" in text for text in desktop.ask(text)), desktop.ask(text)
    run_in_dialog(desktop, "hrsi:tiepoints", given)
    assert (tmp_path / "ties" / "report.json").exists()
    desktop.kill()
    desktop = start()
    desktop.ask(FIND)
    numba, opencv, numpy = desktop.ask(PLACES)
    profile = desktop.ask("QgsApplication.qgisSettingsDirPath()").rstrip("/")
    assert numba.startswith(profile) and opencv.startswith(profile) and numpy == before[2]
    desktop.ask("import cv2, numba")
    desktop.ask(choose)
    desktop.wait(f"any('All packages' in text for text in {text})")
