"""The dialogs and the model of the Processing toolbox, and the documented command, as a user meets them."""

import os
import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from hrsi.tests.desktop.conftest import link_packages
from hrsi.tests.desktop.desktop import SYSTEM_PATH, Desktop

pytestmark = pytest.mark.programs
MODEL = "hrsi:triangulatetoorthoimages"
ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "how-to" / "qgis.md"
ANSWER_S = 10.0  # a step of the chain takes longer
CHAIN_S, LOAD_S = 900.0, 90.0  # on cores that others keep busy


@pytest.fixture(scope="module")
def named(block: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the documented command: images ``a`` and ``b``, GCPs, measurements and a DEM."""
    folder = tmp_path_factory.mktemp("named")
    for old, new in (("image_1.tif", "a.tif"), ("image_2.tif", "b.tif"), ("ground_points.csv", "gcps.csv"),
                     ("dem.tif", "dem.tif")):  # fmt: skip
        shutil.copy(block / old, folder / new)
    rows = (block / "image_points.csv").read_text(encoding="utf-8")
    (folder / "measured.csv").write_text(rows.replace("image_1", "a").replace("image_2", "b"), encoding="utf-8")
    return folder


def test_documented_command_works_as_typed(installed: Path, named: Path, tmp_path: Path) -> None:
    """Its outputs are rasters, too."""
    (command,) = re.findall(r"```sh\n(qgis_process.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    shutil.copytree(installed, tmp_path / "qgis")
    link_packages(tmp_path / "qgis" / "profiles" / "default")  # matching needs them
    environment = {"PATH": SYSTEM_PATH, "QGIS_CUSTOM_CONFIG_PATH": str(tmp_path / "qgis"), "HOME": os.environ["HOME"]}
    environment |= {"QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": str(tmp_path / "qgis" / "runtime")}
    ran = subprocess.run(
        ["bash", "-c", command], cwd=named, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert ran.returncode == 0, ran.stdout[-3000:] + ran.stderr[-2000:]
    line = next(line for line in ran.stdout.splitlines() if line.startswith("ORTHOIMAGES:"))
    made = re.findall(r"/[^ ,]+_ortho\.tif", line)
    assert made == [str(named.resolve() / "ortho" / f"{name}_ortho.tif") for name in ("a", "b")]


def test_model_in_its_dialog(desktop: Desktop, named: Path, tmp_path: Path) -> None:
    """From the toolbox: a title, labelled outputs; after one click on Run the window lives, then has the rasters."""
    desktop.ask("iface.mainWindow().findChild(QWidget, 'ProcessingToolbox').show()")
    box = "iface.mainWindow().findChild(QWidget, 'ProcessingToolbox')"
    desktop.wait(f"{box}.searchBox.isVisible()")
    desktop.click(f"middle_of({box}.searchBox)")
    desktop.write("orthoimages")
    tree = f"{box}.algorithmTree"
    find = (
        f"[index for index in {tree}.model().match({tree}.model().index(0, 0), 0, 'Triangulate to orthoimages', 1, "
        "Qt.MatchRecursive | Qt.MatchExactly)]"
    )
    desktop.ask("from qgis.PyQt.QtCore import Qt")
    desktop.wait(f"len({find})")
    desktop.click(
        f"[(place := {tree}.viewport().mapToGlobal({tree}.visualRect({find}[0]).center())).x(), place.y()]", times=2
    )
    desktop.wait("any('Triangulate to orthoimages' in title for title in windows())", LOAD_S)
    desktop.ask(
        "dialog = next(one for one in QApplication.topLevelWidgets()"
        " if one.isVisible() and one.windowTitle().endswith('Triangulate to orthoimages'))\n"
        "dialog.setGeometry(150, 20, 1100, 900)"
    )
    inputs = {"IMAGES": [str(named / "a.tif"), str(named / "b.tif")], "GCPS": str(named / "gcps.csv"),
              "IMAGE_POINTS": str(named / "measured.csv"), "DEM": str(named / "dem.tif"), "DEM_DATUM": "ellipsoidal",
              "orthorectify:FOLDER": str(tmp_path / "ortho")}  # fmt: skip
    desktop.ask(f"dialog.setParameters({inputs})")
    desktop.picture("model")
    shown = desktop.ask("[one.text() for one in dialog.findChildren(QLabel) if one.isVisible()]")
    for label in ("Images with RPC", "Folder of the triangulation", "Folder of the orthoimages"):
        assert any(text.startswith(label) for text in shown), shown
    desktop.click("middle_of(dialog.runButton())")  # in the background: the window answers while it works
    end = time.monotonic() + CHAIN_S
    slowest = 0.0
    desktop.wait("not dialog.runButton().isEnabled()", LOAD_S)
    while not desktop.ask("dialog.runButton().isEnabled()"):
        began = time.monotonic()
        assert began < end, desktop.picture("model_hangs")
        desktop.ask("None")
        slowest = max(slowest, time.monotonic() - began)
        time.sleep(0.5)
    print(f"slowest answer while the chain ran: {slowest:.2f} s")
    desktop.picture("model_done")
    assert slowest < ANSWER_S
    made = sorted(str(path) for path in (tmp_path / "ortho").glob("*_ortho.tif"))
    assert [Path(path).name for path in made] == ["a_ortho.tif", "b_ortho.tif"]
    assert desktop.ask("dialog.results()")["ORTHOIMAGES"] == made
    layers = "QgsProject.instance().mapLayers().values()"
    rasters = desktop.ask(f"sorted([one.source(), one.isValid()] for one in {layers} if one.type() == one.RasterLayer)")
    assert all(is_valid for _, is_valid in rasters)
    # The surface model is in a temporary folder
    shown = [Path(path).name for path, _ in rasters]
    assert sorted(shown) == ["a_ortho.tif", "b_ortho.tif", "mosaic.tif", "surface.tif"]
    names = desktop.ask(f"[one.name() for one in {layers}]")
    assert {"ground_points", "images", "residuals_utm", "misregistration_utm", "seamlines"} <= set(names)


def test_long_dialog_has_groups(desktop: Desktop) -> None:
    """Few parameters at once, all others in groups with titles that open."""
    desktop.ask("import processing\ndialog = processing.createAlgorithmDialog('hrsi:triangulate', {})\ndialog.show()")
    desktop.ask("dialog.setGeometry(150, 20, 1100, 950)")
    desktop.picture("triangulate")
    desktop.ask(
        "from qgis.gui import QgsCollapsibleGroupBoxBasic as Box\nfrom qgis.PyQt import sip\n"
        "from qgis.PyQt.QtWidgets import QGroupBox\n"
        "advanced = sip.cast(dialog.findChild(QGroupBox, 'grpAdvanced'), Box)\n"
        "advanced.setCollapsed(False)\n"
        "boxes = [sip.cast(one, Box) for one in advanced.findChildren(QGroupBox)]\n"
        "panel = dialog.mainWidget()\n"
        "fields = {name: one.wrappedWidget() for name, one in panel.wrappers.items()}\n"
        "def loose(name):\n"
        "    return advanced.isAncestorOf(fields[name]) and not any(box.isAncestorOf(fields[name]) for box in boxes)"
    )
    titles = desktop.ask("[box.title() for box in boxes]")
    print(len(titles), "groups:", titles)
    desktop.picture("triangulate_groups")
    assert len(titles) >= 8
    assert desktop.ask("[name for name in fields if loose(name)]") == ["HOLD_OUT"]  # it belongs to no group
    assert len(desktop.ask("[name for name, one in fields.items() if not advanced.isAncestorOf(one)]")) <= 14
    desktop.ask("boxes[0].setCollapsed(False)")
    desktop.picture("triangulate_open")
    rpc = "/data/scene_RPC.TXT"
    command = desktop.ask(f"dialog.algorithm().asPythonCommand({{'IMAGES': [{rpc!r}]}}, panel.processing_context)")
    assert rpc in command  # what the history keeps
