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
from qgis.PyQt.QtCore import QByteArray, Qt, pyqtSignal
from qgis.PyQt.QtGui import QPainter, QPixmap
from qgis.PyQt.QtSvg import QSvgRenderer
from qgis.PyQt.QtWidgets import QComboBox, QHBoxLayout, QLabel, QSpinBox, QToolButton, QVBoxLayout, QWidget

from ..translation import tr
from .markers import Marker, PointMarkers

if TYPE_CHECKING:
    from ...processing_algorithms.point_session.views import View

HALF_VIEW_PX = 60.0  # image pixels around the predicted position
STRETCH_PIXELS = 20_000
ACTIVE = "#ffb000"  # the frame of the view that the keyboard acts on, seen with bright and dark themes
STRETCH = QgsContrastEnhancement.ContrastEnhancementAlgorithm.StretchToMinimumMaximum


class ImageView(QWidget):
    """A chooser for the image and its band, its canvas with the points, and the chip of the last fit.

    The wheel zooms, the middle button or the space bar pans.
    """

    clicked = pyqtSignal(str, float, float)  #: image id, sample, line
    image_chosen = pyqtSignal(str)
    whole_asked = pyqtSignal(str)  #: image id: to be seen as a whole

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.chooser, self.note, self.chip = QComboBox(), QLabel(), ChipLabel()
        self.band, self.whole = QSpinBox(), QToolButton()
        self.canvas = QgsMapCanvas(self)
        self.canvas.setCanvasColor(Qt.GlobalColor.black)
        self.canvas.setDestinationCrs(QgsCoordinateReferenceSystem())
        self.canvas.setMinimumSize(160, 130)
        self.canvas.enableAntiAliasing(True)
        self.markers = PointMarkers(self.canvas)
        self._tool = QgsMapToolEmitPoint(self.canvas)
        self._tool.canvasClicked.connect(self._on_click)
        self.canvas.setMapTool(self._tool)
        self.chooser.currentTextChanged.connect(self.image_chosen)
        self.band.valueChanged.connect(lambda _band: self._stretch())
        self.whole.clicked.connect(lambda: self.whole_asked.emit(self.image()))
        self._layer: QgsRasterLayer | None = None
        self._grey_range = (0.0, 1.0)
        self._arrange()

    def _arrange(self) -> None:
        self.band.setMinimum(1)
        self.band.setPrefix(f"{tr('band')} ")
        self.band.setToolTip(tr("The band that is shown; targets are measured on the first"))
        self.whole.setText(tr("Whole image"))
        self.whole.setToolTip(tr("Show the whole image; choosing the point again comes back"))
        top = QHBoxLayout()
        top.addWidget(self.chooser, 1)
        for widget in (self.note, self.band, self.whole):
            top.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addLayout(top)
        layout.addWidget(self.canvas, 1)
        self.chip.setParent(self.canvas)  # over a corner of the image, which keeps its size
        self.chip.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.chip.move(4, 4)

    def image(self) -> str:
        return self.chooser.currentText()

    def show_choice(self, images: Sequence[str], chosen: str) -> None:
        """Offer these images without telling anyone."""
        self.chooser.blockSignals(True)
        if [self.chooser.itemText(row) for row in range(self.chooser.count())] != list(images):
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
        self.note.setText("" if view.source else tr("no pixels"))
        self.show_place(view.middle)

    def show_place(self, middle: tuple[float, float], half: tuple[float, float] = (HALF_VIEW_PX, HALF_VIEW_PX)) -> None:
        """Show the surroundings of a place (sample, line), ``half`` pixels to each side."""
        (sample, line), (across, down) = middle, half
        self.canvas.setExtent(QgsRectangle(sample - across, -line - down, sample + across, -line + down))
        self.canvas.refresh()

    def mark_active(self, is_active: bool) -> None:
        """Show whether the keyboard acts on this view."""
        colour = ACTIVE if is_active else "transparent"  # of the same width: the image stays as it is
        self.canvas.setStyleSheet(f"QgsMapCanvas {{ border: 2px solid {colour}; }}")

    def let_go(self) -> None:
        """Stop drawing, and drop the image, before the view is deleted: its threads would outlive it."""
        self.canvas.stopRendering()
        self.canvas.setLayers([])
        self._layer = None

    def _set_layer(self, view: View | None) -> None:
        has_pixels = view is not None and bool(view.source)
        for widget in (self.band, self.whole):
            widget.setEnabled(has_pixels)
        if view is None or not view.source:
            self.canvas.setLayers([])
            self._layer = None
            return
        if self._layer is None or self._layer.source() != view.source:
            options = QgsRasterLayer.LayerOptions(False)  # without looking at the pixels: that reads a whole scene
            options.skipCrsValidation = True
            self._layer = QgsRasterLayer(view.source, self.image(), "gdal", options)
            self.band.setMaximum(max(self._layer.bandCount(), 1))
            self.canvas.setLayers([self._layer])
        self._grey_range = view.grey_range
        self._stretch()

    def _stretch(self) -> None:
        """Stretch the contrast to the surroundings of the point."""
        layer, band = self._layer, self.band.value()
        if layer is None:
            return
        low, high = self._grey_range  # of the band that is measured on
        if band > 1:
            low, high = layer.dataProvider().cumulativeCut(band, 0.01, 0.99, self.canvas.extent(), STRETCH_PIXELS)
        renderer = QgsSingleBandGrayRenderer(layer.dataProvider(), band)
        contrast = QgsContrastEnhancement(layer.dataProvider().dataType(band))
        contrast.setMinimumValue(low)
        contrast.setMaximumValue(high)
        contrast.setContrastEnhancementAlgorithm(STRETCH)
        renderer.setContrastEnhancement(contrast)
        layer.setRenderer(renderer)
        self.canvas.refresh()

    def _on_click(self, point: QgsPointXY, button: Qt.MouseButton) -> None:
        if button == Qt.MouseButton.LeftButton and self.image():
            self.clicked.emit(self.image(), point.x(), -point.y())


LABEL_SIDE_PX = 96
_NAMESPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


class ChipLabel(QLabel):
    """Shows a chip (SVG) over a corner of its parent; nothing before the first fit."""

    def show_chip(self, svg: str) -> None:
        self.setPixmap(render_chip(svg))
        self.adjustSize()
        self.show()

    def clear(self) -> None:
        super().clear()
        self.hide()


def render_chip(svg: str) -> QPixmap:
    """Return an SVG drawn at the label's size; a null pixmap where there is none."""
    # An SVG made for web pages as Qt wants it: with name spaces, and the image in the older attribute
    for_qt = svg.replace("<svg ", f"<svg {_NAMESPACES} ", 1).replace(' href="data:', ' xlink:href="data:')
    renderer = QSvgRenderer(QByteArray(for_qt.encode("utf-8")))
    if not svg or not renderer.isValid():
        return QPixmap()
    size = renderer.defaultSize().scaled(LABEL_SIDE_PX, LABEL_SIDE_PX, Qt.AspectRatioMode.KeepAspectRatio)
    pixmap = QPixmap(size)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    renderer.render(painter)
    painter.end()
    return pixmap
