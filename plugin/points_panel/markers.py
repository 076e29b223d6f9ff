"""What is drawn over an image: predicted and measured positions, their residuals and names."""

from __future__ import annotations

from dataclasses import dataclass

from qgis.core import QgsPointXY
from qgis.gui import QgsMapCanvas, QgsMapCanvasItem
from qgis.PyQt.QtCore import QPointF, QRectF, Qt
from qgis.PyQt.QtGui import QBrush, QColor, QPainter, QPainterPath, QPen

from .table_models import FAINT, SUSPICIOUS

NAMED_POINTS = 60  # with more in view, only the chosen and the suspicious ones are named: no text could be read
ARROW_PX = 30.0  # on the screen, of a residual of one pixel
_ARM = 9.0
_BESIDE = 200.0  # on the screen: names and arrows of points that lie beside what is shown reach into it
_DARK, _LIGHT = QColor(0, 0, 0, 190), QColor(255, 255, 255, 220)  # around texts
GOOD, PREDICTED, PROPOSED = QColor(255, 176, 0), QColor(90, 200, 255), QColor(80, 230, 120)


@dataclass(frozen=True)
class Marker:
    """A point on one image (sample, line): where it is predicted and, if so, measured; its residual in px, or None.

    ``proposed`` is where matching has found it, until somebody takes or refuses that.
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
    """All points of an image: a ring where predicted, a cross where measured, an arrow for the residual."""

    def __init__(self, canvas: QgsMapCanvas) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.markers: list[Marker] = []

    def show_markers(self, markers: list[Marker]) -> None:
        self.markers = markers
        self.update()  # the pixels below stay

    def boundingRect(self) -> QRectF:
        return QRectF(0.0, 0.0, self._canvas.width(), self._canvas.height())

    def updatePosition(self) -> None:
        self.prepareGeometryChange()

    def paint(self, painter: QPainter, option: object = None, widget: object = None) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        near = self.boundingRect().adjusted(-_BESIDE, -_BESIDE, _BESIDE, _BESIDE)
        shown = [marker for marker in self.markers if self._is_in(near, marker)]
        for marker in shown:
            self._paint(painter, marker, len(shown) <= NAMED_POINTS or marker.is_chosen or marker.is_suspicious)

    def _is_in(self, near: QRectF, marker: Marker) -> bool:
        """Return whether a marker, or its name or arrow, reaches into what is shown."""
        return any(
            near.contains(self._place(place)) for place in (marker.predicted, marker.measured, marker.proposed) if place
        )

    def _paint(self, painter: QPainter, marker: Marker, is_named: bool) -> None:
        """Draw a marker; one without a name among many others has a cross or a ring, not both."""
        at = self._place(marker.predicted)
        if is_named or marker.measured is None:
            painter.setPen(QPen(PREDICTED, 1.2, Qt.PenStyle.DashLine))
            painter.drawEllipse(at, _ARM, _ARM)
        if marker.proposed is not None:
            at = self._place(marker.proposed)
            painter.setPen(QPen(PROPOSED, 2.0))
            for side in (QPointF(_ARM, 0.0), QPointF(0.0, _ARM)):
                painter.drawLine(at - side, at - 0.3 * side)
                painter.drawLine(at + side, at + 0.3 * side)
            painter.drawPolygon(*(at + _ARM * QPointF(*corner) for corner in ((1, 0), (0, 1), (-1, 0), (0, -1))))
        colour = FAINT if marker.is_off else SUSPICIOUS if marker.is_suspicious else GOOD
        if marker.measured is not None:
            at = self._place(marker.measured)
            painter.setPen(QPen(colour, 1.8))
            painter.drawLine(at - QPointF(_ARM, 0.0), at + QPointF(_ARM, 0.0))
            painter.drawLine(at - QPointF(0.0, _ARM), at + QPointF(0.0, _ARM))
            if marker.residual_px is not None:
                painter.setPen(QPen(colour, 2.4))
                painter.drawLine(at, at + ARROW_PX * QPointF(*marker.residual_px))
        if is_named:
            _draw_text(painter, at + QPointF(_ARM + 2.0, -_ARM - 2.0), marker_label(marker), colour)

    def _place(self, xy: tuple[float, float]) -> QPointF:
        return self.toCanvasCoordinates(QgsPointXY(xy[0], -xy[1]))


def _draw_text(painter: QPainter, at: QPointF, text: str, colour: QColor) -> None:
    """Write a text that is read on bright and on dark ground."""
    outline = QPainterPath()
    outline.addText(at, painter.font(), text)
    halo = _LIGHT if colour == SUSPICIOUS else _DARK
    painter.strokePath(outline, QPen(halo, 3.0, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
    painter.fillPath(outline, QBrush(colour))


def marker_label(marker: Marker) -> str:
    """Return a point's name with its residual."""
    if marker.proposed is not None:
        return f"{marker.name}  Y / X"
    if marker.residual_px is None:
        return marker.name
    return f"{marker.name}  {marker.residual_px[0]:+.2f} {marker.residual_px[1]:+.2f} px"
