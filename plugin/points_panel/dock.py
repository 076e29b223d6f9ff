"""The dock "HRSI Points": tables on the left, two images on the right, and what their buttons do."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from qgis.core import QgsApplication, QgsProject, QgsVectorLayer
from qgis.PyQt.QtCore import QModelIndex, pyqtSignal
from qgis.PyQt.QtWidgets import QDockWidget, QFileDialog, QInputDialog, QMessageBox

from ...hrsi_engine.foundation.errors import HrsiError
from ...hrsi_engine.foundation.reasons import Level
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from ..dependencies import missing_package_message
from ..layer_or_file import LayerOrFile
from .adjust_task import AdjustTask
from .layout import PanelLayout
from .markers import Marker
from .new_block import NewBlockDialog
from .project_state import PanelState, restore_state, store
from .table_models import MeasurementsModel, PointsModel

BLOCK_FILTER = "GeoPackage (*.gpkg)"


def told(method: Callable[..., Any]) -> Callable[..., Any]:
    """Show the errors that a user can act on in the panel instead of raising them."""

    @wraps(method)
    def run(self: PointsDock, *arguments: Any) -> Any:
        try:
            return method(self, *arguments)
        except HrsiError as error:
            self.tell(str(error), is_error=True)
        except ImportError as error:
            message = missing_package_message(error)
            if message is None:
                raise
            self.tell(message, is_error=True)
        return None

    return run


class PointsDock(QDockWidget):
    """Shows a `PointSession` and passes on what the user does to it."""

    adjusted = pyqtSignal(bool)  #: an adjustment has ended, well or not

    def __init__(self, parent: Any = None) -> None:
        super().__init__("HRSI Points", parent)
        self.setObjectName("HrsiPoints")
        self.ui = PanelLayout(self)
        self.setWidget(self.ui)
        self.session = PointSession()
        self.points_model, self.measurements_model = PointsModel(self.session), MeasurementsModel(self.session)
        self._task: AdjustTask | None = None
        self._connect()
        self.show_session(PointSession())
        self.restore()

    def _connect(self) -> None:
        ui = self.ui
        actions = {
            ui.new: self.new, ui.open: self.open, ui.add: self.add_points, ui.remove: self.remove_point,
            ui.save: self.save, ui.save_as: self.save_as, ui.adjust: self.adjust, ui.cancel: self.cancel,
        }  # fmt: skip
        for action, slot in actions.items():
            action.triggered.connect(lambda _checked=False, slot=slot: slot())
        for view in ui.views:
            view.clicked.connect(self.measure)
            view.image_chosen.connect(lambda _name: self._show_images())
        for box in (ui.model, ui.kind):
            box.currentTextChanged.connect(lambda _text: self._store())
        project = QgsProject.instance()
        project.readProject.connect(self._on_project)
        project.cleared.connect(self._on_project)

    def close_for_good(self) -> None:
        """Let go of the project and of a running task, before the plugin is taken away."""
        self.cancel()
        project = QgsProject.instance()
        project.readProject.disconnect(self._on_project)
        project.cleared.disconnect(self._on_project)
        for view in self.ui.views:
            view.let_go()

    # ---- showing -----------------------------------------------------------------------------------------------

    def show_session(self, session: PointSession, point: str = "") -> None:
        """Show another block."""
        self.session = session
        self.points_model, self.measurements_model = PointsModel(session), MeasurementsModel(session)
        for model in (self.points_model, self.measurements_model):
            model.refused.connect(lambda message: self.tell(message, is_error=True))
            model.edited.connect(self.refresh)
        self.ui.show_models(self.points_model, self.measurements_model)
        self.ui.points.selectionModel().currentRowChanged.connect(self._on_point)
        self.points_model.refresh()
        names = list(session.images)
        for number, view in enumerate(self.ui.views):
            view.show_choice(names, names[min(number, len(names) - 1)] if names else "")
            view.setVisible(number < max(len(names), 1))
        self.choose(point or next(iter(session.points), ""))
        self.refresh()

    def choose(self, name: str) -> None:
        """Choose a point: its images are shown where it should be."""
        row = self.points_model.row_of(name)
        if row >= 0:
            self.ui.points.selectRow(row)
            self.ui.points.setCurrentIndex(self.points_model.index(row, 0))

    def point(self) -> str:
        """Return the chosen point's id, empty without."""
        return self.measurements_model.point

    def refresh(self) -> None:
        """Show tables and markers as the session is now."""
        self.points_model.refresh()
        self.measurements_model.refresh()
        for view in self.ui.views:
            view.markers.show_markers(self._markers(view.image()))
        self.setWindowTitle(f"HRSI Points{' *' if self.session.changed else ''}")
        self.ui.enable(bool(self.session.images), bool(self.point()), self._task is not None)

    def tell(self, text: str, is_error: bool = False) -> None:
        self.ui.tell(text, is_error)

    def _on_point(self, index: QModelIndex, _before: QModelIndex | None = None) -> None:
        name = self.points_model.rows[index.row()].point.id if index.isValid() else ""
        self.measurements_model.show_point(name)
        self._choose_images(name)
        self._show_images()
        self._store()

    def _choose_images(self, name: str) -> None:
        """Bring forward images in which the point lies, those measured already first."""
        rows = [row for row in self.session.measurements(name) if row.is_inside or row.measured] if name else []
        fitting = [row.image for row in sorted(rows, key=lambda row: row.measured is None)]
        shown = [view.image() for view in self.ui.views]
        kept = [image for image in shown if image in fitting]
        free = iter([image for image in fitting if image not in kept])
        for view in self.ui.views:
            if view.image() not in fitting:
                view.show_choice(list(self.session.images), next(free, view.image()))

    @told
    def _show_images(self) -> None:
        for view in self.ui.views:
            view.chip.clear()
            shown = self.point() and view.image()
            view.show_view(
                point_session.view_of(self.session, self.point(), view.image()) if shown else None,
                self._markers(view.image()),
            )

    def _markers(self, image: str) -> list[Marker]:
        """Return all points that lie on an image."""
        if image not in self.session.images:
            return []
        markers = []
        for name in self.session.points:
            row = next(row for row in self.session.measurements(name) if row.image == image)
            if not (row.is_inside or row.measured):
                continue
            measured = (row.measured.sample, row.measured.line) if row.measured else None
            residual = None if row.residual_px[0] != row.residual_px[0] else row.residual_px  # NaN: none
            markers.append(Marker(name, row.predicted, measured, residual, bool(row.suspicion)))
        return markers

    # ---- what the user does ------------------------------------------------------------------------------------

    @told
    def measure(self, image: str, sample: float, line: float) -> None:
        """Measure the chosen point near a click on an image."""
        if not self.point():
            self.tell("Choose a ground point in the list first")
            return
        fit = self.session.measure(self.point(), image, (sample, line), self.ui.kind.currentText())
        quality = f"sigma {fit.measured.sigma:.2f} px" if fit.measured.sigma == fit.measured.sigma else "as clicked"
        text = fit.refusal or f"{fit.measured.sample:.2f} {fit.measured.line:.2f}, {quality}"
        next(view for view in self.ui.views if view.image() == image).chip.show_chip(fit.chip_svg, text)
        self.tell(f"{self.point()} on {image}: {text}", is_error=bool(fit.refusal))
        self.refresh()

    @told
    def new(self) -> None:
        """Begin a block with images and points."""
        dialog = NewBlockDialog(self)
        if self._may_leave() and dialog.exec():
            self.show_session(point_session.new_session(**dialog.sources()))

    @told
    def open(self, path: str = "") -> None:
        """Open a block's GeoPackage."""
        path = path or QFileDialog.getOpenFileName(self, "Open block", "", BLOCK_FILTER)[0]
        if path and self._may_leave():
            self.show_session(point_session.open_block(path))
            self.tell(f"{len(self.session.points)} points, {len(self.session.images)} images: {path}")
            self._store()

    @told
    def add_points(self) -> None:
        """Add the ground points of a layer of the project."""
        layers = [one for one in QgsProject.instance().mapLayers().values() if isinstance(one, QgsVectorLayer)]
        names = [layer.name() for layer in layers]
        name, chosen = QInputDialog.getItem(self, "Add ground points", "Layer or file", names, 0, True)
        if chosen and name:
            field = LayerOrFile()
            field.box.setEditText(name)
            self.session.add_points(point_session.read_ground_points(source_of(field.value(), "gcps")))
            self.refresh()

    @told
    def remove_point(self) -> None:
        """Remove the chosen point with its measurements."""
        self.session.remove_point(self.point())
        self.measurements_model.show_point("")
        self.refresh()
        self.choose(next(iter(self.session.points), ""))

    @told
    def save(self) -> bool:
        """Save the block; True where that was done."""
        if not self.session.path:
            return bool(self.save_as())
        point_session.save(self.session)
        self._after_save()
        return True

    @told
    def save_as(self, path: str = "") -> bool:
        """Save the block under a name."""
        path = path or QFileDialog.getSaveFileName(self, "Save block", "block.gpkg", BLOCK_FILTER)[0]
        if not path:
            return False
        point_session.save(self.session, path)
        self._after_save()
        return True

    def _after_save(self) -> None:
        self.tell(f"saved: {self.session.path}")
        self.refresh()
        self._store()
        for layer in QgsProject.instance().mapLayers().values():  # the map shows the new rows
            if isinstance(layer, QgsVectorLayer) and layer.source().startswith(self.session.path):
                layer.dataProvider().reloadData()
                layer.loadDefaultStyle()
                layer.triggerRepaint()

    @told
    def adjust(self) -> None:
        """Adjust the block in the background; `adjusted` is emitted at the end."""
        if self._task is not None:
            return
        task = AdjustTask(self.session, self.ui.model.currentText())
        task.progressChanged.connect(self.ui.show_progress)
        task.taskCompleted.connect(lambda: self._on_adjusted(task))
        task.taskTerminated.connect(lambda: self._on_adjusted(task))
        self._task = task
        self.refresh()
        self.tell("adjusting …")
        QgsApplication.taskManager().addTask(task)

    def is_adjusting(self) -> bool:
        return self._task is not None

    def cancel(self) -> None:
        """Ask a running adjustment to stop."""
        if self._task is not None:
            self._task.cancel()

    @told
    def _on_adjusted(self, task: AdjustTask) -> None:
        if task is not self._task:
            return
        self._task = None
        self.ui.show_progress(0.0)
        if task.adjusted is None:
            self.tell(task.failure or "cancelled", is_error=bool(task.failure))
        else:
            self.session.accept(task.adjusted)
            if self.session.path:
                point_session.save_adjusted(self.session)
                self._after_save()
            self.tell(task.adjusted.told, is_error=task.adjusted.verdict.level is Level.UNUSABLE)
        self.refresh()
        self.adjusted.emit(task.adjusted is not None)

    # ---- project -----------------------------------------------------------------------------------------------

    def restore(self) -> None:
        """Show the block that the project names, if there is one."""
        state = restore_state(QgsProject.instance())
        self.ui.model.setCurrentText(state.model)
        self.ui.kind.setCurrentText(state.kind)
        if state.path and state.path != self.session.path:
            self._restore_block(state)

    @told
    def _restore_block(self, state: PanelState) -> None:
        self.show_session(point_session.open_block(state.path), state.point)

    def _on_project(self, _document: Any = None) -> None:
        if not restore_state(QgsProject.instance()).path:
            self.show_session(PointSession())
        self.restore()

    def _store(self) -> None:
        if self.session.path:
            state = PanelState(self.session.path, self.ui.model.currentText(), self.ui.kind.currentText(), self.point())
            store(state, QgsProject.instance())

    def _may_leave(self) -> bool:
        """Ask what to do with unsaved measurements."""
        if not self.session.changed:
            return True
        buttons = QMessageBox.StandardButton
        answer = QMessageBox.question(
            self,
            "HRSI Points",
            "Save the measurements of this block first?",
            buttons.Save | buttons.Discard | buttons.Cancel,
        )
        return answer == buttons.Discard or (answer == buttons.Save and bool(self.save()))


def source_of(value: str, name: str) -> str:
    """Return what the engine opens for a layer id or a file."""
    from qgis.core import QgsProcessingContext, QgsProcessingFeedback

    from ..layer_sources import point_source

    context = QgsProcessingContext()
    context.setProject(QgsProject.instance())
    return point_source(value, name, context, QgsProcessingFeedback())
