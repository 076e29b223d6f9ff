"""A session of work in the real window: everything still draws, memory is as before, and nothing measured is lost.

The map shows the layers of three adjusted blocks. Actions are real clicks, keys and turns of the wheel in the panel
that shows one of them, with saving, which replaces the file under these layers, and changes of the block in between.
Five algorithms run in their dialogs, one of them is cancelled, and another project is opened and left again. At the
end QGIS is killed with unsaved measurements, which are recovered.

The variable ``HRSI_SESSION_MINUTES`` spreads the complete session over this time, as `make test-session` does with 45;
without it a shorter one runs without pauses.
"""

import os
import random
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from hrsi.processing_algorithms import run
from hrsi.tests.desktop.conftest import float_panel, run_in_dialog
from hrsi.tests.desktop.desktop import Desktop
from hrsi.tests.desktop.test_layers_stay import ENDED_S

pytestmark = pytest.mark.programs
MINUTES = float(os.environ.get("HRSI_SESSION_MINUTES", "0"))
ACTIONS, SEED = (320 if MINUTES else 90), 17
WARM_UP = 120 if MINUTES else 60  # actions in which every algorithm runs for the first time, and caches fill
FIRST_RUNS, RUN_EVERY = (10, 20, 30, 40, 50), 50  # actions after which an algorithm runs
LEAST_SHARE = 0.8  # of the pixels that a layer drew at the beginning: points move and change colour
LARGEST_LEAK_MB = 0.1  # an action: 5000 of a long day are 0.5 GB
LEAST_MEASURED = 40  # points in images, of a complete session
#: Variables of QGIS: without freed memory that is kept for later, and the pixels of images that GDAL keeps.
MEMORY = {"GDAL_CACHEMAX": "64", "MALLOC_ARENA_MAX": "2", "MALLOC_TRIM_THRESHOLD_": "131072"}
WHEEL = {"up": 4, "down": 5}  # buttons of X
KEYS = {  # how often of each: mostly measuring
    "n": 8, "p": 4, "a": 4, "Delete": 3, "Ctrl+z": 6, "Ctrl+Shift+z": 4, "m": 2, "y": 3, "Shift+y": 3, "x": 2,
    "F5": 3, "Ctrl+s": 3,
}  # fmt: skip
OTHERS = {"click": 30, "up": 3, "down": 3, "image": 4, "number": 3, "row": 5, "tab": 3, "block": 3, "hide": 2}
LAYERS = "images", "ground_points", "image_points"
#: Statements for QGIS: all layers of the blocks, and what each draws alone at its own extent.
LOAD = """
from qgis.PyQt.QtCore import QThreadPool
from qgis.core import QgsVectorLayer
QThreadPool.globalInstance().setExpiryTimeout(30000)
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
REMOVE_RESULTS = (
    "QgsProject.instance().removeMapLayers([key for key, one in QgsProject.instance().mapLayers().items() "
    "if one.name() not in LAYERS])"
)
MEASURED = "sorted([*key, one.sample] for key, one in panel().session.measured.items())"


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


class Operator:
    """Works in the panel and beside it, at random, and counts what was done.

    done : the actions in their order; counts : measurements, blocks opened, algorithms, projects
    """

    def __init__(self, desktop: Desktop, blocks: list[str], folder: Path) -> None:
        self.desktop, self.blocks, self.folder = desktop, blocks, folder
        self.chance, self.done, self.counts = random.Random(SEED), list[str](), Counter[str]()

    def act(self) -> None:
        """Do one thing in the panel as a user does it, and wait for its end."""
        weights = KEYS | OTHERS
        (what,) = self.chance.choices(list(weights), list(weights.values()))
        self.done.append(what)
        before = self.desktop.ask(MEASURED)
        self._do(what)
        self.desktop.wait(f"not ({BUSY})")
        assert self.desktop.ask("QApplication.activeModalWidget() is None"), "a dialog asks for something"
        if what in ("click", "a", "y", "Shift+y"):
            self.counts["measurements"] += sum(one not in before for one in self.desktop.ask(MEASURED))

    def _do(self, what: str) -> None:
        desktop, chance = self.desktop, self.chance
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
            path = chance.choice(self.blocks)
            desktop.ask(f"panel().files.open({path!r})")
            self.counts[f"open {path}"] += 1
        else:
            desktop.ask("panel().hide(), panel().show()")

    def run_algorithm(self) -> None:
        """Run the next of five algorithms, and after each second one open another project and return.

        The layers of the run before are removed first: what a project shows is no leak.
        """
        desktop, number = self.desktop, self.counts["algorithms"]
        self.counts["algorithms"] += 1
        desktop.ask(REMOVE_RESULTS)
        source = Path(self.blocks[number % len(self.blocks)]).parents[1]
        images = [str(path) for path in sorted(source.glob("image_?.tif"))]
        points = {"GCPS": str(source / "ground_points.csv"), "IMAGE_POINTS": str(source / "image_points.csv")}
        given = {
            "hrsi:adjust": {"IMAGES": images, **points}, "hrsi:rpcinfo": {"IMAGES": images},
            "hrsi:triangulate": {"IMAGES": images, "TIE_POINTS": "none", **points},
            "hrsi:project": {"IMAGES": images[:1], "POINTS": points["GCPS"]},
            "hrsi:simulate": {"SIZE": 6000},
        }  # fmt: skip
        name = list(given)[number % len(given)]
        output = {"OUTPUT_DIR": str(self.folder / f"run_{number}")}
        desktop.ask("panel().hide()")
        run_in_dialog(desktop, name, given[name] | output, cancel=name == "hrsi:simulate")
        if number % 2:
            project = str(self.folder / "kept.qgz")
            desktop.ask(f"QgsProject.instance().write({project!r})")
            desktop.ask("later(lambda: iface.newProject(False))")
            desktop.wait("QgsProject.instance().fileName() == ''")
            desktop.ask(f"later(lambda: iface.addProject({project!r}))")
            desktop.wait(f"QgsProject.instance().fileName() == {project!r}")
            desktop.ask(
                "LAYERS = {one.name(): one for one in QgsProject.instance().mapLayers().values() if '/' in one.name()}"
            )
            self.counts["projects"] += 1
        desktop.ask("panel().show()")
        desktop.wait(f"not ({BUSY})")


def read_memory_mb(desktop: Desktop) -> float:
    """Return what QGIS keeps in memory."""
    return int(Path(f"/proc/{desktop.process.pid}/statm").read_text(encoding="ascii").split()[1]) / 256.0


def work(operator: Operator) -> float:
    """Do all actions, spread over the session; return the growth of the memory, MB an action after the warm-up.

    Single values differ by 100 MB, as after an algorithm: medians of many actions are compared.
    """
    desktop, began_s, memory_mb = operator.desktop, time.monotonic(), list[float]()
    for number in range(1, ACTIONS + 1):
        try:
            operator.act()
            if number in FIRST_RUNS or number % RUN_EVERY == 0:
                operator.run_algorithm()
        except BaseException:
            desktop.picture("failed")
            print("actions so far:", operator.done)
            raise
        memory_mb.append(read_memory_mb(desktop))
        if number % 40 == 0:
            desktop.picture(f"after_{number}")
            print(f"after {number} actions: {memory_mb[-1]:.0f} MB", flush=True)
        time.sleep(max(0.0, began_s + 60.0 * MINUTES * number / ACTIONS - time.monotonic()))
    half = (ACTIONS - WARM_UP) // 2
    return float(np.median(memory_mb[-half:]) - np.median(memory_mb[WARM_UP : WARM_UP + half])) / half


def test_session_of_work(start, blocks: list[str], tmp_path: Path) -> None:
    """No error, no dialog, no critical message, no layer or marker gone, no memory kept, nothing measured lost."""
    began_s, desktop = time.monotonic(), start(**MEMORY)
    desktop.ask(LOAD % (blocks, LAYERS))
    before = desktop.ask("seen(LAYERS)")
    assert all(before.values()), before
    desktop.ask(f"panel().show(), panel().files.open({blocks[0]!r})")
    desktop.wait("len(panel().session.images)")
    float_panel(desktop)
    desktop.wait(f"not ({BUSY})")
    operator = Operator(desktop, blocks, tmp_path)
    leak_mb = work(operator)
    counts = operator.counts
    opened = sum(name.startswith("open ") for name in counts) + (f"open {blocks[0]}" not in counts)
    print(
        f"{(time.monotonic() - began_s) / 60.0:.1f} min, {ACTIONS} actions, {counts['measurements']} measurements, "
        f"{opened} blocks, {counts['algorithms']} runs of 5 algorithms, {counts['projects']} changes of the project, "
        f"QGIS used {desktop.cpu_s():.0f} CPU s: {leak_mb:.3f} MB an action stay; pixels of layers before and after:"
    )
    time.sleep(ENDED_S)
    after = desktop.ask("seen(LAYERS)")
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
    )
    assert desktop.ask("all(one != other for one, other in zip(with_markers, without))"), "markers are gone"
    assert desktop.ask("CRITICAL") == []
    desktop.press("a")
    desktop.wait(f"not ({BUSY}) and panel().session.changed")
    measured = desktop.ask(MEASURED)
    desktop.kill()
    desktop = start()
    desktop.click("button_named('Recover')")
    desktop.wait(f"len(panel().session.measured) == {len(measured)}")
    assert desktop.ask(MEASURED) == measured
    if MINUTES:
        assert counts["measurements"] >= LEAST_MEASURED and opened == len(blocks) and counts["projects"] >= 2
        assert leak_mb < LARGEST_LEAK_MB
