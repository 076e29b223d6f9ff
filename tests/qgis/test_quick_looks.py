"""What is there to look at after an adjustment: images before and after it on the map, in turn, and a print layout."""

import re
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal
from qgis.core import (
    QgsApplication,
    QgsLayoutItemAttributeTable,
    QgsLayoutItemLabel,
    QgsLayoutItemMap,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.gui import QgsMapCanvas

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.plugin.results import Comparison, make_print_layout
from hrsi.processing_algorithms import run
from hrsi.tests.qgis.panels import guarded_threads, run_in_background

LOOK_PX = 2.0  # resampling twice, and relief of the simulated ground


@pytest.fixture(scope="module")
def result(hrsi_provider, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an adjustment in a background task of QGIS, of images with pixels."""
    folder = tmp_path_factory.mktemp("looks")
    run("simulate", output_dir=str(folder / "block"), size=400, gcps=6, checks=2, ties=8, seed=3, relief=1.0)
    given = {
        "IMAGES": [str(folder / "block" / f"image_{number}.tif") for number in (1, 2)], "MODEL": "shift",
        "GCPS": str(folder / "block" / "ground_points.csv"), "OUTPUT_DIR": str(folder / "out"),
        "IMAGE_POINTS": str(folder / "block" / "image_points.csv"),
    }  # fmt: skip
    algorithm = QgsApplication.processingRegistry().createAlgorithmById("hrsi:adjust")
    with guarded_threads():
        successful, _results = run_in_background(algorithm, given)
    assert successful
    return folder / "out"


def test_quick_looks_lie_where_the_rpcs_put_them(result: Path) -> None:
    """The middle of each image is where its RPC, evaluated by the engine, has it; before and after differ."""
    places = {}
    for path in sorted((result / "quick_looks").glob("*.tif")):
        name, _, state = path.stem.rpartition("_")
        image = open_image(
            str(result.parent / "block" / f"{name}.tif" if state == "before" else result / f"{name}.tif")
        )
        look = gdal.Open(str(path))
        origin_x, step_x, _, origin_y, _, step_y = look.GetGeoTransform()
        valid = np.argwhere(look.ReadAsArray() > 0)
        middle = np.array([origin_x, origin_y]) + (valid.mean(axis=0)[::-1] + 0.5) * (step_x, step_y)
        heights = QgsVectorLayer(f"{result / 'block.gpkg'}|layername=images", "", "ogr")
        height = next(row["footprint_height_m"] for row in heights.getFeatures() if row["id"] == name)
        expected = image.rpc.localize(np.array([[199.5, 199.5]]), height).ground[0, :2]
        assert np.abs((middle - expected) / step_x).max() < LOOK_PX
        places[(name, state)] = expected
    assert len(places) == 4
    assert np.abs(places[("image_1", "before")] - places[("image_1", "after")]).max() > 1e-6


def test_comparison_shows_one_state_at_a_time(result: Path, qgis_new_project) -> None:
    project = QgsProject.instance()
    for path in (result / "quick_looks").glob("*.tif"):
        project.addMapLayer(QgsRasterLayer(str(path), path.stem))
    project.addMapLayer(QgsVectorLayer("Point?crs=EPSG:4326", "flood_before", "memory"))  # the user's own

    def shown() -> set[str]:
        names = {node.name() for node in project.layerTreeRoot().findLayers() if node.isVisible()}
        assert "flood_before" in names
        return {name.rpartition("_")[2] for name in names - {"flood_before"}}

    comparison = Comparison()
    comparison.switch(True)
    assert shown() == {"after"}
    comparison.swap()
    assert shown() == {"before"}
    comparison.switch(False)
    assert shown() == {"after"}


def test_print_layout_has_title_map_and_table(result: Path, qgis_new_project) -> None:
    """The table has the control and check points with their residuals; the map has the layers of the canvas."""
    layer = QgsVectorLayer(f"{result / 'block.gpkg'}|layername=residuals_utm", "residuals", "ogr")
    QgsProject.instance().addMapLayer(layer)
    canvas = QgsMapCanvas()
    canvas.setLayers([layer])
    canvas.setExtent(layer.extent())
    layout = make_print_layout(canvas)
    items = {type(item): item for item in layout.items()}
    assert items[QgsLayoutItemLabel].text().startswith("Block adjustment")
    assert items[QgsLayoutItemMap].layers() == [layer]
    assert items[QgsLayoutItemMap].extent().buffered(1e-6).contains(layer.extent())
    assert items[QgsLayoutItemMap].sizeWithUnits().width() == pytest.approx(180.0)
    (table,) = (one for one in layout.multiFrames() if isinstance(one, QgsLayoutItemAttributeTable))
    table.refresh()
    rows = table.contents()
    assert len(rows) == 8 and {row[1] for row in rows} == {"gcp", "check"}
    assert all(re.fullmatch(r"-?\d+\.\d\d", number) for row in rows for number in row[2:]), rows
    assert layout.pageCollection().page(0).pageSize().width() == pytest.approx(297.0)
    assert make_print_layout(canvas).name() == "HRSI 2"
