"""The benchmark of wrong inputs in short: every kind on one simulated block, from files as `adjust` reads them."""

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.benchmarks.wrong_inputs import KINDS, clean, clean_blocks, real_blocks_outcome, run_checks, run_whole

SENSORS = ("pleiades", "worldview-2", "spot5")
BY_NAME = {kind.name: kind for kind in KINDS}
#: The first kind of each family; a family is what the verdict names by the same codes.
FIRST = list({kind.codes: kind.name for kind in reversed(KINDS)}.values())


def wrong(name: str, sensor: str, seed: int):
    kind = BY_NAME[name]
    right = clean(sensor, seed, kind.images, kind.gcps)
    spoilt = kind.spoil(right, np.random.default_rng(seed))
    return kind, kind.size(right, spoilt), spoilt


@pytest.mark.parametrize(
    "name", [name if name in FIRST else pytest.param(name, marks=pytest.mark.wrong_inputs) for name in BY_NAME]
)
def test_every_kind(name):
    kind, size, spoilt = wrong(name, SENSORS[len(name) % 3], 200)
    found = (run_whole if kind.whole else run_checks)(spoilt)
    assert not found.crash
    if size != "below":
        assert found.names(kind.codes), found
    if size == "gross":
        assert not found.written


@pytest.mark.parametrize(
    "name",
    mark_beyond(
        1, "wrong_inputs", ["GCPs moved by 6 degrees", "longitude and latitude swapped", "GCP ids shifted by one"]
    ),
)
def test_no_refined_rpc_comes_out(name):
    kind, _, spoilt = wrong(name, "pleiades", 200)
    found = run_whole(spoilt)
    assert found.names(kind.codes)
    assert not found.written
    assert not found.crash


@pytest.mark.parametrize("sensor", mark_beyond(1, "thorough", ["quickbird", "worldview-2", "pleiades"]))
def test_the_likelier_of_two_slips_that_ties_cannot_tell_apart(sensor):
    """Images of one strip and their mirror images meet alike: swapped columns look like those of a turned copy."""
    _, _, spoilt = wrong("sample and line swapped, tie points", sensor, 142)
    assert run_checks(spoilt).names(("image-axes",))


@pytest.mark.parametrize("sensor", mark_beyond(1, "thorough", SENSORS))
def test_right_blocks(sensor):
    assert [found.codes for _, _, found in clean_blocks(range(200, 201), [sensor], run_checks)] == [()]


@pytest.mark.parametrize(("seed", "images", "gcps"), mark_beyond(1, "thorough", [(714, 3, 6), (717, 2, 1)]))
def test_rpcs_that_drift_against_one_another(seed, images, gcps):
    """By 10 px over the image, linear: errors of RPCs. Every second measurement wrong beside it is told."""
    right = clean("quickbird", seed, images, gcps)
    assert run_checks(right).codes == ()
    spoilt = BY_NAME["55 % of the tie points wrong"].spoil(right, np.random.default_rng(seed))
    assert run_checks(spoilt).names(("ties-wrong",))


def test_real_blocks(real_data):
    assert {reasons for _, reasons in real_blocks_outcome(matching=False)} == {"none"}
