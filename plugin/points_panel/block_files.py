"""The panel's block as a file: new, opened, saved; in the project; recovered after a crash; and the chip library."""

import os
from typing import Any

from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProject, QgsSettings, QgsVectorLayer
from qgis.PyQt.QtWidgets import QFileDialog, QInputDialog, QMessageBox

from ...processing_algorithms import point_session
from ...processing_algorithms.point_session import PointSession
from ..dialog_fields import LayerOrFile
from ..layer_sources import point_source
from ..translation import tr
from .actions import show_errors
from .dialogs import NewBlockDialog
from .project_link import PanelState, restore_state, store

BLOCK_FILTER, BLOCK_SUFFIX = "GeoPackage (*.gpkg)", ".gpkg"
LIBRARY_SETTING = "hrsi/chip_library"  # path of the library, for all projects of the user


class BlockFiles:
    """Opens and saves the block that a `PointsDock` shows."""

    def __init__(self, dock: Any) -> None:
        self.dock = dock
        project = QgsProject.instance()
        project.readProject.connect(self._on_project)
        project.cleared.connect(self._on_project)

    def tell(self, text: str, is_error: bool = False) -> None:
        self.dock.tell(text, is_error)

    def disconnect_project(self) -> None:
        project = QgsProject.instance()
        project.readProject.disconnect(self._on_project)
        project.cleared.disconnect(self._on_project)

    @show_errors
    def use_library(self) -> None:
        """Load the user's library of chips into the session, if there is one."""
        path = str(QgsSettings().value(LIBRARY_SETTING, "") or "")
        if path and self.dock.session.images:
            self.dock.session.library = point_session.ChipLibrary(path)

    @show_errors
    def choose_library(self, path: str = "") -> None:
        """Use a library of chips, created if missing; its GCPs in the images are added to the list."""
        how = QFileDialog.Option.DontConfirmOverwrite
        path = (
            path
            or QFileDialog.getSaveFileName(self.dock, tr("Chip library"), "chips.gpkg", BLOCK_FILTER, options=how)[0]
        )
        if path:
            self.dock.session.library = library = point_session.ChipLibrary(path)
            QgsSettings().setValue(LIBRARY_SETTING, path)
            if new := point_session.list_library_points(self.dock.session):
                self.dock.session.add_points(new)
                self.dock.show_edit()
                self.dock.choose(new[0].id)
            text = tr("{}: {} chips; {} of its GCPs are new in the list. Saving the block adds chips.")
            self.tell(text.format(path, len(library), len(new)))

    @show_errors
    def new(self) -> None:
        """Create a block with images and points."""
        dialog = NewBlockDialog(self.dock)
        if self.may_leave() and dialog.exec():
            self.dock.show_session(point_session.new_session(**dialog.sources()))
            self.dock.adjust_measurements()

    @show_errors
    def open(self, path: str = "") -> None:
        """Open the GeoPackage of a block."""
        path = path or QFileDialog.getOpenFileName(self.dock, tr("Open block"), "", BLOCK_FILTER)[0]
        if path and self.may_leave():
            self._open(path)

    @show_errors
    def add_points(self) -> None:
        """Add the ground points of a layer of the project."""
        layers = [one for one in QgsProject.instance().mapLayers().values() if isinstance(one, QgsVectorLayer)]
        names = [layer.name() for layer in layers]
        name, chosen = QInputDialog.getItem(self.dock, tr("Add ground points"), tr("Layer or file"), names, 0, True)
        if chosen and name:
            field = LayerOrFile()
            field.box.setEditText(name)
            context = QgsProcessingContext()
            context.setProject(QgsProject.instance())
            source = point_source(field.value(), "gcps", context, QgsProcessingFeedback())
            self.dock.session.add_points(point_session.read_ground_points(source))
            self.dock.show_edit()

    def save(self) -> bool:
        """Save the block; return True if it was saved."""
        return bool(self.save_as(self.dock.session.path))

    @show_errors
    def save_as(self, path: str = "") -> bool:
        """Save the block under a path, for which the user is asked if it is empty; return True if it was saved."""
        if not path:
            dialog = QFileDialog(self.dock, tr("Save block"), "", BLOCK_FILTER)
            dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
            dialog.setDefaultSuffix(BLOCK_SUFFIX)
            dialog.selectFile("block.gpkg")
            path = dialog.selectedFiles()[0] if dialog.exec() else ""
        if path:
            point_session.save(self.dock.session, path if path.lower().endswith(BLOCK_SUFFIX) else path + BLOCK_SUFFIX)
            self.show_save()
        return bool(path)

    def show_save(self) -> None:
        """Show the message that the block is saved, and its rows on the map; add new chips to the library."""
        self.tell(tr("saved: {}").format(self.dock.session.path))
        self.dock.refresh()
        self.store()
        for layer in QgsProject.instance().mapLayers().values():  # the map shows the new rows
            if isinstance(layer, QgsVectorLayer) and layer.source().startswith(self.dock.session.path):
                layer.dataProvider().reloadData()
                layer.loadDefaultStyle()
                layer.triggerRepaint()
        if (count := point_session.save_chips(self.dock.session)) and self.dock.session.library is not None:
            self.tell(
                tr("saved: {}; {} chips added to {}").format(
                    self.dock.session.path, count, self.dock.session.library.path
                )
            )

    # ---- project -----------------------------------------------------------------------------------------------

    def restore(self) -> None:
        """Show the block that the project refers to, if there is one."""
        self._show_state(restore_state(QgsProject.instance()))

    @show_errors
    def _show_state(self, state: PanelState) -> None:
        """Show the block, model and kind of click that a project refers to."""
        self.dock.ui.model.setCurrentText(state.model)
        self.dock.ui.kind.setCurrentText(state.kind)
        if state.path and state.path != self.dock.session.path:
            self._open(state.path, state.point)
            self.dock.ui.model.setCurrentText(state.model)

    def _open(self, path: str, point: str = "") -> None:
        """Show a block of a file, with a point chosen, and adjust it."""
        self.dock.show_session(point_session.open_block(path), point)
        if self.dock.ui.model.findText(self.dock.session.model) >= 0:
            self.dock.ui.model.setCurrentText(self.dock.session.model)
        numbers = len(self.dock.session.points), len(self.dock.session.images)
        self.tell(tr("{} points, {} images: {}").format(*numbers, path))
        self.store()
        self.dock.adjust_measurements()

    def _on_project(self, _document: Any = None) -> None:
        """Show the block of another project; unsaved measurements remain unless the user discards them."""
        state = restore_state(QgsProject.instance())  # now: saving writes the old block's path into the project
        if self.dock.session.changed:
            if not state.path or state.path == self.dock.session.path or not self.may_leave():
                self.tell(tr("The measurements of the previous block are still here; they are not saved yet"))
                return
        elif not state.path:
            self.dock.show_session(PointSession())
            self.tell("")
        self._show_state(state)

    # ---- unsaved sessions --------------------------------------------------------------------------------------

    def find_journals(self) -> list[Any]:
        """Return the unsaved sessions of programs that have ended; quick if there is no folder of journals."""
        return point_session.find_journals(self.dock.unsaved_root) if os.path.isdir(self.dock.unsaved_root) else []

    @show_errors
    def recover(self, unsaved: Any) -> None:
        """Continue an unsaved session of another program."""
        self.dock.show()
        if self.may_leave():
            last, _image = next(reversed(unsaved.measured), ("", ""))
            self.dock.show_session(point_session.recover(unsaved), last)  # from now on it has its own journal
            point_session.forget(unsaved)
            self.tell(tr("{} measurements are back; save them").format(len(self.dock.session.measured)))
            self.dock.adjust_measurements()

    def store(self) -> None:
        """Store in the project which block, model, kind of click and point are shown."""
        if self.dock.session.path:
            state = PanelState(
                self.dock.session.path,
                self.dock.ui.model.currentText(),
                self.dock.ui.kind.currentText(),
                self.dock.point(),
            )
            store(state, QgsProject.instance())

    def may_leave(self) -> bool:
        """Ask whether unsaved measurements are saved or discarded; return False to cancel."""
        if not self.dock.session.changed:
            return True
        buttons = QMessageBox.StandardButton
        answer = QMessageBox.question(
            self.dock,
            tr("HRSI Points"),
            tr("Save the measurements of this block first?"),
            buttons.Save | buttons.Discard | buttons.Cancel,
        )
        return answer == buttons.Discard or (answer == buttons.Save and bool(self.save()))
