"""Measuring that leads: images off by 80 px are measured and adjusted with a click and a key a point.

The truth is the simulation's own: where the physical camera sees the middle of each disc, shifted as the RPCs are.
"""

import csv
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond
from qgis.core import QgsPointXY, QgsRectangle
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QImage
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QApplication

from hrsi.hrsi_engine.foundation.workers.threads import one_thread_calls
from hrsi.hrsi_engine.io.rasters.images import close_images
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.processing_algorithms import point_session, run
from hrsi.processing_algorithms.point_session import PointSession, files
from hrsi.processing_algorithms.point_session.rows import ImageMeasurement
from hrsi.tests.qgis.panels import click_in_image, close, is_at_rest, wait_for

BIAS_PX = ((80.0, 0.0), (-57.0, 57.0), (0.0, -80.0))
MOST_ACTIONS = 25  # the panel's issue: 10 GCPs on 3 images, where it were 56
LARGEST_PX = 0.15
LONGEST_CLICK_S = 0.15  # from a click to redrawn views: what follows a hand at once
#: CPU time of `work_as_a_click_does` on the machine for which the limit was set, when nothing else ran. A shared core
#: takes up to twice the CPU seconds for the same: a click counts in units of this work, done before and after it.
WORK_S = 0.025
WRONG = ("G000004", "image_2")  #: what is measured 9 px off
Truth = dict[tuple[str, str], np.ndarray]


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("guided") / "block"
    run(
        "simulate", output_dir=str(folder), images=3, along="-12,0,12", size=900, gcps=10, checks=0, ties=12, seed=11,
        noise_image=0.0, noise_gcp_xy=0.02, noise_gcp_h=0.03,
    )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def truth(block: Path) -> Truth:
    with (block / "image_points.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {(row["id"], row["image"]): np.array([float(row["sample"]), float(row["line"])]) for row in rows}


def make_session(block: Path, number: int = 3) -> PointSession:
    """Return nothing measured, on images whose RPCs are off by 80 px; more than three are the three again."""
    session = files.new_session([str(block / f"image_{k}.tif") for k in (1, 2, 3)], str(block / "ground_points.csv"))
    images = []
    for k in range(number):
        image, (sample, line) = list(session.images.values())[k % 3], BIAS_PX[k % 3]
        rpc = replace(image.rpc, samp_off=image.rpc.samp_off + sample, line_off=image.rpc.line_off + line)
        images.append(replace(image, id=image.id if k < 3 else f"{image.id}_{k}", rpc=rpc))
    return PointSession(images, list(session.points.values()))


@pytest.fixture
def dock(qgis_app, qgis_new_project, tmp_path: Path):
    panel = PointsDock(None, None, str(tmp_path / "unsaved"))
    panel.resize(1500, 800)
    panel.show()
    QApplication.setActiveWindow(panel)
    yield panel
    panel.discard_edits()
    close(panel)


@pytest.mark.rendered
def test_ten_gcps_on_three_images(dock, block: Path, truth: Truth) -> None:
    """A click in one image, a key for what is found in the others, on to the next point; adjusted all along."""
    dock.ui.number.setCurrentText("3")
    dock.show_session(make_session(block))
    actions, found, missed = 0, 0, []
    for _ in range(len(dock.session.points)):
        name = dock.point()
        wanted = [row.image for row in dock.session.measurements(name) if (name, row.image) in truth]
        image = dock.ui.grid.active_image()
        assert (name, image) not in dock.session.measured
        click_in_image(dock, image, truth[(name, image)] + (2.0, -1.5))
        actions += 1
        wait_for(lambda: is_at_rest(dock))
        found += len(dock.search.proposals)
        if dock.search.proposals:
            dock.ui.points.setFocus()
            QTest.keyClick(dock.ui.points, Qt.Key.Key_Y, Qt.KeyboardModifier.ShiftModifier)
            actions += 1
            wait_for(lambda: is_at_rest(dock))
        missed += [(name, image) for image in wanted if (name, image) not in dock.session.measured]
    off = [np.hypot(one.sample - truth[key][0], one.line - truth[key][1]) for key, one in dock.session.measured.items()]
    assert actions <= MOST_ACTIONS
    assert not missed
    assert max(off) < LARGEST_PX
    assert dock.session.is_adjusted  # nobody has asked for it
    predicted = [
        np.hypot(*(dock.session.predict_place(*key) - place)) for key, place in truth.items() if key[0][0] == "G"
    ]
    assert max(predicted) < LARGEST_PX


@pytest.fixture
def adjusted(dock, block: Path, truth: Truth) -> PointsDock:
    """Everything measured as it is, but one point 9 px off on one image, and adjusted."""
    session = make_session(block)
    for number, (key, place) in enumerate(truth.items()):
        if key[0] in session.points:
            session.measured[key] = ImageMeasurement(
                *(place + 0.05 * np.cos([number, 2.0 * number])), 0.1, "center", 0.9
            )
    wrong = session.measured[WRONG]
    session.measured[WRONG] = replace(wrong, sample=wrong.sample + 9.0)
    dock.show_session(session)
    dock.adjust()
    wait_for(lambda: is_at_rest(dock))
    return dock


def test_verdict_is_a_list_that_leads_to_the_points(adjusted) -> None:
    """Each reason is a line of its own, a click on it shows the residuals concerned; another block has no verdict."""
    dock, page = adjusted, adjusted.ui.tabs.indexOf(adjusted.ui.verdict)
    verdict = dock.session.adjusted.verdict
    assert dock.ui.tabs.tabText(page) == f"Verdict: {verdict.level.label}"
    assert dock.ui.message.text().count("\n") == 0  # no more lines than one below the images
    lines = [dock.ui.verdict.item(row) for row in range(dock.ui.verdict.count())]
    reasons = [item.data(Qt.ItemDataRole.UserRole) for item in lines]
    assert [reason for reason in reasons if reason is not None] == list(verdict.reasons)
    concerned = next(item for item, reason in zip(lines, reasons, strict=True) if reason and WRONG[0] in reason.points)
    dock.ui.tabs.setCurrentIndex(page)
    dock.ui.verdict.scrollToItem(concerned)
    where = dock.ui.verdict.visualItemRect(concerned).center()
    QTest.mouseClick(dock.ui.verdict.viewport(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, where)
    assert dock.ui.residuals.isVisible()
    assert dock.point() == WRONG[0] and dock.ui.grid.active_image() == WRONG[1]
    dock.show_session(PointSession())
    assert dock.ui.verdict.count() == 0 and dock.ui.tabs.tabText(page) == "Verdict"


def test_residuals_are_sorted_filtered_and_switched_off_in_one_table(adjusted) -> None:
    """The worst first, by the residual in its own sigmas; RMSE of the roles as computed from the residuals."""
    dock, model = adjusted, adjusted.residuals_model
    dock.ui.tabs.setCurrentIndex(1)
    row = model.rows[0]
    assert (row.point.id, row.image) == WRONG
    statistics = [row.statistic for row in model.rows]
    assert statistics == sorted(statistics, reverse=True)
    left = np.array([row.residual_px for row in model.rows])
    across, down = np.sqrt((left**2).mean(axis=0))
    assert f"gcp: 10 points, {len(left)} rays, RMSE {across:.2f}, {down:.2f} px" in dock.ui.rmse.text()
    dock.ui.filter.setCurrentIndex(2)
    dock.filter_residuals()
    assert {row.image for row in model.rows} == {"image_2"}
    dock.ui.residuals.sortByColumn(model.titles.index("ds px"), Qt.SortOrder.AscendingOrder)
    sizes = [abs(float(model.text(row, "ds px"))) for row in model.rows]
    assert sizes == sorted(sizes)
    dock.ui.residuals.selectRow(3)
    chosen = model.rows[3]
    assert (dock.point(), dock.ui.grid.active_image()) == (chosen.point.id, "image_2")
    dock.ui.filter.setCurrentIndex(0)
    dock.filter_residuals()
    at = model.index(model.row_of(*WRONG), model.titles.index("role"))
    assert model.setData(at, "off")
    assert dock.session.points[WRONG[0]].role == "off"
    wait_for(lambda: is_at_rest(dock))
    worst = max(row.statistic for row in point_session.list_residuals(dock.session) if row.point.role != "off")
    assert worst < 4.0 and dock.session.is_adjusted
    dock.undo()
    assert dock.session.points[WRONG[0]].role == "gcp"


@pytest.mark.thorough
def test_center_takes_what_is_seen_where_no_shape_is(dock, block: Path, truth: Truth) -> None:
    """On texture a click is taken as it is, and told to be; what is only predicted is refused there."""
    dock.show_session(make_session(block))
    rng = np.random.default_rng(3)
    targets = np.array([place for (name, image), place in truth.items() if image == "image_1" and name[0] != "T"])
    clicks = [xy for xy in rng.uniform(40.0, 860.0, (30, 2)) if np.hypot(*(targets - xy).T).min() > 40.0]
    moved = []
    for xy in clicks:
        fit = dock.session.fit("image_1", tuple(xy), "center")
        assert not fit.refusal
        if fit.measured.kind == "point":
            assert (fit.measured.sample, fit.measured.line) == tuple(xy) and np.isnan(fit.measured.sigma)
            assert dock.session.fit("image_1", tuple(xy), "center", is_seen=False).refusal
        else:
            moved.append(float(np.hypot(fit.measured.sample - xy[0], fit.measured.line - xy[1])))
    assert len(moved) <= 0.05 * len(clicks)  # the ground has a few closed shapes of its own
    for place in targets:
        assert dock.session.fit("image_1", tuple(place + (3.4, -2.6)), "center").measured.kind == "center"


def work_as_a_click_does() -> float:
    """Return the CPU time of a fixed work like that of a click: small matrices, calls of Python, drawing."""
    began, generator = time.process_time(), np.random.default_rng(1)
    A, b = generator.normal(size=(40, 6, 6)) + 6.0 * np.eye(6), generator.normal(size=(40, 6, 1))
    picture = QImage(400, 400, QImage.Format.Format_ARGB32)
    with one_thread_calls():
        for _ in range(300):
            rows = [f"{value:.3f}" for value in np.linalg.solve(A, b).ravel().tolist()]
            picture.fill(len(rows))
    return time.process_time() - began


@pytest.mark.parametrize(("number", "is_measured"), mark_beyond(1, "large", [(9, False), (9, True), (3, True)]))
def test_click_to_redrawn_views(dock, block: Path, truth: Truth, number: int, is_measured: bool) -> None:
    """CPU time from a click until all views are drawn anew and the residuals follow: the least of six, see `WORK_S`.

    The point is measured in all images and its residuals follow, or in none: then all others go to where it is now.
    """
    dock.ui.number.setCurrentText(str(number))
    session = make_session(block, number)
    for key, place in truth.items():
        for image in session.images:
            if key[0] in session.points and image.startswith(key[1]):
                session.measured[(key[0], image)] = ImageMeasurement(*place, 0.1, "center", 0.9)
    names = [name for name in session.points if all((name, image) in session.measured for image in session.images)]
    made = dict(session.measured)
    for key in made if not is_measured else ():
        if key[0] in names[:-1]:
            del session.measured[key]
    dock.show_session(session)
    dock.adjust()
    took = []
    for step in range(6):
        name = names[0 if is_measured else step % (len(names) - 1)]
        dock.choose(name)
        wait_for(lambda: is_at_rest(dock))
        view = dock.ui.grid.list_views()[0]
        place, before = made[(name, view.image())], dock.session.history.state
        work = work_as_a_click_does()
        began = time.process_time()
        click_in_image(dock, view.image(), (place.sample + 0.3 * step, place.line))
        dock.search._queue.clear()  # looking for it in the others comes behind: an image at a time
        QApplication.processEvents()
        wait_for(lambda: not any(one.canvas.isDrawing() for one in dock.ui.grid.list_views()))
        taken = time.process_time() - began
        took.append(taken * 2.0 * WORK_S / (work + work_as_a_click_does()))
        assert dock.session.history.state != before
        dock.undo()
        wait_for(lambda: is_at_rest(dock))
    assert min(took) <= LONGEST_CLICK_S


def test_views_have_north_on_top_and_zoom_together(adjusted) -> None:
    dock = adjusted
    for view in dock.ui.grid.list_views():
        point, session = dock.session.points[dock.point()], dock.session
        places = [np.array([[point.lon, point.lat + step, point.height]]) for step in (0.0, 1e-4)]
        south, north = (session.project(view.image(), place)[0] for place in places)
        to_screen = view.canvas.getCoordinateTransform().transform
        low, high = (to_screen(QgsPointXY(xy[0], -xy[1])) for xy in (south, north))
        assert high.y() < low.y() and abs(high.x() - low.x()) < 0.03 * (low.y() - high.y())
    first, second = dock.ui.grid.list_views()[:2]
    before = second.canvas.mapUnitsPerPixel()
    first.canvas.zoomed.emit(0.5)
    assert second.canvas.mapUnitsPerPixel() == pytest.approx(0.5 * before, rel=0.01)
    dock.ui.linked.setChecked(False)
    first.canvas.zoomed.emit(0.5)
    assert second.canvas.mapUnitsPerPixel() == pytest.approx(0.5 * before, rel=0.01)


def test_contrast_is_that_of_the_view(adjusted) -> None:
    """Black and white are 2 and 98 % of the greys in view, by the pixels themselves; gamma stays with its image."""
    view = adjusted.ui.grid.list_views()[0]
    adjusted.ui.north.setChecked(False)
    extent = view.canvas.extent()
    low, high = (round(v) for v in (extent.xMinimum(), extent.xMaximum()))
    top, bottom = (round(-v) for v in (extent.yMaximum(), extent.yMinimum()))
    low, top = max(low, 0), max(top, 0)
    raster = adjusted.session.images[view.image()].raster
    high, bottom = min(high, raster.size[0]), min(bottom, raster.size[1])
    grey, valid = raster.read(low, top, high - low, bottom - top)
    close_images()
    wanted = np.percentile(grey[valid], (2.0, 98.0))
    assert view.grey_range == pytest.approx(wanted, rel=0.05)
    view.gamma.setValue(1.8)
    image, other = view.image(), next(name for name in adjusted.session.images if name != view.image())
    adjusted.ui.number.setCurrentText("1")
    for chosen, gamma in ((other, 1.0), (image, 1.8)):
        adjusted.ui.grid.frame_image(chosen)
        assert adjusted.ui.grid.views[0].gamma.value() == gamma


def test_contrast_waits_for_an_extent(adjusted, monkeypatch) -> None:
    """A new canvas of QGIS 3.40 has an extent without end."""
    view, nothing = adjusted.ui.grid.list_views()[0], QgsRectangle()
    nothing.setMinimal()
    before = view.grey_range
    with monkeypatch.context() as patched:
        patched.setattr(view.canvas, "extent", lambda: nothing)
        view.show_place((100.0, 100.0))
    assert view.grey_range == before
