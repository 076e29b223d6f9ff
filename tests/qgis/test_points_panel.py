"""The panel on a simulated block: clicks become sub-pixel measurements, they are saved, adjusted and judged.

The truth is the simulation's own: image points without noise, where the physical camera sees the middle of each disc.
"""

import csv
import gc
import shutil
import time
from pathlib import Path

import pytest
from osgeo import ogr
from qgis.core import QgsApplication, QgsProject, QgsRasterLayer
from qgis.gui import QgsMapCanvas
from qgis.PyQt.QtCore import Qt

from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.plugin.points_panel.table_models import SUSPICIOUS
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import files
from hrsi.tests.qgis.panels import click_in_image, close, wait_for
from hrsi.tests.qgis.profile import REPOSITORY

SUBPIXEL = 0.1  # px: what a click must come to, as the issue of the panel asks
CLICK_OFF = (3.4, -2.6)  # px beside the middle, as a hurried hand does
IMAGE = "image_1"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two images of a place with discs whose middles are known exactly."""
    folder = tmp_path_factory.mktemp("simulated") / "block"
    run(
        "simulate", output_dir=str(folder), size=500, gcps=7, checks=3, ties=12, seed=4, noise_image=0.0,
        noise_gcp_xy=0.02, noise_gcp_h=0.03,
    )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def truth(simulated: Path) -> dict[tuple[str, str], tuple[float, float]]:
    with (simulated / "image_points.csv").open(encoding="utf-8", newline="") as file:
        return {(row["id"], row["image"]): (float(row["sample"]), float(row["line"])) for row in csv.DictReader(file)}


def make_dock(simulated: Path, canvas: QgsMapCanvas | None = None) -> PointsDock:
    """Return the panel with images and ground points, nothing measured."""
    panel = PointsDock(None, canvas, str(simulated / "unsaved"))
    panel.resize(1100, 600)
    panel.show()
    images = [str(simulated / f"image_{number}.tif") for number in (1, 2)]
    panel.show_session(files.new_session(images, str(simulated / "ground_points.csv")))
    return panel


@pytest.fixture
def dock(qgis_app, qgis_new_project, simulated: Path):
    panel = make_dock(simulated)
    yield panel
    panel.discard_edits()
    close(panel)


@pytest.fixture(scope="module")
def clicked(qgis_app, simulated: Path, truth):
    """Every point clicked on both images, once for all tests: the measurements, and how far they are from the truth."""
    panel = make_dock(simulated)
    distances = measure_all(panel, truth)
    assert all(not view.chip.pixmap().isNull() for view in panel.ui.grid.views)
    assert panel.session.changed and panel.windowTitle().endswith("*")
    measured = panel.session.measured
    panel.discard_edits()
    close(panel)
    return measured, distances


@pytest.fixture
def measured(dock, clicked) -> PointsDock:
    """The panel with everything measured."""
    dock.session.restore(dock.session.points, clicked[0])
    dock.refresh()
    return dock


def measure_all(panel: PointsDock, truth: dict[tuple[str, str], tuple[float, float]]) -> list[float]:
    """Click every known point on both images; return how far from the truth the measurements are (px)."""
    distances = []
    for name in panel.session.points:
        panel.choose(name)
        for view in panel.ui.grid.views:
            sample, line = truth[(name, view.image())]
            click_in_image(panel, view.image(), (sample + CLICK_OFF[0], line + CLICK_OFF[1]))
            made = panel.session.measured[(name, view.image())]
            distances.append(((made.sample - sample) ** 2 + (made.line - line) ** 2) ** 0.5)
    return distances


def adjust(panel: PointsDock) -> bool:
    """Press "Adjust" and let the event loop turn until it has ended."""
    ended: list[bool] = []
    panel.adjusted.connect(ended.append)
    panel.ui.adjust.trigger()
    wait_for(lambda: bool(ended), 60.0)
    return ended[0]


def test_images_are_zoomed_to_the_predicted_position(dock) -> None:
    for name in list(dock.session.points)[:3]:
        dock.choose(name)
        for view in dock.ui.grid.views:
            sample, line = dock.session.predict_place(name, view.image())
            middle = view.canvas.extent().center()
            assert middle.x() == pytest.approx(sample, abs=0.01)
            assert middle.y() == pytest.approx(-line, abs=0.01)


def test_map_coordinates_are_sample_and_minus_line(dock, simulated: Path) -> None:
    """The first pixel's middle is (0, 0), and the view has no RPC that QGIS would warp it by."""
    dock.choose(next(iter(dock.session.points)))
    (layer,) = dock.ui.grid.views[0].canvas.layers()
    assert isinstance(layer, QgsRasterLayer) and layer.isValid()
    extent = layer.extent()
    assert (extent.xMinimum(), extent.yMaximum()) == (-0.5, 0.5)
    assert (extent.width(), extent.height()) == (500.0, 500.0)


