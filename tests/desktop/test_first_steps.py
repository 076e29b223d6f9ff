"""The tour by real clicks, from the first start of QGIS to arrows on the map."""

import pytest

pytestmark = pytest.mark.programs
EXAMPLE_S, ADJUST_S = 120.0, 60.0  # on cores that others keep busy
TOUR = "plugins['hrsi']._steps"


def test_every_step_is_seen_and_clicked(start) -> None:
    """The window stays in front of main window and panel, leaves the images free, and ends with arrows on the map."""
    desktop = start(settings="[hrsi]\nfirst_steps_done=false\n")
    desktop.wait(f"{TOUR}.isVisible()")
    desktop.picture("started")
    desktop.click("button_named('Load the example')")
    desktop.wait("len(panel().session.images)", EXAMPLE_S)
    desktop.wait(f"{TOUR}.step() == 1 and not panel().ui.grid.views[0].canvas.isDrawing()")
    desktop.click("button_named('Show me the point')")
    desktop.picture("point")
    point, image = desktop.ask(f"{TOUR}.missing")
    assert desktop.ask("panel().point()") == point
    desktop.click(f"place_in(view_of({image!r}), *panel().session.predict_place({point!r}, {image!r}))")
    desktop.wait(f"{TOUR}.step() >= 2")
    assert desktop.ask(f"panel().session.measured[({point!r}, {image!r})].kind") == "center"
    if desktop.ask(f"{TOUR}.step()") == 2:  # not adjusted after the click already
        desktop.click("button_named('Adjust')")
    desktop.wait(f"{TOUR}.step() == 3 and not panel().adjustment.is_running()", ADJUST_S)
    desktop.picture("adjusted")
    desktop.click("button_named('Show the arrows')")
    desktop.wait("not iface.mapCanvas().isDrawing() and len(QgsProject.instance().mapLayers()) == 2")
    desktop.picture("arrows")
    assert not desktop.ask("panel().isVisible()") and desktop.ask("pixels()") > 1000
