"""The state behind the panel: opening, editing, adjusting and saving, without QGIS; on the Hobart block."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.foundation.errors import HrsiError, InputError
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import (
    EditJournal,
    PointSession,
    Snapshot,
    files,
    find_journals,
    forget,
    recover,
)
from hrsi.processing_algorithms.point_session.adjusting import adjust_block, block_of, follow
from hrsi.processing_algorithms.point_session.files import image_points
from hrsi.processing_algorithms.point_session.rows import ImageMeasurement, SurveyPoint
from hrsi.processing_algorithms.point_session.targets import IDENTIFICATION_PX, fit_target

HOBART = Path(__file__).resolve().parents[2] / "examples" / "hobart"
GCPS = "H003,H022,H024,H035,H048,H058,H077,H098,H103,H105"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(HOBART, tmp_path / "hobart"))


def sources(folder: Path) -> dict[str, object]:
    return {
        "images": [str(folder / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)],
        "gcps": str(folder / "hobart_ground_points.csv"),
        "image_points": str(folder / "hobart_image_points.csv"),
    }  # fmt: skip


@pytest.fixture
def session(folder: Path) -> PointSession:
    made = files.new_session(**sources(folder))
    for name in made.points:
        made.set_role(name, "gcp" if name in GCPS.split(",") else "check")
    return made


def measured_name(session: PointSession) -> tuple[str, str]:
    return next(iter(session.measured))


def test_adjustment_is_that_of_the_algorithm(session: PointSession, folder: Path, tmp_path: Path) -> None:
    """The panel's figures are those of ``hrsi adjust`` with the same points and model."""
    adjusted = adjust_block(block_of(session), "shift")
    report = run("adjust", **sources(folder), gcp_ids=GCPS, model="shift", output_dir=str(tmp_path / "out"))
    for key in ("points", "rmse_east_m", "rmse_height_m", "ce90_m", "le90_m", "rmse_line_px"):
        assert adjusted.check[key] == pytest.approx(report["check"][key], rel=1e-9), key


def test_result_of_an_algorithm_can_be_opened(session: PointSession, folder: Path, tmp_path: Path) -> None:
    """Surveyed positions come back, not the adjusted ones, and adjusting again gives the same."""
    run("adjust", **sources(folder), gcp_ids=GCPS, model="shift", output_dir=str(tmp_path / "out"))
    opened = files.open_block(str(tmp_path / "out" / "block.gpkg"))
    for name, point in opened.points.items():
        before = session.points[name]
        assert (point.lon, point.lat, point.height) == pytest.approx((before.lon, before.lat, before.height), abs=1e-9)
        assert point.role == before.role
    assert opened.measured.keys() == {key for key in session.measured if key[0] in opened.points}
    again, once = adjust_block(block_of(opened), "shift"), adjust_block(block_of(session), "shift")
    assert again.check["ce90_m"] == pytest.approx(once.check["ce90_m"], rel=1e-9)


def test_saved_block_serves_the_command_line(session: PointSession, folder: Path, tmp_path: Path) -> None:
    path = str(tmp_path / "block.gpkg")
    session.accept(adjust_block(block_of(session), "shift"))
    files.save(session, path)
    given = {
        "images": sources(folder)["images"], "gcps": f"{path}|layername=ground_points",
        "image_points": f"{path}|layername=image_points", "model": "shift",
    }  # fmt: skip
    report = run("adjust", **given, output_dir=str(tmp_path / "out"))
    assert report["check"]["ce90_m"] == pytest.approx(session.adjusted.check["ce90_m"], rel=1e-9)


def test_points_that_no_image_shows_are_kept(session: PointSession, tmp_path: Path) -> None:
    session.add_points([SurveyPoint("NEW", 147.3, -42.9, 50.0, "check", 0.4)])
    session.accept(adjust_block(block_of(session), "shift"))
    files.save(session, str(tmp_path / "block.gpkg"))
    assert (session.is_adjusted, session.changed) == (True, False)
    point = files.open_block(session.path).points["NEW"]
    assert (point.lon, point.height, point.role, point.sigma_xy) == (147.3, 50.0, "check", 0.4)
    assert math.isnan(point.sigma_h)