def test_click_measures_to_subpixel(clicked) -> None:
    distances = clicked[1]
    assert len(distances) == 20
    assert sum(distances) / len(distances) < SUBPIXEL / 2.0
    assert max(distances) < SUBPIXEL


def test_chip_shows_the_pixels(dock, truth) -> None:
    """The chip has the image's grey values under the fitted curve, not only lines."""
    name = next(iter(dock.session.points))
    dock.choose(name)
    click_in_image(dock, IMAGE, truth[(name, IMAGE)])
    chip = dock.ui.grid.views[0].chip.pixmap().toImage()
    colours = {chip.pixelColor(x, y).rgb() for x in range(0, chip.width(), 3) for y in range(0, chip.height(), 3)}
    assert len(colours) > 30


def test_nothing_there_is_refused_with_the_reason(dock, truth) -> None:
    name = next(iter(dock.session.points))
    dock.choose(name)
    dock.ui.kind.setCurrentText("corner")
    before = dict(dock.session.measured)
    dock.measure(IMAGE, 1e5, 1e5)
    assert dock.session.measured == before
    assert "outside the image" in dock.ui.message.text()


def test_save_adjust_and_reopen(measured, tmp_path: Path) -> None:
    path = str(tmp_path / "block.gpkg")
    measured.files.save_as(path)
    assert not measured.session.changed
    assert adjust(measured)
    rows = measured.points_model.rows
    assert all(abs(part) < 0.5 for row in rows for part in row.residual_m)  # metres, of pixels of 0.7 m
    assert "Verdict: " in measured.ui.message.text().splitlines()[0]
    check = measured.session.adjusted.check
    assert check["points"] == 3
    columns = measured.points_model.titles
    texts = [measured.points_model.index(0, columns.index(title)).data() for title in ("dE m", "dN m", "dH m")]
    assert all(texts)  # the residuals appear next to the point
    assert any(marker.residual_px for marker in measured.ui.grid.views[0].markers.markers)
    assert not any(row.suspicion for row in rows)
    again = files.open_block(path)
    assert again.measured.keys() == measured.session.measured.keys()
    for key, made in measured.session.measured.items():
        assert again.measured[key].sample == pytest.approx(made.sample, abs=1e-9)
        assert again.measured[key].sigma == pytest.approx(made.sigma, abs=1e-9)
    for name, point in measured.session.points.items():
        assert again.points[name].role == point.role
        assert again.points[name].lon == pytest.approx(point.lon, abs=1e-11)  # the survey, not the adjusted position
        assert again.points[name].height == pytest.approx(point.height, abs=1e-6)


def test_prediction_follows_the_adjustment(measured, truth) -> None:
    name = "G000001"
    vendor = files.new_session([measured.session.images[IMAGE].path])
    vendor.points = measured.session.points
    before = vendor.predict_place(name, IMAGE)
    assert adjust(measured)
    after, wanted = measured.session.predict_place(name, IMAGE), truth[(name, IMAGE)]
    off = [((x - wanted[0]) ** 2 + (y - wanted[1]) ** 2) ** 0.5 for x, y in (before, after)]
    assert off[0] > 2.0  # the vendor's RPC errs
    assert off[1] < 0.5


def test_suspicious_point_is_red(measured) -> None:
    wrong = "G000003"
    made = measured.session.measured[(wrong, IMAGE)]
    measured.choose(wrong)
    sample = measured.measurements_model.index(0, measured.measurements_model.titles.index("sample"))
    assert measured.measurements_model.setData(sample, f"{made.sample + 25.0:.2f}")
    assert adjust(measured)
    red = [
        row.point.id
        for index, row in enumerate(measured.points_model.rows)
        if measured.points_model.index(index, 0).data(Qt.ItemDataRole.ForegroundRole) == SUSPICIOUS
    ]
    assert red == [wrong]
    tip = measured.points_model.index(measured.points_model.row_of(wrong), 0).data(Qt.ItemDataRole.ToolTipRole)
    assert tip
    assert any(marker.is_suspicious for marker in measured.ui.grid.views[0].markers.markers)


