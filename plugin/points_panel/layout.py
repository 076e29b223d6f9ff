"""The widgets of the panel and where they stand; what they do is connected by the dock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qgis.PyQt.QtCore import QAbstractItemModel, QModelIndex, Qt
from qgis.PyQt.QtWidgets import (
    QAbstractItemView,
    QAction,
    QComboBox,
    QHeaderView,
    QLabel,
    QProgressBar,
    QSplitter,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTableView,
    QToolBar,
    QVBoxLayout,
    QWidget,
)

from ...processing_algorithms.point_session import MODEL
from ...processing_algorithms.point_session.rows import CLICK_KINDS, ROLES
from .image_view import ImageView

VIEWS = 2
KIND_TIP = "What is clicked: a round or closed object (center), two straight edges (corner), or just this place (point)"


class Choices(QStyledItemDelegate):
    """A cell that takes one of a few words."""

    def __init__(self, words: Sequence[str], parent: QWidget) -> None:
        super().__init__(parent)
        self._words = list(words)

    def createEditor(self, parent: QWidget, option: QStyleOptionViewItem, index: QModelIndex) -> QWidget:
        box = QComboBox(parent)
        box.addItems(self._words)
        return box

    def setEditorData(self, editor: QWidget, index: QModelIndex) -> None:
        editor.setCurrentText(str(index.data(Qt.ItemDataRole.EditRole)))

    def setModelData(self, editor: QWidget, model: QAbstractItemModel, index: QModelIndex) -> None:
        model.setData(index, editor.currentText(), Qt.ItemDataRole.EditRole)


class PanelLayout(QWidget):
    """Tool bar, the two tables, the images, and a line that tells what happened."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.model, self.kind = QComboBox(), QComboBox()
        self.model.addItems(MODEL.choices)
        self.model.setCurrentText(MODEL.default)
        self.kind.addItems(CLICK_KINDS)
        self.kind.setToolTip(KIND_TIP)
        self.message, self.progress = QLabel(), QProgressBar()
        self.message.setWordWrap(True)
        self.message.setTextFormat(Qt.TextFormat.PlainText)  # ids of points may look like HTML
        self.message.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.points, self.measurements = QTableView(), QTableView()
        self.views = [ImageView(self) for _ in range(VIEWS)]
        self.bar = self._tool_bar()
        self._arrange()
        self.show_progress(0.0)

    def _tool_bar(self) -> QToolBar:
        bar = QToolBar(self)
        self.new = _action(bar, "New…", "Begin a block with images and points")
        self.open = _action(bar, "Open…", "Open the block.gpkg of a result, or a block saved here")
        self.save = _action(bar, "Save", "Save points and measurements in the block's GeoPackage")
        self.save_as = _action(bar, "Save as…", "Save under another name")
        bar.addSeparator()
        self.add = _action(bar, "Add points…", "Add the ground points of a layer or file")
        self.remove = _action(bar, "Remove point", "Remove the chosen point and its measurements")
        bar.addSeparator()
        bar.addWidget(QLabel(" Click on: "))
        bar.addWidget(self.kind)
        bar.addWidget(QLabel(" Model: "))
        bar.addWidget(self.model)
        self.adjust = _action(bar, "Adjust", "Adjust the block with what is measured so far")
        self.cancel = _action(bar, "Cancel", "Stop the adjustment")
        return bar

    def _arrange(self) -> None:
        tables = QSplitter(Qt.Orientation.Vertical)
        for table in (self.points, self.measurements):
            table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
            table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
            table.verticalHeader().hide()
            table.verticalHeader().setDefaultSectionSize(22)
            tables.addWidget(table)
        tables.setSizes([300, 150])
        whole = QSplitter(Qt.Orientation.Horizontal)
        whole.addWidget(tables)
        for view in self.views:
            whole.addWidget(view)
        whole.setSizes([430, 300, 300])
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2, 2, 2, 2)
        layout.addWidget(self.bar)
        layout.addWidget(whole, 1)
        layout.addWidget(self.progress)
        layout.addWidget(self.message)

    def show_models(self, points: Any, measurements: Any) -> None:
        """Show these tables, with a choice of words where a cell takes one of a few."""
        for table, model, title, words in (
            (self.points, points, "role", ROLES),
            (self.measurements, measurements, "kind", CLICK_KINDS),
        ):
            table.setModel(model)
            table.setItemDelegateForColumn(model.titles.index(title), Choices(words, table))
            table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)

    def show_progress(self, percent: float) -> None:
        self.progress.setVisible(percent > 0.0)
        self.progress.setValue(round(percent))

    def tell(self, text: str, is_error: bool) -> None:
        self.message.setStyleSheet("color: #b3261e;" if is_error else "")
        self.message.setText(text)

    def enable(self, has_images: bool, has_point: bool, is_adjusting: bool) -> None:
        """Offer what can be done now."""
        for action in (self.save, self.save_as, self.add):
            action.setEnabled(has_images)
        self.remove.setEnabled(has_point and not is_adjusting)
        self.adjust.setEnabled(has_images and not is_adjusting)
        self.cancel.setEnabled(is_adjusting)


def _action(bar: QToolBar, text: str, tip: str) -> QAction:
    action = bar.addAction(text)
    action.setToolTip(tip)
    return action
