"""The styles stored in a GeoPackage are what QGIS loads, and its pictures show the arrows where they belong."""

from pathlib import Path

import numpy as np
import pytest
from qgis.core import (
    QgsLayerTree,
    QgsLayerTreeModel,
    QgsMapRendererSequentialJob,
    QgsMapSettings,
    QgsRectangle,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor
from shapely.geometry import Polygon

from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.geopackage.typed_rows import write_title

SIZE, DPI = 400, 127.0  # 127 dpi: 5 pixels a millimetre
GROUND_PX, IMAGE_PX = 40, 20  # 8 mm and 4 mm


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory, qgis_app: object) -> Path:
    """One check point in the middle with a residual to the north; one measurement with a residual down the image."""
    path = tmp_path_factory.mktemp("styles") / "block.gpkg"
    level = np.array(["ground", "image"])
    fields = {
        "id": np.array(["", ""]), "role": np.array(["check", "check"]), "image": np.array(["", "img"]), "level": level,
        "flag": np.array(["ok", "ok"]), "residual_sample_px": np.array([np.nan, 0.0]),
        "residual_line_px": np.array([np.nan, 0.3]), "residual_east_m": np.array([0.0, np.nan]),
        "residual_north_m": np.array([0.25, np.nan]),
    }  # fmt: skip
    place = np.array([[5.0, 44.0, 0.0], [5.0, 44.0, 0.0]])
    ring = np.array([[4.95, 43.95], [5.05, 43.95], [5.05, 44.05], [4.95, 44.05]])
    write_geopackage(str(path), [
        Layer("images", "Polygon", 4326, [Polygon(ring)], {"id": np.array(["img"])}),
        Layer("ground_points", "PointZ", 4326, place[:1], {"id": np.array(["A"]), "role": np.array(["gcp"])}),
        Layer("residuals_wgs84", "PointZ", 4326, place, fields),
        Layer("image_points", "PointZ", 4326, place[1:], {name: column[1:] for name, column in fields.items()}),
    ])  # fmt: skip
    return path


def loaded(block: Path, name: str) -> QgsVectorLayer:
    layer = QgsVectorLayer(f"{block}|layername={name}", name, "ogr")
    assert layer.isValid()
    _, found = layer.loadDefaultStyle()
    assert found
    return layer


def picture(layer: QgsVectorLayer) -> tuple[np.ndarray, int]:
    """Return the grey values (rows, columns) of a map around the point, and the number of labels."""
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setOutputSize(QSize(SIZE, SIZE))
    settings.setOutputDpi(DPI)
    settings.setExtent(QgsRectangle(4.9, 43.9, 5.1, 44.1))
    settings.setBackgroundColor(QColor("white"))
    job = QgsMapRendererSequentialJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage()
    grey = np.array([[QColor(image.pixel(x, y)).lightness() for x in range(SIZE)] for y in range(SIZE)])
    return grey, len(job.takeLabelingResults().labelsWithinRect(settings.visibleExtent()))


def test_ground_residual_is_an_arrow_of_8_mm_to_the_north(block: Path) -> None:
    grey, _ = picture(loaded(block, "residuals_wgs84"))
    rows, columns = np.nonzero(grey < 200)
    assert rows.min() == pytest.approx(SIZE // 2 - GROUND_PX, abs=3)  # antialiasing and the head's width
    assert abs(rows.max() - SIZE // 2) <= 8  # the point's own symbol, 2 mm wide
    assert np.abs(columns - SIZE // 2).max() <= 8


def test_image_residual_points_down_where_the_line_grows(block: Path) -> None:
    grey, _ = picture(loaded(block, "image_points"))
    rows, columns = np.nonzero(grey < 200)
    assert rows.max() == pytest.approx(SIZE // 2 + IMAGE_PX, abs=3)
    assert rows.min() >= SIZE // 2 - 4
    assert np.abs(columns - SIZE // 2).max() <= 5


def test_the_legend_has_short_symbols(block: Path) -> None:
    """The texts stand beside small symbols; arrows as wide as the panel pushed them off the screen."""
    layer = loaded(block, "residuals_wgs84")
    tree = QgsLayerTree()
    node = tree.addLayer(layer)
    model = QgsLayerTreeModel(tree)
    texts = {entry.data(0): entry.minimumIconSize().width() for entry in model.layerLegendNodes(node)}
    assert "Check point, 8 mm = 0.25 m" in texts
    assert max(texts.values()) <= 24  # pixels


def test_image_rows_are_off_while_there_are_ground_rows(block: Path) -> None:
    layer = loaded(block, "residuals_wgs84")  # the rules live as long as the layer
    shown = {rule.label().split(",")[0]: rule.active() for rule in layer.renderer().rootRule().children()}
    assert shown["Check point"]
    assert not shown["In image"]


@pytest.mark.parametrize(
    ("name", "renderer", "names"), [("images", "singleSymbol", 1), ("ground_points", "RuleRenderer", 0)]
)
def test_names_are_drawn_once(block: Path, name: str, renderer: str, names: int) -> None:
    """Residuals and points lie on one another in the map: the residuals carry the names."""
    layer = loaded(block, name)
    assert layer.renderer().type() == renderer
    assert picture(layer)[1] == names
    assert loaded(block, "residuals_wgs84").labelsEnabled()


def test_fields_have_names_with_units(block: Path) -> None:
    """Forms and tables show words and units, from the file alone."""
    layer = loaded(block, "residuals_wgs84")
    names = {field.name(): layer.attributeDisplayName(index) for index, field in enumerate(layer.fields())}
    assert names["residual_east_m"] == "Residual east (m)"
    assert names["residual_sample_px"] == "Residual sample (px)"
    assert names["role"] == "Role"
    assert write_title("sigma_xy") == "Sigma xy" and write_title("footprint_height_m") == "Footprint height (m)"