def test_edits_take_their_residuals_away(session: PointSession) -> None:
    name, image = measured_name(session)
    session.accept(adjust_block(block_of(session), "shift"))
    row = next(row for row in session.measurements(name) if row.image == image)
    assert math.isfinite(row.residual_px[0])
    session.set_measurement(name, image, ImageMeasurement(row.measured.sample + 1.0, row.measured.line))
    row = next(row for row in session.measurements(name) if row.image == image)
    assert math.isnan(row.residual_px[0])
    assert session.changed


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda s, n, i: s.set_role(n, "control"), "role 'control' is unknown: use gcp, check or off"),
        (lambda s, n, i: s.set_sigma(n, "sigma_h", 0.0), "sigma_h 0: give a number above 0"),
        (lambda s, n, i: s.set_measurement(n, i, ImageMeasurement(math.inf, 0.0)), "must be numbers"),
        (lambda s, n, i: s.set_role("X99", "gcp"), "no ground point 'X99'"),
        (lambda s, n, i: s.add_points([s.points[n]]), "in the list already"),
        (lambda s, n, i: s.measure(n, i, (1.0, 1.0), "square"), "kind 'square' is unknown"),
        (lambda s, n, i: s.measure(n, i, (1.0, 1.0), "center"), "has no pixels to measure on"),
        (lambda s, n, i: files.save(PointSession()), "has no file yet"),
        (lambda s, n, i: block_of(PointSession()), "measure one first"),
    ],
)
def test_wrong_edits_say_what_to_do(session: PointSession, edit, message: str) -> None:
    name, image = measured_name(session)
    before = dict(session.measured)
    with pytest.raises(InputError, match=message):
        edit(session, name, image)
    assert session.measured == before


def test_missing_image_is_named(session: PointSession, folder: Path, tmp_path: Path) -> None:
    files.save(session, str(tmp_path / "block.gpkg"))
    (folder / "hobart_ikonos_2_RPC.TXT").rename(folder / "away_RPC.TXT")
    with pytest.raises(InputError, match=r"hobart_ikonos_2_RPC\.TXT.* is missing"):
        files.open_block(session.path)
    shutil.copy(folder / "away_RPC.TXT", tmp_path / "hobart_ikonos_2_RPC.TXT")  # beside the GeoPackage
    assert len(files.open_block(session.path).images) == 3


def test_other_geopackage_is_refused(tmp_path: Path) -> None:
    session = PointSession()
    with pytest.raises(InputError, match="cannot be opened"):
        files.open_block(str(tmp_path / "nothing.gpkg"))
    assert not session.points


class Disc:
    """Pixels of one bright disc, each the mean of 9 x 9 samples."""

    size = (120, 120)
    middle, radius = np.array([61.3, 57.8]), 9.0

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        fine = (np.arange(9) - 4.0) / 9.0
        x = (sample + np.arange(samples))[:, None] + fine
        y = (line + np.arange(lines))[:, None] + fine
        away = np.hypot(*np.meshgrid(x.ravel() - self.middle[0], y.ravel() - self.middle[1]))
        bright = (away < self.radius).reshape(lines, 9, samples, 9).mean(axis=(1, 3))
        column, row = np.meshgrid(sample + np.arange(samples), line + np.arange(lines))
        valid = (column >= 0) & (column < self.size[0]) & (row >= 0) & (row < self.size[1])
        noise = np.sin(12.9898 * column + 78.233 * row)
        return np.where(valid, 200.0 + 500.0 * bright + 2.0 * noise, 0.0), valid


