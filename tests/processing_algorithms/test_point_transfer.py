"""Points measured by hand on one image and found on others by matching, on a rendered block with known truth."""

import csv
from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond
from scipy.ndimage import affine_transform, gaussian_filter

from hrsi.hrsi_engine.block.block import ArrayRaster
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.measurement.point_transfer import transfer_point
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import PointSession, files, find_transfers, new_tie, place_tie
from hrsi.processing_algorithms.point_session.adjusting import adjust_block, block_of
from hrsi.processing_algorithms.point_session.rows import TIE, TRANSFERRED, ImageMeasurement

Truth = dict[str, dict[str, tuple[float, float]]]
IMAGES = 3
#: What the matcher promises on this ground without noise of the images' coordinates; a wrong place is pixels away.
RMSE_PX, WORST_PX = 0.15, 0.6


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block whose points are where its files say: without noise."""
    made = tmp_path_factory.mktemp("transfer") / "block"
    run("simulate", output_dir=str(made), images=IMAGES, along="-15,0,15", size=500, gcps=6, checks=0, ties=24, seed=23,
        noise_image=0.0, relief=40.0)  # fmt: skip
    return made


@pytest.fixture
def session(folder: Path) -> PointSession:
    images = [str(folder / f"image_{number}.tif") for number in range(1, IMAGES + 1)]
    made = files.new_session(images, str(folder / "ground_points.csv"), str(folder / "image_points.csv"))
    made.ties = None  # they are what is to be found
    return made


@pytest.fixture(scope="module")
def truth(folder: Path) -> Truth:
    found: Truth = {}
    with open(folder / "image_points.csv", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            if row["id"].startswith("T"):
                found.setdefault(row["id"], {})[row["image"]] = float(row["sample"]), float(row["line"])
    return found


def begin(session: PointSession, name: str, xy: tuple[float, float], image: str = "image_2") -> None:
    session.add_tie(new_tie(session, name, image, xy), image, ImageMeasurement(*xy, kind="point"))


@pytest.mark.parametrize("is_adjusted", mark_beyond(1, "rendered", [False, True]))
def test_ties_are_transferred(session: PointSession, truth: Truth, is_adjusted: bool) -> None:
    """Before anything is adjusted and after it: most points are found, within the matcher's accuracy, none far off."""
    if is_adjusted:
        session.accept(adjust_block(block_of(session), "shift"))
    off, sigma, asked = [], [], 0
    for name, places in truth.items():
        if "image_2" not in places:
            continue
        begin(session, name, places["image_2"])
        for image, one in find_transfers(session, name).items():
            if image in places:
                asked += 1
                if not one.refusal:
                    off.append(np.hypot(*np.subtract(one.xy, places[image])))
                    sigma.append(one.sigma_px)
    rmse = float(np.sqrt(np.mean(np.square(off))))
    assert asked > 24 and len(off) > 0.6 * asked
    assert rmse < RMSE_PX and max(off) < WORST_PX


def test_tie_is_placed_kept_and_adjusted(session: PointSession, truth: Truth, tmp_path: Path) -> None:
    """Accepted transfers are one edit; the point lies where its rays meet; saved and opened it is still of the list."""
    session.accept(adjust_block(block_of(session), "shift"))
    name, places = next((name, places) for name, places in truth.items() if len(places) == IMAGES)
    begin(session, name, places["image_2"])
    found = find_transfers(session, name)
    session.accept_transfers(name, found)
    good = [image for image, one in found.items() if not one.refusal]
    assert good and {session.measured[(name, image)].kind for image in good} == {TRANSFERRED}
    session.move_point(place_tie(session, name))
    for image in ("image_2", *good):
        assert np.hypot(*np.subtract(session.predict_place(name, image), places[image])) < 1.0
    session.history.undo()
    assert [key for key in session.measured if key[0] == name] == [(name, "image_2")]
    session.history.redo()
    session.accept(adjust_block(block_of(session), "shift", listed=session.points))
    assert np.isfinite(session.measurement(name, "image_2").residual_px).all()
    path = str(tmp_path / "block.gpkg")
    files.save(session, path)
    opened = files.open_block(path)
    assert opened.points[name].role == TIE
    assert {key for key in opened.measured if key[0] == name} == {key for key in session.measured if key[0] == name}
    assert list(opened.points) == list(files.open_block(path).points)


def test_what_cannot_be_transferred_is_told(session: PointSession, folder: Path) -> None:
    name = next(iter(session.points))
    session.measured.clear()
    with pytest.raises(InputError, match="click on it in one first"):
        find_transfers(session, name)
    begin(session, "sky", (20.0, 20.0))
    session.images["image_1"] = files.new_session([str(folder / "image_1.tif")]).images["image_1"]
    assert all(one.refusal or np.isfinite(one.xy).all() for one in find_transfers(session, "sky").values())
    with pytest.raises(InputError, match="has no survey"):
        session.set_role("sky", "gcp")
    with pytest.raises(InputError, match="has a survey"):
        session.set_role(name, TIE)


@pytest.mark.parametrize(("change", "refusal"), [
    (None, ""), ("around", "what lies around it differs"), ("sheared", "objects of several heights lie"),
])  # fmt: skip
def test_a_chip_is_found_where_its_surroundings_and_its_height_are_the_same(change, refusal):
    """A roof or a crossing looks like another one; old chips show the ground around it, too."""
    rng = np.random.default_rng(7)
    grey, other = (gaussian_filter(rng.normal(size=(301, 301)), 1.5) * 300.0 + 500.0 for _ in range(2))
    second = grey.copy()
    if change == "around":
        second[:] = other
        second[125:176, 125:176] = grey[125:176, 125:176]
    elif change == "sheared":
        second = affine_transform(grey, [[1.0, 0.0], [-0.15, 1.0]], [0.0, 0.15 * 150.0], mode="nearest")
    middle, line = np.array([150.0, 150.0]), np.full((2, 2), 150.0)
    found = transfer_point(ArrayRaster(grey), middle, ArrayRaster(second), line, np.eye(2), 3.0, 60)
    assert found.refusal.startswith(refusal) and bool(found.refusal) == bool(refusal)
