"""The tour at the first start: an example block is measured and adjusted, and its residuals are shown on the map.

The example is simulated in a second or two: no download is needed, and its images have pixels to measure in.
"""

import math
from functools import partial
from pathlib import Path
from typing import Any

from qgis.core import QgsApplication, QgsCoordinateTransform, QgsProject, QgsSettings, QgsVectorLayer
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtWidgets import QDialog, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from ..processing_algorithms import point_session, run
from .background_task import BackgroundTask
from .package_offer import offer_packages
from .points_panel.dock import PointsDock
from .translation import tr

SKIPPED_FOR_EVER = "hrsi/first_steps_done"  #: setting: the user does not want the tour again
IMAGES = 3
EXAMPLE: dict[str, Any] = {
    "images": IMAGES,
    "along": "-12,0,12",
    "size": 500,
    "gcps": 6,
    "checks": 12,
    "ties": 40,
    "relief": 40.0,
    "seed": 5,
}
SHOWN_LAYERS = ("images", "residuals_utm")  # from bottom to top

#: Text of each step, and label of its button.
STEPS = (
    (
        "1. Load the example: three simulated satellite images, six GCPs and twelve check points. "
        "One GCP is not measured on one image yet.",
        "Load the example",
    ),
    (
        "2. Measure it: the framed view shows where the camera puts the GCP (blue ring). Click near the disc; "
        "its centre is found to a few hundredths of a pixel.",
        "Show me the point",
    ),
    (
        "3. Adjust: the cameras of all images are refined at once. The verdict shows whether the result can be used.",
        "Adjust",
    ),
    (
        "4. Look at the residuals: the block is saved, and residual arrows are shown on the map, in red where a point "
        "does not fit.",
        "Show the arrows",
    ),
)


class FirstSteps(QDialog):
    """Four steps with a button each; the main window can be used at the same time."""

    def __init__(self, dock: PointsDock, folder: str = "", canvas: Any = None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("HRSI: first steps"))
        self.setModal(False)
        self._dock, self._canvas = dock, canvas
        self.folder = Path(folder or Path(QgsApplication.qgisSettingsDirPath()) / "hrsi" / "example")
        self.missing: tuple[str, str] = ("", "")  # GCP and image to be measured
        self._task: BackgroundTask | None = None
        layout = QVBoxLayout(self)
        self.texts, self.buttons = [], []
        for (text, button), act in zip(STEPS, (self.load, self.show_point, self.adjust, self.show_arrows), strict=True):
            label, does_it = QLabel(tr(text)), QPushButton(tr(button))
            label.setWordWrap(True)
            does_it.clicked.connect(lambda _checked=False, act=act: act())
            layout.addWidget(label)
            layout.addWidget(does_it, 0, Qt.AlignmentFlag.AlignRight)
            self.texts.append(label)
            self.buttons.append(does_it)
        self.note = QLabel()
        self.note.setWordWrap(True)
        layout.addWidget(self.note)
        self.skip, self.later = QPushButton(tr("Do not show this again")), QPushButton(tr("Close"))
        self.skip.clicked.connect(lambda _checked=False: QgsSettings().setValue(SKIPPED_FOR_EVER, True))
        self.skip.clicked.connect(lambda _checked=False: self.close())
        self.later.clicked.connect(lambda _checked=False: self.close())
        ends = QHBoxLayout()
        for widget in (self.skip, self.later):
            ends.addWidget(widget)
        layout.addLayout(ends)
        self.resize(430, self.sizeHint().height())
        dock.edited.connect(self.refresh)
        dock.adjusted.connect(lambda _well: self.refresh())
        self.refresh()

    def show_in_front(self) -> None:
        """Show the window in front of the others, at the lower left: over the tables of the panel, not its images."""
        self.show()
        free = self.screen().availableGeometry()
        self.move(free.left(), free.bottom() - self.frameGeometry().height())
        self.raise_()
        self.activateWindow()

    def tell(self, text: str) -> None:
        """Show a message below the steps."""
        self.note.setText(text)

    def step(self) -> int:
        """Return the number of the next step."""
        session = self._dock.session
        if not self.missing[0] or self.missing[0] not in session.points:
            return 0
        if self.missing not in session.measured:
            return 1
        return 2 if session.adjusted is None else 3

    def refresh(self) -> None:
        """Enable the next step and those before it."""
        for number, (text, button) in enumerate(zip(self.texts, self.buttons, strict=True)):
            button.setEnabled(number <= self.step() and self._task is None)
            font = text.font()
            font.setBold(number == self.step())
            text.setFont(font)

    def load(self) -> None:
        """Simulate the example in the background, and open it in the panel."""
        if not self._dock.files.may_leave():
            return
        offer_packages()  # the second step needs them
        self.tell(tr("making the images …"))
        simulate = partial(run, "simulate", output_dir=str(self.folder), overwrite=True, **EXAMPLE)
        title = tr("HRSI: making the example")
        self._task = BackgroundTask(title, lambda progress: simulate(progress=progress), self._on_simulation_end)
        self.refresh()
        self._task.start()

    def _on_simulation_end(self, task: BackgroundTask) -> None:
        self._task = None
        if task.is_done:
            images = [str(self.folder / f"image_{number}.tif") for number in range(1, IMAGES + 1)]
            points = (str(self.folder / f"{kind}_points.csv") for kind in ("ground", "image"))
            session = point_session.new_session(images, *points)
            gcps = {name for name, point in session.points.items() if point.role == "gcp"}
            self.missing = next(key for key in session.measured if key[0] in gcps)
            del session.measured[self.missing]  # not an edit
            self._dock.show_session(session, self.missing[0])
            self._dock.show()
            self.show_in_front()
        self.tell("" if task.is_done else task.failure or tr("cancelled"))
        self.refresh()

    def show_point(self) -> None:
        """Show the GCP at its predicted position."""
        self._dock.show()
        self.show_in_front()
        self._dock.choose(self.missing[0])
        self._dock.ui.grid.frame_image(self.missing[1])
        self.tell(tr("Click in the framed view of {}").format(self.missing[1]))

    def adjust(self) -> None:
        """Adjust, as the button of the panel does."""
        self.tell("")
        self._dock.adjust()

    def show_arrows(self) -> None:
        """Save the block, and load its residual layers; the panel is hidden, so that the map is seen."""
        self._dock.hide()
        path = str(self.folder / "block.gpkg")
        self._dock.files.save_as(path)
        project = QgsProject.instance()
        for name in SHOWN_LAYERS:
            layer = QgsVectorLayer(f"{path}|layername={name}", name, "ogr")
            if layer.isValid():
                layer.loadDefaultStyle()
                project.addMapLayer(layer)
        if self._canvas is not None and layer.isValid() and not math.isnan(layer.extent().width()):
            of_map = self._canvas.mapSettings().destinationCrs()
            extent = QgsCoordinateTransform(layer.crs(), of_map, project).transformBoundingBox(layer.extent())
            extent.scale(1.3)
            self._canvas.setExtent(extent)
            self._canvas.refresh()
        self.tell(
            tr(
                "This was the last step. Use New… in the panel for your own block, and the toolbox for all other "
                "algorithms."
            )
        )


def is_tour_wanted() -> bool:
    """Return False if the user has chosen not to see the tour again."""
    return not QgsSettings().value(SKIPPED_FOR_EVER, False, type=bool)
