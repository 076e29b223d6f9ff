"""Places in the map and on the ground agree in every CRS of a project, that of HRSI's own layers (EPSG:4979) too."""

import pyproj
import pytest
from qgis.core import QgsCoordinateReferenceSystem
from qgis.gui import QgsMapCanvas

from hrsi.plugin.points_panel.project_link import MapLink, lonlat_of

PLACE = 5.4, 43.5
SAME_DEG = 1e-9


@pytest.mark.parametrize("code", ["EPSG:4979", "EPSG:4326", "EPSG:32631", "EPSG:2154"])
def test_mark_and_click_are_at_one_place(qgis_app, code: str) -> None:
    """The mark lies where PROJ has it, and a click there gives longitude and latitude back."""
    canvas = QgsMapCanvas()
    canvas.setDestinationCrs(QgsCoordinateReferenceSystem(code))
    link = MapLink(None, canvas)
    link.mark(PLACE)
    centre = link._mark.center()
    expected = pyproj.Transformer.from_crs("EPSG:4326", code, always_xy=True).transform(*PLACE)
    assert (centre.x(), centre.y()) == pytest.approx(expected, abs=1e-2 if abs(expected[0]) > 180.0 else SAME_DEG)
    assert lonlat_of(canvas, centre) == pytest.approx(PLACE, abs=1e-7)
    link.mark(None)
