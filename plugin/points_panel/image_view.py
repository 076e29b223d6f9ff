"""One image in a map canvas of its own, in pixel coordinates: map x is the sample, map y minus the line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from qgis.core import (
    QgsContrastEnhancement,
    QgsCoordinateReferenceSystem,
    QgsPointXY,
    QgsRasterLayer,
    QgsRectangle,
    QgsSingleBandGrayRenderer,
)
from qgis.gui import QgsMapCanvas, QgsMapToolEmitPoint
from qgis.PyQt.QtCore import Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QComboBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from .chip_label import ChipLabel
from .markers import Marker, PointMarkers

if TYPE_CHECKING:
    from ...processing_algorithms.point_session.views import View

HALF_VIEW_PX = 60.0  # image pixels around the predicted position
STRETCH = QgsContrastEnhancement.ContrastEnhancementAlgorithm.StretchToMinimumMaximum


class ImageView(QWidget):
    """A chooser for the image, its canvas with the points, and the chip of the last fit."""

    clicked = pyqtSignal(str, float, float)  #: image id, sample, line
    image_chosen = pyqtSignal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.chooser, self.note, self.chip = QComboBox(), QLabel(), ChipLabel()
        self.canvas = QgsMapCanvas(self)
        self.canvas.setCanvasColor(Qt.GlobalColor.black)
        self.canvas.setDestinationCrs(QgsCoordinateReferenceSystem())
        self.canvas.setMinimumSize(220, 200)
        self.canvas.enableAntiAliasing(True)
        self.markers = PointMarkers(self.canvas)
        self._tool = QgsMapToolEmitPoint(self.canvas)
        self._tool.canvasClicked.connect(self._on_click)
        self.canvas.setMapTool(self._tool)
        self.chooser.currentTextChanged.connect(self.image_chosen)
        self._layer: QgsRasterLayer | None = None
        self._arrange()

    def _arrange(self) -> None:
        top = QHBoxLayout()
        top.addWidget(self.chooser, 1)
        top.addWidget(self.note)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(top)
        layout.addWidget(self.canvas, 1)
        layout.addWidget(self.chip)

    def image(self) -> str:
        return self.chooser.currentText()

    def show_choice(self, images: Sequence[str], chosen: str) -> None:
        """Offer these images without telling anyone."""
        self.chooser.blockSignals(True)
        self.chooser.clear()
        self.chooser.addItems(list(images))
        self.chooser.setCurrentText(chosen)
        self.chooser.blockSignals(False)

    def show_view(self, view: View | None, markers: list[Marker]) -> None:
        """Show an image around a position; without pixels only where the points are."""
        self._set_layer(view)
        self.markers.show_markers(markers)
        if view is None:
            return
        sample, line = view.middle
        self.note.setText("" if view.source else "no pixels")
        half = HALF_VIEW_PX
        self.canvas.setExtent(QgsRectangle(sample - half, -line - half, sample + half, -line + half))
        self.canvas.refresh()

    def let_go(self) -> None:
        """Stop drawing, and drop the image, before the view is deleted: its threads would outlive it."""
        self.canvas.stopRendering()
        self.canvas.setLayers([])
        self._layer = None

    def _set_layer(self, view: View | None) -> None:
        if view is None or not view.source:
            self.canvas.setLayers([])
            self._layer = None
            return
        if self._layer is None or self._layer.source() != view.source:
            options = QgsRasterLayer.LayerOptions(False)  # without looking at the pixels: that reads a whole scene
            options.skipCrsValidation = True
            self._layer = QgsRasterLayer(view.source, self.image(), "gdal", options)
            self.canvas.setLayers([self._layer])
        self._stretch(self._layer, *view.grey_range)

    def _stretch(self, layer: QgsRasterLayer, low: float, high: float) -> None:
        """Stretch the contrast to the surroundings of the point."""
        renderer = QgsSingleBandGrayRenderer(layer.dataProvider(), 1)
        contrast = QgsContrastEnhancement(layer.dataProvider().dataType(1))
        contrast.setMinimumValue(low)
        contrast.setMaximumValue(high)
        contrast.setContrastEnhancementAlgorithm(STRETCH)
        renderer.setContrastEnhancement(contrast)
        layer.setRenderer(renderer)

    def _on_click(self, point: QgsPointXY, button: Qt.MouseButton) -> None:
        if button == Qt.MouseButton.LeftButton and self.image():
            self.clicked.emit(self.image(), point.x(), -point.y())
