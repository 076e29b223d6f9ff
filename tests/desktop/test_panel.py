"""The panel "HRSI Points" with real clicks and keys."""

import zipfile
from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import float_panel, show_block
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
    desktop.wait("not any(view.canvas.isDrawing() for view in panel().ui.grid.list_views())")
    point, image = desktop.ask("[panel().point(), panel().ui.grid.list_views()[0].image()]")
    assert click_point(desktop, truth, point, image) < SUBPIXEL
    desktop.picture("measured")


def show_first_point(desktop: Desktop, block: Path, name: str = "G000001") -> str:
    """Show the block and a point; return the image of the first view."""
    show_block(desktop, block)
    float_panel(desktop)
    desktop.click(f"cell_of(panel().ui.points, panel().points_model.row_of({name!r}), 0)")
    desktop.wait(f"panel().point() == {name!r} and not panel().ui.grid.views[0].canvas.isDrawing()")
    return str(desktop.ask("panel().ui.grid.views[0].image()"))


def test_keys_of_the_panel_beside_those_of_qgis(desktop: Desktop, block: Path, truth, tmp_path: Path) -> None:
    """F5, Ctrl+S, Ctrl+Z and the letters reach the panel wherever in it the focus is, and QGIS outside of it."""
    image = show_first_point(desktop, block)
    desktop.ask(  # QGIS's own Undo is alive while a layer is edited
        "layer = QgsVectorLayer('Point?crs=EPSG:4326', 'edited', 'memory')\nQgsProject.instance().addMapLayer(layer)\n"
        "iface.setActiveLayer(layer)\nlayer.startEditing()"
    )
    click_point(desktop, truth, "G000001", image)
    desktop.press("Ctrl+z")
    assert desktop.ask("len(panel().session.measured)") == 0
    desktop.press("Ctrl+Shift+z")
    assert desktop.ask("len(panel().session.measured)") == 1
    path = tmp_path / "block.gpkg"
    desktop.ask(
        f"from hrsi.processing_algorithms.point_session import files\nfiles.save(panel().session, {str(path)!r})"
    )
    for focus in ("panel().ui.points.setFocus()", "panel().ui.measurements.setFocus()", "panel().ui.kind.setFocus()"):
        desktop.ask(f"panel().session.set_sigma('G000001', 'sigma_h', {0.3 + len(focus) / 1000})\n{focus}")
        assert desktop.ask("panel().session.changed")
        desktop.press("Ctrl+s")
        assert desktop.wait("not panel().session.changed", 5.0)
    desktop.press("n")
    assert desktop.ask("panel().point()") == "G000002"
    desktop.ask("ADJUSTED = []\npanel().adjusted.connect(ADJUSTED.append)\npanel().ui.grid.views[0].canvas.setFocus()")
    desktop.press("F5")
    assert desktop.wait("ADJUSTED", 60.0)  # or why not: that it was tried is what counts here
    desktop.picture("adjusted")


def test_letters_in_a_cell_are_text(desktop: Desktop, block: Path) -> None:
    """While a cell is typed in, its letters and Delete are no commands."""
    show_first_point(desktop, block)
    desktop.click("cell_of(panel().ui.points, 3, 6)", times=2)
    desktop.press("BackSpace")
    desktop.write("0.25")
    desktop.press("Return")
    assert desktop.ask("panel().session.points['G000001'].sigma_xy") == pytest.approx(0.25)
    assert desktop.ask("len(panel().session.points)") == 12


def test_recover_after_a_kill(start, block: Path, truth) -> None:
    """What was clicked and not saved comes back with the button in the message bar, after a kill -9."""
    desktop = start()
    image = show_first_point(desktop, block)
    click_point(desktop, truth, "G000001", image)
    made = desktop.ask("[[*key, one.sample, one.line] for key, one in panel().session.measured.items()]")
    desktop.kill()
    desktop = start()
    desktop.picture("offered")
    desktop.ask("iface.messageBar().clearWidgets()")  # closed without an answer: the menu offers it again
    desktop.ask("[action.trigger() for action in plugins['hrsi']._actions if action.text().startswith('Recover')]")
    desktop.click("button_named('Recover')")
    desktop.wait("len(panel().session.measured)")
    assert desktop.ask("panel().point()") == "G000001"
    assert desktop.ask("[[*key, one.sample, one.line] for key, one in panel().session.measured.items()]") == made
    assert desktop.ask("panel().session.changed")
    desktop.picture("recovered")


def extent_of_views(desktop: Desktop) -> list[list[float]]:
    """Return middle (sample, line) and width of what the views show."""
    return desktop.ask(
        "[[round(view.canvas.extent().center().x(), 1), round(-view.canvas.extent().center().y(), 1), "
        "round(view.canvas.extent().width(), 1)] for view in panel().ui.grid.list_views()]"
    )


def test_projects_leave_the_image_views_alone(desktop: Desktop, block: Path, truth, tmp_path: Path) -> None:
    """Another project opened with unsaved points: the views still show the chosen point, and a click measures it."""
    image = show_first_point(desktop, block, "G000003")
    project = tmp_path / "saved.qgz"
    desktop.ask(f"QgsProject.instance().write({str(project)!r})")
    desktop.click("cell_of(panel().ui.points, 3, 0)")
    click_point(desktop, truth, "G000001", image)
    shown = extent_of_views(desktop)
    desktop.ask(
        f"from qgis.PyQt.QtCore import QTimer\nQTimer.singleShot(0, lambda: iface.addProject({str(project)!r}))"
    )
    desktop.wait(f"QgsProject.instance().fileName() == {str(project)!r}")
    desktop.picture("opened")
    assert extent_of_views(desktop) == shown
    assert desktop.ask("panel().point()") == "G000001"
    other = desktop.ask("panel().ui.grid.views[1].image()")
    assert click_point(desktop, truth, "G000001", other) < SUBPIXEL
    with zipfile.ZipFile(project) as archive:
        text = archive.read("saved.qgs").decode()
    assert text.count("<mapcanvas") == 1  # QGIS's own map
    desktop.ask("later(lambda: iface.newProject(False))")
    desktop.wait("QgsProject.instance().fileName() == ''")
    assert extent_of_views(desktop) == shown
