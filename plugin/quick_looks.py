"""What to do with the layers of an adjustment: images before and after it in turn, and a print layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsLayoutFrame,
    QgsLayoutItemAttributeTable,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemScaleBar,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsPrintLayout,
    QgsProject,
    QgsVectorLayer,
    QgsWkbTypes,
)
from qgis.PyQt.QtCore import QObject, QTimer

from ..processing_algorithms.interface.declare import QUICK_LOOKS, STATES
from .translation import tr

STATE_BEFORE, STATE_AFTER = STATES
FLICKER_MS = 800
#: Fields of the table of points, and their headings.
TABLE_FIELDS = {
    "id": "point", "role": "role", "residual_east_m": "dE m", "residual_north_m": "dN m", "residual_height_m": "dH m",
}  # fmt: skip
TITLE_PT, MAP_MM = 18, (180.0, 165.0)
TABLE_ROWS = 18  # of points, the first control and check points


class Comparison(QObject):
    """Shows the images before and after an adjustment in turn, as long as it is switched on."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.shown = STATE_AFTER
        self._timer = QTimer(self)
        self._timer.setInterval(FLICKER_MS)
        self._timer.timeout.connect(self.swap)

    def switch(self, is_on: bool) -> None:
        """Begin or end; at the end the images after the adjustment are shown."""
        self.shown = STATE_BEFORE
        if is_on:
            self._timer.start()
        else:
            self._timer.stop()
        self.swap()

    def swap(self) -> None:
        """Show the quick-looks of the other state."""
        self.shown = STATE_AFTER if self.shown == STATE_BEFORE else STATE_BEFORE
        for node in QgsProject.instance().layerTreeRoot().findLayers():
            path = Path(node.layer().source() if node.layer() is not None else "")
            if path.parent.name == QUICK_LOOKS:
                node.setItemVisibilityChecked(path.stem.endswith(f"_{self.shown}"))


def make_print_layout(canvas: Any) -> QgsPrintLayout:
    """Add a layout to the project, A4: title, map as on the screen, legend, scale bar, and a table of the points."""
    project = QgsProject.instance()
    layout = QgsPrintLayout(project)
    layout.initializeDefaults()  # A4, landscape
    names = {one.name() for one in project.layoutManager().layouts()}
    number = next(k for k in range(1, len(names) + 2) if f"HRSI {k}" not in names)
    layout.setName(f"HRSI {number}")
    title = QgsLayoutItemLabel(layout)
    title.setText(f"{tr('Block adjustment')}: {Path(project.fileName()).stem or 'HRSI'}")
    font = title.font()
    font.setPointSize(TITLE_PT)
    title.setFont(font)
    _place(title, 10.0, 8.0, 190.0, 12.0)
    drawn = QgsLayoutItemMap(layout)
    _place(drawn, 10.0, 22.0, *MAP_MM)
    drawn.setLayers(canvas.layers())
    drawn.setExtent(canvas.extent())  # which changes the size; an item without extent cannot be zoomed
    drawn.attemptResize(QgsLayoutSize(*MAP_MM))
    drawn.zoomToExtent(canvas.extent())
    drawn.setFrameEnabled(True)
    scale_bar = QgsLayoutItemScaleBar(layout)
    scale_bar.setLinkedMap(drawn)
    scale_bar.applyDefaultSize()
    _place(scale_bar, 10.0, 190.0, 80.0, 12.0)
    layers = [one for one in project.mapLayers().values() if isinstance(one, QgsVectorLayer)]
    points = next((one for one in layers if set(TABLE_FIELDS) <= set(one.fields().names())), None)
    _place(_make_legend(drawn, points), 195.0, 20.0, 90.0, 70.0)
    if points is not None:
        _place(_make_table(layout, points), 195.0, 98.0, 92.0, 102.0)
    project.layoutManager().addLayout(layout)
    return layout


def _place(item: Any, x: float, y: float, width: float, height: float) -> None:
    """Add an item to its layout, at a position in mm from the upper left corner."""
    item.layout().addLayoutItem(item)
    item.attemptMove(QgsLayoutPoint(x, y))
    item.attemptResize(QgsLayoutSize(width, height))


def _make_legend(drawn: QgsLayoutItemMap, points: QgsVectorLayer | None) -> QgsLayoutItemLegend:
    """Return a legend of the points' layer and the footprints: other layers have the same symbols, images none."""
    legend = QgsLayoutItemLegend(drawn.layout())
    legend.setLinkedMap(drawn)
    legend.setAutoUpdateModel(False)
    polygons = QgsWkbTypes.GeometryType.PolygonGeometry
    for node in legend.model().rootGroup().findLayers():
        layer = node.layer()
        if layer is not points and not (isinstance(layer, QgsVectorLayer) and layer.geometryType() == polygons):
            node.parent().removeChildNode(node)
    return legend


def _make_table(layout: QgsPrintLayout, points: QgsVectorLayer) -> QgsLayoutFrame:
    """Return the frame of a table with the control and check points and their residuals."""
    table = QgsLayoutItemAttributeTable.create(layout)
    layout.addMultiFrame(table)
    table.setVectorLayer(points)
    table.setDisplayedFields(list(TABLE_FIELDS))
    columns = table.columns()
    for column, (field, heading) in zip(columns, TABLE_FIELDS.items(), strict=True):
        column.setHeading(heading)
        if field.endswith("_m"):
            column.setAttribute(f'format_number("{field}", 2)')
    table.setColumns(columns)
    table.setFeatureFilter("\"role\" IN ('gcp', 'check') AND \"residual_east_m\" IS NOT NULL")
    table.setFilterFeatures(True)
    table.setMaximumNumberOfFeatures(TABLE_ROWS)
    frame = QgsLayoutFrame(layout, table)
    table.addFrame(frame)
    return frame
