"""The dialog that begins a block: images and, where there are such, ground and image points."""

from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProject, QgsRasterLayer
from qgis.gui import QgsFileWidget, QgsProjectionSelectionWidget
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QHBoxLayout,
    QMenu,
    QToolButton,
    QWidget,
)

from ..layer_or_file import LayerOrFile
from ..layer_sources import point_source, raster_source
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
        self.layers = self._layers_button()
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
        images = QHBoxLayout()
        images.addWidget(self.images, 1)
        images.addWidget(self.layers)
        form.addRow(tr("Images or RPC files"), images)
        form.addRow(tr("Ground points"), self.gcps.widget)
        form.addRow(tr("Image points (optional)"), self.image_points.widget)
        form.addRow(tr("CRS, where the points name none"), self.crs)
        form.addRow(tr("Heights refer to"), self.datum)
        form.addWidget(box)
        self.resize(720, self.sizeHint().height())  # file names are long

    def _layers_button(self) -> QToolButton:
        """Return a button with the project's rasters; what is chosen joins the images."""
        button = QToolButton(self)
        button.setText(tr("Layers"))
        button.setToolTip(tr("Add raster layers of the project"))
        button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        layers = [one for one in QgsProject.instance().mapLayers().values() if isinstance(one, QgsRasterLayer)]
        layers = sorted((one for one in layers if one.providerType() == "gdal"), key=lambda one: one.name().lower())
        menu = QMenu(button)
        for title, chosen in ((tr("All"), layers), *((layer.name(), [layer]) for layer in layers)):
            ids = [layer.id() for layer in chosen]
            menu.addAction(title).triggered.connect(lambda _checked=False, ids=ids: self._add_layers(ids))
        button.setMenu(menu)
        button.setEnabled(bool(layers))
        return button

    def _add_layers(self, ids: list[str]) -> None:
        context = QgsProcessingContext()
        context.setProject(QgsProject.instance())
        named = QgsFileWidget.splitFilePaths(self.images.filePath()) if self.images.filePath() else []
        paths = dict.fromkeys([*named, *(raster_source(name, context) for name in ids)])  # each once, in order
        self.images.setFilePath(" ".join(f'"{path}"' for path in paths))

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
