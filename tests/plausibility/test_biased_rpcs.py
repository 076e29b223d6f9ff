"""RPCs biased beyond their figure are said to be biased, and blamed on nothing else; GCPs take the bias away.

Two images of every simulated sensor see the ground 5 to 10 times as far off as the sensor points (CE90), in eight
directions; nothing else is wrong.
"""

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine import AdjustOptions, adjust, check_block, judge
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.foundation.reasons import Level
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.plausibility.mistakes import find_datum_shifts
from hrsi.hrsi_engine.results.verdict import Verdict

#: Sensor, and its CE90 without ground control (`block.pointing`); of the wide-field camera, of its simulated errors.
FIGURES_M = {
    "ikonos": 15.0,
    "quickbird": 17.5,
    "worldview-2": 5.0,
    "pleiades": 12.0,
    "spot5": 60.0,
    "wide-field": 145.0,
}
PLACES = ((5.45, 43.53), (147.3, -42.85), (-71.6, -33.4), (-105.0, 39.7), (36.9, 37.6), (113.2, 34.6), (18.4, -33.9))
DIRECTIONS = 8


def make_block(sensor: str, bias_m: float, direction: int, seed: int) -> Block:
    """Return a block whose images all lie ``bias_m`` off in one of eight directions; its place goes with the seed."""
    angle = 2.0 * np.pi * direction / DIRECTIONS
    error = lab.OrientationError(position_m=(bias_m * np.sin(angle), bias_m * np.cos(angle), 0.0))
    views = lab.make_along_track_views(lab.SENSORS[sensor], 2, (2000, 2000))
    views = tuple(replace(view, vendor_error=error) for view in views)
    lon, lat = PLACES[seed % len(PLACES)]
    return lab.simulate_block(
        lab.SceneSpec(lon, lat, relief_m=100.0, seed=seed), views, lab.PointCounts(8, 30, 200), lab.Noise()
    ).block


def judge_block(block: Block) -> Verdict:
    """Return the verdict on a block as the command line gives it."""
    before = check_block(block)
    return judge(adjust(block, AdjustOptions()), before)


@pytest.mark.parametrize("sensor", mark_beyond(0, "coverage", ["worldview-2", "spot5", *sorted(FIGURES_M)[:4]]))
def test_no_datum_is_blamed(sensor: str) -> None:
    """5 and 10 times the sensor's CE90, to the east at a place where NTF and NAD27 lie east and west of WGS84.

    Power (comparison): every block is judged by itself; one datum that is blamed is seen.
    """
    for number, factor in enumerate((5.0, 10.0)):
        for direction in range(2, DIRECTIONS, 4):
            verdict = judge_block(make_block(sensor, factor * FIGURES_M[sensor], direction, 3 * number))
            ((code, level),) = ((reason.code, reason.level) for reason in verdict.reasons)
            # ten times the published figure may be more than ten times what the RPC itself states
            assert code in ("rpc-biased", "control-implausible") and level == Level.DOUBTFUL


def test_the_message_has_the_figure() -> None:
    (reason,) = check_block(make_block("pleiades", 43.4, 2, 0))
    assert reason.code == "rpc-biased" and reason.images == ("image_1", "image_2")
    # Position 1 m and attitude 6 microrad at 694 km and more, along an oblique ray: 4.3 to 4.6 m a coordinate
    assert "43.5 m, 4.6 times the stated accuracy (CE90 9.53 m" in reason.message
    assert "NTF" in reason.advice and "NTF" not in reason.message


def with_wrong_heights(block: Block, count: int) -> Block:
    step = np.zeros((len(block.points), 3))
    step[np.flatnonzero(block.points.role == Role.GCP)[:count], 2] = np.resize([25.0, -30.0], count)
    return replace(block, points=replace(block.points, ground=move_ground(block.points.ground, step)))


def test_blunders_that_were_left_out_make_no_block_unusable() -> None:
    """Two of eight heights wrong: both are found, the rest is right. With half of them wrong, nobody can say which."""
    right = make_block("pleiades", 1.0, 0, 7)
    for count, level in ((2, Level.DOUBTFUL), (4, Level.UNUSABLE)):
        block = with_wrong_heights(right, count)
        before = check_block(block)
        assert max(reason.level for reason in before) is Level.UNUSABLE
        result = adjust(block, AdjustOptions())
        verdict = judge(result, before)
        assert verdict.level is level
        if count == 2:
            wrong = right.points.ids[np.flatnonzero(right.points.role == Role.GCP)[:2]].tolist()
            assert {finding.id for finding in result.findings if finding.left_out} == set(wrong)
            assert set(verdict.reasons[0].points) == set(wrong)


@pytest.mark.thorough
def test_utm_of_another_datum_is_named_and_its_shift_that_of_pyproj() -> None:
    """NAD27 / UTM 13 read as WGS84 / UTM 13 at Denver; the true shift by pyproj's own pipeline, its best operation."""
    read, meant = (pyproj.Transformer.from_crs(4326, code, always_xy=True) for code in (32613, 26713))
    lon, lat = meant.transform(*read.transform(-105.0, 39.7), direction="INVERSE")
    true_m = np.array([(lon + 105.0) * 85_760.0, (lat - 39.7) * 111_030.0])  # metres a degree at 39.7 N
    (found,) = (shift for shift in find_datum_shifts(-105.0, 39.7) if shift.name.startswith("NAD27 / UTM"))
    assert np.hypot(*(np.array([found.east_m, found.north_m]) - true_m)) < 10.0 < 200.0 < np.hypot(*true_m)
