"""Fixtures of the tests in the real window: QGIS with the installed zip, and a simulated block of three images."""

import csv
import os
import shutil
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from hrsi.hrsi_engine.foundation.version import VERSION
from hrsi.plugin.dependencies import package_folder
from hrsi.processing_algorithms import run
from hrsi.tests.desktop.desktop import Desktop, build_zip

PICTURES = Path(__file__).resolve().parents[2] / "build" / "desktop"  #: of every step, to be looked at
BLOCK = {"images": 3, "size": 700, "gcps": 9, "checks": 3, "ties": 30, "seed": 5, "noise_image": 0.0}
COMPILED = f"\n[hrsi]\ncompiled_for={VERSION}\n"  #: settings with which the plugin compiles nothing at its start
RUN_S = 300.0  # of an algorithm, on cores that others keep busy
DIALOG = """
import processing
dialog = processing.createAlgorithmDialog({name!r}, {given})
dialog.setGeometry(150, 20, 1100, 900)
dialog.show()
"""


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A profile into which QGIS's plugin manager has installed the zip; no loop is compiled."""
    work = tmp_path_factory.mktemp("profile")
    with Desktop(work, build_zip(tmp_path_factory.mktemp("zip")), settings=COMPILED):
        pass
    return work


def link_packages(profile: Path) -> None:
    """Put the packages of this environment that matching needs into a profile, as the plugin installs them.

    By links to their files: OpenCV does not load from a folder that is a link itself.
    """
    folder = package_folder(str(profile))
    places = [Path(find_spec(name).origin).parent for name in ("cv2", "numba", "llvmlite")]
    places += places[0].parent.glob("opencv_python_headless.libs")
    for place in places:
        shutil.copytree(place, folder / place.name, copy_function=link_file)


def link_file(source: str, target: str) -> None:
    """Make a hard link, or a copy on another disk."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


@pytest.fixture
def start(installed: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Callable[..., Desktop]]:
    """Start QGIS with a copy of the profile, with packages for matching or without; after a kill: with the same one.

    ``compiles``: the plugin compiles the loops of matching, as at its first start; otherwise the first run does.
    """
    work, running = tmp_path / "qgis", []

    def begin(packages: bool = True, compiles: bool = False, **options: Any) -> Desktop:
        if not work.exists():
            shutil.copytree(installed, work)
            if packages:
                link_packages(work / "profiles" / "default")
        if compiles:
            file = work / "profiles" / "default" / "QGIS" / "QGIS3.ini"
            lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
            file.write_text("".join(line for line in lines if not line.startswith("compiled_for")), encoding="utf-8")
        else:
            options["settings"] = options.get("settings", "") + COMPILED
        running.append(Desktop(work, pictures=PICTURES / request.node.name, **options).__enter__())
        return running[-1]

    yield begin
    for desktop in running:
        desktop.__exit__()


@pytest.fixture
def desktop(start: Callable[..., Desktop]) -> Desktop:
    """A running QGIS."""
    return start()


@pytest.fixture(scope="session")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with images of discs whose middles are known exactly: ``image_points.csv`` has them without noise."""
    folder = tmp_path_factory.mktemp("simulated") / "block"
    run("simulate", output_dir=str(folder), **BLOCK)
    return folder


@pytest.fixture(scope="session")
def truth(block: Path) -> dict[tuple[str, str], tuple[float, float]]:
    """(sample, line) of the points by their and their images' names."""
    with (block / "image_points.csv").open(encoding="utf-8", newline="") as file:
        return {(row["id"], row["image"]): (float(row["sample"]), float(row["line"])) for row in csv.DictReader(file)}


def show_block(desktop: Desktop, block: Path, ground_points: str = "ground_points.csv") -> None:
    """Show the panel with the block's images and ground points, nothing measured, floating over the whole screen."""
    images = [str(path) for path in sorted(block.glob("image_?.tif"))]
    desktop.ask(
        "from hrsi.processing_algorithms.point_session import files\n"
        f"panel().show_session(files.new_session({images}, {str(block / ground_points)!r}))\n"
        "panel().show()"
    )
    desktop.wait("panel().ui.grid.views[0].isVisible() and not panel().ui.grid.views[0].canvas.isDrawing()")


def float_panel(desktop: Desktop) -> None:
    """Let the panel float over the whole screen."""
    width, height = desktop.screen.size_px
    desktop.ask(f"panel().setFloating(True), panel().setGeometry(0, 20, {width}, {height - 20})")
    desktop.ask("panel().activateWindow()")  # there is no window manager
    desktop.wait("not any(view.canvas.isDrawing() for view in panel().ui.grid.list_views())")


def run_in_dialog(desktop: Desktop, name: str, given: dict[str, object], cancel: bool = False) -> None:
    """Run an algorithm by the button of its dialog; with ``cancel``, end it by the other button."""
    desktop.ask(DIALOG.format(name=name, given=given))
    desktop.wait("dialog.runButton().isVisible()")
    desktop.click("middle_of(dialog.runButton())")
    desktop.wait("not dialog.runButton().isEnabled() or dialog.findChild(QWidget, 'txtLog').toPlainText()")
    if cancel:
        desktop.wait("dialog.cancelButton().isEnabled()")
        desktop.click("middle_of(dialog.cancelButton())")
    desktop.wait("dialog.runButton().isEnabled()", RUN_S)
    desktop.ask("dialog.close()")
