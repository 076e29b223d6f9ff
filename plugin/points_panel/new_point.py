"""A new ground point where somebody clicked in the map: its name, height and accuracy are asked for."""

from typing import Any

from qgis.core import QgsMapLayer, QgsProject
from qgis.PyQt.QtWidgets import QComboBox, QDialog, QDialogButtonBox, QDoubleSpinBox, QFormLayout, QLineEdit, QWidget

from ...hrsi_engine.foundation.errors import HrsiError
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session.rows import ROLES, SurveyPoint
from ..translation import tr
from .new_block import HEIGHT_DATUMS

_HIGHEST_M = 10_000.0  # of heights


class NewPointDialog(QDialog):
    """Asks for what a place on the map does not tell; the height comes from a DEM of the project, if there is one."""

    def __init__(self, lonlat: tuple[float, float], name: str, height_m: float, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(f"{tr('New ground point at')} {lonlat[0]:.6f}, {lonlat[1]:.6f}")
        self._lonlat = lonlat
        self.name, self.role = QLineEdit(name), QComboBox()
        self.role.addItems(ROLES)
        self.dem, self.datum = QComboBox(), QComboBox()
        self.dem.addItem(tr("no DEM: as typed"), "")
        layers = QgsProject.instance().mapLayers().values()
        rasters = [one for one in layers if one.type() == QgsMapLayer.LayerType.RasterLayer and one.bandCount() == 1]
        for layer in sorted(rasters, key=lambda one: str(one.name()).lower()):
            self.dem.addItem(layer.name(), layer.source())
        self.datum.addItems(HEIGHT_DATUMS)
        self.height, self.sigma_xy, self.sigma_h = (_metres() for _ in range(3))
        self.height.setMinimum(-_HIGHEST_M)
        self.height.setValue(height_m)
        for sigma in (self.sigma_xy, self.sigma_h):
            sigma.setSpecialValueText(tr("default"))
        box = QDialogButtonBox(QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel)
        box.accepted.connect(self.accept)
        box.rejected.connect(self.reject)
        form = QFormLayout(self)
        for label, widget in (
            (tr("Name"), self.name), (tr("Role"), self.role), (tr("Height from"), self.dem),
            (tr("Heights of the DEM refer to"), self.datum), (tr("Ellipsoidal height (m)"), self.height),
            (tr("Sigma east, north (m)"), self.sigma_xy), (tr("Sigma height (m)"), self.sigma_h),
        ):  # fmt: skip
            form.addRow(label, widget)
        form.addWidget(box)
        for chooser in (self.dem, self.datum):
            chooser.currentIndexChanged.connect(lambda _index: self._look_up())

    def _look_up(self) -> None:
        """Show the DEM's height, or why there is none."""
        if not self.dem.currentData():
            return
        try:
            dem, datum = self.dem.currentData(), self.datum.currentText()
            self.height.setValue(point_session.dem_height(dem, datum, self._lonlat))
            self.height.setToolTip("")
        except HrsiError as error:
            self.height.setToolTip(str(error))

    def point(self) -> SurveyPoint:
        """Return the point; a sigma of 0 takes the default."""
        sigmas: dict[str, Any] = {
            name: field.value()
            for name, field in (("sigma_xy", self.sigma_xy), ("sigma_h", self.sigma_h))
            if field.value()
        }
        name, role = self.name.text().strip(), self.role.currentText()
        return SurveyPoint(name, *self._lonlat, self.height.value(), role, **sigmas)


def _metres() -> QDoubleSpinBox:
    field = QDoubleSpinBox()
    field.setDecimals(3)
    field.setMaximum(_HIGHEST_M)
    field.setSuffix(" m")
    return field
