"""Pictures of HRSI: dialogs, map and first steps in the QGIS desktop, the panel "HRSI Points" in use, and a report.

``python docs/make_screenshots.py [FOLDER]`` starts QGIS on a virtual screen (xvfb) with a fresh profile and runs this
same file inside it, which writes ``qgis_*.png``, and once more with QGIS's dark theme: ``qgis_*_dark.png``; Chromium
writes ``report.png``, ``report_phone.png`` and ``report_dark.png``, which ``--reports`` makes alone. Without FOLDER all
go to ``build/pictures``, and those that the pages show to ``docs/pictures``. Dialog, map and reports show the Hobart
block, panel and the dark report a simulated one with a gross error.
"""

from __future__ import annotations

import csv
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

#: Environment variables: where pictures and temporary files go, and what is put to the pictures' names.
PICTURES, WORK, ENDING = "HRSI_PICTURES", "HRSI_PICTURES_WORK", "HRSI_PICTURES_ENDING"
THEMES = {"": "default", "_dark": "Night Mapping"}  #: of QGIS, by the ending of the pictures' names
SCREEN_PX = (1400, 960)
START_MS, SETTLE_MS = 3000, 2500
DESK_PX, PHONE_PX, DARK_PX = (1400, 1560), (390, 1560), (1400, 1100)
WRONG_POINT = "G000004"
GCP_IDS = "H003,H022,H024,H035,H048,H058,H077,H098,H103,H105"


def launch(pictures: Path) -> int:
    """Start QGIS on a virtual screen with a fresh profile; return its exit code."""
    repository = Path(__file__).resolve().parents[1]
    pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="hrsi-") as work:
        shutil.copytree(repository / "examples" / "hobart", Path(work) / "hobart")
        simulate_block(Path(work) / "simulated")
        status = 0
        for ending in THEMES:
            status = status or launch_qgis(Path(work), pictures, ending)
        return status or pictures_of_reports(Path(work) / "simulated", Path(work), pictures)


def launch_qgis(work: Path, pictures: Path, ending: str) -> int:
    """Run QGIS with a fresh profile and the theme of an ending; return its exit code."""
    profile = work / f"profile{ending}"
    environment = _module_of("profile_of_tests", Path("tests", "qgis", "profile.py")).make_profile(profile)
    with (profile / "profiles" / "default" / "QGIS" / "QGIS3.ini").open("a", encoding="utf-8") as settings:
        settings.write(f"[UI]\nUITheme={THEMES[ending]}\n[hrsi]\nfirst_steps_done=true\n")
    environment |= {PICTURES: str(pictures.resolve()), WORK: str(work), ENDING: ending}
    environment["CPL_LOG"] = str(work / "gdal.log")  # QGIS's own world map has dates that GDAL warns of
    del environment["QT_QPA_PLATFORM"]  # a real (virtual) screen, not Qt's offscreen one
    screen = ["xvfb-run", "-a", "-s", "-screen 0 {}x{}x24".format(*SCREEN_PX)]
    qgis = ["qgis", "--nologo", "--noversioncheck", "--profiles-path", str(profile), "--code", __file__]
    return subprocess.run([*screen, *qgis], env=environment, timeout=600, check=False).returncode


def launch_reports(pictures: Path) -> int:
    """Make the pictures of reports alone; return an exit code."""
    pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="hrsi-") as work:
        shutil.copytree(Path(__file__).resolve().parents[1] / "examples" / "hobart", Path(work) / "hobart")
        simulate_block(Path(work) / "simulated")
        return pictures_of_reports(Path(work) / "simulated", Path(work), pictures)


def simulate_block(folder: Path) -> None:
    """Make two images with points, one measurement of them wrong by 9 pixels, and a report of their adjustment."""
    from hrsi.processing_algorithms import run

    run("simulate", output_dir=str(folder), size=700, gcps=9, checks=5, ties=150, seed=6)
    table = folder / "image_points.csv"
    rows = list(csv.DictReader(table.open(encoding="utf-8", newline="")))
    wrong = next(row for row in rows if row["id"] == WRONG_POINT)
    wrong["sample"] = str(float(wrong["sample"]) + 9.0)
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    run(
        "triangulate", images=simulated_images(folder), gcps=str(folder / "ground_points.csv"),
        image_points=str(table), tie_points="none", model="auto", height_datum="ellipsoidal", write="none",
        output_dir=str(folder / "result"),
    )  # fmt: skip


def simulated_images(folder: Path) -> list[str]:
    return [str(folder / f"image_{number}.tif") for number in (1, 2)]


