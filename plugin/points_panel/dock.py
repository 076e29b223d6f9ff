"""The dock "HRSI Points": a session, its tables and images, and the slots of the actions."""

from __future__ import annotations

import math
import os
from typing import Any

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QEvent, QModelIndex, Qt, pyqtSignal
from qgis.PyQt.QtWidgets import QDockWidget

from ...hrsi_engine.foundation.reasons import Level
from ...hrsi_engine.foundation.workers.threads import one_thread_calls
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from ...processing_algorithms.point_session.rows import TIE
from ..background_task import BackgroundTask
from ..translation import tr
from .actions import ShortcutMap, show_errors
from .block_files import BlockFiles
from .layout import PanelLayout, describe_missing_check
from .live_adjustment import LiveAdjustment
from .project_link import MapLink
from .table_models import MeasurementsModel, PointsModel, ResidualsModel
from .transfer_search import TransferSearch

TITLE_BAR_PX = 30  # of a window


class PointsDock(QDockWidget):
    """Displays a `PointSession` and passes the user's edits to it.

    ``canvas`` is the map of the main window, if there is one; journals of unsaved edits are below ``unsaved_root``.
    """

    adjusted = pyqtSignal(bool)  #: an adjustment has ended; whether it succeeded
    edited = pyqtSignal()  #: points or measurements have changed

    _shortcuts: ShortcutMap | None = None  # events come before it

    def __init__(self, parent: Any = None, canvas: Any = None, unsaved_root: str = "") -> None:
        super().__init__(tr("HRSI Points"), parent)
        self.setObjectName("HrsiPoints")
        self.ui = PanelLayout(self)
        self.setWidget(self.ui)
        self.session = PointSession()
        self.points_model, self.measurements_model = PointsModel(self.session), MeasurementsModel(self.session)
        self.residuals_model = ResidualsModel(self.session)
        self.map = MapLink(self, canvas)
        self.unsaved_root = unsaved_root or os.path.join(QgsApplication.qgisSettingsDirPath(), "hrsi", "unsaved")
        self.keeper: Any = None  # made with the first session: it needs the engine
        self.files = BlockFiles(self)
        self.adjustment, self.search = LiveAdjustment(self), TransferSearch(self)
        self.ui.grid.proposals = self.search.proposals
        self._pictures: dict[Any, Any] = {}  # of the chosen point, by key
        self._clicked = ""  # result of the last click
        self._connect()
        self.ui.grid.set_number(int(self.ui.number.currentText()))
        self.show_session(PointSession())
        self.files.restore()

    def _connect(self) -> None:
        """Connect actions and signals of the widgets with the slots."""
        ui, grid, files = self.ui, self.ui.grid, self.files
        actions = {
            ui.new: files.new, ui.open: files.open, ui.add: files.add_points, ui.remove: self.remove_point,
            ui.save: files.save, ui.save_as: files.save_as, ui.adjust: self.adjust, ui.cancel: self.adjustment.cancel,
            ui.undo: self.undo, ui.redo: lambda: self.undo(again=True), ui.next: lambda: self.step_to_gap(1),
            ui.previous: lambda: self.step_to_gap(-1), ui.take: self.take_prediction,
            ui.forget: self.forget_measurement, ui.pick: self.map.pick_point, ui.go_to: self.map.go_to_place,
            ui.live: self._adjust_live, ui.tie: self.begin_tie, ui.transfer: self.transfer,
            ui.accept: lambda: self.accept_transfers(grid.activate_proposal()), ui.accept_all: self.accept_transfers,
            ui.reject: self.reject_transfer, ui.library: files.choose_library,
        }  # fmt: skip
        for action, slot in actions.items():
            action.triggered.connect(lambda _checked=False, slot=slot: slot())
        self._shortcuts = ShortcutMap(self, actions)
        ui.north.toggled.connect(grid.set_north_up)
        ui.linked.toggled.connect(grid.link_zoom)
        ui.filter.activated.connect(lambda _index: self.filter_residuals())
        ui.tabs.currentChanged.connect(lambda _index: self.refresh())
        ui.tabs.currentChanged.connect(lambda _index: ui.fit_columns())
        ui.verdict.itemClicked.connect(lambda item: self.show_reason(item.data(Qt.ItemDataRole.UserRole)))
        for box in (ui.model, ui.kind):
            box.currentTextChanged.connect(lambda _text: self.files.store())
        ui.number.currentTextChanged.connect(lambda text: grid.set_number(int(text)))
        grid.clicked.connect(self.measure)
        self.search.due.connect(self._search_image)
        self.adjustment.due.connect(self._adjust_live)
        self.adjustment.progressed.connect(ui.show_progress)
        self.adjustment.ended.connect(self._on_adjustment_end)

    def open_as_window(self) -> None:
        """Make the panel a window of its own, nearly as large as the screen, and hide it until it is asked for.

        Docked in a common window, three images have a fifth of this size.
        """
        self.setFloating(True)
        free = self.screen().availableGeometry()
        self.setGeometry(free.adjusted(0, TITLE_BAR_PX, 0, 0))
        self.hide()

    def event(self, event: QEvent) -> bool:
        is_claimed = self._shortcuts is not None and self._shortcuts.claim(event)
        return is_claimed or bool(super().event(event))

    def shut_down(self) -> None:
        """Disconnect from the project and a running task before the plugin is removed; unsaved edits are kept."""
        self.adjustment.watch(PointSession())
        self.map.stop()
        self.map.mark(None)
        if self.keeper is not None:
            self.keeper.leave()
        self.files.disconnect_project()
        self.ui.grid.release_images()

    def discard_edits(self) -> None:
        """Discard the unsaved edits, as the user has chosen."""
        if self.keeper is not None:
            self.keeper.discard()

    # ---- display -----------------------------------------------------------------------------------------------

    def show_session(self, session: PointSession, point: str = "") -> None:
        """Show another block instead of the present one."""
        self.adjustment.watch(session)
        self.search.show_point(session, "")
        self.session = session
        if self.keeper is None and session.images:
            self.keeper = point_session.EditJournal(self.unsaved_root)
        if self.keeper is not None:  # edits are stored in a journal
            self.keeper.follow(session)
        models = PointsModel(session), MeasurementsModel(session), ResidualsModel(session)
        self.points_model, self.measurements_model, self.residuals_model = models
        for model in models:
            model.refused.connect(lambda message: self.tell(message, is_error=True))
            model.edited.connect(self.show_edit)
        self.ui.show_models(*models)
        self.ui.points.selectionModel().currentRowChanged.connect(self._on_point)
        self.ui.residuals.selectionModel().currentRowChanged.connect(self._on_residual)
        self.ui.filter.clear()
        self.ui.filter.addItems([tr("All images"), *session.images])
        self.files.use_library()
        self.points_model.refresh()
        self.ui.grid.show_session(session)
        self.choose(point or next(iter(session.points), ""))
        self.refresh()
        self.ui.fit_columns()

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
        self.ui.show_verdict(adjusted, self.adjustment.failure or stale)
        self.ui.grid.refresh()
        self.setWindowTitle(f"{tr('HRSI Points')}{' *' if self.session.changed else ''}")
        has_point, is_running = self.point() in self.session.points, self.adjustment.is_running()
        self.ui.enable(self.session, has_point, is_running, self.map.canvas is not None, bool(self.search.proposals))

    def tell(self, text: str, is_error: bool = False) -> None:
        self.ui.tell(text, is_error)

    def _on_point(self, index: QModelIndex, _before: QModelIndex | None = None) -> None:
        self._show_point(self.points_model.rows[index.row()].point.id if index.isValid() else "")

    def _show_point(self, name: str, clicked: str = "") -> None:
        """Show a point in tables, images and on the map; the image in which it was ``clicked`` does not move."""
        self.search.show_point(self.session, name)
        self.measurements_model.show_point(name)
        self.ui.grid.show_point(name, clicked)
        point = self.session.points.get(name)
        self.map.mark((point.lon, point.lat) if point else None)
        self.files.store()
        self.refresh()
        self.ui.measurements.resizeColumnsToContents()  # suspicious rows have a mark before their name
        self._show_pictures()
        library, measured = self.session.library, any(other == name for other, _ in self.session.measured)
        if point is not None and library is not None and not measured and library.find_rows(point).size:
            self._clicked = tr("Searching for {} by its chips.").format(name)
            self.search.begin(self.ui.grid.list_images())

    @show_errors
    def _show_pictures(self) -> None:
        """Show photographs of the chosen point, and chips of its measurements."""
        name, before = self.point(), self._pictures
        is_listed = name in self.session.points
        self._pictures = point_session.list_pictures(self.session, name, before) if is_listed else {}
        if self._pictures != before:
            self.ui.show_pictures(self._pictures.values())

    # ---- actions of the user -----------------------------------------------------------------------------------

    @show_errors
    @one_thread_calls()  # the systems are small: BLAS threads would wait for each other
    def measure(self, image: str, sample: float, line: float, is_seen: bool = True) -> None:
        """Measure the chosen point near a position in an image, clicked (``is_seen``) or predicted."""
        view = self.ui.grid.find_view(image)
        self.ui.grid.activate(view)
        if self.ui.tie.isChecked():
            self._begin_tie_at(image, (sample, line))
            return
        if self.point() not in self.session.points:
            self.tell(tr("Choose a ground point in the list first"))
            return
        kind = self.ui.kind.currentText()
        fit = self.session.measure(self.point(), image, (sample, line), kind, is_seen)
        self.search.reject(image)
        self._place_tie()
        quality = tr("as clicked") if math.isnan(sigma := fit.measured.sigma) else tr("sigma {:.2f} px").format(sigma)
        text = fit.refusal or f"{fit.measured.sample:.2f} {fit.measured.line:.2f}, {quality}"
        if not fit.refusal and fit.measured.kind != kind:
            text += tr("; no closed target here, clicked position used")
        if view is not None:
            view.show_fit(fit.chip_svg, self.session.measured.get((self.point(), image)))
        self._clicked = tr("{} on {}: {}").format(self.point(), image, text)
        self.tell(self._clicked, is_error=bool(fit.refusal))
        self.show_edit()
        if not fit.refusal:
            self.search.begin(self.ui.grid.list_images())

    @show_errors
    def show_edit(self) -> None:
        """Show the edit; with live residuals update these, and adjust again if that is quick."""
        try:
            if self.ui.live.isChecked():
                self.adjustment.follow_edit()
        finally:  # also if the edited measurements do not determine the cameras
            self.refresh()
            self._show_pictures()
            if self.keeper is not None and self.keeper.failure:
                self.tell(self.keeper.failure, is_error=True)
            self.edited.emit()

    def begin_tie(self) -> None:
        """Start a tie point with the next click in an image."""
        if self.ui.tie.isChecked():
            self.tell(tr("Click in an image on a detail that the other images show too: it becomes a tie point"))

    def _begin_tie_at(self, image: str, click: tuple[float, float]) -> None:
        """Enter a tie point at a click, choose it, and search it in the other images; the clicked one does not move."""
        self.ui.tie.setChecked(False)
        fit = self.session.fit(image, click, self.ui.kind.currentText())
        if fit.refusal:
            self.tell(tr("tie point on {}: {}").format(image, fit.refusal), is_error=True)
            return
        name = self.session.find_free_id("T")
        tie = point_session.new_tie(self.session, name, image, (fit.measured.sample, fit.measured.line))
        self.session.add_tie(tie, image, fit.measured)
        self.show_edit()
        selection = self.ui.points.selectionModel()
        selection.blockSignals(True)  # the image of the click does not move
        self.choose(name)
        selection.blockSignals(False)
        self.ui.points.viewport().update()
        self._show_point(name, image)
        self._clicked = name
        self.search.begin(self.ui.grid.list_images())

    def _place_tie(self) -> None:
        """Move the chosen point, if it is a tie point, to the present intersection of its rays."""
        point = self.session.points.get(self.point())
        if point is not None and point.role == TIE:
            self.session.move_point(point_session.place_tie(self.session, point.id))

    @show_errors
    def transfer(self) -> None:
        """Search the chosen point by matching in all images that should contain it, and show what is found."""
        results = self.search.find()
        self.ui.grid.show_proposals()
        self.ui.grid.activate_proposal()
        self.refresh()
        good = tr("found, correlation {:.2f}")
        lines = [f"{image}: {one.refusal or good.format(one.correlation)}" for image, one in results.items()]
        self.tell(
            f"{self.point()}  {self._describe_keys()}  {';  '.join(lines) or tr('no other image contains this point')}"
        )

    @show_errors
    def _search_image(self, image: str) -> None:
        """Search the chosen point in one image."""
        self.search.find([image])
        self.ui.grid.refresh()
        self.ui.enable_answers(bool(self.search.proposals))
        self.tell(f"{self._clicked}  {self._describe_keys()}")

    def _describe_keys(self) -> str:
        """Return the keys that answer the proposals, and where some are not in view."""
        if not self.search.proposals:
            return ""
        text = tr("Y accepts the match in the framed view, Shift+Y all matches, X rejects it.")
        hidden = ", ".join(self.ui.grid.list_hidden_proposals())
        return f"{text} {tr('Not in view: {}; M shows it.').format(hidden)}" if hidden else text

    @show_errors
    def accept_transfers(self, image: str | None = None) -> None:
        """Accept the proposals of all images, or of one."""
        if not (accepted := self.search.accept(image)):
            return
        text = tr("{} measured on {}").format(self.point(), ", ".join(accepted))
        self._place_tie()
        self.show_edit()
        if image is None and not self.search.is_running():  # on to the next point
            self.step_to_gap(1)
        self.tell(text)

    def reject_transfer(self) -> None:
        """Reject the proposal in the active view."""
        image = self.ui.grid.activate_proposal()
        if self.search.reject(image):
            self.tell(tr("{} on {}: match rejected; click on the point, or leave it out").format(self.point(), image))
            self.refresh()

    @show_errors
    def take_prediction(self) -> None:
        """Measure the chosen point at its predicted position in the active view, as if it had been clicked there."""
        if (image := self.ui.grid.active_image()) in self.session.images:
            self.measure(image, *self.session.predict_place(self.point(), image), is_seen=False)

    @show_errors
    def forget_measurement(self) -> None:
        """Remove the measurement of the chosen point in the active view."""
        if image := self.ui.grid.active_image():
            self.session.remove_measurement(self.point(), image)
            self._place_tie()
            self.show_edit()

    def undo(self, again: bool = False) -> None:
        """Undo the last edit, or with ``again`` redo the one undone last."""
        if title := self.session.history.redo() if again else self.session.history.undo():
            if self.point() not in self.session.points:
                self.measurements_model.show_point("")
            self.tell(f"{title}: {tr('redone') if again else tr('undone')}")
            self.show_edit()

    def step_to_gap(self, step: int) -> None:
        """Choose the next point (``step`` -1: the previous one) that is not measured in all images that contain it."""
        self.choose(self.session.find_next_gap(self.point(), step))
        self.ui.grid.activate_gap()

    # ---- residuals and verdict ---------------------------------------------------------------------------------

    def _refresh_residuals(self) -> None:
        """Show the present residuals, with the row of the chosen point and active image selected."""
        model, table = self.residuals_model, self.ui.residuals
        model.refresh()
        self.ui.rmse.setText("\n".join(point_session.summarise_roles(self.session)))
        row, selection = model.row_of(self.point(), self.ui.grid.active_image()), table.selectionModel()
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
            self.ui.grid.frame_image(row.image)

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

    @show_errors
    def remove_point(self) -> None:
        """Remove the chosen point with its measurements."""
        row = self.points_model.row_of(self.point())
        self.session.remove_point(self.point())
        self.measurements_model.show_point("")
        self.show_edit()
        names = list(self.session.points)
        self.choose(names[min(row, len(names) - 1)] if names else "")

    @show_errors
    def adjust(self, is_asked: bool = True) -> None:
        """Adjust the block in the background; `adjusted` is emitted at the end.

        is_asked : the user has requested it: the result is shown as a message, and the block is saved if it has a file
        """
        self.adjustment.start(self.ui.model.currentText(), is_asked)
        self.refresh()
        if is_asked:
            self.tell(tr("adjusting …"))

    def _adjust_live(self) -> None:
        """Adjust again if the measurements have changed since the last adjustment and none is running."""
        if self.ui.live.isChecked() and self.adjustment.is_needed():
            self.adjust(is_asked=False)

    def adjust_measurements(self) -> None:
        """Adjust a block that has measurements, to show residuals and predict with adjusted cameras."""
        if self.session.measured:
            self.adjust(is_asked=False)

    @show_errors
    def _on_adjustment_end(self, task: BackgroundTask, is_asked: bool) -> None:
        """Show an adjustment, or why there is none."""
        self.ui.show_progress(0.0)
        if task.outcome is None:
            if is_asked or not task.failure:  # live adjustments fail until enough is measured
                self.tell(task.failure or tr("cancelled"), is_error=bool(task.failure))
        else:
            if is_asked and self.session.path and self.session.is_adjusted:
                point_session.save(self.session)
                self.files.show_save()
            if is_asked:
                unchecked = describe_missing_check(task.outcome) if task.outcome.verdict.level is Level.OK else ""
                text = f"{unchecked}; {tr('measure more GCPs, or a check point')}" if unchecked else ""
                self.tell(text or task.outcome.headline, is_error=task.outcome.verdict.level is Level.UNUSABLE)
            if self.ui.live.isChecked() and not self.session.is_adjusted:
                self.show_edit()
        self.refresh()
        self.ui.fit_columns()
        self.adjusted.emit(task.outcome is not None)
