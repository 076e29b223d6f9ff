"""A label that shows the chip of a fit."""

from qgis.PyQt.QtCore import QByteArray, Qt
from qgis.PyQt.QtGui import QPainter, QPixmap
from qgis.PyQt.QtSvg import QSvgRenderer
from qgis.PyQt.QtWidgets import QLabel

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


def _for_qt(svg: str) -> str:
    """Return an SVG made for web pages as Qt wants it: with name spaces, and the image in the older attribute."""
    return svg.replace("<svg ", f"<svg {_NAMESPACES} ", 1).replace(' href="data:', ' xlink:href="data:')


def render_chip(svg: str) -> QPixmap:
    """Return an SVG drawn at the label's size; a null pixmap where there is none."""
    renderer = QSvgRenderer(QByteArray(_for_qt(svg).encode("utf-8")))
    if not svg or not renderer.isValid():
        return QPixmap()
    size = renderer.defaultSize().scaled(LABEL_SIDE_PX, LABEL_SIDE_PX, Qt.AspectRatioMode.KeepAspectRatio)
    pixmap = QPixmap(size)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    renderer.render(painter)
    painter.end()
    return pixmap