def pictures_of_reports(simulated: Path, work: Path, pictures: Path) -> int:
    """Have Chromium show the Hobart report on a desk and a phone, and the simulated one in the dark; return a code."""
    from hrsi.processing_algorithms import run

    driver = _module_of("browser", Path("tests", "browser.py"))
    if driver.chromium_program() is None:
        print("no pictures of reports: apt-get install chromium", file=sys.stderr)
        return 1
    hobart = work / "hobart"
    run(
        "triangulate", images=[str(hobart / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)],
        gcps=str(hobart / "hobart_ground_points.csv"), image_points=str(hobart / "hobart_image_points.csv"),
        height_datum="ellipsoidal", tie_points="none", gcp_ids=GCP_IDS.split(","), output_dir=str(work / "report"),
    )  # fmt: skip
    with driver.Browser(work / "web") as browser:
        choose = "document.querySelector(\"a[data-point='{}']\").click()"
        browser.open(work / "report" / "report.html", *DESK_PX)
        browser.value(choose.format("H106"))
        browser.value("document.querySelector('#zoom-all').click(); scrollTo(0, 0)")
        browser.picture(pictures / "report.png", whole=False)
        browser.open(work / "report" / "report.html", *PHONE_PX, phone=True)
        browser.picture(pictures / "report_phone.png", whole=False)
        browser.open(simulated / "result" / "report.html", *DARK_PX, dark=True)
        browser.value(choose.format(WRONG_POINT))
        browser.value("document.querySelector('#map').scrollIntoView()")
        browser.picture(pictures / "report_dark.png", whole=False)
    return 0


