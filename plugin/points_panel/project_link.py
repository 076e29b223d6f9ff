"""The panel and the main window: positions on its map, and the panel's block, stored in the project."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from qgis.core import QgsPointXY, QgsProject
from qgis.gui import QgsMapCanvas, QgsMapToolEmitPoint, QgsVertexMarker
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QColor
from qgis.PyQt.QtWidgets import QAction

from ...processing_algorithms import point_session
from ..layer_sources import crs_text
from ..translation import tr
from .actions import show_errors
from .dialogs import NewPointDialog

_MARK = QColor(255, 176, 0)


class MapLink:
    """Asks for a position by a click on the map, and marks the chosen point there; ``canvas`` None: there is no map."""

    def __init__(self, dock: Any, canvas: QgsMapCanvas | None) -> None:
        self._dock, self.canvas = dock, canvas
        self._tool: QgsMapToolEmitPoint | None = None
        self._before: Any = None
        self._mark: QgsVertexMarker | None = None

    def pick_point(self) -> None:
        """Ask for a position on the map, and add a ground point there."""
        text = tr("Click in the map where the new point is")
        self._ask_map(self._dock.ui.pick, self._dock.ui.go_to, text, self._add_point_at)

    def go_to_place(self) -> None:
        """Ask for positions on the map, and show them in all images."""
        text = tr("Click in the map: the images show that place, at the points' middle height")
        self._ask_map(self._dock.ui.go_to, self._dock.ui.pick, text, self._dock.ui.grid.show_ground)

    def _ask_map(
        self, asked: QAction, other: QAction, text: str, on_click: Callable[[tuple[float, float]], None]
    ) -> None:
        other.setChecked(False)
        if asked.isChecked():
            self.tell(text)
            self.ask(on_click)
        else:
            self.stop()

    @show_errors
    def _add_point_at(self, lonlat: tuple[float, float]) -> None:
        session = self._dock.session
        dialog = NewPointDialog(lonlat, session.find_free_id("P"), session.middle_height_m(), self._dock)
        if dialog.exec() and dialog.point().id:
            session.add_points([dialog.point()])
            self._dock.show_edit()
            self._dock.choose(dialog.point().id)

    def tell(self, text: str, is_error: bool = False) -> None:
        self._dock.tell(text, is_error)

    def ask(self, on_click: Callable[[tuple[float, float]], None]) -> None:
        """Call ``on_click`` with longitude and latitude of every left click, until `stop`."""
        canvas = self.canvas
        if canvas is None:
            return
        self.stop()
        self._before, self._tool = canvas.mapTool(), QgsMapToolEmitPoint(canvas)
        self._tool.canvasClicked.connect(
            lambda point, button: on_click(lonlat_of(canvas, point)) if button == Qt.MouseButton.LeftButton else None
        )
        canvas.setMapTool(self._tool)

    def stop(self) -> None:
        """Restore the previous tool of the map."""
        if self.canvas is None or self._tool is None:
            return
        if self.canvas.mapTool() is self._tool:
            self.canvas.setMapTool(self._before) if self._before is not None else self.canvas.unsetMapTool(self._tool)
        self._tool = None

    def mark(self, lonlat: tuple[float, float] | None) -> None:
        """Mark a position on the map; None removes the mark."""
        if self.canvas is None:
            return
        if self._mark is not None:
            self.canvas.scene().removeItem(self._mark)
            self._mark = None
        if lonlat is None:
            return
        self._mark = QgsVertexMarker(self.canvas)
        self._mark.setIconType(QgsVertexMarker.IconType.ICON_CROSS)
        self._mark.setColor(_MARK)
        self._mark.setIconSize(18)
        self._mark.setPenWidth(2)
        of_map = self.canvas.mapSettings().destinationCrs()
        if of_map.isValid():
            lonlat = point_session.operations_of(crs_text(of_map)).from_wgs84(np.array([lonlat]))[0]
        self._mark.setCenter(QgsPointXY(*map(float, lonlat)))


def lonlat_of(canvas: QgsMapCanvas, point: QgsPointXY) -> tuple[float, float]:
    """Return longitude and latitude of a position in the CRS of a map."""
    of_map = canvas.mapSettings().destinationCrs()
    if not of_map.isValid():
        return point.x(), point.y()
    place = np.array([[point.x(), point.y(), 0.0]])
    lon, lat, _ = point_session.operations_of(crs_text(of_map)).to_wgs84(place)[0].tolist()
    return lon, lat


_SCOPE = "hrsi"


@dataclass(frozen=True)
class PanelState:
    """Path of the block's GeoPackage, model, kind of target, and chosen point."""

    path: str = ""
    model: str = "auto"
    kind: str = "center"
    point: str = ""


def store(state: PanelState, project: QgsProject) -> None:
    """Write the state into a project, in which the user saves it."""
    project.writeEntry(_SCOPE, "/points/path", project.writePath(state.path) if state.path else "")
    for name in ("model", "kind", "point"):
        project.writeEntry(_SCOPE, f"/points/{name}", getattr(state, name))


def restore_state(project: QgsProject) -> PanelState:
    """Return the state that is stored in a project."""
    default = PanelState()
    path = project.readEntry(_SCOPE, "/points/path", "")[0]
    others = {
        name: project.readEntry(_SCOPE, f"/points/{name}", getattr(default, name))[0]
        for name in ("model", "kind", "point")
    }
    return PanelState(project.readPath(path) if path else "", **others)