def test_sigma_of_a_click_knows_more_than_the_fit(folder: Path) -> None:
    """The position is right to a few hundredths of a pixel; its sigma holds the identification too."""
    rpc = open_image(str(folder / "hobart_ikonos_1_RPC.TXT")).rpc
    image = Image("disc", rpc, Disc.size, "", Disc())
    fit = fit_target(image, (63.0, 56.0), "center")
    assert fit.refusal == ""
    assert (fit.measured.sample, fit.measured.line) == pytest.approx(tuple(Disc.middle), abs=0.05)
    assert fit.measured.sigma > IDENTIFICATION_PX
    assert "<image" in fit.chip_svg
    nothing = fit_target(image, (15.0, 105.0), "center", is_seen=False)
    assert "closed object" in nothing.refusal
    by_hand = fit_target(image, (15.0, 105.0), "point")
    assert (by_hand.measured.sample, by_hand.measured.line, by_hand.refusal) == (15.0, 105.0, "")


def test_edits_are_undone_and_done_again(session: PointSession) -> None:
    """Every kind of edit comes back to the letter, the order of the points too; saved and adjusted states are known."""
    name, image = measured_name(session)
    session.accept(adjust_block(block_of(session), "shift"))
    session.note_save("somewhere.gpkg")
    start = (dict(session.points), dict(session.measured))
    names = list(session.points)
    edits = [
        lambda: session.set_measurement(name, image, ImageMeasurement(1.0, 2.0)),
        lambda: session.remove_measurement(name, image),
        lambda: session.set_role(names[3], "off"),
        lambda: session.set_sigma(names[4], "sigma_h", 0.7),
        lambda: session.remove_point(names[1]),
        lambda: session.add_points([SurveyPoint("NEW", 147.3, -42.9, 50.0)]),
    ]
    states = [start]
    for edit in edits:
        edit()
        states.append((dict(session.points), dict(session.measured)))
    assert session.changed and not session.is_adjusted
    for before in states[-2::-1]:
        assert session.history.undo()
        assert (session.points, session.measured) == before
        assert list(session.points) == list(before[0])
    assert (session.changed, session.is_adjusted) == (False, True)
    assert session.rows()[0].residual_m[0] == session.adjusted.residual_m[names[0]][0]
    for after in states[1:]:
        assert session.history.redo()
        assert (session.points, session.measured) == after
    assert session.history.redo() == ""
    session.history.undo()
    assert PointSession().history.undo() == ""
    session.set_role(names[5], "off")  # what was undone is gone
    assert session.history.redo_title == "" and session.changed


def test_edits_made_while_adjusting_have_no_residuals(session: PointSession) -> None:
    """The adjustment is of what it saw, not of what was measured while it ran."""
    name, image = measured_name(session)
    seen, block = Snapshot(session), block_of(session)
    session.set_measurement(name, image, ImageMeasurement(session.measured[(name, image)].sample + 1.0, 5.0))
    session.accept(adjust_block(block, "shift"), seen)
    assert not session.is_adjusted
    assert math.isnan(session.measurement(name, image).residual_px[0])
    assert math.isnan(next(row for row in session.rows() if row.point.id == name).residual_m[0])
    others = [row for row in session.rows() if row.images and row.point.id != name]
    assert others and all(math.isfinite(row.residual_m[0]) for row in others)


def test_points_off_take_no_part_and_are_kept(session: PointSession, folder: Path, tmp_path: Path) -> None:
    """A point that is off counts neither as GCP nor as tie, in the panel and in files; its measurements stay."""
    name = GCPS.split(",")[0]
    with_it = adjust_block(block_of(session), "shift")
    session.set_role(name, "off")
    block = block_of(session)
    assert name not in block.points.ids.tolist()
    without = adjust_block(block, "shift")
    assert without.check["ce90_m"] != with_it.check["ce90_m"]
    session.accept(without)
    path = str(tmp_path / "block.gpkg")
    files.save(session, path)
    opened = files.open_block(path)
    assert opened.points[name].role == "off"
    assert {key for key in opened.measured if key[0] == name} == {key for key in session.measured if key[0] == name}
    given = {"images": sources(folder)["images"], "gcps": f"{path}|layername=ground_points",
             "image_points": f"{path}|layername=image_points", "model": "shift"}  # fmt: skip
    report = run("adjust", **given, output_dir=str(tmp_path / "out"))
    assert report["check"]["ce90_m"] == pytest.approx(without.check["ce90_m"], rel=1e-9)
    assert report["ties"]["points"] == 0
    named = run("adjust", **given, gcp_ids=GCPS, output_dir=str(tmp_path / "named"))  # who names it wants it
    assert named["check"]["ce90_m"] == pytest.approx(with_it.check["ce90_m"], rel=1e-9)


