"""Hours of measuring in minutes: after some hundred random actions everything still draws and memory is as before.

The map shows the layers of two adjusted blocks. Actions are real clicks, keys and turns of the wheel in the panel that
shows one of them, with saving, which replaces the file under these layers, and changes of the block in between.
"""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from hrsi.processing_algorithms import run
from hrsi.tests.desktop.conftest import float_panel
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs
ACTIONS, WARM_UP, SEED = 300, 60, 17
LEAST_SHARE = 0.8  # of the pixels that a layer drew at the beginning: points move and change colour
LARGEST_LEAK_MB = 0.2  # an action: 5000 of a long day are 1 GB
WHEEL = {"up": 4, "down": 5}  # buttons of X
KEYS = {  # how often of each: mostly measuring
    "n": 8, "p": 4, "a": 4, "Delete": 3, "Ctrl+z": 6, "Ctrl+Shift+z": 4, "m": 2, "y": 3, "Shift+y": 3, "x": 2,
    "F5": 3, "Ctrl+s": 3,
}  # fmt: skip
OTHERS = {"click": 30, "up": 3, "down": 3, "image": 4, "number": 3, "row": 5, "tab": 3, "block": 3, "hide": 2}
LAYERS = "images", "ground_points", "image_points"
#: Statements for QGIS: all layers of the blocks, and what each draws alone at its own extent.
LOAD = """
from qgis.core import QgsVectorLayer
iface.newProject(False)
LAYERS = {}
for path in %r:
    for name in %r:
        layer = QgsVectorLayer(f"{path}|layername={name}", f"{path} {name}", "ogr")
        layer.loadDefaultStyle()
        QgsProject.instance().addMapLayer(layer)
        LAYERS[layer.name()] = layer
"""
BUSY = (
    "panel().search.is_running() or panel().adjustment.is_waiting() or panel().adjustment.is_running() or "
    "any(view.canvas.isDrawing() for view in panel().ui.grid.list_views())"
)


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Two adjusted blocks, as they come out of the toolbox."""
    paths = []
    for seed in (5, 6):
        folder = tmp_path_factory.mktemp("long") / f"block_{seed}"
        run("simulate", output_dir=str(folder), images=3, size=500, gcps=9, checks=3, ties=60, seed=seed)
        run(
            "triangulate", images=[str(path) for path in sorted(folder.glob("image_?.tif"))],
            gcps=str(folder / "ground_points.csv"), image_points=str(folder / "image_points.csv"), tie_points="none",
            model="shift", output_dir=str(folder / "result"), overwrite=True,
        )  # fmt: skip
        paths.append(str(folder / "result" / "block.gpkg"))
    return paths


def memory_mb(desktop: Desktop) -> float:
    """Return what QGIS keeps in memory."""
    return int(Path(f"/proc/{desktop.process.pid}/statm").read_text(encoding="ascii").split()[1]) / 256.0


def act(desktop: Desktop, what: str, chance: random.Random, blocks: list[str]) -> None:
    """Do one thing as a user does it."""
    views = desktop.ask("len(panel().ui.grid.list_views())")
    view = f"panel().ui.grid.list_views()[{chance.randrange(views)}]"
    if what in KEYS:
        desktop.press(what)
    elif what == "click" or what in WHEEL:
        across, down = (chance.uniform(-30.0, 30.0) for _ in range(2))
        place = desktop.ask(f"middle_of({view}.canvas.viewport())")
        desktop.screen.click(round(place[0] + across), round(place[1] + down), button=WHEEL.get(what, 1))
        desktop._settle()
    elif what == "image":
        desktop.ask(f"{view}.chooser.setCurrentIndex({chance.randrange(3)})")
    elif what == "number":
        desktop.ask(f"panel().ui.number.setCurrentText({chance.choice(('1', '2', '3', '4'))!r})")
    elif what == "row":
        desktop.ask("panel().ui.tabs.setCurrentIndex(0)")
        desktop.click(f"cell_of(panel().ui.points, {chance.randrange(12)}, 0)")
    elif what == "tab":
        desktop.ask(f"panel().ui.tabs.setCurrentIndex({chance.randrange(3)})")
    elif what == "block":
        desktop.press("Ctrl+s")
        desktop.wait("not panel().session.changed")
        desktop.ask(f"panel().files.open({chance.choice(blocks)!r})")
    else:
        desktop.ask("panel().hide(), panel().show()")
    desktop.wait(f"not ({BUSY})")


def test_all_still_draws_after_hundreds_of_actions(desktop: Desktop, blocks: list[str]) -> None:
    """No Python error, no dialog, no layer or marker gone, no memory kept."""
    desktop.ask(LOAD % (blocks, LAYERS))
    before = desktop.ask("seen(LAYERS)")
    assert all(before.values()), before
    desktop.ask(f"panel().show(), panel().files.open({blocks[0]!r})")
    desktop.wait("len(panel().session.images)")
    float_panel(desktop)
    desktop.wait(f"not ({BUSY})")
    chance = random.Random(SEED)
    weights = KEYS | OTHERS
    done: list[str] = []
    kept_mb = 0.0
    for number in range(ACTIONS):
        what = chance.choices(list(weights), list(weights.values()))[0]
        done.append(what)
        try:
            act(desktop, what, chance, blocks)
            assert desktop.ask("QApplication.activeModalWidget() is None"), "a dialog asks for something"
        except BaseException:
            desktop.picture("failed")
            print("actions so far:", done)
            raise
        if number + 1 == WARM_UP:
            kept_mb = memory_mb(desktop)
        if (number + 1) % 100 == 0:
            desktop.picture(f"after_{number + 1}")
    leak_mb = (memory_mb(desktop) - kept_mb) / (ACTIONS - WARM_UP)
    after = desktop.ask("seen(LAYERS)")
    print(f"{ACTIONS} actions: {leak_mb:.3f} MB an action stay; pixels of layers before and after:")
    for name, pixels in before.items():
        print(f"  {name}: {pixels}, {after[name]}")
    assert {name for name, pixels in after.items() if pixels < LEAST_SHARE * before[name]} == set()
    desktop.ask("panel().choose(next(iter(panel().session.points)))")
    desktop.wait(f"not ({BUSY})")
    desktop.picture("after_all")
    plain = "[view.canvas.grab().toImage() for view in panel().ui.grid.list_views()]"
    desktop.ask(
        f"with_markers = {plain}\n"
        "[view.markers.hide() for view in panel().ui.grid.list_views()]\n"
        f"without = {plain}\n"
        "[view.markers.show() for view in panel().ui.grid.list_views()]\n"
        "result = [one != other for one, other in zip(with_markers, without)]"
    )
    assert desktop.ask("all(one != other for one, other in zip(with_markers, without))"), "markers are gone"
    assert leak_mb < LARGEST_LEAK_MB
