"""The tables: known points, the chosen point in all images, all residuals. Edits are passed to the session."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from qgis.PyQt.QtCore import QAbstractTableModel, QModelIndex, Qt, pyqtSignal
from qgis.PyQt.QtGui import QColor

from ...hrsi_engine.foundation.errors import HrsiError
from ...processing_algorithms.point_session import MeasurementRow, PointRow, PointSession, list_residuals
from ...processing_algorithms.point_session.rows import CLICK_KINDS, ImageMeasurement, ResidualRow
from ..help import as_rich_text
from ..translation import tr

SUSPICIOUS = QColor(215, 25, 28)
FAINT = QColor(130, 130, 130)
NUMBER_ALIGNMENT = 0x82  #: AlignRight | AlignVCenter as a number, which Qt 5 needs; flags of Qt 6 are no numbers
_NOWHERE = QModelIndex()


def format_number(value: float, digits: int) -> str:
    """Return a number for a cell, empty for NaN."""
    return "" if math.isnan(value) else f"{value:z.{digits}f}"


def number_of(text: Any) -> float:
    """Return the number typed into a cell, NaN for an empty one; raise ValueError for other text."""
    text = str(text).strip().replace(",", ".")
    return float(text) if text else math.nan


class RowsModel(QAbstractTableModel):
    """A table of rows of the session: each column has a title, a text and, if it can be edited, a setter."""

    edited = pyqtSignal()
    refused = pyqtSignal(str)  #: an edit that the session refused: the reason
    texts: Mapping[str, Callable[[Any], str]] = {}  #: of the cells of a row, by the title of the column
    editable: Sequence[str] = ()

    def __init__(self, session: PointSession) -> None:
        super().__init__()
        self.session, self.titles = session, tuple(self.texts)
        self.rows: list[Any] = []
        self._order = -1, False  # column for sorting, and whether the largest is first

    def rowCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.titles)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        is_title = role == Qt.ItemDataRole.DisplayRole and orientation == Qt.Orientation.Horizontal
        return tr(self.titles[section]) if is_title else None

    def flags(self, index: QModelIndex) -> Qt.ItemFlag:
        flags = super().flags(index)
        return flags | Qt.ItemFlag.ItemIsEditable if self.titles[index.column()] in self.editable else flags

    def data(self, index: QModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row, title = self.rows[index.row()], self.titles[index.column()]
        if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.EditRole):
            return self.text(row, title)
        if role == Qt.ItemDataRole.TextAlignmentRole and _sort_key(self.text(row, title))[0] >= 0.0:
            return NUMBER_ALIGNMENT
        if role == Qt.ItemDataRole.ForegroundRole:
            return SUSPICIOUS if row.suspicion else self.colour(row)
        if role == Qt.ItemDataRole.DecorationRole and row.suspicion and index.column() == 0:
            return SUSPICIOUS  # visible also if the row is selected
        if role == Qt.ItemDataRole.ToolTipRole:
            tip = row.suspicion or self.tip(row)
            return as_rich_text(tip) if tip else None
        return None

    def setData(self, index: QModelIndex, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        if role != Qt.ItemDataRole.EditRole or value == self.data(index, role):
            return False
        try:
            self.edit(self.rows[index.row()], self.titles[index.column()], value)
        except HrsiError as error:
            self.refused.emit(str(error))
            return False
        except ValueError:
            self.refused.emit(tr("{} is not a number").format(repr(value)))
            return False
        self.refresh()
        self.edited.emit()
        return True

    def refresh(self) -> None:
        """Show the present session; the selection keeps its row if no row is added or removed."""
        column, is_descending = self._order
        rows = self.current_rows()
        if column >= 0:
            rows.sort(key=lambda row: _sort_key(self.text(row, self.titles[column])), reverse=is_descending)
        before, now = ([self.key(row) for row in each] for each in (self.rows, rows))
        if now == before:
            self.rows = rows
            if rows:
                self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, len(self.titles) - 1))
        elif len(now) == len(before) and set(now) == set(before):
            self.layoutAboutToBeChanged.emit()
            self.rows, row_of = rows, {key: row for row, key in enumerate(now)}
            for index in self.persistentIndexList():
                self.changePersistentIndex(index, self.index(row_of[before[index.row()]], index.column()))
            self.layoutChanged.emit()
        else:
            self.beginResetModel()
            self.rows = rows
            self.endResetModel()

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Sort by a column, numbers by their magnitude; -1: in the order of the session."""
        self._order = column, order == Qt.SortOrder.DescendingOrder
        self.refresh()

    def row_of(self, *key: str) -> int:
        """Return the number of a row, -1 if it is not in the table."""
        return next((index for index, row in enumerate(self.rows) if self.key(row) == key), -1)

    def key(self, row: Any) -> tuple[str, ...]:
        """Return the unique key of a row."""
        raise NotImplementedError

    def current_rows(self) -> list[Any]:
        raise NotImplementedError

    def text(self, row: Any, title: str) -> str:
        return self.texts[title](row)

    def edit(self, row: Any, title: str, value: Any) -> None:
        raise NotImplementedError

    def colour(self, row: Any) -> QColor | None:
        return None

    def tip(self, row: Any) -> str | None:
        return None


def _sort_key(text: str) -> tuple[float, str]:
    try:
        return abs(float(text)), ""
    except ValueError:
        return -1.0, text