def test_next_point_to_measure(session: PointSession) -> None:
    """Around the list, over points that are off, measured everywhere, or seen by no image."""
    names = list(session.points)
    away = [name for name in names if not any(row.is_inside for row in session.measurements(name))]
    session.measured.clear()
    assert session.find_next_gap(names[0], 1) == next(name for name in names[1:] if name not in away)
    session.set_role(names[1], "off")
    assert session.find_next_gap(names[0], 1) == next(name for name in names[2:] if name not in away)
    assert session.find_next_gap(names[0], -1) == next(name for name in names[::-1] if name not in away)
    assert PointSession().find_next_gap("", 1) == ""


def test_unsaved_edits_are_found_again(session: PointSession, tmp_path: Path) -> None:
    """Saved or undone: nothing is left. Killed: everything comes back, a line that was cut off excepted."""
    root, (name, image) = tmp_path / "unsaved", measured_name(session)
    path = str(tmp_path / "block.gpkg")
    files.save(session, path)
    keeper = EditJournal(root)
    keeper.follow(session)
    session.set_role(name, "off")
    assert find_journals(root) == []  # the program lives
    session.history.undo()
    keeper.leave()
    assert find_journals(root) == []  # nothing to save
    keeper.follow(session)
    session.set_role(name, "off")
    session.remove_measurement(name, image)
    session.add_points([SurveyPoint("NEW", 147.3, -42.9, 50.0)])
    session.set_measurement("NEW", image, ImageMeasurement(3.25, 4.5, 0.1, "center", 0.9))
    keeper.leave()  # as when the process is killed: the lock is gone, the file is not
    (file,) = root.glob("*/journal.jsonl")
    with file.open("a") as cut:
        cut.write('{"points": nu')
    (unsaved,) = find_journals(root)
    assert unsaved.path == path
    back = recover(unsaved)
    assert repr((back.points, back.measured)) == repr((session.points, session.measured))
    assert back.changed and back.path == path
    again = EditJournal(root)
    again.follow(back)  # kept by another journal before the old one goes
    forget(unsaved)
    again.leave()
    (kept,) = find_journals(root)
    assert kept.measured.keys() == session.measured.keys()
    forget(kept)
    assert find_journals(root) == []


def test_unsaved_new_block_comes_back_without_its_layers(folder: Path, tmp_path: Path) -> None:
    """The points' file was a copy that QGIS made of a layer, and removed."""
    session, root = files.new_session(**sources(folder)), tmp_path / "unsaved"
    keeper = EditJournal(root)
    keeper.follow(session)
    name, image = measured_name(session)
    session.set_measurement(name, image, ImageMeasurement(10.0, 20.0))
    keeper.leave()
    (folder / "hobart_ground_points.csv").unlink()
    (unsaved,) = find_journals(root)
    back = recover(unsaved)
    assert repr((back.points, back.measured)) == repr((session.points, session.measured))


def test_journal_that_cannot_be_written_is_told(session: PointSession, tmp_path: Path) -> None:
    (tmp_path / "unsaved").write_text("a file where the folder should be")
    keeper = EditJournal(tmp_path / "unsaved")
    keeper.follow(session)
    session.set_role(next(iter(session.points)), "off")
    assert session.changed and "save often" in keeper.failure