def _module_of(name: str, file: Path) -> Any:
    """Return a module of the tests."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).resolve().parents[1] / file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def hobart_parameters() -> dict[str, object]:
    """Return the parameters of the main job on the Hobart block."""
    data = Path(os.environ[WORK]) / "hobart"
    return {
        "IMAGES": [str(data / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)],
        "GCPS": str(data / "hobart_ground_points.csv"),
        "IMAGE_POINTS": str(data / "hobart_image_points.csv"),
        "TIE_POINTS": "none",
        "GCP_IDS": GCP_IDS,
        "MODEL": "shift",
        "OUTPUT_DIR": str(data / "result"),
        "OVERWRITE": True,
    }


sessions: list[Session] = []


class Session:
    """What happens inside QGIS, one step after another; each has a while to settle before the next."""

    def __init__(self) -> None:
        self.steps = iter((
            self.show_toolbox, self.show_dialog, self.save_dialog, self.run_and_zoom, self.save_map,
            self.show_extent, self.save_extent, self.show_first_steps, self.save_first_steps,
            self.show_panel, self.click, self.adjust, self.choose_point, self.save_panel,
            self.begin_tie, self.save_tie, self.show_new_block, self.save_new_block,
        ))  # fmt: skip
        self.dialog: Any = None
        self.tour: Any = None
        self.panel: Any = None

    def next_step(self) -> None:
        from qgis.PyQt.QtCore import QTimer

        step = next(self.steps, None)
        if step is None:
            os._exit(0)  # without QGIS's questions about unsaved projects
        try:
            step()
        except Exception:
            traceback.print_exc()
            os._exit(1)
        QTimer.singleShot(SETTLE_MS, self.next_step)

    def show_toolbox(self) -> None:
        from qgis.PyQt.QtWidgets import QDockWidget, QLineEdit
        from qgis.utils import iface

        window = iface.mainWindow()
        window.setGeometry(0, 0, *SCREEN_PX)  # the virtual screen has no window manager to maximise it
        toolbox = window.findChild(QDockWidget, "ProcessingToolbox")
        toolbox.setVisible(True)
        toolbox.findChild(QLineEdit).setText("hrsi")

    def show_dialog(self) -> None:
        import processing

        self.dialog = processing.createAlgorithmDialog("hrsi:triangulate", hobart_parameters())
        self.dialog.setGeometry(60, 60, 950, 880)
        self.dialog.show()

    def save_dialog(self) -> None:
        save_screen("qgis_dialog.png")
        self.dialog.close()

    def run_and_zoom(self) -> None:
        import processing
        from qgis.core import QgsProject
        from qgis.utils import iface

        processing.runAndLoadResults("hrsi:triangulate", hobart_parameters())
        layers = {layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}
        iface.setActiveLayer(layers["residuals_utm"])
        iface.zoomToActiveLayer()

    def save_map(self) -> None:
        from qgis.PyQt.QtWidgets import QApplication
        from qgis.utils import iface

        iface.mapCanvas().waitWhileRendering()  # names are drawn last
        QApplication.processEvents()
        save_screen("qgis_residuals.png")

    def show_extent(self) -> None:
        import processing

        self.dialog = processing.createAlgorithmDialog("hrsi:orthorectify", {})
        self.dialog.setGeometry(60, 60, 950, 880)
        self.dialog.show()

    def save_extent(self) -> None:
        save_screen("qgis_extent.png")
        self.dialog.close()

    def show_first_steps(self) -> None:
        from qgis.PyQt.QtWidgets import QDockWidget
        from qgis.utils import iface, plugins

        iface.newProject()
        for name in ("ProcessingToolbox", "Browser"):
            iface.mainWindow().findChild(QDockWidget, name).setVisible(False)
        self.tour, self.panel = plugins["hrsi"]._steps, plugins["hrsi"].dock
        self.tour.show()
        self.tour.move(SCREEN_PX[0] - 470, 130)
        self.tour.buttons[0].click()
        wait_until(lambda: self.tour.step() == 1)
        self.tour.buttons[1].click()

    def save_first_steps(self) -> None:
        self.wait_for_images()
        self.tour.raise_()
        save_screen("qgis_first_steps.png")
        self.tour.close()
        self.panel.discard_edits()

    def show_panel(self) -> None:
        from hrsi.processing_algorithms.point_session import files

        folder = Path(os.environ[WORK]) / "simulated"
        self.panel.show_session(
            files.new_session(
                simulated_images(folder), str(folder / "ground_points.csv"), str(folder / "image_points.csv"),
                height_datum="ellipsoidal",
            )
        )  # fmt: skip
        self.panel.setFloating(True)
        self.panel.setGeometry(20, 20, SCREEN_PX[0] - 40, SCREEN_PX[1] - 60)
        self.panel.show()
        self.panel.raise_()
        self.panel.choose("G000002")

    def click(self) -> None:
        for view in self.panel.ui.grid.list_views():
            made = self.panel.session.measured[("G000002", view.image())]
            self.panel.measure(view.image(), made.sample + 3.0, made.line - 2.0)

    def adjust(self) -> None:
        self.panel.ui.adjust.trigger()

    def choose_point(self) -> None:
        """Show the wrong point, and the fit at the place where the adjustment expects it."""
        from hrsi.processing_algorithms.point_session.targets import fit_target

        wait_until(lambda: not self.panel.adjustment.is_running())
        self.panel.choose(WRONG_POINT)
        for view in self.panel.ui.grid.list_views():
            expected = self.panel.session.predict_place(WRONG_POINT, view.image())
            fit = fit_target(self.panel.session.images[view.image()], expected, "center")
            view.chip.show_chip(fit.chip_svg)

    def save_panel(self) -> None:
        self.wait_for_images()
        save_screen("qgis_panel.png")

    def begin_tie(self) -> None:
        """Click beside the crossing of two roads: matching finds the place in the other image, and waits for Y or X."""
        view = self.panel.ui.grid.list_views()[0]
        self.panel.ui.kind.setCurrentText("point")
        self.panel.ui.tie.trigger()
        view.show_place((350.0, 350.0))
        self.panel.measure(view.image(), 350.0, 350.0)

    def save_tie(self) -> None:
        self.wait_for_images()
        save_screen("qgis_ties.png")

    def show_new_block(self) -> None:
        from hrsi.plugin.points_panel.dialogs import NewBlockDialog

        self.panel.discard_edits()
        self.panel.setVisible(False)
        self.dialog = NewBlockDialog()
        self.dialog.show()

    def save_new_block(self) -> None:
        self.dialog.grab().save(picture("qgis_new_block.png"))

    def wait_for_images(self) -> None:
        for view in self.panel.ui.grid.list_views():
            view.canvas.waitWhileRendering()


def wait_until(condition: Callable[[], bool]) -> None:
    """Let QGIS work until something is so."""
    from qgis.PyQt.QtWidgets import QApplication

    while not condition():
        QApplication.processEvents()
        time.sleep(0.02)


def save_screen(name: str) -> None:
    """Write a picture of the whole virtual screen."""
    from qgis.PyQt.QtWidgets import QApplication

    QApplication.primaryScreen().grabWindow(0).save(picture(name))


def picture(name: str) -> str:
    """Return where a picture goes, with the ending of the theme."""
    path = Path(os.environ[PICTURES]) / name
    return str(path.with_stem(path.stem + os.environ[ENDING]))


def start_session() -> None:
    """Begin once QGIS has come up."""
    from qgis.PyQt.QtCore import QTimer

    sessions.append(Session())  # a timer keeps no object alive
    QTimer.singleShot(START_MS, sessions[0].next_step)


if WORK in os.environ:
    start_session()
elif __name__ == "__main__":
    if "--reports" in sys.argv:
        sys.exit(launch_reports(Path(__file__).parent / "pictures"))
    if shutil.which("xvfb-run") is None:
        sys.exit("xvfb-run is not installed: apt-get install xvfb xauth")
    if len(sys.argv) > 1:
        sys.exit(launch(Path(sys.argv[1])))
    made, shown = Path(__file__).parents[1] / "build" / "pictures", Path(__file__).parent / "pictures"
    status = launch(made)
    for page_picture in () if status else shown.glob("*.png"):  # the others are there to be looked at
        if (made / page_picture.name).exists():  # `make_report_pictures.py` makes some
            shutil.copy(made / page_picture.name, page_picture)
    sys.exit(status)
