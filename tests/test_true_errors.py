"""Errors of refined RPCs by GDAL, with which wrong inputs are judged: a known shift comes out as it went in."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.benchmarks.true_errors import measure_errors, run_for_harm
from hrsi.benchmarks.wrong_inputs import TruePoints, clean
from hrsi.benchmarks.wrong_kinds import TRUE_KINDS
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.ground.geodesy import metres_per_degree
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata

EAST_M, NORTH_M, UP_M = 3.0, -4.0, 7.0


def seen_by(rpcs: list[RPC]) -> TruePoints:
    """Return points and the pixels where cameras have them."""
    rng = np.random.default_rng(3)
    middle = np.array([rpcs[0].long_off, rpcs[0].lat_off, rpcs[0].height_off])
    ground = middle + rng.uniform(-1.0, 1.0, (40, 3)) * [0.01, 0.01, 100.0]
    rows = np.arange(len(ground))
    return TruePoints(
        ground, np.tile(rows, len(rpcs)), np.repeat(np.arange(len(rpcs)), len(rows)),
        np.concatenate([rpc.project(ground) for rpc in rpcs]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def rpcs() -> list[RPC]:
    return [image.rpc for image in clean("worldview-2", 1).images]


def test_right_cameras_have_no_error(rpcs: list[RPC]):
    assert max(measure_errors([gdal_metadata(rpc) for rpc in rpcs], seen_by(rpcs))) < 0.005  # GDAL's inverse: 1e-4 px


def test_shifted_cameras_err_by_their_shift(rpcs: list[RPC]):
    east, north, _ = metres_per_degree(np.array([[rpcs[0].long_off, rpcs[0].lat_off, rpcs[0].height_off]]))[0]
    moved = [
        replace(
            rpc, long_off=rpc.long_off + EAST_M / east, lat_off=rpc.lat_off + NORTH_M / north,
            height_off=rpc.height_off + UP_M,
        )
        for rpc in rpcs
    ]  # fmt: skip
    plan, height = measure_errors([gdal_metadata(rpc) for rpc in moved], seen_by(rpcs))
    assert plan == pytest.approx(np.hypot(EAST_M, NORTH_M), abs=0.01)
    assert height == pytest.approx(UP_M, abs=0.01)


def test_a_right_block_does_no_harm():
    harm = run_for_harm(clean("ikonos", 1))
    assert harm.verdict == "ok"
    assert 0.1 < harm.times < 2.0


def test_kinds_have_names_of_their_own():
    assert len({kind.name for kind in TRUE_KINDS}) == len(TRUE_KINDS) >= 60
