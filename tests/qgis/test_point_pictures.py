"""Photographs of the survey and chips of other images beside the views, and a library of chips in the panel."""

import csv
from pathlib import Path

import numpy as np
import pytest
from qgis.core import QgsSettings
from qgis.PyQt.QtGui import QColor, QImage
from qgis.PyQt.QtWidgets import QApplication

from hrsi.plugin.points_panel.block_files import LIBRARY_SETTING
from hrsi.plugin.points_panel.dock import PointsDock
from hrsi.processing_algorithms import point_session, run
from hrsi.processing_algorithms.point_session import files
from hrsi.tests.qgis.panels import close, wait_for

NAME, OTHER = "G000001", "G000003"


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two days of a scene; a photograph of one point named in the file, of another in a folder by its id."""
    folder = tmp_path_factory.mktemp("pictures") / "block"
    run("simulate", output_dir=str(folder), images=2, along="-10,12", size=500, gcps=6, checks=0, ties=6, seed=24,
        dates=2, noise_image=0.0, relief=40.0)  # fmt: skip
    (folder / "photos").mkdir()
    for path, colour in (
        ("field/first.jpg", "red"),
        (f"photos/{OTHER}_north.png", "blue"),
        ("photos/G00000.png", "red"),
    ):
        photo = QImage(800, 600, QImage.Format.Format_RGB32)
        photo.fill(QColor(colour))
        (folder / path).parent.mkdir(exist_ok=True)
        assert photo.save(str(folder / path))
    with (folder / "ground_points.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with (folder / "with_photos.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [*rows[0], "photo"])
        writer.writeheader()
        writer.writerows(row | {"photo": "field/first.jpg" if row["id"] == NAME else ""} for row in rows)
    return folder


@pytest.fixture
def dock(qgis_app, qgis_new_project, block: Path, tmp_path: Path):
    QgsSettings().remove(LIBRARY_SETTING)
    panel = PointsDock(None, None, str(tmp_path / "unsaved"))
    panel.resize(1500, 800)
    panel.show()
    QApplication.setActiveWindow(panel)
    panel.show_session(open_day(block, 1))
    yield panel
    QgsSettings().remove(LIBRARY_SETTING)
    panel.discard_edits()
    close(panel)


def open_day(block: Path, day: int, points: str = "with_photos.csv") -> point_session.PointSession:
    images = [str(block / f"d{day}_{number}.tif") for number in (1, 2)]
    measured = str(block / "image_points.csv") if day == 1 else ""
    with (block / "image_points.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["image"].startswith(f"d{day}")]
    table = block / f"image_points_{day}.csv"
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return files.new_session(images, str(block / points) if points else "", str(table) if measured else "")


def list_shown(panel: PointsDock) -> list[str]:
    return [panel.ui.pictures.item(row).text() for row in range(panel.ui.pictures.count())]


@pytest.mark.thorough
def test_photographs_and_chips_are_shown_beside_the_images(dock, block: Path, tmp_path: Path) -> None:
    dock.choose(NAME)
    images = [image for name, image in dock.session.measured if name == NAME]
    assert images and list_shown(dock) == ["first.jpg", *images] and dock.ui.pictures.isVisible()
    icon = dock.ui.pictures.item(0).icon().pixmap(90, 90).toImage()
    assert icon.width() == 90 and QColor(icon.pixel(45, icon.height() // 2)).red() > 200
    # A cross in the middle of the chip, red as nothing else there
    chip = dock.ui.pictures.item(1).icon().pixmap(150, 150).toImage()
    colours = [QColor(chip.pixel(x, y)) for x in range(chip.width()) for y in range(chip.height())]
    red = [number for number, colour in enumerate(colours) if colour.red() > colour.green() + 60]
    at = np.mean([divmod(number, chip.height()) for number in red], axis=0)
    assert len(red) > 8 and np.abs(at - np.array([chip.width(), chip.height()]) / 2.0).max() < 3.0
    dock.choose(OTHER)
    assert list_shown(dock)[0] == f"{OTHER}_north.png"
    path = str(tmp_path / "block.gpkg")
    dock.files.save_as(path)
    opened = files.open_block(path)
    assert point_session.list_photos(opened.points[NAME]) == [str(block / "field" / "first.jpg")]
    assert point_session.list_photos(opened.points[OTHER]) == [str(block / "photos" / f"{OTHER}_north.png")]


@pytest.mark.thorough  # what proposes is tested by tests/processing_algorithms/test_chip_library.py
def test_library_proposes_in_a_new_project(dock, block: Path, tmp_path: Path) -> None:
    """Saved chips lead to measurements on the images of another day with one key a point; the setting is kept."""
    dock.files.choose_library(str(tmp_path / "chips.gpkg"))
    dock.files.save_as(str(tmp_path / "block.gpkg"))
    count = len(point_session.ChipLibrary(str(tmp_path / "chips.gpkg")))
    assert count == len(dock.session.measured) and f"{count} chips" in dock.ui.message.text()
    dock.show_session(open_day(block, 2, points=""))
    assert dock.session.library is not None and not dock.session.points
    dock.files.choose_library(str(tmp_path / "chips.gpkg"))
    for known in list(dock.session.points):  # those with a twin nearby are refused
        dock.choose(known)
        wait_for(lambda: not dock.search.is_running())
        if dock.search.proposals:
            break
    name, found = dock.point(), dict(dock.search.proposals)
    assert {title.split()[0] for title in list_shown(dock)} <= {"d1_1", "d1_2"} and list_shown(dock)
    dock.ui.accept_all.trigger()
    with (block / "image_points.csv").open(encoding="utf-8", newline="") as file:
        truth = {(row["id"], row["image"]): (float(row["sample"]), float(row["line"])) for row in csv.DictReader(file)}
    assert found
    for image in found:
        measured = dock.session.measured[(name, image)]
        assert np.hypot(*np.subtract((measured.sample, measured.line), truth[(name, image)])) < 0.3
    dock.files.choose_library(str(tmp_path / "block.gpkg"))
    assert "has no layer 'chips'" in dock.ui.message.text()
    assert dock.session.library.path == str(tmp_path / "chips.gpkg")
