"""What is drawn over an image: predicted and measured positions, their residuals and names."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from qgis.core import QgsPointXY
from qgis.gui import QgsMapCanvas, QgsMapCanvasItem
from qgis.PyQt.QtCore import QLineF, QPointF, QRectF, Qt
from qgis.PyQt.QtGui import QBrush, QColor, QPainter, QPainterPath, QPen

from .table_models import FAINT, SUSPICIOUS

NAMED_POINTS = 60  # with more in view, only the chosen and the suspicious ones are named: no text could be read
ARROW_PX = 30.0  # on the screen, of a residual of one pixel
_ARM = 9.0
_NOWHERE = (math.nan, math.nan)
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
        self._xy = np.empty((0, 3, 2))  # of each marker: predicted, measured, proposed; NaN where it is not

    def show_markers(self, markers: list[Marker]) -> None:
        self.markers = markers
        places = [[one.predicted, one.measured or _NOWHERE, one.proposed or _NOWHERE] for one in markers]
        self._xy = np.array(places, dtype=np.float64).reshape(-1, 3, 2)
        self.update()  # the pixels below stay

    def boundingRect(self) -> QRectF:
        return QRectF(0.0, 0.0, self._canvas.width(), self._canvas.height())

    def updatePosition(self) -> None:
        self.prepareGeometryChange()

    def paint(self, painter: QPainter, option: object = None, widget: object = None) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        zero, one = (self.toCanvasCoordinates(QgsPointXY(*place)) for place in ((0.0, 0.0), (1.0, -1.0)))
        on_screen = np.array([zero.x(), zero.y()]) + self._xy * (one.x() - zero.x(), one.y() - zero.y())
        size = self._canvas.width(), self._canvas.height()
        near = ((on_screen > -_BESIDE) & (on_screen < np.add(size, _BESIDE))).all(axis=2).any(axis=1).nonzero()[0]
        are_named = len(near) <= NAMED_POINTS
        crosses: dict[str, list[int]] = {}  # the markers of each colour that are a cross and an arrow, no more
        for index in near.tolist():
            marker = self.markers[index]
            if are_named or marker.measured is None or marker.is_chosen or marker.is_suspicious:
                self._paint(painter, marker, [QPointF(*place) for place in on_screen[index].tolist()], are_named)
            else:
                crosses.setdefault(_colour_of(marker).name(), []).append(index)
        for colour, chosen in crosses.items():
            residuals_px = [self.markers[index].residual_px for index in chosen]
            _draw_crosses(painter, QColor(colour), on_screen[chosen, 1].tolist(), residuals_px)

    def _paint(self, painter: QPainter, marker: Marker, places: Sequence[QPointF], are_named: bool) -> None:
        """Draw a marker where it is predicted, measured and proposed on the screen, with its name."""
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
            _draw_crosses(painter, colour, [(at.x(), at.y())], [marker.residual_px])
        if are_named or marker.is_chosen or marker.is_suspicious:
            # Write a text that is read on bright and on dark ground
            outline = QPainterPath()
            outline.addText(at + QPointF(_ARM + 2.0, -_ARM - 2.0), painter.font(), marker_label(marker))
            halo = _LIGHT if colour == SUSPICIOUS else _DARK
            painter.strokePath(outline, QPen(halo, 3.0, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
            painter.fillPath(outline, QBrush(colour))


def _colour_of(marker: Marker) -> QColor:
    return FAINT if marker.is_off else SUSPICIOUS if marker.is_suspicious else GOOD


def _draw_crosses(
    painter: QPainter, colour: QColor, places: Sequence[tuple[float, float]],
    residuals_px: Sequence[tuple[float, float] | None],
) -> None:  # fmt: skip
    """Draw crosses on the screen, and their residuals, all at once: one by one takes long with some hundred."""
    crosses = [QLineF(x - i, y - j, x + i, y + j) for i, j in ((_ARM, 0.0), (0.0, _ARM)) for x, y in places]
    arrows = [
        QLineF(x, y, x + ARROW_PX * left[0], y + ARROW_PX * left[1])
        for (x, y), left in zip(places, residuals_px, strict=True)
        if left is not None
    ]
    for lines, width in ((crosses, 1.8), (arrows, 2.4)):
        painter.setPen(QPen(colour, width))
        if lines:
            painter.drawLines(lines)


def marker_label(marker: Marker) -> str:
    """Return a point's name with its residual."""
    if marker.proposed is not None:
        return f"{marker.name}  Y / X"
    if marker.residual_px is None:
        return marker.name
    return f"{marker.name}  {marker.residual_px[0]:+.2f} {marker.residual_px[1]:+.2f} px"