_POINT_TEXT: dict[str, Callable[[PointRow], str]] = {
    "point": lambda row: row.point.id,
    "role": lambda row: row.point.role,
    "images": lambda row: str(row.images),
    "dE m": lambda row: format_number(row.residual_m[0], 2),
    "dN m": lambda row: format_number(row.residual_m[1], 2),
    "dH m": lambda row: format_number(row.residual_m[2], 2),
    "sigma xy m": lambda row: format_number(row.point.sigma_xy, 3),
    "sigma h m": lambda row: format_number(row.point.sigma_h, 3),
}
_SIGMAS = {"sigma xy m": "sigma_xy", "sigma h m": "sigma_h"}


class PointsModel(RowsModel):
    """The table of known points."""

    texts = _POINT_TEXT
    editable = ("role", *_SIGMAS)

    def current_rows(self) -> list[PointRow]:
        return self.session.rows()

    def edit(self, row: PointRow, title: str, value: Any) -> None:
        if title == "role":
            self.session.set_role(row.point.id, str(value))
        else:
            self.session.set_sigma(row.point.id, _SIGMAS[title], number_of(value))

    def colour(self, row: PointRow) -> QColor | None:
        return None if row.images and row.point.role != "off" else FAINT

    def key(self, row: PointRow) -> tuple[str, ...]:
        return (row.point.id,)


_RESIDUAL_TEXT: dict[str, Callable[[ResidualRow], str]] = {
    "point": lambda row: row.point.id,
    "role": lambda row: row.point.role,
    "image": lambda row: row.image,
    "ds px": lambda row: format_number(row.residual_px[0], 2),
    "dl px": lambda row: format_number(row.residual_px[1], 2),
    "normalised": lambda row: format_number(row.statistic, 1),
    "kind": lambda row: row.kind,
}


class ResidualsModel(RowsModel):
    """The table of all measurements with their residuals, the largest first, or of some images or points."""

    texts = _RESIDUAL_TEXT
    editable = ("role",)

    def __init__(self, session: PointSession) -> None:
        super().__init__(session)
        self._images, self._points = frozenset[str](), frozenset[str]()

    def show_only(self, images: Iterable[str] = (), points: Iterable[str] = ()) -> None:
        """Show the measurements in these images, and of these points; empty: all."""
        self._images, self._points = frozenset(images), frozenset(points)
        self.refresh()

    def current_rows(self) -> list[ResidualRow]:
        rows = list_residuals(self.session)
        rows = [row for row in rows if row.image in self._images] if self._images else rows
        return [row for row in rows if row.point.id in self._points] if self._points else rows

    def edit(self, row: ResidualRow, title: str, value: Any) -> None:
        self.session.set_role(row.point.id, str(value))

    def key(self, row: ResidualRow) -> tuple[str, ...]:
        return row.point.id, row.image


def _measurement_of(part: str, digits: int) -> Callable[[MeasurementRow], str]:
    return lambda row: "" if row.measured is None else format_number(getattr(row.measured, part), digits)


_MEASUREMENT_TEXT: dict[str, Callable[[MeasurementRow], str]] = {
    "image": lambda row: row.image,
    "sample": _measurement_of("sample", 2),
    "line": _measurement_of("line", 2),
    "ds px": lambda row: format_number(row.residual_px[0], 2),
    "dl px": lambda row: format_number(row.residual_px[1], 2),
    "sigma px": _measurement_of("sigma", 2),
    "kind": lambda row: row.measured.kind if row.measured else "",
}
_MEASUREMENT_FIELDS = {"sample": "sample", "line": "line", "sigma px": "sigma"}


class MeasurementsModel(RowsModel):
    """The table of the chosen point in every image; emptying sample or line removes a measurement."""

    texts = _MEASUREMENT_TEXT
    editable = (*_MEASUREMENT_FIELDS, "kind")

    def __init__(self, session: PointSession) -> None:
        super().__init__(session)
        self.point = ""

    def show_point(self, name: str) -> None:
        self.point = name
        self.refresh()

    def current_rows(self) -> list[MeasurementRow]:
        return self.session.measurements(self.point) if self.point in self.session.points else []

    def edit(self, row: MeasurementRow, title: str, value: Any) -> None:
        """Enter a value; if the point was not measured, the other coordinate is the predicted one."""
        measured = row.measured or ImageMeasurement(*row.predicted, kind=CLICK_KINDS[-1])
        if title == "kind":
            changed = replace(measured, kind=str(value))
        else:
            entered: dict[str, Any] = {_MEASUREMENT_FIELDS[title]: number_of(value)}
            changed = replace(measured, **entered)
            if math.isnan(changed.sample) or math.isnan(changed.line):
                self.session.remove_measurement(self.point, row.image)
                return
        self.session.set_measurement(self.point, row.image, changed)

    def key(self, row: MeasurementRow) -> tuple[str, ...]:
        return (row.image,)

    def colour(self, row: MeasurementRow) -> QColor | None:
        return None if row.is_inside or row.measured else FAINT

    def tip(self, row: MeasurementRow) -> str | None:
        where = "" if row.is_inside else tr(", outside the image")
        return tr("predicted at sample {:.1f}, line {:.1f}").format(*row.predicted) + where
