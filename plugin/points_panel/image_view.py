"""Drawing over an image: predicted and measured positions, residuals and names; and the view of an image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from qgis.core import (
    QgsContrastEnhancement,
    QgsCoordinateReferenceSystem,
    QgsPointXY,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsSingleBandGrayRenderer,
)
from qgis.gui import QgsMapCanvas, QgsMapCanvasItem, QgsMapToolEmitPoint
from qgis.PyQt.QtCore import QByteArray, QLineF, QPointF, QRectF, Qt, pyqtSignal
from qgis.PyQt.QtGui import QColor, QPainter, QPen, QPixmap, QWheelEvent
from qgis.PyQt.QtSvg import QSvgRenderer
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QLabel,
    QSpinBox,
    QToolButton,
    QVBoxLayout,
    QWidget,
)
from qgis.PyQt.QtXml import QDomDocument

from ...hrsi_engine.foundation.pixel_filters import STRETCH
from ...processing_algorithms.point_session.rows import ImageMeasurement
from ..translation import tr
from .actions import make_pause
from .table_models import FAINT, SUSPICIOUS

NAMED_POINTS = 60  # with more in view, only chosen and suspicious ones are named, so that the text is legible
ARROW_PX = 30.0  # length on the screen of a residual of one pixel
_ARM = 9.0
_NOWHERE = (math.nan, math.nan)
_BESIDE = 200.0  # px on the screen: names and arrows of points outside the view may reach into it
_DARK, _LIGHT = QColor(0, 0, 0), QColor(255, 255, 255)  # outlines of texts
_HALO = [QPointF(across, down) for across in (-1.0, 0.0, 1.0) for down in (-1.0, 0.0, 1.0) if across or down]
GOOD, PREDICTED, PROPOSED = QColor(255, 176, 0), QColor(90, 200, 255), QColor(80, 230, 120)


@dataclass(frozen=True)
class Marker:
    """A point in one image (sample, line): predicted and, if measured, measured position; residual in px, or None.

    ``proposed`` is the position found by matching, until the user accepts or rejects it.
    """

    name: str
    predicted: tuple[float, float]
    measured: tuple[float, float] | None
    residual_px: tuple[float, float] | None
    is_suspicious: bool
    is_off: bool = False
    is_chosen: bool = False
    proposed: tuple[float, float] | None = None


class PointMarkers(QgsMapCanvasItem):
    """All points of an image: a ring at the predicted, a cross at the measured position, an arrow for the residual."""

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.markers: list[Marker] = []
        self._xy = np.empty((0, 3, 2))  # of each marker: predicted, measured, proposed; NaN if missing
        self.segment: np.ndarray | None = None  # positions of the chosen point at its possible heights (k, 2)

    def show_markers(self, markers: list[Marker]) -> None:
        """Draw these markers instead of the present ones."""
        self.markers = markers
        places = [[one.predicted, one.measured or _NOWHERE, one.proposed or _NOWHERE] for one in markers]
        self._xy = np.array(places, dtype=np.float64).reshape(-1, 3, 2)
        self.update()  # the image below is not drawn again

    def boundingRect(self) -> QRectF:
        return QRectF(0.0, 0.0, self._canvas.width(), self._canvas.height())

    def updatePosition(self) -> None:
        self.prepareGeometryChange()

    def paint(self, painter: QPainter, option: object = None, widget: object = None) -> None:
        """Draw the markers near the view: few with names and all their parts, many with one line of each colour."""
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        corners = [self.toCanvasCoordinates(QgsPointXY(*place)) for place in ((0.0, 0.0), (1.0, 0.0), (0.0, -1.0))]
        zero, *sides = np.array([[corner.x(), corner.y()] for corner in corners])
        to_screen = np.array(sides) - zero  # rows: one sample and one line on the screen
        on_screen = zero + self._xy @ to_screen
        turn = to_screen / max(np.hypot(*to_screen[0]), 1e-12)
        if self.segment is not None:
            painter.setPen(QPen(PREDICTED, 1.2, Qt.PenStyle.DotLine))
            painter.drawPolyline(*(QPointF(*place) for place in (zero + self.segment @ to_screen).tolist()))
        size = self._canvas.width(), self._canvas.height()
        near = ((on_screen > -_BESIDE) & (on_screen < np.add(size, _BESIDE))).all(axis=2).any(axis=1).nonzero()[0]
        are_named = len(near) <= NAMED_POINTS
        crosses: dict[str, list[int]] = {}  # by colour: markers with a cross and an arrow only
        for index in near.tolist():
            marker = self.markers[index]
            if are_named or marker.measured is None or marker.is_chosen or marker.is_suspicious:
                places = [QPointF(*place) for place in on_screen[index].tolist()]
                self._paint(painter, marker, places, are_named, turn)
            else:
                crosses.setdefault(_colour_of(marker).name(), []).append(index)
        for colour, chosen in crosses.items():
            residuals_px = [self.markers[index].residual_px for index in chosen]
            _draw_crosses(painter, QColor(colour), on_screen[chosen, 1].tolist(), residuals_px, turn)

    def _paint(
        self, painter: QPainter, marker: Marker, places: Sequence[QPointF], are_named: bool, turn: np.ndarray
    ) -> None:
        """Draw a marker at its predicted, measured and proposed positions on the screen, with its name."""
        predicted, measured, proposed = places
        at = predicted
        painter.setPen(QPen(PREDICTED, 1.2, Qt.PenStyle.DashLine))
        painter.drawEllipse(predicted, _ARM, _ARM)
        if marker.proposed is not None:
            at = proposed
            painter.setPen(QPen(PROPOSED, 2.0))
            for side in (QPointF(_ARM, 0.0), QPointF(0.0, _ARM)):
                painter.drawLine(at - side, at - 0.3 * side)
                painter.drawLine(at + side, at + 0.3 * side)
            painter.drawPolygon(*(at + _ARM * QPointF(*corner) for corner in ((1, 0), (0, 1), (-1, 0), (0, -1))))
        colour = _colour_of(marker)
        if marker.measured is not None:
            at = measured
            _draw_crosses(painter, colour, [(at.x(), at.y())], [marker.residual_px], turn)
        if are_named or marker.is_chosen or marker.is_suspicious:
            # A text that is legible on bright and dark ground: glyphs are cached, outlines of letters are not
            text, place = marker_label(marker), at + QPointF(_ARM + 2.0, -_ARM - 2.0)
            beyond = place.x() + painter.fontMetrics().horizontalAdvance(text) + 4.0 - self._canvas.width()
            if beyond > 0.0 and at.x() < self._canvas.width():  # as far left as it is legible
                place -= QPointF(beyond, 0.0)
            painter.setPen(_LIGHT if colour == SUSPICIOUS else _DARK)
            for aside in _HALO:
                painter.drawText(place + aside, text)
            painter.setPen(colour)
            painter.drawText(place, text)


def _colour_of(marker: Marker) -> QColor:
    return FAINT if marker.is_off else SUSPICIOUS if marker.is_suspicious else GOOD


def _draw_crosses(
    painter: QPainter,
    colour: QColor,
    places: Sequence[tuple[float, float]],
    residuals_px: Sequence[tuple[float, float] | None],
    turn: np.ndarray,
) -> None:
    """Draw crosses on the screen, and their residuals, at once: one by one is slow for some hundred.

    turn : (2, 2) directions of sample and line on the screen, as rows
    """
    crosses = [QLineF(x - i, y - j, x + i, y + j) for i, j in ((_ARM, 0.0), (0.0, _ARM)) for x, y in places]
    arrows = [
        QLineF(x, y, *(np.array([x, y]) + ARROW_PX * (np.array(left) @ turn)).tolist())
        for (x, y), left in zip(places, residuals_px, strict=True)
        if left is not None
    ]
    for lines, width in ((crosses, 1.8), (arrows, 2.4)):
        painter.setPen(QPen(colour, width))
        if lines:
            painter.drawLines(lines)


def marker_label(marker: Marker) -> str:
    """Return the name of a point with its residual, or with the keys for a proposal."""
    if marker.proposed is not None:
        return f"{marker.name}  Y / X"
    left = marker.residual_px
    return marker.name if left is None else f"{marker.name}  {left[0]:+z.2f} {left[1]:+z.2f} px"


if TYPE_CHECKING:
    from ...processing_algorithms.point_session.views import View

CANVAS_NAME = "hrsi image view"  # by which QGIS stores canvases in projects
LEAST_SIZE_PX = 160, 150
IMAGE_LETTERS = 6  # of an image's id at least; a longer one would widen its view
SETTLE_MS = 250  # time after a zoom until the contrast is updated
STRETCH_PIXELS = 20_000
ACTIVE = "#ffb000"  # frame of the active view, visible in bright and dark themes
ENHANCEMENT = QgsContrastEnhancement.ContrastEnhancementAlgorithm.StretchToMinimumMaximum


class ImageCanvas(QgsMapCanvas):
    """Emits the factor by which the wheel has zoomed."""

    zoomed = pyqtSignal(float)

    def wheelEvent(self, event: QWheelEvent) -> None:
        before = self.mapUnitsPerPixel()
        super().wheelEvent(event)
        self.zoomed.emit(self.mapUnitsPerPixel() / before)


class ImageView(QWidget):
    """A chooser of the image and its band, a canvas with the points, and the chip of the last fit.

    The wheel zooms, the middle button or the space bar pans. ``gammas`` has the gamma of each image, by id.
    """

    clicked = pyqtSignal(str, float, float)  #: image id, sample, line
    image_chosen = pyqtSignal(str)
    whole_asked = pyqtSignal(str)  #: image id: to be shown completely

    def __init__(self, parent: QWidget, gammas: dict[str, float]) -> None:
        super().__init__(parent)
        self.chooser, self.note, self.chip = QComboBox(), QLabel(), ChipLabel()
        self.band, self.gamma, self.whole = QSpinBox(), QDoubleSpinBox(), QToolButton()
        self._gammas = gammas
        self.canvas = ImageCanvas(self)
        self.canvas.setObjectName(CANVAS_NAME)
        project = QgsProject.instance()  # after the canvas, which connects to the same signals
        project.writeProject.connect(self._leave_project)
        project.cleared.connect(self._note_extent)
        project.readProject.connect(self._return)
        self.canvas.setCanvasColor(Qt.GlobalColor.black)
        self.canvas.setDestinationCrs(QgsCoordinateReferenceSystem())
        self.setMinimumSize(*LEAST_SIZE_PX)  # also if the fields above the image need more: all views have one size
        self.canvas.enableAntiAliasing(True)
        self.markers = PointMarkers(self.canvas)
        self._tool = QgsMapToolEmitPoint(self.canvas)
        self._tool.canvasClicked.connect(self._on_click)
        self.canvas.setMapTool(self._tool)
        self.chooser.currentTextChanged.connect(self.image_chosen)
        self._settle = make_pause(self, SETTLE_MS, self._stretch)
        self.canvas.extentsChanged.connect(self._settle.start)
        self.band.valueChanged.connect(lambda _band: self._stretch())
        self.gamma.valueChanged.connect(self._set_gamma)
        self.whole.clicked.connect(lambda: self.whole_asked.emit(self.image()))
        self._layer: QgsRasterLayer | None = None
        self._north_deg = 0.0
        self._fitted: ImageMeasurement | None = None  # of the chip
        self.grey_range = 0.0, 1.0  #: grey values shown as black and white
        self._stretched: tuple[Any, ...] = ()  # parameters of the present contrast
        self._shown = QgsRectangle(), 0.0  #: extent and rotation before a project is read
        self._arrange()

    def _arrange(self) -> None:
        self.chooser.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.chooser.setMinimumContentsLength(IMAGE_LETTERS)
        self.band.setMinimum(1)
        self.band.setPrefix(f"{tr('band')} ")
        self.band.setToolTip(tr("The band that is shown; targets are measured on the first"))
        self.gamma.setRange(0.2, 4.0)
        self.gamma.setSingleStep(0.2)
        self.gamma.setDecimals(1)
        self.gamma.setPrefix("γ ")
        self.gamma.setToolTip(
            tr("Gamma of this image: above 1 it is brighter; its contrast is 2-98 % of what is in view")
        )
        self.whole.setText(tr("Whole"))
        self.whole.setToolTip(tr("Show the whole image; choosing the point again comes back"))
        top = QHBoxLayout()
        top.addWidget(self.chooser, 1)
        for widget in (self.note, self.band, self.gamma, self.whole):
            top.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addLayout(top)
        layout.addWidget(self.canvas, 1)
        self.chip.setParent(self.canvas)  # over a corner of the image, whose size does not change
        self.chip.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.chip.move(4, 4)

    def image(self) -> str:
        return self.chooser.currentText()

    def show_choice(self, images: Sequence[str], chosen: str) -> None:
        """Set the list of images and the chosen one, without a signal."""
        self.chooser.blockSignals(True)
        if [self.chooser.itemText(row) for row in range(self.chooser.count())] != list(images):
            self.chooser.clear()
            self.chooser.addItems(list(images))
        self.chooser.setCurrentText(chosen)
        self.chooser.blockSignals(False)

    def show_view(self, view: View | None, markers: list[Marker], is_north_up: bool) -> None:
        """Show an image around a position; without pixels only the markers."""
        self.chip.clear()
        for widget in (self.band, self.gamma, self.whole):
            widget.setEnabled(view is not None and bool(view.source))
        if view is None or not view.source:
            self.canvas.setLayers([])
            self._layer = None
        else:
            if self._layer is None or self._layer.source() != view.source:
                options = QgsRasterLayer.LayerOptions(False)  # no statistics: these read a complete scene
                options.skipCrsValidation = True
                self._layer = QgsRasterLayer(view.source, self.image(), "gdal", options)
                self.band.setMaximum(max(self._layer.bandCount(), 1))
                self.band.setVisible(self._layer.bandCount() > 1)
                self.canvas.setLayers([self._layer])
            self.gamma.setValue(self._gammas.get(self.image(), 1.0))
        self.markers.segment = view.segment if view is not None else None
        self.markers.show_markers(markers)
        if view is not None:
            self.note.setText("" if view.source else tr("no pixels"))
            self._north_deg = view.north_deg
            self.turn(is_north_up)
            self.show_place(view.middle, (view.half_px, view.half_px))

    def show_place(self, middle: tuple[float, float], half: tuple[float, float] | None = None) -> None:
        """Show the surroundings of a position (sample, line), ``half`` pixels to each side; None keeps the scale."""
        if half is None:
            self.canvas.setCenter(QgsPointXY(middle[0], -middle[1]))
        else:
            (sample, line), (across, down) = middle, half
            self.canvas.setExtent(QgsRectangle(sample - across, -line - down, sample + across, -line + down))
        self._stretch()
        self.canvas.refresh()

    def turn(self, is_north_up: bool) -> None:
        """Turn the image around the middle of the view: north on top, or its first line."""
        self.canvas.setRotation(-self._north_deg if is_north_up else 0.0)

    def is_in_view(self, place: tuple[float, float]) -> bool:
        """Whether a position (sample, line) is in the visible part of the image."""
        at = self.canvas.getCoordinateTransform().transform(QgsPointXY(place[0], -place[1]))
        return bool(self.canvas.rect().contains(round(at.x()), round(at.y())))

    def show_fit(self, svg: str, measured: ImageMeasurement | None) -> None:
        """Show the chip of a fit as long as the point's measurement remains ``measured``."""
        self.chip.show_chip(svg)
        self._fitted = measured

    def check_fit(self, measured: ImageMeasurement | None) -> None:
        """Hide the chip of a fit if the point has another measurement now."""
        if measured is not self._fitted:
            self.chip.clear()

    def mark_active(self, is_active: bool) -> None:
        """Show whether this is the active view, on which the keyboard acts."""
        colour = ACTIVE if is_active else "transparent"  # equal width: the image does not move
        self.canvas.setStyleSheet(f"QgsMapCanvas {{ border: 2px solid {colour}; }}")

    def _leave_project(self, document: QDomDocument) -> None:
        """Remove the view from a project that is written: QGIS stores all its canvases there."""
        found = document.elementsByTagName("mapcanvas")
        for canvas in [found.at(index).toElement() for index in range(found.length())]:
            if canvas.attribute("name") == CANVAS_NAME:
                canvas.parentNode().removeChild(canvas)

    def _note_extent(self) -> None:
        self._shown = self.canvas.mapSettings().extent(), self.canvas.rotation()

    def _return(self, _document: QDomDocument) -> None:
        """Restore the view from before a project was read: QGIS sets all its canvases to those of the project."""
        self.canvas.setDestinationCrs(QgsCoordinateReferenceSystem())
        extent, rotation = self._shown
        self.canvas.setRotation(rotation)
        self.canvas.setExtent(extent)

    def release_images(self) -> None:
        """Stop drawing, and remove the image, before the view is deleted: otherwise its threads would continue."""
        project = QgsProject.instance()
        project.writeProject.disconnect(self._leave_project)
        project.cleared.disconnect(self._note_extent)
        project.readProject.disconnect(self._return)
        self._settle.stop()
        self.canvas.stopRendering()
        self.canvas.setLayers([])
        self._layer = None

    def _stretch(self) -> None:
        """Stretch the contrast to the visible part of the image."""
        layer, band, extent = self._layer, self.band.value(), self.canvas.extent()
        if layer is None or extent.isEmpty():  # a new canvas has no extent, which is infinite in QGIS 3.40
            return
        step = max(extent.width(), 1.0) / 4.0  # after smaller moves the content is nearly equal
        place = round(step), round(extent.xMinimum() / step), round(extent.yMinimum() / step)
        wanted = layer.id(), band, self.gamma.value(), *place
        if wanted == self._stretched:
            return
        self._stretched = wanted
        low, high = (0.01 * percent for percent in STRETCH.view_percent)
        self.grey_range = low, high = layer.dataProvider().cumulativeCut(band, low, high, extent, STRETCH_PIXELS)
        renderer = QgsSingleBandGrayRenderer(layer.dataProvider(), band)
        contrast = QgsContrastEnhancement(layer.dataProvider().dataType(band))
        contrast.setMinimumValue(low)
        contrast.setMaximumValue(high)
        contrast.setContrastEnhancementAlgorithm(ENHANCEMENT)
        renderer.setContrastEnhancement(contrast)
        layer.setRenderer(renderer)
        layer.brightnessFilter().setGamma(self.gamma.value())
        self.canvas.refresh()

    def _set_gamma(self, gamma: float) -> None:
        self._gammas[self.image()] = gamma
        self._stretch()

    def _on_click(self, point: QgsPointXY, button: Qt.MouseButton) -> None:
        if button == Qt.MouseButton.LeftButton and self.image():
            self.clicked.emit(self.image(), point.x(), -point.y())


LABEL_SIDE_PX = 96
_NAMESPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


class ChipLabel(QLabel):
    """Shows a chip (SVG) over a corner of its parent; hidden before the first fit."""

    def show_chip(self, svg: str) -> None:
        self.setPixmap(render_chip(svg))
        self.adjustSize()
        self.show()

    def clear(self) -> None:
        super().clear()
        self.hide()


def render_chip(svg: str, side_px: int = LABEL_SIDE_PX) -> QPixmap:
    """Return an SVG drawn at this size; a null pixmap if it is empty or invalid."""
    # An SVG for web pages, changed for Qt: with name spaces, and the image in the older attribute
    for_qt = svg.replace("<svg ", f"<svg {_NAMESPACES} ", 1).replace(' href="data:', ' xlink:href="data:')
    renderer = QSvgRenderer(QByteArray(for_qt.encode("utf-8")))
    if not svg or not renderer.isValid():
        return QPixmap()
    size = renderer.defaultSize().scaled(side_px, side_px, Qt.AspectRatioMode.KeepAspectRatio)
    pixmap = QPixmap(size)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    renderer.render(painter)
    painter.end()
    return pixmap
