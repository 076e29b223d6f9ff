"""The widgets of the panel and their arrangement; the dock connects their signals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from qgis.PyQt.QtCore import QAbstractItemModel, QModelIndex, QSize, Qt, QUrl
from qgis.PyQt.QtGui import QDesktopServices, QIcon, QImageReader, QKeySequence, QPixmap
from qgis.PyQt.QtWidgets import (
    QAbstractItemView,
    QAction,
    QComboBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QScrollArea,
    QSplitter,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTableView,
    QTabWidget,
    QToolBar,
    QVBoxLayout,
    QWidget,
)

from ...hrsi_engine.foundation.reasons import Level
from ...processing_algorithms.point_session import MODEL, PointSession
from ...processing_algorithms.point_session.rows import CLICK_KINDS, ROLES
from ..translation import tr
from .image_view import render_chip
from .view_grid import ViewGrid

if TYPE_CHECKING:
    from ...processing_algorithms.point_session.adjusted import AdjustmentView
    from ...processing_algorithms.point_session.chips import PointPicture

MOST_VIEWS = 9
FIRST_VIEWS = 2
EMPTY = "New… begins a block with images and points; Open… continues with the block.gpkg of a result or of a session."
PAGES = "Points", "Residuals", "Verdict"  #: titles of the tabs
SHOWN_LETTERS = 9  # of a model in the box; the list has the complete name
TABLES_WIDTH_PX = 440  # three images of 300 px are next to the tables on a screen of 1366 px
PICTURE_SIDE_PX = 110  # of a photograph or chip below the tables
PICTURE_HEIGHT_PX = PICTURE_SIDE_PX + 50  # with its title and a scroll bar
PHOTO_WIDTH_PX = 600  # of a photograph in a tool tip
SIZED_ROWS = 30  # rows that determine the widths of columns
KIND_TIP = "What is clicked: a round or closed object, two straight edges, or only this position"


class Choices(QStyledItemDelegate):
    """A cell with a choice of a few words."""

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
    """Tool bars, tables, images, and a line for messages."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.model, self.kind, self.number = QComboBox(), QComboBox(), QComboBox()
        self.model.addItems(MODEL.choices)
        self.model.setCurrentText(MODEL.default)
        self.model.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.model.setMinimumContentsLength(SHOWN_LETTERS)
        self.kind.addItems(CLICK_KINDS)
        self.kind.setToolTip(tr(KIND_TIP))
        self.number.addItems([str(number) for number in range(1, MOST_VIEWS + 1)])
        self.number.setCurrentText(str(FIRST_VIEWS))
        self.message, self.progress = QLabel(), QProgressBar()
        self.message.setWordWrap(True)
        self.message.setTextFormat(Qt.TextFormat.PlainText)  # ids of points may look like HTML
        self.message.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.points, self.measurements, self.residuals = QTableView(), QTableView(), QTableView()
        self.filter, self.rmse, self.verdict, self.tabs = QComboBox(), QLabel(), QListWidget(), QTabWidget()
        self.filter.setToolTip(tr("Show the residuals of one image, or those that a reason of the verdict is about"))
        self.pictures = QListWidget()
        self._verdict_of: tuple[AdjustmentView | None, str] = None, ""
        self.empty, self.grid = QLabel(tr(EMPTY)), ViewGrid()
        self.bar, self.second_bar = self._tool_bar(), self._second_bar()
        for toggle in (self.live, self.pick, self.go_to, self.tie, self.linked, self.north):
            toggle.setCheckable(True)
            toggle.setChecked(toggle in (self.live, self.linked, self.north))
        self._arrange()
        self.show_progress(0.0)
        self.show_pictures([])
        self.pictures.itemDoubleClicked.connect(_open_photo)

    def _tool_bar(self) -> QToolBar:
        bar = QToolBar(self)
        self.new = _action(bar, "New…", "Begin a block with images and points")
        self.open = _action(bar, "Open…", "Open the block.gpkg of a result, or a block saved here")
        self.save = _action(bar, "Save", "Save points and measurements in the block's GeoPackage", "Ctrl+S")
        self.save_as = _action(bar, "Save as…", "Save under another name")
        bar.addSeparator()
        self.undo = _action(bar, "Undo", "", "Ctrl+Z")
        self.redo = _action(bar, "Redo", "", "Ctrl+Shift+Z")
        bar.addSeparator()
        bar.addWidget(QLabel(f" {tr('Model')}: "))
        bar.addWidget(self.model)
        self.adjust = _action(bar, "Adjust", "Adjust the block with the present measurements", "F5")
        self.live = _action(bar, "Live", "Adjust again after every change of the measurements")
        self.cancel = _action(bar, "Cancel", "Stop the adjustment")
        bar.addSeparator()
        bar.addWidget(QLabel(f" {tr('Click on')}: "))
        bar.addWidget(self.kind)
        bar.addWidget(QLabel(f" {tr('Images')}: "))
        bar.addWidget(self.number)
        self.linked = _action(bar, "Linked zoom", "The wheel zooms all images")
        self.north = _action(bar, "North up", "Turn the images so that north is on top")
        return bar

    def _second_bar(self) -> QToolBar:
        bar = QToolBar(self)
        self.add = _action(bar, "Add points…", "Add the ground points of a layer or file")
        self.pick = _action(
            bar, "Point from map", "Click in the map: a new ground point there, with the height of a DEM"
        )
        self.go_to = _action(bar, "Go to place", "Click in the map: the images show that place")
        self.tie = _action(
            bar, "Tie point", "Click in an image: a new tie point, searched for in the other images", "T"
        )
        self.library = _action(
            bar, "Chip library…", "Keep chips of measured GCPs in a file, and find these GCPs in new images by matching"
        )
        self.remove = _action(bar, "Remove", "Remove the chosen point and its measurements")
        bar.addSeparator()
        self.previous = _action(bar, "Previous", "The previous point that is not measured on all its images", "P")
        self.next = _action(bar, "Next", "The next point that is not measured on all its images", "N")
        self.take = _action(bar, "Take prediction", "Measure where the point is predicted, in the active view", "A")
        self.forget = _action(bar, "Forget", "Delete the measurement in the active view", "Del")
        self.transfer = _action(
            bar, "Transfer", "Search for the point by matching in all other images that contain it", "M"
        )
        self.accept = _action(bar, "Accept", "Accept the match in the active view", "Y")
        self.accept_all = _action(bar, "Accept all", "Accept the matches in all images", "Shift+Y")
        self.reject = _action(bar, "Reject", "Reject the match in the active view", "X")
        return bar

    def _arrange(self) -> None:
        """Put the widgets into the panel: tools, tables next to image views, messages."""
        tables = self._arrange_tables()
        self._prepare_pictures()
        self.empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.empty.setWordWrap(True)
        self.empty.setMargin(20)
        self.whole = QSplitter(Qt.Orientation.Horizontal)
        for widget in (tables, self.grid):
            self.whole.addWidget(widget)
        self.whole.setSizes([TABLES_WIDTH_PX, 900])
        self.whole.setCollapsible(0, False)
        self.whole.setStretchFactor(1, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2, 2, 2, 2)
        for bar in (self.bar, self.second_bar):
            layout.addWidget(bar)
        layout.addWidget(self.whole, 1)
        layout.addWidget(self.empty, 1)
        layout.addLayout(self._arrange_messages())

    def _arrange_tables(self) -> QSplitter:
        """Return the tables of points, residuals, reasons and measurements, above the pictures."""
        residuals = QWidget()
        column = QVBoxLayout(residuals)
        column.setContentsMargins(0, 2, 0, 0)
        self.rmse.setTextFormat(Qt.TextFormat.PlainText)
        self.rmse.setWordWrap(True)
        for widget in (self.filter, self.residuals, self.rmse):
            column.addWidget(widget)
        self.verdict.setWordWrap(True)
        self.verdict.setSpacing(3)
        self.verdict.setAlternatingRowColors(True)
        self.verdict.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.verdict.setToolTip(tr("A click shows the residuals of the points concerned, the worst first"))
        for page, title in zip((self.points, residuals, self.verdict), PAGES, strict=True):
            self.tabs.addTab(page, tr(title))
        tables = QSplitter(Qt.Orientation.Vertical)
        for table in (self.points, self.residuals, self.measurements):
            table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
            table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
            table.verticalHeader().hide()
            table.horizontalHeader().setHighlightSections(False)
            table.verticalHeader().setDefaultSectionSize(22)
            table.horizontalHeader().setResizeContentsPrecision(SIZED_ROWS)
            table.horizontalHeader().setSortIndicator(-1, Qt.SortOrder.AscendingOrder)
            table.setSortingEnabled(True)
        for widget in (self.tabs, self.measurements, self.pictures):
            tables.addWidget(widget)
        tables.setSizes([300, 150, PICTURE_HEIGHT_PX])
        tables.setStretchFactor(0, 1)
        return tables

    def _prepare_pictures(self) -> None:
        """Show photographs and chips in one row."""
        self.pictures.setViewMode(QListWidget.ViewMode.IconMode)
        self.pictures.setMovement(QListWidget.Movement.Static)
        self.pictures.setResizeMode(QListWidget.ResizeMode.Adjust)
        self.pictures.setIconSize(QSize(PICTURE_SIDE_PX, PICTURE_SIDE_PX))
        self.pictures.setFlow(QListWidget.Flow.LeftToRight)
        self.pictures.setWrapping(False)
        self.pictures.setMinimumHeight(PICTURE_HEIGHT_PX)
        self.pictures.setToolTip(
            tr("Photographs of the survey, and where the point was measured; a double click opens one")
        )

    def _arrange_messages(self) -> QHBoxLayout:
        """Return the line of messages and progress."""
        # Two lines for messages, more with the wheel, and the progress: with variable sizes the images would move
        scrolled = QScrollArea()
        scrolled.setFrameShape(QScrollArea.Shape.NoFrame)
        scrolled.setWidgetResizable(True)
        scrolled.setFixedHeight(2 * self.message.fontMetrics().lineSpacing() + 4)
        scrolled.setWidget(self.message)
        self.progress.setMaximumWidth(150)
        policy = self.progress.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.progress.setSizePolicy(policy)
        bottom = QHBoxLayout()
        bottom.addWidget(scrolled, 1)
        bottom.addWidget(self.progress)
        return bottom

    def show_models(self, points: Any, measurements: Any, residuals: Any) -> None:
        """Show these tables, with a choice of words for cells that have one."""
        for table, model, title, words in (
            (self.points, points, "role", ROLES),
            (self.measurements, measurements, "kind", CLICK_KINDS),
            (self.residuals, residuals, "role", ROLES),
        ):
            table.setModel(model)
            table.setItemDelegateForColumn(model.titles.index(title), Choices(words, table))
            table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Interactive)

    def fit_columns(self) -> None:
        """Fit the columns of the tables to their content; not after every edit, because it takes longer than that."""
        for table in (self.points, self.measurements, self.residuals):
            table.resizeColumnsToContents()

    def show_verdict(self, adjusted: AdjustmentView | None, remark: str) -> None:
        """List the verdict and its reasons, with the points and images of each; ``remark`` is listed first."""
        if self._verdict_of == (adjusted, remark):
            return
        self._verdict_of = adjusted, remark
        title, lines = tr("Verdict"), list[tuple[str, Any]]([(remark, None)] if remark else [])
        if adjusted is not None:
            verdict, warnings = adjusted.verdict, adjusted.warnings
            unchecked = describe_missing_check(adjusted)
            title = f"{title}: {unchecked if unchecked and verdict.level is Level.OK else tr(verdict.level.label)}"
            lines += [(text, None) for text in (unchecked, verdict.sentence) if text]
            lines += [(f"{one.level.label}: {one.message} [{one.code}]\n{one.advice}", one) for one in verdict.reasons]
            lines += [(f"{tr('warning')}: {text}", None) for text in warnings]
        self.tabs.setTabText(self.tabs.indexOf(self.verdict), title)
        self.verdict.clear()
        for text, reason in lines:
            item = QListWidgetItem(text, self.verdict)
            item.setData(Qt.ItemDataRole.UserRole, reason)

    def show_pictures(self, pictures: Iterable[PointPicture]) -> None:
        """Show photographs and chips below the tables."""
        self.pictures.clear()
        for one in pictures:
            if one.path:  # read at the size of an icon: photographs are large
                reader = QImageReader(one.path)
                reader.setAutoTransform(True)
                reader.setScaledSize(reader.size().scaled(*[PICTURE_SIDE_PX] * 2, Qt.AspectRatioMode.KeepAspectRatio))
                icon = QPixmap.fromImage(reader.read())
            else:
                icon = render_chip(one.svg, PICTURE_SIDE_PX)
            item = QListWidgetItem(QIcon(icon), one.title, self.pictures)
            item.setData(Qt.ItemDataRole.UserRole, one.path)
            larger = f'<img src="{escape(QUrl.fromLocalFile(one.path).toString())}" width="{PHOTO_WIDTH_PX}">'
            item.setToolTip(larger if one.path else one.title)

    def show_progress(self, percent: float) -> None:
        self.progress.setVisible(percent > 0.0)
        self.progress.setValue(round(percent))

    def tell(self, text: str, is_error: bool) -> None:
        self.message.setStyleSheet("color: #b3261e;" if is_error else "")
        self.message.setText(text)

    def enable_answers(self, has_proposals: bool) -> None:
        """Enable or disable the answers to proposals of matching."""
        for action in (self.accept, self.accept_all, self.reject):
            action.setEnabled(has_proposals)

    def enable(
        self, session: PointSession, has_point: bool, is_adjusting: bool, has_map: bool, has_proposals: bool
    ) -> None:
        """Enable the actions that are possible now."""
        has_images, history = bool(session.images), session.history
        self.enable_answers(has_proposals)
        self.whole.setVisible(has_images)
        self.empty.setVisible(not has_images)
        possible = (
            dict.fromkeys((self.save, self.save_as, self.add, self.live, self.tie, self.library), has_images)
            | dict.fromkeys((self.remove, self.previous, self.next, self.take, self.forget, self.transfer), has_point)
            | dict.fromkeys((self.pick, self.go_to), has_images and has_map)
            | {self.adjust: has_images and not is_adjusting, self.cancel: is_adjusting}
        )
        for action, is_possible in possible.items():
            action.setEnabled(is_possible)
        for action, word, title in (
            (self.undo, tr("Undo"), history.undo_title),
            (self.redo, tr("Redo"), history.redo_title),
        ):
            action.setEnabled(bool(title))
            action.setToolTip(f"{word}: {title or tr('nothing')}")


def describe_missing_check(adjusted: AdjustmentView) -> str:
    """Return "1 GCP: no check possible" if no residual can show an error of the GCPs, otherwise an empty text."""
    gcps = adjusted.unchecked_gcps
    texts = "", tr("no GCP: no check possible"), tr("1 GCP: no check possible"), tr("{} GCPs: no check possible")
    return texts[min(-1 if gcps is None else gcps, 2) + 1].format(gcps)


def _open_photo(item: QListWidgetItem) -> None:
    if path := item.data(Qt.ItemDataRole.UserRole):
        QDesktopServices.openUrl(QUrl.fromLocalFile(path))


def _action(bar: QToolBar, text: str, tip: str, keys: str = "") -> QAction:
    """Return a new action of a tool bar, in the user's language; its keys work if any part of the panel has focus."""
    text, tip = tr(text), tr(tip) if tip else ""
    action = bar.addAction(text)
    action.setToolTip(f"{tip} ({keys})" if keys else tip)
    if keys:
        action.setShortcut(QKeySequence(keys))
        action.setShortcutContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
        bar.parentWidget().addAction(action)
    return action
