"""What of the panel is seen: room for the images, whole columns, rows of one height."""

from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import float_panel, show_block
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs
IMAGES_SHARE = 0.5  # of the panel: measuring is done in them
SMALLEST_PX = 300  # side of a view
#: Statements for QGIS: fill a block with everything that was measured, one point 9 px off.
BLUNDER = """
from dataclasses import replace
from hrsi.processing_algorithms.point_session import files
session = files.new_session({images}, {gcps!r}, {measured!r})
key = next(key for key in session.measured if key[0] in session.points)
session.measured[key] = replace(session.measured[key], sample=session.measured[key].sample + 9.0)
panel().show_session(session)
"""
AT_REST = (
    "not (panel().adjustment.is_running() or panel().adjustment.is_waiting() or panel().search.is_running() or "
    "any(view.canvas.isDrawing() for view in panel().ui.grid.list_views()))"
)
#: Columns, by table, whose heading or text is cut, of those that a table of its width shows.
CUT = """
def cut(table):
    model, header = table.model(), table.horizontalHeader()
    short = []
    for column in range(model.columnCount()):
        needed = max(table.sizeHintForColumn(column), header.sectionSizeHint(column))
        if header.sectionSize(column) < needed:
            short.append([str(model.headerData(column, 1)), header.sectionSize(column), needed])
    return short
"""


def share_of_images(desktop: Desktop) -> float:
    """Return the share of the panel that shows pixels of images."""
    return float(
        desktop.ask(
            "sum(one.canvas.width() * one.canvas.height() for one in panel().ui.grid.list_views())"
            " / (panel().width() * panel().height())"
        )
    )


def test_room_for_what_is_looked_at(desktop: Desktop, block: Path) -> None:
    """Images have half of the panel whatever the verdict says; columns are whole, headings sort, RMSE is below."""
    images = [str(path) for path in sorted(block.glob("image_?.tif"))]
    desktop.ask("panel().show()")
    float_panel(desktop)
    desktop.ask(
        BLUNDER.format(images=images, gcps=str(block / "ground_points.csv"), measured=str(block / "image_points.csv"))
    )
    desktop.wait(AT_REST, 120.0)
    before = share_of_images(desktop)
    desktop.press("F5")
    desktop.wait(f"panel().session.is_adjusted and {AT_REST}", 300.0)
    desktop.picture("blunder")
    assert desktop.ask("panel().session.adjusted.verdict.reasons != ()")
    assert share_of_images(desktop) == pytest.approx(before, abs=0.01)  # the verdict takes nothing from them
    assert before > IMAGES_SHARE
    desktop.ask(CUT)
    for table in ("points", "measurements"):
        assert desktop.ask(f"cut(panel().ui.{table})") == []
    tabs = "panel().ui.tabs.tabBar()"
    desktop.click(f"[(place := {tabs}.mapToGlobal({tabs}.tabRect(1).center())).x(), place.y()]")
    desktop.wait("panel().ui.residuals.isVisible()")
    assert desktop.ask("cut(panel().ui.residuals)") == []
    assert "RMSE" in desktop.ask("panel().ui.rmse.text()") and desktop.ask("middle_of(panel().ui.rmse)")
    column = desktop.ask("panel().residuals_model.titles.index('ds px')")
    header = "panel().ui.residuals.horizontalHeader()"
    for _ in range(2):  # a click on the heading, and another one: the other way round
        desktop.click(
            f"[(place := {header}.viewport().mapToGlobal(QPoint({header}.sectionViewportPosition({column}) + 12, 8)))"
            ".x(), place.y()]"
        )
    sizes = [
        abs(float(text))
        for text in desktop.ask(f"[one.index(row, {column}).data() for one in [panel().residuals_model]"
                                " for row in range(one.rowCount())]")
        if text
    ]  # fmt: skip
    assert len(sizes) > 10 and sizes in (sorted(sizes), sorted(sizes, reverse=True))
    desktop.picture("residuals")
    desktop.click(f"[(place := {tabs}.mapToGlobal({tabs}.tabRect(2).center())).x(), place.y()]")
    desktop.wait("panel().ui.verdict.isVisible()")
    desktop.picture("verdict")


@pytest.mark.parametrize("size_px", [(1366, 768)])
def test_views_of_300_px_on_a_small_screen(start, block: Path, size_px: tuple[int, int]) -> None:
    """The panel opens as a window of its own: up to three images of at least 300 x 300 px on a common notebook."""
    desktop = start(size_px=size_px)
    desktop.ask("panel().toggleViewAction().trigger()")
    show_block(desktop, block)
    assert desktop.ask("panel().isFloating()")
    desktop.ask(
        "from dataclasses import replace\nfrom hrsi.processing_algorithms.point_session import PointSession\n"
        "images = [replace(one, id=f'{one.id}_{k}') for one in panel().session.images.values() for k in range(3)]\n"
        "panel().show_session(PointSession(images, list(panel().session.points.values())))"
    )
    for number in range(1, 10):
        desktop.ask(f"panel().ui.number.setCurrentText('{number}')")
        desktop.wait(AT_REST, 60.0)
        desktop.picture(f"images_{number}")
        sizes = desktop.ask("[[one.canvas.width(), one.canvas.height()] for one in panel().ui.grid.list_views()]")
        assert len(sizes) == number and (number > 3 or min(map(min, sizes)) >= SMALLEST_PX), sizes
        used = sum(width * height for width, height in sizes)
        assert used > 0.75 * desktop.ask("panel().ui.grid.width() * panel().ui.grid.height()")


def test_german_panel_has_all_its_buttons(start, installed: Path) -> None:
    """Longer words push no button out of a panel as wide as the screen."""
    desktop = start(settings="[locale]\noverrideFlag=true\nuserLocale=de\n")
    desktop.ask("panel().show()")
    float_panel(desktop)
    desktop.picture("german")
    assert desktop.ask("panel().ui.save.text()") == "Speichern"
    hidden = desktop.ask(
        "[one.text() for bar in (panel().ui.bar, panel().ui.second_bar) for one in bar.actions()"
        " if not one.isSeparator() and not bar.widgetForAction(one).isVisible()]"
    )
    assert hidden == []