def test_residuals_follow_an_edit(session: PointSession) -> None:
    """Between two adjustments residuals are of what is measured now; a wrong measurement stands out at once."""
    session.accept(adjust_block(block_of(session), "shift"))
    name, image = next(key for key in session.measured if session.points[key[0]].role == "gcp")
    made, before = session.measured[(name, image)], session.measurement(name, image).residual_px
    session.set_measurement(name, image, ImageMeasurement(made.sample + 10.0, made.line, made.sigma))
    assert math.isnan(session.measurement(name, image).residual_px[0])
    session.follow(follow(session))
    row, others = session.measurement(name, image), [key for key in session.measured if key[0] != name]
    assert 3.0 < row.residual_px[0] - before[0] < 10.0 and "sigma off" in row.suspicion
    assert next(row.suspicion for row in session.rows() if row.point.id == name) and not session.is_adjusted
    known = [session.measurement(*key).residual_px[0] for key in others if key[0] in session.points]
    assert np.isfinite(known).all()
    session.remove_measurement(name, image)
    session.follow(follow(session))
    assert math.isnan(session.measurement(name, image).residual_px[0])
    session.history.undo()
    session.history.undo()
    session.follow(follow(session))
    assert session.measurement(name, image).residual_px == pytest.approx(before, abs=0.005)
    session.remove_point(name)
    session.follow(follow(session))
    assert all(math.isfinite(row.residual_m[0]) for row in session.rows() if row.images)


def test_without_known_points_the_ground_is_where_the_adjusted_ties_are(session: PointSession) -> None:
    """The RPCs' own middle height may be hundreds of metres off: nobody would look for a new tie point far enough."""
    ties = image_points(session)
    alone = PointSession(list(session.images.values()), ties=ties)
    known = np.array([point.height for point in session.points.values()])
    rpc_m = float(np.median([image.middle_height_m for image in session.images.values()]))
    assert alone.middle_height_m() == rpc_m and not len(alone.ground_heights_m())
    alone.accept(adjust_block(block_of(alone), "shift"))
    assert alone.middle_height_m() == pytest.approx(float(np.median(known)), abs=30.0)  # free: as the RPCs have it
    assert abs(rpc_m - float(np.median(known))) > 60.0
    assert known.min() - 30.0 < alone.ground_heights_m().min() < alone.ground_heights_m().max() < known.max() + 30.0


@pytest.mark.parametrize(
    "roles", [("check", "gcp"), *(pytest.param((one,), marks=pytest.mark.thorough) for one in ("gcp", "check"))]
)
def test_first_measurement_takes_the_shift_over(session: PointSession, roles: tuple[str, ...]) -> None:
    """RPCs off by 80 px: from the first measurement of an image on, adjusted or not, its next points are found."""
    truth, session.measured = dict(session.measured), {}
    for number, (name, image) in enumerate(session.images.items()):
        off = (80.0, -57.0, 0.0)[number], -57.0
        rpc = replace(image.rpc, samp_off=image.rpc.samp_off + off[0], line_off=image.rpc.line_off + off[1])
        session.images[name] = replace(image, rpc=rpc)
    names = [name for name in session.points if all((name, image) in truth for image in session.images)]
    for name in names:
        session.set_role(name, roles[min(names.index(name), len(roles) - 1)])

    def distance_px(name: str, image: str) -> float:
        wanted = truth[(name, image)]
        return math.dist(session.predict_place(name, image), (wanted.sample, wanted.line))

    assert min(distance_px(names[1], image) for image in session.images) > 50.0
    for name in names[:2]:
        for image in session.images:
            session.set_measurement(name, image, truth[(name, image)])
            assert session.is_located(image)
            assert distance_px(names[2], image) < 3.0  # the block's own scatter and drifts
            try:
                session.accept(adjust_block(block_of(session), "shift"))
            except HrsiError:  # too little is measured yet
                continue
            assert distance_px(names[2], image) < 3.0