def test_role_and_sigma_are_edited_in_the_table(dock) -> None:
    model = dock.points_model
    name = model.rows[0].point.id
    assert model.setData(model.index(0, model.titles.index("role")), "gcp")
    assert model.setData(model.index(0, model.titles.index("sigma xy m")), "0,25")
    assert (dock.session.points[name].role, dock.session.points[name].sigma_xy) == ("gcp", 0.25)
    assert not model.setData(model.index(0, model.titles.index("sigma h m")), "-1")
    assert "above 0" in dock.ui.message.text()
    assert not model.setData(model.index(0, model.titles.index("sigma h m")), "much")
    assert "not a number" in dock.ui.message.text()


def test_cancel(measured, monkeypatch) -> None:
    """The task gives up at its next report of progress; the panel can adjust again."""
    from hrsi.hrsi_engine.foundation.progress import advance
    from hrsi.processing_algorithms.point_session import adjusting

    def slow(block, model, progress, listed):
        for step in range(3000):
            advance(progress, step / 3000.0)
            time.sleep(0.02)

    monkeypatch.setattr(adjusting, "adjust_block", slow)
    ended: list[bool] = []
    measured.adjusted.connect(ended.append)
    measured.ui.adjust.trigger()
    wait_for(lambda: measured.ui.progress.isVisible(), 10.0)
    start = time.monotonic()
    measured.ui.cancel.trigger()
    wait_for(lambda: bool(ended), 10.0)
    assert time.monotonic() - start < 1.0
    assert ended == [False]
    assert measured.ui.adjust.isEnabled()
    assert "cancelled" in measured.ui.message.text()


def test_nothing_measured_is_told(dock) -> None:
    dock.ui.adjust.trigger()
    assert "measure one first" in dock.ui.message.text()


def test_project_keeps_the_block(measured, tmp_path: Path) -> None:
    measured.files.save_as(str(tmp_path / "block.gpkg"))
    measured.choose("G000002")
    project = tmp_path / "project.qgz"
    assert QgsProject.instance().write(str(project))
    QgsProject.instance().clear()
    assert not measured.session.points
    assert QgsProject.instance().read(str(project))
    assert len(measured.session.measured) == 20
    assert measured.point() == "G000002"


def test_a_panel_is_closed_while_it_adjusts(measured) -> None:
    """Nobody but QGIS knows the task then: collecting what nobody holds must not take it away from under it."""
    task_manager = QgsApplication.taskManager()
    for _ in range(5):
        measured.adjust(is_asked=False)
        assert measured.adjustment.is_running()
        end = time.monotonic() + 0.05  # some have begun, some have not
        while time.monotonic() < end:
            QgsApplication.processEvents()
        measured.show_session(measured.session)  # which gives the adjustment up
        gc.collect()
        wait_for(lambda: task_manager.count() == 0, 60.0)
        assert not measured.adjustment.is_running()
    assert adjust(measured)


@pytest.mark.thorough
def test_rpc_files_without_pixels(qgis_app, qgis_new_project, tmp_path: Path) -> None:
    """The Hobart block: the table takes coordinates, the views say that there are no pixels."""
    hobart = tmp_path / "hobart"
    shutil.copytree(REPOSITORY / "examples" / "hobart", hobart)
    panel = PointsDock(unsaved_root=str(tmp_path / "unsaved"))
    images = [str(hobart / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)]
    panel.show_session(
        files.new_session(images, str(hobart / "hobart_ground_points.csv"), str(hobart / "hobart_image_points.csv"))
    )
    name = panel.session.rows()[0].point.id
    panel.choose(name)
    assert panel.ui.grid.views[0].note.text() == "no pixels"
    panel.measure(panel.ui.grid.views[0].image(), 100.0, 100.0)
    assert "no pixels" in panel.ui.message.text()
    path = str(tmp_path / "block.gpkg")
    panel.files.save_as(path)
    assert adjust(panel)
    dataset = ogr.Open(path)
    assert dataset.GetLayerByName("residuals_utm").GetFeatureCount() > len(panel.session.measured)
    close(panel)
