"""Ten GCPs on three images whose RPCs are 80 px off, in the real window: actions counted, distances from the truth."""

from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import float_panel, show_block
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs
BIAS_PX = [[80.0, 0.0], [-57.0, 57.0], [0.0, -80.0]]
POINTS, MOST_ACTIONS, LARGEST_PX = 10, 25, 0.15
HAND_PX = (2.0, -1.5)  # a click beside the middle of a disc
SHIFT = """
from dataclasses import replace
from hrsi.processing_algorithms.point_session import PointSession
old = panel().session
images = [
    replace(image, rpc=replace(image.rpc, samp_off=image.rpc.samp_off + off[0], line_off=image.rpc.line_off + off[1]))
    for image, off in zip(old.images.values(), {bias})
]
panel().show_session(PointSession(images, list(old.points.values())[:{points}]))
"""
AT_REST = (
    "not (panel().search.is_running() or panel().adjustment.is_waiting() or panel().adjustment.is_running() or "
    "any(view.canvas.isDrawing() for view in panel().ui.grid.list_views()))"
)


def test_ten_gcps_on_three_images(desktop: Desktop, block: Path, truth) -> None:
    """A click in one image and a key for what is found in the others, which goes on to the next point."""
    show_block(desktop, block)
    float_panel(desktop)
    desktop.ask("panel().ui.number.setCurrentText('3')")
    desktop.ask(SHIFT.format(bias=BIAS_PX, points=POINTS))
    desktop.wait(AT_REST, 60.0)
    desktop.picture("empty")
    before = desktop.actions
    for number in range(POINTS):
        point, image = desktop.ask("[panel().point(), panel().ui.grid.active_image()]")
        sample, line = truth[(point, image)]
        desktop.click(f"place_in(view_of({image!r}), {sample + HAND_PX[0]}, {line + HAND_PX[1]})")
        desktop.wait(f"({point!r}, {image!r}) in panel().session.measured and {AT_REST}", 120.0)
        if desktop.ask("bool(panel().search.proposals)"):
            if number == 0:
                desktop.picture("proposed")
            desktop.press("Shift+y")
            desktop.wait(f"not panel().search.proposals and {AT_REST}", 120.0)
    actions = desktop.actions - before
    desktop.picture("measured")
    made = desktop.ask("[[*key, one.sample, one.line] for key, one in panel().session.measured.items()]")
    off = [
        ((sample - truth[(point, image)][0]) ** 2 + (line - truth[(point, image)][1]) ** 2) ** 0.5
        for point, image, sample, line in made
    ]
    print(
        f"{POINTS} GCPs on 3 images off by 80 px: {actions} actions, {len(off)} measurements, largest {max(off):.3f} px"
    )
    assert actions <= MOST_ACTIONS
    assert max(off) < LARGEST_PX
    assert len(off) >= 2.5 * POINTS  # a point at the rim is not in all images
    assert desktop.ask("panel().session.is_adjusted")
