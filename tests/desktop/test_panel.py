"""The panel "HRSI Points" with real clicks and keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import float_panel
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs
HAND_PX = (2.0, -1.5)  # a click beside the middle of a disc
SUBPIXEL = 0.1  # px


def click_point(desktop: Desktop, truth, point: str, image: str) -> float:
    """Click a point in its image, a little off; return how far from the truth the measurement is (px)."""
    sample, line = truth[(point, image)]
    desktop.click(f"place_in(view_of({image!r}), {sample + HAND_PX[0]}, {line + HAND_PX[1]})")
    made = f"panel().session.measured[({point!r}, {image!r})]"
    at = desktop.ask(f"[{made}.sample, {made}.line]")
    return float(((at[0] - sample) ** 2 + (at[1] - line) ** 2) ** 0.5)


def test_new_block_by_mouse_and_keyboard(desktop: Desktop, block: Path, truth) -> None:
    """New…, files typed, a click on a target: a measurement."""
    desktop.ask("panel().show()")
    float_panel(desktop)
    desktop.picture("empty")
    desktop.click("button_of(panel().ui.new)")
    desktop.wait("'New block of images' in windows()")
    desktop.ask(
        "from hrsi.plugin.points_panel.dialogs import NewBlockDialog\nfrom qgis.PyQt.QtWidgets import QLineEdit"
    )
    desktop.ask("dialog = QApplication.activeModalWidget()")
    desktop.click("middle_of(dialog.images.lineEdit())")
    desktop.write(" ".join(f'"{path}"' for path in sorted(block.glob("image_?.tif"))))
    desktop.click("middle_of(dialog.gcps.box.lineEdit())")
    desktop.write(str(block / "ground_points.csv"))
    desktop.picture("new_block")
    desktop.click("button_named('OK')")
    assert desktop.wait("len(panel().session.images)") == 3
    desktop.wait("not any(view.canvas.isDrawing() for view in panel().ui.list_views())")
    point, image = desktop.ask("[panel().point(), panel().ui.list_views()[0].image()]")
    assert click_point(desktop, truth, point, image) < SUBPIXEL
    desktop.picture("measured")
