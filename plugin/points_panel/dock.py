"""The dock "HRSI Points": tables on the left, images on the right, and the slots of their buttons."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Callable, Sequence
from functools import partial, wraps
from typing import Any

from qgis.core import (
    QgsApplication,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProject,
    QgsSettings,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QCoreApplication, QEvent, QModelIndex, QObject, Qt, QTimer, pyqtSignal
from qgis.PyQt.QtWidgets import QAction, QDockWidget, QFileDialog, QInputDialog, QMessageBox

from ...hrsi_engine.foundation.errors import HrsiError
from ...hrsi_engine.foundation.progress import Progress
from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.foundation.workers.threads import one_thread_calls
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from ...processing_algorithms.point_session.rows import PANEL, TIE
from ..background_task import BackgroundTask
from ..dependencies import missing_package_message
from ..dialog_fields import LayerOrFile
from ..layer_sources import point_source
from ..translation import tr
from .dialogs import NewBlockDialog, NewPointDialog
from .image_view import ImageView, Marker
from .layout import PanelLayout
from .project_link import MapLink, PanelState, restore_state, store
from .table_models import MeasurementsModel, PointsModel, ResidualsModel

LIVE_DELAY_MS = 300
QUICK_S = 10.0  # CPU time up to which an adjustment is repeated after each edit; residuals follow edits in any case
BLOCK_FILTER = "GeoPackage (*.gpkg)"
LIBRARY_SETTING = "hrsi/chip_library"  # path of the library, for all projects of the user


def show_errors(method: Callable[..., Any]) -> Callable[..., Any]:
    """Show errors of input in the panel instead of raising them."""

    @wraps(method)
    def run(self: PointsDock, *arguments: Any, **options: Any) -> Any:
        try:
            return method(self, *arguments, **options)
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
    """Displays a `PointSession` and passes the user's edits to it.

    ``canvas`` is the map of the main window, if there is one; journals of unsaved edits are below ``unsaved_root``.
    """

    adjusted = pyqtSignal(bool)  #: an adjustment has ended; whether it succeeded
    edited = pyqtSignal()  #: points or measurements have changed

    def __init__(self, parent: Any = None, canvas: Any = None, unsaved_root: str = "") -> None:
        super().__init__(tr("HRSI Points"), parent)
        self._due: QAction | None = None  # action whose key is pressed
        self.setObjectName("HrsiPoints")
        self.ui = PanelLayout(self)
        self.setWidget(self.ui)
        self.session = PointSession()
        self.points_model, self.measurements_model = PointsModel(self.session), MeasurementsModel(self.session)
        self.residuals_model = ResidualsModel(self.session)
        self.map = MapLink(canvas)
        self.unsaved_root = unsaved_root or os.path.join(QgsApplication.qgisSettingsDirPath(), "hrsi", "unsaved")
        self.keeper: Any = None  # made with the first session: it needs the engine
        self._task: BackgroundTask | None = None
        self._adjusted_in_s = 0.0  # CPU seconds of the last adjustment
        self._active: ImageView | None = None
        self.proposals: dict[str, Any] = {}  # by image: positions of the chosen point found by matching
        self._searched: list[str] = []  # images in which it is still to be searched
        self._search = QTimer(self)  # one image at a time, so that the click is shown first
        self._search.setSingleShot(True)
        self._search.timeout.connect(self._search_next)
        self._pictures: dict[Any, Any] = {}  # of the chosen point, by key
        self._failure = ""  # of the last adjustment
        self._clicked = ""  # result of the last click
        self._again = QTimer(self)  # a live adjustment waits for the end of a series of edits
        self._again.setSingleShot(True)
        self._again.setInterval(LIVE_DELAY_MS)
        self._again.timeout.connect(self._adjust_live)
        self._connect()
        self._show_views()
        self.show_session(PointSession())
        self.restore()

    def _connect(self) -> None:
        ui = self.ui
        actions = {
            ui.new: self.new, ui.open: self.open, ui.add: self.add_points, ui.remove: self.remove_point,
            ui.save: self.save, ui.save_as: self.save_as, ui.adjust: self.adjust, ui.cancel: self.cancel,
            ui.undo: self.undo, ui.redo: lambda: self.undo(again=True), ui.next: lambda: self.step_to_gap(1),
            ui.previous: lambda: self.step_to_gap(-1), ui.take: self.take_prediction,
            ui.forget: self.forget_measurement, ui.pick: self.pick_point, ui.go_to: self.go_to_place,
            ui.live: self._adjust_live, ui.tie: self.begin_tie, ui.transfer: self.transfer,
            ui.accept: lambda: self.accept_transfers(self.find_active_image()), ui.accept_all: self.accept_transfers,
            ui.reject: self.reject_transfer, ui.library: self.choose_library,
        }  # fmt: skip
        for action, slot in actions.items():
            action.triggered.connect(lambda _checked=False, slot=slot: slot())
        ui.north.toggled.connect(lambda _checked: self._show_images())
        ui.filter.activated.connect(lambda _index: self.filter_residuals())
        ui.tabs.currentChanged.connect(lambda _index: self.refresh())
        ui.tabs.currentChanged.connect(lambda _index: ui.fit_columns())
        ui.verdict.itemClicked.connect(lambda item: self.show_reason(item.data(Qt.ItemDataRole.UserRole)))
        for box in (ui.model, ui.kind):
            box.currentTextChanged.connect(lambda _text: self._store())
        ui.number.currentTextChanged.connect(lambda _text: self._show_views())
        project = QgsProject.instance()
        project.readProject.connect(self._on_project)
        project.cleared.connect(self._on_project)

    def event(self, event: QEvent) -> bool:
        """Claim the keys of the panel's actions before QGIS's own shortcuts; keys typed into a cell are not claimed."""
        if event.type() == QEvent.Type.ShortcutOverride and (action := self.ui.action_of(event)) is not None:
            event.accept()  # so that the widget with the focus gets a key press instead
            self._due = action
            QCoreApplication.instance().installEventFilter(self)
            return True
        return bool(super().event(event))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Trigger the action for the next key press, which `event` has claimed."""
        if self._due is None or event.type() != QEvent.Type.KeyPress:
            return False
        QCoreApplication.instance().removeEventFilter(self)
        action, self._due = self._due, None
        action.trigger()
        return True

    def shut_down(self) -> None:
        """Disconnect from the project and a running task before the plugin is removed; unsaved edits are kept."""
        self.cancel()
        self._task = None  # its end is ignored
        self._again.stop()
        self.map.stop()
        self.map.mark(None)
        if self.keeper is not None:
            self.keeper.leave()
        project = QgsProject.instance()
        project.readProject.disconnect(self._on_project)
        project.cleared.disconnect(self._on_project)
        for view in self.ui.views:
            view.release_images()

    def discard_edits(self) -> None:
        """Discard the unsaved edits, as the user has chosen."""
        if self.keeper is not None:
            self.keeper.discard()

    # ---- display -----------------------------------------------------------------------------------------------

    def show_session(self, session: PointSession, point: str = "") -> None:
        """Show another block instead of the present one."""
        self._again.stop()
        self.cancel()
        self._task = None
        self.session = session
        if self.keeper is None and session.images:
            self.keeper = point_session.EditJournal(self.unsaved_root)
        if self.keeper is not None:  # edits are stored in a journal
            self.keeper.follow(session)
        models = PointsModel(session), MeasurementsModel(session), ResidualsModel(session)
        self.points_model, self.measurements_model, self.residuals_model = models
        for model in models:
            model.refused.connect(lambda message: self.tell(message, is_error=True))
            model.edited.connect(self._on_edit)
        self.ui.show_models(*models)
        self.ui.points.selectionModel().currentRowChanged.connect(self._on_point)
        self.ui.residuals.selectionModel().currentRowChanged.connect(self._on_residual)
        self.ui.filter.clear()
        self.ui.filter.addItems([tr("All images"), *session.images])
        self.ui.gammas.clear()
        self._failure = ""
        self._use_library()
        self.points_model.refresh()
        self._choose_images("")
        self.choose(point or next(iter(session.points), ""))
        self.refresh()
        self.ui.fit_columns()

    def _show_views(self) -> None:
        """Show the number of images that the user has chosen."""
        for view in self.ui.show_views(int(self.ui.number.currentText())):
            view.clicked.connect(self.measure)
            view.image_chosen.connect(lambda _name, view=view: self._show_image(view))
            view.whole_asked.connect(lambda name, view=view: self._show_whole(view))
            view.canvas.zoomed.connect(lambda factor, view=view: self._zoom_others(view, factor))
        self._choose_images(self.point())
        self._show_images()
        self.activate(self.ui.views[0])

    def activate(self, view: ImageView) -> None:
        """Make a view the one on which the keyboard acts."""
        self._active = view
        for other in self.ui.views:
            other.mark_active(other is view)

    def frame_image(self, image: str) -> None:
        """Make the view of an image active; the image is shown if it was not."""
        views = self.ui.list_views()
        view = next((view for view in views if view.image() == image), views[-1])
        if view.image() != image:
            view.show_choice(list(self.session.images), image)
            self._show_image(view)
        self.activate(view)

    def choose(self, name: str) -> None:
        """Choose a point, and show its images at its measured or predicted position."""
        row = self.points_model.row_of(name)
        if row >= 0:
            self.ui.points.selectRow(row)
            self.ui.points.setCurrentIndex(self.points_model.index(row, 0))

    def point(self) -> str:
        """Return the id of the chosen point, empty if there is none."""
        return self.measurements_model.point

    def refresh(self) -> None:
        """Update tables and markers to the present session."""
        self.points_model.refresh()
        self.measurements_model.refresh()
        if self.ui.residuals.isVisible():  # sorting some ten thousand rows takes longest
            self._refresh_residuals()
        adjusted = self.session.adjusted
        stale = "" if adjusted is None or self.session.is_adjusted else tr("Before the last edits:")
        self.ui.show_verdict(adjusted, self._failure or stale)
        for view in self.ui.list_views():
            view.markers.show_markers(self._markers(view.image()))
        self.setWindowTitle(f"{tr('HRSI Points')}{' *' if self.session.changed else ''}")
        has_point = self.point() in self.session.points
        has_map = self.map.canvas is not None
        self.ui.enable(self.session, has_point, self._task is not None, has_map, bool(self.proposals))

    def tell(self, text: str, is_error: bool = False) -> None:
        self.ui.tell(text, is_error)

    def _on_point(self, index: QModelIndex, _before: QModelIndex | None = None) -> None:
        name = self.points_model.rows[index.row()].point.id if index.isValid() else ""
        self.proposals, self._searched = {}, []
        self.measurements_model.show_point(name)
        self._choose_images(name)
        self._show_images()
        point = self.session.points.get(name)
        self.map.mark((point.lon, point.lat) if point else None)
        self._store()
        self.refresh()
        self.ui.measurements.resizeColumnsToContents()  # suspicious rows have a mark before their name
        self._show_pictures()
        library, measured = self.session.library, any(other == name for other, _ in self.session.measured)
        if point is not None and library is not None and not measured and library.find_rows(point).size:
            self._clicked = tr("{} is looked for by its chips.").format(name)
            self._begin_search()

    @show_errors
    def _show_pictures(self) -> None:
        """Show photographs of the chosen point, and chips of its measurements."""
        name, before = self.point(), self._pictures
        is_listed = name in self.session.points
        self._pictures = point_session.list_pictures(self.session, name, before) if is_listed else {}
        if self._pictures != before:
            self.ui.show_pictures(self._pictures.values())

    @show_errors
    def _use_library(self) -> None:
        """Load the user's library of chips into the session, if there is one."""
        path = str(QgsSettings().value(LIBRARY_SETTING, "") or "")
        if path and self.session.images:
            self.session.library = point_session.ChipLibrary(path)

    @show_errors
    def choose_library(self, path: str = "") -> None:
        """Use a library of chips, created if missing; its GCPs in the images are added to the list."""
        how = QFileDialog.Option.DontConfirmOverwrite
        path = path or QFileDialog.getSaveFileName(
            self, tr("Chip library"), "chips.gpkg", BLOCK_FILTER, options=how
        )[0]  # fmt: skip
        if path:
            self.session.library = library = point_session.ChipLibrary(path)
            QgsSettings().setValue(LIBRARY_SETTING, path)
            if new := point_session.list_library_points(self.session):
                self.session.add_points(new)
                self._on_edit()
                self.choose(new[0].id)
            told = tr("{}: {} chips; {} of its GCPs are new in the list. Saving the block adds chips.")
            self.tell(told.format(path, len(library), len(new)))

    def _choose_images(self, name: str) -> None:
        """Show images that contain the point, those with a measurement first; no image is shown twice."""
        names, views = list(self.session.images), self.ui.list_views()
        rows = [row for row in self.session.measurements(name) if row.is_inside or row.measured] if name else []
        fitting = [row.image for row in sorted(rows, key=lambda row: row.measured is None)] if rows else names
        shown = [view.image() for view in views]
        kept = {image for image in shown if image in fitting}
        others = [image for image in names if image not in fitting]
        free = iter([*(image for image in fitting if image not in kept), *others])
        taken = set[str]()
        for view in views:
            image = view.image()
            if image not in fitting or image in taken:
                image = next(free, "")
            taken.add(image)
            view.show_choice(names if image else [], image)

    @show_errors
    def _show_images(self) -> None:
        for view in self.ui.list_views():
            self._show_image(view)

    def _show_image(self, view: ImageView) -> None:
        view.chip.clear()
        shown = self.point() in self.session.points and view.image()
        view.show_view(
            point_session.view_of(self.session, self.point(), view.image()) if shown else None,
            self._markers(view.image()), self.ui.north.isChecked(),
        )  # fmt: skip

    def _zoom_others(self, view: ImageView, factor: float) -> None:
        """Zoom the other images by the same factor."""
        for other in self.ui.list_views():
            if other is not view and self.ui.linked.isChecked():
                other.canvas.zoomByFactor(factor)

    def _show_whole(self, view: ImageView) -> None:
        if view.image() in self.session.images:
            first_sample, last_sample, first_line, last_line = self.session.images[view.image()].domain_px
            middle = ((first_sample + last_sample) / 2.0, (first_line + last_line) / 2.0)
            view.show_place(middle, ((last_sample - first_sample) / 2.0, (last_line - first_line) / 2.0))

    def _markers(self, image: str) -> list[Marker]:
        """Return the markers of all points in an image."""
        if image not in self.session.images:
            return []
        markers = []
        for name, row in self.session.on_image(image).items():
            measured = (row.measured.sample, row.measured.line) if row.measured else None
            residual = None if math.isnan(row.residual_px[0]) else row.residual_px
            states = bool(row.suspicion), self.session.points[name].role == "off", name == self.point()
            found = self.proposals.get(image) if name == self.point() else None
            proposed = found.xy if found is not None else None
            markers.append(Marker(name, row.predicted, measured, residual, *states, proposed))
        return markers

    # ---- actions of the user -----------------------------------------------------------------------------------

    @show_errors
    @one_thread_calls()  # the systems are small: BLAS threads would wait for each other
    def measure(self, image: str, sample: float, line: float, is_seen: bool = True) -> None:
        """Measure the chosen point near a position in an image, clicked (``is_seen``) or predicted."""
        view = next(view for view in self.ui.list_views() if view.image() == image)
        self.activate(view)
        if self.ui.tie.isChecked():
            self._begin_tie_at(image, (sample, line))
            return
        if self.point() not in self.session.points:
            self.tell(tr("Choose a ground point in the list first"))
            return
        kind = self.ui.kind.currentText()
        fit = self.session.measure(self.point(), image, (sample, line), kind, is_seen)
        self.proposals.pop(image, None)
        self._place_tie()
        quality = tr("as clicked") if math.isnan(sigma := fit.measured.sigma) else tr("sigma {:.2f} px").format(sigma)
        text = fit.refusal or f"{fit.measured.sample:.2f} {fit.measured.line:.2f}, {quality}"
        if not fit.refusal and fit.measured.kind != kind:
            text += tr(", for no clear closed object lies there")
        view.chip.show_chip(fit.chip_svg)
        self._clicked = tr("{} on {}: {}").format(self.point(), image, text)
        self.tell(self._clicked, is_error=bool(fit.refusal))
        self._on_edit()
        if not fit.refusal:
            self._follow_views()
            self._begin_search()

    def _follow_views(self) -> None:
        """Show the chosen point at its present predicted position in images in which it is not measured."""
        for view in self.ui.list_views():
            if view.image() in self.session.images and (self.point(), view.image()) not in self.session.measured:
                self._show_image(view)

    def _begin_search(self) -> None:
        """Search the chosen point, by matching, in all other images that should contain it, one after the other."""
        shown = [view.image() for view in self.ui.list_views()]
        rows = [row for row in self.session.measurements(self.point()) if row.is_inside and row.measured is None]
        wanted = [row.image for row in rows if row.image not in self.proposals]
        self._searched = sorted(wanted, key=lambda image: image not in shown)  # visible ones first
        self._search.start()

    def _search_next(self) -> None:
        if self._searched:
            self.transfer([self._searched.pop(0)], is_asked=False)
            self._search.start()

    def _on_edit(self) -> None:
        """Show the edit; with live residuals update these, and adjust again if that is quick."""
        if self.ui.live.isChecked():
            self._follow()
        self.refresh()
        self._show_pictures()
        if self.keeper is not None and self.keeper.failure:
            self.tell(self.keeper.failure, is_error=True)
        if self.ui.live.isChecked() and self._adjusted_in_s < QUICK_S:
            self._again.start()
        self.edited.emit()

    @show_errors
    def _follow(self) -> None:
        """Update residuals and cameras of the last adjustment to the present measurements."""
        if self.session.adjusted is not None:
            self.session.follow(point_session.follow(self.session))

    def begin_tie(self) -> None:
        """Start a tie point with the next click in an image."""
        if self.ui.tie.isChecked():
            self.tell(tr("Click in an image on what the other images show too: a new tie point"))

    def _begin_tie_at(self, image: str, click: tuple[float, float]) -> None:
        self.ui.tie.setChecked(False)
        fit = self.session.fit(image, click, self.ui.kind.currentText())
        if fit.refusal:
            self.tell(tr("tie point on {}: {}").format(image, fit.refusal), is_error=True)
            return
        name = self._new_name("T")
        tie = point_session.new_tie(self.session, name, image, (fit.measured.sample, fit.measured.line))
        self.session.add_tie(tie, image, fit.measured)
        self._on_edit()
        self.choose(name)
        self._clicked = name
        self._begin_search()

    def _new_name(self, letter: str) -> str:
        """Return an id that is neither in the list nor among the tie points in the background."""
        ties = self.session.ties
        taken = set(self.session.points) | set([] if ties is None else ties.ids.tolist())
        return next(name for name in (f"{letter}{number}" for number in itertools.count(1)) if name not in taken)

    def _place_tie(self) -> None:
        """Move the chosen point, if it is a tie point, to the present intersection of its rays."""
        point = self.session.points.get(self.point())
        if point is not None and point.role == TIE:
            self.session.move_point(point_session.place_tie(self.session, point.id))

    @show_errors
    def transfer(self, images: Sequence[str] = (), is_asked: bool = True) -> None:
        """Search the chosen point by matching in images (default: all) that should contain it; propose positions."""
        found = point_session.find_transfers(self.session, self.point(), images)
        self.proposals |= {image: one for image, one in found.items() if not one.refusal}
        for view in self.ui.list_views():
            if view.image() in found:
                if view.image() in self.proposals:
                    view.show_place(self.proposals[view.image()].xy, (PANEL.half_view_px, PANEL.half_view_px))
                view.markers.show_markers(self._markers(view.image()))
        self.ui.enable_answers(bool(self.proposals))
        if is_asked:
            self.find_active_image()
        keys = tr("Y takes what was found in the framed view, Shift+Y all, X refuses it.") if self.proposals else ""
        if not is_asked:
            self.tell(f"{self._clicked}  {keys}")
            return
        good = tr("found, correlation {:.2f}")
        said = ";  ".join(f"{image}: {one.refusal or good.format(one.correlation)}" for image, one in found.items())
        self.tell(f"{self.point()}  {keys}  {said or tr('no other image should show it')}")

    def find_active_image(self) -> str:
        """Return the image of the proposal that is answered next, and make its view active; empty if there is none."""
        waiting = [view for view in self.ui.list_views() if view.image() in self.proposals]
        if waiting and self._active not in waiting:
            self.activate(waiting[0])
        return self._active_image() if waiting else ""

    @show_errors
    def accept_transfers(self, image: str | None = None) -> None:
        """Accept the proposals of all images, or of one."""
        found = {name: one for name, one in self.proposals.items() if image in (None, name)}
        if not found:
            return
        self.session.accept_transfers(self.point(), found)
        self.proposals = {name: one for name, one in self.proposals.items() if name not in found}
        self._place_tie()
        self._on_edit()
        said = tr("{} measured on {}").format(self.point(), ", ".join(found))
        if not self.proposals and not self._searched and image is None:  # on to the next point
            self.step_to_gap(1)
        self.tell(said)

    def reject_transfer(self) -> None:
        """Reject the proposal in the active view."""
        image = self.find_active_image()
        if self.proposals.pop(image, None) is not None:
            self.tell(tr("{} on {}: refused; click where it is, or leave it").format(self.point(), image))
            self.refresh()

    @show_errors
    def take_prediction(self) -> None:
        """Measure the chosen point at its predicted position in the active view, as if it had been clicked there."""
        if (image := self._active_image()) in self.session.images:
            self.measure(image, *self.session.predict_place(self.point(), image), is_seen=False)

    @show_errors
    def forget_measurement(self) -> None:
        """Remove the measurement of the chosen point in the active view."""
        if image := self._active_image():
            self.session.remove_measurement(self.point(), image)
            self._place_tie()
            self._on_edit()

    def _active_image(self) -> str:
        """Return the image of the active view, empty if there is none."""
        return self._active.image() if self._active is not None else ""

    def undo(self, again: bool = False) -> None:
        """Undo the last edit, or with ``again`` redo the one undone last."""
        if title := self.session.redo() if again else self.session.undo():
            if self.point() not in self.session.points:
                self.measurements_model.show_point("")
            self.tell(f"{title}: {tr('done again') if again else tr('taken back')}")
            self._on_edit()

    def step_to_gap(self, step: int) -> None:
        """Choose the next point (``step`` -1: the previous one) that is not measured in all images that contain it."""
        self.choose(self.session.find_next_gap(self.point(), step))
        views = [view for view in self.ui.list_views() if view.image() in self.session.images]
        gaps = [view for view in views if (self.point(), view.image()) not in self.session.measured]
        if gaps:
            self.activate(gaps[0])

    # ---- residuals and verdict ---------------------------------------------------------------------------------

    def _refresh_residuals(self) -> None:
        """Show the present residuals, with the row of the chosen point and active image selected."""
        model, table = self.residuals_model, self.ui.residuals
        model.refresh()
        self.ui.rmse.setText("\n".join(point_session.summarise_roles(self.session)))
        row, selection = model.row_of(self.point(), self._active_image()), table.selectionModel()
        if selection is not None and row != table.currentIndex().row():
            selection.blockSignals(True)  # it is chosen already
            table.setCurrentIndex(model.index(row, 0))
            selection.blockSignals(False)
            table.viewport().update()

    def _on_residual(self, index: QModelIndex, _before: QModelIndex | None = None) -> None:
        """Show the point of a residual, with its image active."""
        if index.isValid():
            row = self.residuals_model.rows[index.row()]
            self.choose(row.point.id)
            self.frame_image(row.image)

    def filter_residuals(self) -> None:
        """Show the residuals of the chosen image, or all."""
        box = self.ui.filter
        self.residuals_model.show_only([box.currentText()] if box.currentIndex() > 0 else [])

    def show_reason(self, reason: Any) -> None:
        """Show the residuals of the images and points of a reason of the verdict, and the worst of these points."""
        if reason is None or not (reason.points or reason.images):
            return
        self.ui.filter.setCurrentIndex(-1)
        self.ui.tabs.setCurrentIndex(1)
        self.residuals_model.show_only(reason.images, reason.points)
        if self.residuals_model.rows:
            self._on_residual(self.residuals_model.index(0, 0))
        elif reason.points:
            self.choose(reason.points[0])

    def pick_point(self) -> None:
        """Ask for a position on the map, and add a ground point there."""
        text = tr("Click in the map where the new point is")
        self._ask_map(self.ui.pick, self.ui.go_to, text, self._add_point_at)

    def go_to_place(self) -> None:
        """Ask for positions on the map, and show them in all images."""
        text = tr("Click in the map: the images show that place, at the points' middle height")
        self._ask_map(self.ui.go_to, self.ui.pick, text, self._show_ground)

    def _ask_map(self, asked: QAction, other: QAction, text: str, told: Callable[[tuple[float, float]], None]) -> None:
        other.setChecked(False)
        if asked.isChecked():
            self.tell(text)
            self.map.ask(told)
        else:
            self.map.stop()

    @show_errors
    def _add_point_at(self, lonlat: tuple[float, float]) -> None:
        dialog = NewPointDialog(lonlat, self._new_name("P"), self.session.middle_height_m(), self)
        if dialog.exec() and dialog.point().id:
            self.session.add_points([dialog.point()])
            self._on_edit()
            self.choose(dialog.point().id)

    def _show_ground(self, lonlat: tuple[float, float]) -> None:
        height = self.session.middle_height_m()
        for view in self.ui.list_views():
            if view.image():
                view.show_place(point_session.place_on(self.session, view.image(), lonlat, height))

    @show_errors
    def new(self) -> None:
        """Create a block with images and points."""
        dialog = NewBlockDialog(self)
        if self.may_leave() and dialog.exec():
            self.show_session(point_session.new_session(**dialog.sources()))
            self._show_measurements()

    @show_errors
    def open(self, path: str = "") -> None:
        """Open the GeoPackage of a block."""
        path = path or QFileDialog.getOpenFileName(self, tr("Open block"), "", BLOCK_FILTER)[0]
        if path and self.may_leave():
            self._open(path)

    @show_errors
    def add_points(self) -> None:
        """Add the ground points of a layer of the project."""
        layers = [one for one in QgsProject.instance().mapLayers().values() if isinstance(one, QgsVectorLayer)]
        names = [layer.name() for layer in layers]
        name, chosen = QInputDialog.getItem(self, tr("Add ground points"), tr("Layer or file"), names, 0, True)
        if chosen and name:
            field = LayerOrFile()
            field.box.setEditText(name)
            context = QgsProcessingContext()
            context.setProject(QgsProject.instance())
            source = point_source(field.value(), "gcps", context, QgsProcessingFeedback())
            self.session.add_points(point_session.read_ground_points(source))
            self._on_edit()

    @show_errors
    def remove_point(self) -> None:
        """Remove the chosen point with its measurements."""
        row = self.points_model.row_of(self.point())
        self.session.remove_point(self.point())
        self.measurements_model.show_point("")
        self._on_edit()
        names = list(self.session.points)
        self.choose(names[min(row, len(names) - 1)] if names else "")

    def save(self) -> bool:
        """Save the block; return True if it was saved."""
        return bool(self.save_as(self.session.path))

    @show_errors
    def save_as(self, path: str = "") -> bool:
        """Save the block under a path, for which the user is asked if it is empty; return True if it was saved."""
        path = path or QFileDialog.getSaveFileName(self, tr("Save block"), "block.gpkg", BLOCK_FILTER)[0]
        if path:
            point_session.save(self.session, path)
            self._after_save()
        return bool(path)

    def _after_save(self) -> None:
        self.tell(tr("saved: {}").format(self.session.path))
        self.refresh()
        self._store()
        for layer in QgsProject.instance().mapLayers().values():  # the map shows the new rows
            if isinstance(layer, QgsVectorLayer) and layer.source().startswith(self.session.path):
                layer.dataProvider().reloadData()
                layer.loadDefaultStyle()
                layer.triggerRepaint()
        if (count := point_session.save_chips(self.session)) and self.session.library is not None:
            self.tell(tr("saved: {}; {} chips added to {}").format(self.session.path, count, self.session.library.path))

    @show_errors
    def adjust(self, save: bool = True) -> None:
        """Adjust the block in the background; `adjusted` is emitted at the end.

        save : the user has requested it: the result is shown as a message, and the block is saved if it has a file
        """
        if self._task is not None:
            return
        session, model, block = self.session, self.ui.model.currentText(), point_session.block_of(self.session)
        adjust = partial(point_session.adjust_block, block, model, listed=frozenset(session.points))

        def work(progress: Progress) -> Any:
            began_s = time.thread_time()
            adjusted = adjust(progress=progress)
            self._adjusted_in_s = time.thread_time() - began_s
            return adjusted

        on_end = partial(self._on_adjustment_end, point_session.Snapshot(session), save)
        task = BackgroundTask(tr("HRSI: adjusting the block"), work, on_end)
        task.progressChanged.connect(self.ui.show_progress)
        self._task = task
        self.refresh()
        if save:
            self.tell(tr("adjusting …"))
        task.start()

    def _adjust_live(self) -> None:
        """Adjust again if the measurements have changed since the last adjustment and none is running."""
        if self.ui.live.isChecked() and self._task is None and self.session.measured and not self.session.is_adjusted:
            self.adjust(save=False)

    def _show_measurements(self) -> None:
        """Adjust a block that has measurements, to show residuals and predict with adjusted cameras."""
        if self.session.measured:
            self.adjust(save=False)

    def is_adjusting(self) -> bool:
        return self._task is not None

    def cancel(self) -> None:
        """Ask a running adjustment to stop."""
        if self._task is not None:
            self._task.cancel()

    @show_errors
    def _on_adjustment_end(self, seen: Any, is_asked: bool, task: BackgroundTask) -> None:
        """Show the adjustment of the state ``seen`` at its start."""
        if task is not self._task:
            return
        self._task = None
        self.ui.show_progress(0.0)
        if task.outcome is None:
            self._failure = task.failure
            if is_asked or not task.failure:  # live adjustments fail until enough is measured
                self.tell(task.failure or tr("cancelled"), is_error=bool(task.failure))
        else:
            self._failure = ""
            self.session.accept(task.outcome, seen)
            if is_asked and self.session.path and self.session.is_adjusted:
                point_session.save(self.session)
                self._after_save()
            if is_asked:
                self.tell(task.outcome.told, is_error=task.outcome.verdict.level is Level.UNUSABLE)
            if self.ui.live.isChecked() and not self.session.is_adjusted:
                self._on_edit()
        self.refresh()
        self.ui.fit_columns()
        self.adjusted.emit(task.outcome is not None)

    # ---- project -----------------------------------------------------------------------------------------------

    def restore(self) -> None:
        """Show the block that the project refers to, if there is one."""
        self._show_state(restore_state(QgsProject.instance()))

    @show_errors
    def _show_state(self, state: PanelState) -> None:
        self.ui.model.setCurrentText(state.model)
        self.ui.kind.setCurrentText(state.kind)
        if state.path and state.path != self.session.path:
            self._open(state.path, state.point)
            self.ui.model.setCurrentText(state.model)

    def _open(self, path: str, point: str = "") -> None:
        self.show_session(point_session.open_block(path), point)
        if self.ui.model.findText(self.session.model) >= 0:
            self.ui.model.setCurrentText(self.session.model)
        numbers = len(self.session.points), len(self.session.images)
        self.tell(tr("{} points, {} images: {}").format(*numbers, path))
        self._store()
        self._show_measurements()

    def _on_project(self, _document: Any = None) -> None:
        """Show the block of another project; unsaved measurements remain unless the user discards them."""
        state = restore_state(QgsProject.instance())  # now: saving writes the old block's path into the project
        if self.session.changed:
            if not state.path or state.path == self.session.path or not self.may_leave():
                self.tell(tr("the measurements of the block before are still here; they are not saved yet"))
                return
        elif not state.path:
            self.show_session(PointSession())
        self._show_state(state)

    # ---- unsaved sessions --------------------------------------------------------------------------------------

    def find_journals(self) -> list[Any]:
        """Return the unsaved sessions of programs that have ended; quick if there is no folder of journals."""
        return point_session.find_journals(self.unsaved_root) if os.path.isdir(self.unsaved_root) else []

    @show_errors
    def recover(self, unsaved: Any) -> None:
        """Continue an unsaved session of another program."""
        self.show()
        if self.may_leave():
            last, _image = next(reversed(unsaved.measured), ("", ""))
            self.show_session(point_session.recover(unsaved), last)  # from now on it has its own journal
            point_session.forget(unsaved)
            self.tell(tr("{} measurements are back; save them").format(len(self.session.measured)))
            self._show_measurements()

    def _store(self) -> None:
        if self.session.path:
            state = PanelState(self.session.path, self.ui.model.currentText(), self.ui.kind.currentText(), self.point())
            store(state, QgsProject.instance())

    def may_leave(self) -> bool:
        """Ask whether unsaved measurements are saved or discarded; return False to cancel."""
        if not self.session.changed:
            return True
        buttons = QMessageBox.StandardButton
        answer = QMessageBox.question(
            self, tr("HRSI Points"), tr("Save the measurements of this block first?"),
            buttons.Save | buttons.Discard | buttons.Cancel,
        )  # fmt: skip
        return answer == buttons.Discard or (answer == buttons.Save and bool(self.save()))
