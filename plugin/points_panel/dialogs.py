"""The dialogs of the panel: a new block (images, ground and image points), and a new ground point on the map."""

from typing import Any

from qgis.core import QgsMapLayer, QgsProcessingContext, QgsProcessingFeedback, QgsProject, QgsRasterLayer
from qgis.gui import QgsFileWidget, QgsProjectionSelectionWidget
from qgis.PyQt.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDoubleSpinBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLineEdit,
    QMenu,
    QToolButton,
    QWidget,
)

from ...hrsi_engine.foundation.errors import HrsiError
from ...processing_algorithms import point_session
from ...processing_algorithms.point_session.rows import ROLES, SurveyPoint
from ..dialog_fields import LayerOrFile
from ..layer_sources import crs_text, name_fields, point_source, raster_source
from ..parameters import label_gcp_fields
from ..translation import tr
from .actions import make_pause

HEIGHT_DATUMS = ("layer", "ellipsoidal", "egm96", "egm2008")
TYPING_MS = 300  # without a further letter, until what is typed is looked at


class NewBlockDialog(QDialog):
    """Dialog for images and points; ``sources`` returns the arguments of `files.new_session`."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("New block of images"))
        self.images = QgsFileWidget()
        self.images.setStorageMode(QgsFileWidget.StorageMode.GetMultipleFiles)
        self.images.setFilter(f"{tr('Images and RPC files')} (*)")
        # A button with the project's rasters; chosen ones are added to the images
        self.layers, menu = QToolButton(self), QMenu(self)
        self.layers.setText(tr("Layers"))
        self.layers.setToolTip(tr("Add raster layers of the project"))
        self.layers.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        rasters = [one for one in QgsProject.instance().mapLayers().values() if isinstance(one, QgsRasterLayer)]
        rasters = sorted((one for one in rasters if one.providerType() == "gdal"), key=lambda one: one.name().lower())
        for title, chosen in ((tr("All"), rasters), *((layer.name(), [layer]) for layer in rasters)):
            ids = [layer.id() for layer in chosen]
            menu.addAction(title).triggered.connect(lambda _checked=False, ids=ids: self._add_layers(ids))
        self.layers.setMenu(menu)
        self.layers.setEnabled(bool(rasters))
        self.gcps, self.image_points = LayerOrFile(), LayerOrFile()
        self.fields = {field: QComboBox() for field in label_gcp_fields()}
        # Listing the fields opens the layer
        self._pause = make_pause(self, TYPING_MS, lambda: self._offer_fields(self.gcps.field_names()))
        self.gcps.box.editTextChanged.connect(lambda _text: self._offer_fields([]))
        self.gcps.box.editTextChanged.connect(lambda _text: self._pause.start())
        self.crs = QgsProjectionSelectionWidget()
        self.crs.setOptionVisible(QgsProjectionSelectionWidget.CrsOption.CrsNotSet, True)
        self.datum = QComboBox()
        self.datum.setEditable(True)
        self.datum.addItems(HEIGHT_DATUMS)
        images = QHBoxLayout()
        images.addWidget(self.images, 1)
        images.addWidget(self.layers)
        fields = QGroupBox(tr("Fields of the GCPs"))
        rows = QFormLayout(fields)
        for field, label in label_gcp_fields().items():
            rows.addRow(label, self.fields[field])
        _arrange_rows(
            self,
            (tr("Images or RPC files"), images),
            (tr("Ground points"), self.gcps.widget),
            (fields,),
            (tr("Image points (optional)"), self.image_points.widget),
            (tr("CRS if the file has none"), self.crs),
            (tr("Heights refer to"), self.datum),
        )
        self.resize(720, self.sizeHint().height())  # file names are long

    def _add_layers(self, ids: list[str]) -> None:
        context = QgsProcessingContext()
        context.setProject(QgsProject.instance())
        named = QgsFileWidget.splitFilePaths(self.images.filePath()) if self.images.filePath() else []
        paths = dict.fromkeys([*named, *(raster_source(name, context) for name in ids)])  # each once, in order
        self.images.setFilePath(" ".join(f'"{path}"' for path in paths))

    def _offer_fields(self, names: list[str]) -> None:
        """List the fields of the ground points for choosing."""
        for box in self.fields.values():
            box.clear()
            box.addItems(["", *names])

    def sources(self) -> dict[str, Any]:
        """Return the chosen files and settings; layers that differ from their file are copied."""
        context, feedback = QgsProcessingContext(), QgsProcessingFeedback()
        context.setProject(QgsProject.instance())
        points = {
            key: point_source(field.value(), key, context, feedback) if field.value() else ""
            for key, field in (("gcps", self.gcps), ("image_points", self.image_points))
        }
        chosen = {field: box.currentText() for field, box in self.fields.items()}
        points["gcps"] = name_fields(points["gcps"], chosen)
        return {
            "images": QgsFileWidget.splitFilePaths(self.images.filePath()),
            **points,
            "ground_crs": crs_text(crs) if (crs := self.crs.crs()).isValid() else None,
            "height_datum": self.datum.currentText(),
        }


_HIGHEST_M = 10_000.0  # largest height


class NewPointDialog(QDialog):
    """Dialog for a point clicked on the map: id, role, sigmas, and its height, which a DEM of the project can give."""

    def __init__(self, lonlat: tuple[float, float], name: str, height_m: float, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(f"{tr('New ground point at')} {lonlat[0]:.6f}, {lonlat[1]:.6f}")
        self._lonlat = lonlat
        self.name, self.role = QLineEdit(name), QComboBox()
        self.role.addItems(ROLES)
        self.dem, self.datum = QComboBox(), QComboBox()
        self.dem.addItem(tr("no DEM: as typed"), "")
        layers, kinds = QgsProject.instance().mapLayers().values(), QgsMapLayer.LayerType
        dems = [
            one
            for one in layers
            if one.type() == kinds.PointCloudLayer or (one.type() == kinds.RasterLayer and one.bandCount() == 1)
        ]
        for layer in sorted(dems, key=lambda one: str(one.name()).lower()):
            self.dem.addItem(layer.name(), layer.source())
        self.datum.addItems(HEIGHT_DATUMS)
        self.height, self.sigma_xy, self.sigma_h = (_metres() for _ in range(3))
        self.height.setMinimum(-_HIGHEST_M)
        self.height.setValue(height_m)
        for sigma in (self.sigma_xy, self.sigma_h):
            sigma.setSpecialValueText(tr("default"))
        _arrange_rows(
            self,
            (tr("Name"), self.name),
            (tr("Role"), self.role),
            (tr("Height from"), self.dem),
            (tr("Heights of the DEM refer to"), self.datum),
            (tr("Ellipsoidal height (m)"), self.height),
            (tr("Sigma east, north (m)"), self.sigma_xy),
            (tr("Sigma height (m)"), self.sigma_h),
        )
        for chooser in (self.dem, self.datum):
            chooser.currentIndexChanged.connect(lambda _index: self._look_up())

    def _look_up(self) -> None:
        """Show the height of the DEM, or the reason why there is none."""
        if not self.dem.currentData():
            return
        try:
            dem, datum = self.dem.currentData(), self.datum.currentText()
            self.height.setValue(point_session.dem_height(dem, datum, self._lonlat))
            self.height.setToolTip("")
        except HrsiError as error:
            self.height.setToolTip(str(error))

    def point(self) -> SurveyPoint:
        """Return the point; a sigma of 0 means the default."""
        sigmas: dict[str, Any] = {
            name: field.value()
            for name, field in (("sigma_xy", self.sigma_xy), ("sigma_h", self.sigma_h))
            if field.value()
        }
        name, role = self.name.text().strip(), self.role.currentText()
        return SurveyPoint(name, *self._lonlat, self.height.value(), role, **sigmas)


def _arrange_rows(dialog: QDialog, *rows: tuple[Any, ...]) -> None:
    """Put labels and their widgets into a dialog, with OK and Cancel below; a row without label has one widget."""
    form = QFormLayout(dialog)
    for row in rows:
        form.addRow(*row)
    buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel)
    buttons.accepted.connect(dialog.accept)
    buttons.rejected.connect(dialog.reject)
    form.addWidget(buttons)


def _metres() -> QDoubleSpinBox:
    """Return a field of metres with three decimals."""
    field = QDoubleSpinBox()
    field.setDecimals(3)
    field.setMaximum(_HIGHEST_M)
    field.setSuffix(" m")
    return field
