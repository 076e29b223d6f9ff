"""The dialog that begins a block: images and, where there are such, ground and image points."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProject
from qgis.gui import QgsFileWidget, QgsProjectionSelectionWidget
from qgis.PyQt.QtWidgets import QComboBox, QDialog, QDialogButtonBox, QFormLayout, QWidget

from ..layer_or_file import LayerOrFile
from ..layer_sources import point_source
from ..translation import tr

HEIGHT_DATUMS = ("layer", "ellipsoidal", "egm96", "egm2008")


class NewBlockDialog(QDialog):
    """Asks for images and points; ``sources`` are the arguments of `files.new_session`."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("New block of images"))
        self.images = QgsFileWidget()
        self.images.setStorageMode(QgsFileWidget.StorageMode.GetMultipleFiles)
        self.images.setFilter(f"{tr('Images and RPC files')} (*)")
        self.gcps, self.image_points = LayerOrFile(), LayerOrFile()
        self.crs = QgsProjectionSelectionWidget()
        self.crs.setOptionVisible(QgsProjectionSelectionWidget.CrsOption.CrsNotSet, True)
        self.datum = QComboBox()
        self.datum.setEditable(True)
        self.datum.addItems(HEIGHT_DATUMS)
        box = QDialogButtonBox(QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel)
        box.accepted.connect(self.accept)
        box.rejected.connect(self.reject)
        form = QFormLayout(self)
        form.addRow(tr("Images or RPC files"), self.images)
        form.addRow(tr("Ground points"), self.gcps.widget)
        form.addRow(tr("Image points (optional)"), self.image_points.widget)
        form.addRow(tr("CRS, where the points name none"), self.crs)
        form.addRow(tr("Heights refer to"), self.datum)
        form.addWidget(box)
        self.resize(560, self.sizeHint().height())

    def sources(self) -> dict[str, Any]:
        """Return what was chosen; layers that are more than their file are copied."""
        context = QgsProcessingContext()
        context.setProject(QgsProject.instance())
        feedback = QgsProcessingFeedback()
        points = {
            key: point_source(field.value(), key, context, feedback) if field.value() else ""
            for key, field in (("gcps", self.gcps), ("image_points", self.image_points))
        }
        crs = self.crs.crs()
        return {
            "images": QgsFileWidget.splitFilePaths(self.images.filePath()), **points,
            "ground_crs": crs.toWkt() if crs.isValid() else None, "height_datum": self.datum.currentText(),
        }  # fmt: skip
