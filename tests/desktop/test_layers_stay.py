"""Layers stay on the map after runs in the background, also when the threads of these runs have ended."""

import shutil
import time
from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import run_in_dialog, show_block
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs
ENDED_S = 45.0  # Qt's pool ends a thread that was idle for 30 s
LEAST_SHARE = 0.95  # of the pixels of the first drawing
#: Statements for QGIS: a layer of the user's that needs a transformation, in a map with the CRS of web maps.
OWN = """
import processing
from qgis.core import QgsCoordinateReferenceSystem, QgsVectorLayer
from qgis.PyQt.QtCore import QThreadPool
iface.newProject(False)
QgsProject.instance().addMapLayer(QgsVectorLayer({path!r}, 'mine', 'delimitedtext'))
QgsProject.instance().setCrs(QgsCoordinateReferenceSystem('EPSG:3857'))
iface.mapCanvas().setParallelRenderingEnabled(True)
"""
LAYERS = "{layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}"
EXPECTED = {"mine", "images", "ground_points", "residuals_utm"} | {
    f"image_{number}_{state}" for number in (1, 2, 3) for state in ("before", "after")
}


def check_drawn(desktop: Desktop, before: dict[str, int], picture: str) -> None:
    """Wait until the threads of the runs have ended; all layers draw what they drew before."""
    time.sleep(ENDED_S)
    after = desktop.ask("seen(LAYERS)")
    print(picture, before, after)
    desktop.picture(picture)
    assert {name for name in before if after[name] < LEAST_SHARE * before[name]} == set()


def test_layers_stay_after_runs(desktop: Desktop, block: Path, tmp_path: Path) -> None:
    """After finished, failed and cancelled runs, with the panel opened and closed; a second project; a model."""
    points = block / "ground_points.csv"
    desktop.ask(OWN.format(path=f"{points.as_uri()}?xField=lon&yField=lat&crs=EPSG:4326"))
    given = {
        "IMAGES": [str(path) for path in sorted(block.glob("image_?.tif"))], "GCPS": str(points), "TIE_POINTS": "none",
        "IMAGE_POINTS": str(block / "image_points.csv"), "OUTPUT_DIR": str(tmp_path / "first"), "MODEL": "shift",
    }  # fmt: skip
    desktop.ask("QThreadPool.globalInstance().setExpiryTimeout(30000)")  # Qt's own: nothing of the plugin needs more
    run_in_dialog(desktop, "hrsi:triangulate", given)
    desktop.wait(f"len({LAYERS}) == {len(EXPECTED)}")
    before = desktop.ask(f"LAYERS = {LAYERS}\nresult = seen(LAYERS)")
    desktop.picture("first")
    assert set(before) == EXPECTED and all(before.values()), before
    run_in_dialog(desktop, "hrsi:triangulate", given | {"GCPS": str(tmp_path / "missing.csv")})
    run_in_dialog(desktop, "hrsi:simulate", {"SIZE": 6000, "OUTPUT_DIR": str(tmp_path / "other")}, cancel=True)
    show_block(desktop, block)
    desktop.ask("panel().hide()")
    check_drawn(desktop, before, "after_runs")
    # A second project; there a model, whose layers QGIS itself makes in the thread of the run
    desktop.ask("plugins['hrsi'].initGui.__globals__['keep_threads']()")
    project = tmp_path / "second.qgz"
    desktop.ask(f"QgsProject.instance().write({str(project)!r})\nEXTENTS.clear()\niface.newProject(False)")
    desktop.ask(f"later(lambda: iface.addProject({str(project)!r}))")
    desktop.wait(f"QgsProject.instance().fileName() == {str(project)!r} and len({LAYERS}) == {len(EXPECTED)}")
    for old, new in (("image_1.tif", "a.tif"), ("image_2.tif", "b.tif")):
        shutil.copy(block / old, tmp_path / new)
    measured = (block / "image_points.csv").read_text(encoding="utf-8").replace("image_1", "a").replace("image_2", "b")
    (tmp_path / "measured.csv").write_text(measured, encoding="utf-8")
    chain = {
        "IMAGES": [str(tmp_path / "a.tif"), str(tmp_path / "b.tif")], "GCPS": str(points), "DEM_DATUM": "ellipsoidal",
        "IMAGE_POINTS": str(tmp_path / "measured.csv"), "DEM": str(block / "dem.tif"),
        "orthorectify:FOLDER": str(tmp_path / "ortho"),
    }  # fmt: skip
    run_in_dialog(desktop, "hrsi:triangulatetoorthoimages", chain)
    desktop.wait(f"len({LAYERS}) > {len(EXPECTED)}")
    before = desktop.ask(f"LAYERS = {LAYERS}\nresult = seen(LAYERS)")
    assert all(before.values()), before
    check_drawn(desktop, before, "after_model")
