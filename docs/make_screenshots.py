"""Pictures of HRSI in the QGIS desktop: toolbox, dialog and the residuals of the Hobart block on the map.

``python docs/make_screenshots.py [FOLDER]`` starts QGIS on a virtual screen (xvfb) with a fresh profile and runs this
same file inside it, which writes ``qgis_dialog.png`` and ``qgis_residuals.png``.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

PICTURES, WORK = "HRSI_PICTURES", "HRSI_PICTURES_WORK"  # environment variables: where pictures and temporary files go
SCREEN_PX = (1400, 960)
START_MS, SETTLE_MS = 3000, 2500
GCP_IDS = "H003,H022,H024,H035,H048,H058,H077,H098,H103,H105"


def launch(pictures: Path) -> int:
    """Start QGIS on a virtual screen with a fresh profile; return its exit code."""
    repository = Path(__file__).resolve().parents[1]
    pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="hrsi-") as work:
        profile = Path(work) / "profile"
        shutil.copytree(repository / "examples" / "hobart", Path(work) / "hobart")
        environment = _profile_module(repository).make_profile(profile)
        environment |= {PICTURES: str(pictures.resolve()), WORK: work}
        del environment["QT_QPA_PLATFORM"]  # a real (virtual) screen, not Qt's offscreen one
        screen = ["xvfb-run", "-a", "-s", "-screen 0 {}x{}x24".format(*SCREEN_PX)]
        qgis = ["qgis", "--nologo", "--noversioncheck", "--profiles-path", str(profile), "--code", __file__]
        return subprocess.run([*screen, *qgis], env=environment, timeout=180, check=False).returncode


def _profile_module(repository: Path) -> Any:
    spec = importlib.util.spec_from_file_location("profile_of_tests", repository / "tests" / "qgis" / "profile.py")
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
    }


class Session:
    """What happens inside QGIS, one step after another; each has a while to settle before the next."""

    def __init__(self) -> None:
        self.steps = iter((self.show_toolbox, self.show_dialog, self.save_dialog, self.run_and_zoom, self.save_map))
        self.dialog: Any = None

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
        save_screen("qgis_residuals.png")


def save_screen(name: str) -> None:
    """Write a picture of the whole virtual screen."""
    from qgis.PyQt.QtWidgets import QApplication

    QApplication.primaryScreen().grabWindow(0).save(str(Path(os.environ[PICTURES]) / name))


def start_session() -> None:
    """Begin once QGIS has come up."""
    from qgis.PyQt.QtCore import QTimer

    QTimer.singleShot(START_MS, Session().next_step)


if WORK in os.environ:
    start_session()
elif __name__ == "__main__":
    if shutil.which("xvfb-run") is None:
        sys.exit("xvfb-run is not installed: apt-get install xvfb xauth")
    sys.exit(launch(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"))
