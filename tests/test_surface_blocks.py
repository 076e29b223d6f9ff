"""Blocks without GCPs on a free DEM through the command line, against the simulation's truth by GDAL."""

import re
from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.benchmarks.surface import DEM, WRONG, Place, adjust_block, measure_block, read_truth, rewrite_dem

SEED = 9  # of development; those from 7000 on are the page's


@pytest.mark.parametrize("sensor", mark_beyond(1, "thorough", ["spot5", "pleiades"]))
def test_mountains_hold_a_block_in_plan(sensor: str, tmp_path: Path):
    block = Place(sensor, "mountains", SEED).write(tmp_path)
    truth = read_truth(block)
    given, found = measure_block(block, truth, block), adjust_block(block, truth, *DEM)
    assert found.surface["holds_plan"]
    assert "not-determined" not in found.codes
    # A CE90 of 6 m is the DEM's own; 12 m are two of it
    assert found.plan_90_m < 12.0 and found.height_90_m < 8.0
    assert found.plan_90_m < 2.0 * found.ce90_m and found.height_90_m < 2.0 * found.le90_m
    if sensor == "spot5":
        assert np.quantile(np.hypot(*given[:, :2].T), 0.9) > 2.0 * found.ce90_m


@pytest.mark.thorough
def test_flat_ground_is_said_to_hold_no_plan(tmp_path: Path):
    block = Place("spot5", "flat", SEED).write(tmp_path)
    found = adjust_block(block, read_truth(block), *DEM)
    assert not found.surface["holds_plan"]
    assert "not-determined" in found.codes
    assert found.level == "ok"
    assert found.ce90_m > 25.0  # SPOT 5's attitude of 40 microradians from 832 km is 33 m a coordinate
    assert found.plan_90_m < 2.0 * found.ce90_m


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("sensor", "landform"), [("worldview-2", "farmland"), ("worldview-2", "hills"), ("spot5", "hills")]
)
def test_a_wrong_datum_is_named_or_stated_as_not_seen(sensor: str, landform: str, tmp_path: Path):
    """48 m are named if they exceed what the sentence states for a right DEM; otherwise the sentence has them."""
    block = Place(sensor, landform, SEED).write(tmp_path)
    truth = read_truth(block)
    right = adjust_block(block, truth, *DEM)
    [unseen_m] = re.findall(
        r"heights rest on the DEM alone: an error of its datum below (\S+) m does not show", right.said
    )
    rewrite_dem(block, WRONG["heights above a geoid 48 m higher"])
    wrong = adjust_block(block, truth, *DEM)
    assert right.level == "ok" and wrong.height_90_m > 40.0
    assert ("sources-disagree" in wrong.codes) == (float(unseen_m) < 48.0) == (sensor == "worldview-2")
