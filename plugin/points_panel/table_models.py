"""The two tables: the known points, and the images of the chosen point. Edits go straight to the session."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from qgis.PyQt.QtCore import QAbstractTableModel, QModelIndex, Qt, pyqtSignal
from qgis.PyQt.QtGui import QColor

from ...hrsi_engine.foundation.errors import HrsiError
from ...processing_algorithms.point_session import MeasurementRow, PointRow, PointSession
from ...processing_algorithms.point_session.rows import CLICK_KINDS, ImageMeasurement
from ..help import as_rich_text
from ..translation import tr

SUSPICIOUS = QColor(215, 25, 28)
FAINT = QColor(130, 130, 130)
_NOWHERE = QModelIndex()


def format_number(value: float, digits: int) -> str:
    """Return a number for a cell, nothing where there is none."""
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def number_of(text: Any) -> float:
    """Return what was typed into a cell: NaN where it was emptied; raise ValueError for no number."""
    text = str(text).strip().replace(",", ".")
    return float(text) if text else math.nan


class RowsModel(QAbstractTableModel):
    """A table of rows of the session with a title, a text and, where it can be edited, a setter for each column."""

    edited = pyqtSignal()
    refused = pyqtSignal(str)  #: an edit that the session did not take, and why
    titles: Sequence[str] = ()
    editable: Sequence[str] = ()

    def __init__(self, session: PointSession) -> None:
        super().__init__()
        self.session = session
        self.rows: list[Any] = []

    def rowCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.titles)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if role != Qt.ItemDataRole.DisplayRole or orientation != Qt.Orientation.Horizontal:
            return None
        return tr(self.titles[section])

    def flags(self, index: QModelIndex) -> Qt.ItemFlag:
        flags = super().flags(index)
        return flags | Qt.ItemFlag.ItemIsEditable if self.titles[index.column()] in self.editable else flags

    def data(self, index: QModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row, title = self.rows[index.row()], self.titles[index.column()]
        if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.EditRole):
            return self.text(row, title)
        if role == Qt.ItemDataRole.ForegroundRole:
            return SUSPICIOUS if row.suspicion else self.colour(row)
        if role == Qt.ItemDataRole.DecorationRole and row.suspicion and index.column() == 0:
            return SUSPICIOUS  # seen where the row is selected, too
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
        """Show the session as it is now; the selection stays where the rows stay."""
        rows = self.current_rows()
        if len(rows) == len(self.rows):
            self.rows = rows
            if rows:
                self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, len(self.titles) - 1))
            return
        self.beginResetModel()
        self.rows = rows
        self.endResetModel()

    def current_rows(self) -> list[Any]:
        raise NotImplementedError

    def text(self, row: Any, title: str) -> str:
        raise NotImplementedError

    def edit(self, row: Any, title: str, value: Any) -> None:
        raise NotImplementedError

    def colour(self, row: Any) -> QColor | None:
        return None

    def tip(self, row: Any) -> str | None:
        return None


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
    """The known points."""

    titles = tuple(_POINT_TEXT)
    editable = ("role", *_SIGMAS)

    def current_rows(self) -> list[PointRow]:
        return self.session.rows()

    def text(self, row: PointRow, title: str) -> str:
        return _POINT_TEXT[title](row)

    def edit(self, row: PointRow, title: str, value: Any) -> None:
        if title == "role":
            self.session.set_role(row.point.id, str(value))
        else:
            self.session.set_sigma(row.point.id, _SIGMAS[title], number_of(value))

    def colour(self, row: PointRow) -> QColor | None:
        return None if row.images and row.point.role != "off" else FAINT

    def row_of(self, name: str) -> int:
        """Return the row of a point, -1 where it is not in the list."""
        return next((index for index, row in enumerate(self.rows) if row.point.id == name), -1)


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
    """The chosen point on every image; emptying sample or line removes a measurement."""

    titles = tuple(_MEASUREMENT_TEXT)
    editable = (*_MEASUREMENT_FIELDS, "kind")

    def __init__(self, session: PointSession) -> None:
        super().__init__(session)
        self.point = ""

    def show_point(self, name: str) -> None:
        self.point = name
        self.refresh()

    def current_rows(self) -> list[MeasurementRow]:
        return self.session.measurements(self.point) if self.point in self.session.points else []

    def text(self, row: MeasurementRow, title: str) -> str:
        return _MEASUREMENT_TEXT[title](row)

    def edit(self, row: MeasurementRow, title: str, value: Any) -> None:
        """Enter a value; where a point was not measured yet, the other coordinate is the predicted one."""
        measured = row.measured or ImageMeasurement(*row.predicted, kind=CLICK_KINDS[-1])
        if title == "kind":
            changed = replace(measured, kind=str(value))
        else:
            typed = number_of(value)
            if math.isnan(typed) and title != "sigma px":
                self.session.remove_measurement(self.point, row.image)
                return
            entered: dict[str, Any] = {_MEASUREMENT_FIELDS[title]: typed}
            changed = replace(measured, **entered)
        self.session.set_measurement(self.point, row.image, changed)

    def colour(self, row: MeasurementRow) -> QColor | None:
        return None if row.is_inside or row.measured else FAINT

    def tip(self, row: MeasurementRow) -> str | None:
        sample, line = row.predicted
        where = "" if row.is_inside else tr(", outside the image")
        return tr("predicted at sample {:.1f}, line {:.1f}").format(sample, line) + where
