"""Jitter of simulated blocks: named with amplitude and period in verdict, report and page, instead of other advice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_blocks import move_surveys

from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.jitter.spectrum import collect_line_profiles
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.foundation.reasons import Level
from hrsi.hrsi_engine.io.pages.report import write_report_html
from hrsi.hrsi_engine.io.rasters.sun_angles import read_line_rate
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.results.block_results import BlockResult, assemble_result
from hrsi.hrsi_engine.results.judged_block import judge_block

SENSOR = lab.SENSORS["pleiades"]
PERIOD = 1200.0


def simulate_pair(amplitude_px: float) -> Block:
    """Return two images of which the first vibrates, with GCPs, check points and tie points without pixels."""
    first, second = lab.make_along_track_views(SENSOR, 2, (3000, 9000))
    waves = ((PERIOD, amplitude_px * SENSOR.detector_angle_rad, 0.4),)
    shaken = replace(first, jitter=lab.OrientationError(vibration=lab.Vibration(waves=waves)))
    scene = lab.SceneSpec(10.0, 45.0, 300.0, relief_m=150.0, seed=12)
    return lab.simulate_block(scene, [shaken, second], lab.PointCounts(8, 40, 500), lab.Noise(0.2)).block


def assemble_results(block: Block) -> BlockResult:
    adjustment = adjust(block, AdjustOptions(model="shift-drift"))
    record = {"version": "0", "date": "2026-01-01T00:00:00Z", "algorithm": "adjust", "crs": {}}
    return assemble_result(judge_block(adjustment), record, {})


@pytest.fixture(scope="module")
def shaken() -> BlockResult:
    return assemble_results(simulate_pair(2.5))


def test_jitter_is_named_with_its_figures(shaken: BlockResult):
    (reason,) = (reason for reason in shaken.verdict.reasons if reason.code == "jitter")
    assert reason.level is Level.DOUBTFUL and reason.images == ("image_1", "image_2")
    assert (
        "across the track" in reason.message and "only the difference" in reason.message and "`jitter`" in reason.advice
    )
    told = shaken.report["line_profiles"]
    waves = [told[name]["waves"][0] for name in ("image_1", "image_2")]
    assert [wave["axis"] for wave in waves] == ["across", "across"]
    # 500 points of 0.2 px (sqrt(2) for two rays) give an amplitude to 0.02 px and, over 7.5 periods, a period to 0.2 %;
    # relief shifts the lines of the second image, which makes its copy of the wave a little smaller
    assert waves[0]["amplitude_px"] == pytest.approx(2.5, abs=0.1)
    assert waves[0]["period_lines"] == pytest.approx(PERIOD, rel=0.01)
    assert waves[0]["amplitude_m"] == pytest.approx(
        waves[0]["amplitude_px"] * shaken.report["images"]["image_1"]["gsd_sample_m"], rel=0.02
    )
    assert 1.8 < waves[1]["amplitude_px"] < 2.6 and waves[1]["period_s"] is None


def test_other_advice_does_not_blame_points_or_models(shaken: BlockResult):
    told = {reason.code: reason.advice for reason in shaken.verdict.reasons}
    assert "check-misfit" not in told
    assert "largest residuals" not in told.get("sigmas-implausible", "")
    assert not any("quadratic" in text for text in shaken.report["warnings"])


def test_a_datum_error_is_still_told_beside_jitter():
    """Check points 6 m too high contradict the block by more than a vibration of 0.5 px does."""
    block = simulate_pair(0.5)
    found = assemble_results(move_surveys(block, block.points.role == Role.CHECK, [0.0, 0.0, 6.0]))
    assert {"jitter", "check-misfit"} <= {reason.code for reason in found.verdict.reasons}


def test_steady_images_have_no_jitter_and_no_waves():
    found = assemble_results(simulate_pair(0.0))
    assert "jitter" not in {reason.code for reason in found.verdict.reasons}
    assert all(entry["waves"] == [] for entry in found.report["line_profiles"].values())


def test_redundancy_scales_residuals_to_the_displacement(shaken: BlockResult):
    """Across the track two rays share the difference, by half each; the profile has the whole."""
    profile = collect_line_profiles(shaken.adjustment)[0]
    seen = profile.weight[:, 0] > 0.0
    truth = 2.5 * np.sin(2.0 * np.pi * (profile.line[seen] - 4499.5) / PERIOD + 0.4)
    slope = np.polyfit(truth, profile.shift_px[seen, 0], 1)[0]
    assert abs(slope) == pytest.approx(1.0, abs=0.05)


def test_page_draws_profiles(shaken: BlockResult, tmp_path: Path):
    write_report_html(str(tmp_path / "report.html"), json.loads(json.dumps(shaken.report, default=str)))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert 'id="lines"' in page and 'aria-label="image_1, across: px by period"' in page
    assert page.count("across the track</figcaption>") == 2


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("avgLineRate = 20000.00;", 20000.0),
        ("<AVGLINERATE>13600.0</AVGLINERATE>", 13600.0),
        ('<LINE_PERIOD unit="ms">0.0735</LINE_PERIOD>', 1000.0 / 0.0735),
        ("<LINE_PERIOD>0.001504</LINE_PERIOD>", 1.0 / 0.001504),
        ("nothing", None),
    ],
)
def test_line_rate_is_that_of_the_delivery(tmp_path: Path, text: str, rate: float | None):
    (tmp_path / "scene.imd").write_text(text, encoding="utf-8")
    (tmp_path / "scene.tif").write_bytes(b"")
    assert read_line_rate(str(tmp_path / "scene.tif")) == (None if rate is None else pytest.approx(rate))
