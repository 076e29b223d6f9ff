"""Every rule of every style of the result's layers has a symbol, and draws in the map of QGIS at every scale."""

from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import Polygon

from hrsi.hrsi_engine.io.geopackage.layer_styles import STYLES
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.tests.desktop.desktop import Desktop

pytestmark = pytest.mark.programs

SCALES = (500, 5000, 50_000)
COUNT = 9000
CENTRE, DEGREE_M = (5.0, 44.0), 111_000.0
#: Values that the fields of rules take; each row has one of each at random.
WORDS = {
    "role": ("gcp", "check", "tie", "held_out"), "flag": ("ok", "outlier"), "level": ("ground", "image"),
    "kind": ("corner", "super", "region", "rectangle", "ellipse", "blob"), "state": ("before", "after"),
    "outcome": ("matched", "no texture"), "reason": ("", "cloud", "water"),
}  # fmt: skip

#: Statements for QGIS: draw each rule of a layer alone, and count its pixels.
DRAWN = """
from qgis.core import QgsPointXY, QgsRectangle, QgsRuleBasedRenderer, QgsVectorLayer

def drawn(source, name, scale):
    layer = QgsVectorLayer(source, name, "ogr")
    layer.loadDefaultStyle()
    canvas = iface.mapCanvas()
    QgsProject.instance().removeAllMapLayers()
    QgsProject.instance().addMapLayer(layer)
    QApplication.processEvents()
    canvas.setExtent(QgsRectangle.fromCenterAndSize(QgsPointXY(*CENTRE), 0.01, 0.01))
    canvas.zoomScale(scale)
    found = {}
    renderer = layer.renderer()
    if not isinstance(renderer, QgsRuleBasedRenderer):
        return {name: pixels()}
    layer.setLabelsEnabled(False)
    rules = renderer.rootRule().children()
    for chosen in rules:
        if chosen.isScaleOK(canvas.scale()):
            for rule in rules:
                rule.setActive(rule is chosen)
            label = chosen.label().split(", one of")[0]
            found[label] = found.get(label, 0) + pixels()
    return found
"""


@pytest.fixture(scope="module")
def layers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A GeoPackage with all layers that have a style: half of the points within 60 m, the others within 12 km."""
    rng = np.random.default_rng(3)
    spread_m = np.where(np.arange(COUNT) % 2 == 0, 60.0, 12_000.0)[:, None]
    xy = np.array(CENTRE) + rng.uniform(-1.0, 1.0, (COUNT, 2)) * spread_m / DEGREE_M
    place = np.column_stack([xy, np.zeros(COUNT)])
    fields = {name: rng.choice(words, COUNT) for name, words in WORDS.items()}
    fields |= {"id": np.arange(COUNT).astype(str), "image": np.full(COUNT, "a"), "views": rng.integers(2, 6, COUNT)}
    fields["used"] = fields["reason"] == ""
    for name in (
        "residual_east_m", "residual_north_m", "residual_sample_px", "residual_line_px", "residual_height_m", "east_m",
        "north_m",
    ):  # fmt: skip
        fields[name] = rng.normal(0.0, 1.0, COUNT)
    folder = tmp_path_factory.mktemp("styles")
    ring = np.array(CENTRE) + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.0004
    areas = "images", "seamlines"
    points = [Layer(name, "PointZ", 4326, place, fields) for name in STYLES if name not in areas]
    polygons = [Layer(name, "Polygon", 4326, [Polygon(ring)], {"id": np.array(["img"])}) for name in areas]
    write_geopackage(str(folder / "block.gpkg"), [*polygons, *points])
    return folder / "block.gpkg"


def test_every_rule_draws_at_every_scale(desktop: Desktop, layers: Path) -> None:
    """Rules that share a symbol in a style's text lose it: QGIS gives it to the first."""
    desktop.ask(f"CENTRE = {CENTRE}\n{DRAWN}")
    desktop.ask("iface.newProject(False)")
    labels: dict[str, set[str]] = {}
    empty = []
    for scale in SCALES:
        for name in STYLES:
            drawn = desktop.ask(f"drawn({f'{layers}|layername={name}'!r}, {name!r}, {scale})")
            labels.setdefault(name, set()).update(drawn)
            empty += [(name, scale, label) for label in labels[name] if not drawn.get(label)]
            print(scale, name, drawn)
            desktop.picture(f"{name}_{scale}")
    assert empty == []
