"""Hours of measuring in minutes: after some hundred random actions everything still draws and memory is as before.

The map shows the layers of three adjusted blocks. Actions are real clicks, keys and turns of the wheel in the panel
that shows one of them, with saving, which replaces the file under these layers, and changes of the block in between.
Now and then an algorithm runs in its dialog, one of them is cancelled, and another project is opened and left again. At
the end QGIS is killed with unsaved measurements, which are recovered.
"""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from hrsi.processing_algorithms import run
from hrsi.tests.desktop.conftest import float_panel, run_in_dialog
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs
ACTIONS, WARM_UP, SEED = 300, 60, 17
LEAST_SHARE = 0.8  # of the pixels that a layer drew at the beginning: points move and change colour
LARGEST_LEAK_MB = 0.1  # an action: 5000 of a long day are 0.5 GB
RUN_EVERY = 50  # actions
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
    """Three adjusted blocks, as they come out of the toolbox."""
    paths = []
    for seed in (5, 6, 7):
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


def work_beside_the_panel(desktop: Desktop, number: int, blocks: list[str], folder: Path) -> None:
    """Run the next of five algorithms, and after each second one open another project and return."""
    source = Path(blocks[number % len(blocks)]).parents[1]
    images = [str(path) for path in sorted(source.glob("image_?.tif"))]
    points = {"GCPS": str(source / "ground_points.csv"), "IMAGE_POINTS": str(source / "image_points.csv")}
    given = {
        "hrsi:adjust": {"IMAGES": images, **points}, "hrsi:rpcinfo": {"IMAGES": images},
        "hrsi:triangulate": {"IMAGES": images, "TIE_POINTS": "none", **points},
        "hrsi:project": {"IMAGES": images[:1], "POINTS": points["GCPS"]},
        "hrsi:simulate": {"SIZE": 6000},
    }  # fmt: skip
    name = list(given)[number % len(given)]
    output = {"OUTPUT_DIR": str(folder / f"run_{number}")}
    desktop.ask("panel().hide()")
    run_in_dialog(desktop, name, given[name] | output, cancel=name == "hrsi:simulate")
    if number % 2:
        project = str(folder / "kept.qgz")
        desktop.ask(f"QgsProject.instance().write({project!r})")
        desktop.ask("later(lambda: iface.newProject(False))")
        desktop.wait("QgsProject.instance().fileName() == ''")
        desktop.ask(f"later(lambda: iface.addProject({project!r}))")
        desktop.wait(f"QgsProject.instance().fileName() == {project!r}")
        desktop.ask(
            "LAYERS = {one.name(): one for one in QgsProject.instance().mapLayers().values() if '/' in one.name()}"
        )
    desktop.ask("panel().show()")
    desktop.wait(f"not ({BUSY})")


def test_all_still_draws_after_hundreds_of_actions(start, blocks: list[str], tmp_path: Path) -> None:
    """No error, no dialog, no critical message, no layer or marker gone, no memory kept, nothing measured lost."""
    desktop = start()
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
        if (number + 1) % RUN_EVERY == 0:
            work_beside_the_panel(desktop, number // RUN_EVERY, blocks, tmp_path)
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
    assert desktop.ask("CRITICAL") == []
    desktop.press("a")
    desktop.wait(f"not ({BUSY}) and panel().session.changed")
    made = desktop.ask("sorted([*key, one.sample] for key, one in panel().session.measured.items())")
    desktop.kill()
    desktop = start()
    desktop.click("button_named('Recover')")
    desktop.wait(f"len(panel().session.measured) == {len(made)}")
    assert desktop.ask("sorted([*key, one.sample] for key, one in panel().session.measured.items())") == made
    assert leak_mb < LARGEST_LEAK_MB
