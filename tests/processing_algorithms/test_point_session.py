"""The state behind the panel: opening, editing, adjusting and saving, without QGIS; on the Hobart block."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rasters import open_image
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.point_session import PointSession, files
from hrsi.processing_algorithms.point_session.adjusting import adjust_block, block_of
from hrsi.processing_algorithms.point_session.rows import KnownPoint, Measured
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
    session.path = path
    files.save_adjusted(session)
    given = {
        "images": sources(folder)["images"], "gcps": f"{path}|layername=ground_points",
        "image_points": f"{path}|layername=image_points", "model": "shift",
    }  # fmt: skip
    report = run("adjust", **given, output_dir=str(tmp_path / "out"))
    assert report["check"]["ce90_m"] == pytest.approx(session.adjusted.check["ce90_m"], rel=1e-9)


def test_points_that_no_image_shows_are_kept(session: PointSession, tmp_path: Path) -> None:
    session.add_points([KnownPoint("NEW", 147.3, -42.9, 50.0, "check", 0.4)])
    session.accept(adjust_block(block_of(session), "shift"))
    files.save(session, str(tmp_path / "block.gpkg"))
    files.save_adjusted(session)
    point = files.open_block(session.path).points["NEW"]
    assert (point.lon, point.height, point.role, point.sigma_xy) == (147.3, 50.0, "check", 0.4)
    assert math.isnan(point.sigma_h)


def test_edits_take_their_residuals_away(session: PointSession) -> None:
    name, image = measured_name(session)
    session.accept(adjust_block(block_of(session), "shift"))
    row = next(row for row in session.measurements(name) if row.image == image)
    assert math.isfinite(row.residual_px[0])
    session.set_measurement(name, image, Measured(row.measured.sample + 1.0, row.measured.line))
    row = next(row for row in session.measurements(name) if row.image == image)
    assert math.isnan(row.residual_px[0])
    assert session.changed


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda s, n, i: s.set_role(n, "control"), "role 'control' is unknown: use gcp or check"),
        (lambda s, n, i: s.set_sigma(n, "sigma_h", 0.0), "sigma_h 0: give a number above 0"),
        (lambda s, n, i: s.set_measurement(n, i, Measured(math.inf, 0.0)), "must be numbers"),
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
    with pytest.raises(InputError, match=r"hobart_ikonos_2_RPC\.TXT.* is not there"):
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
    nothing = fit_target(image, (15.0, 105.0), "center")
    assert "closed object" in nothing.refusal
    by_hand = fit_target(image, (15.0, 105.0), "point")
    assert (by_hand.measured.sample, by_hand.measured.line, by_hand.refusal) == (15.0, 105.0, "")
