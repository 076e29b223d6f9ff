"""Many RPCs at once give the numbers that each of them gives alone, by NumPy and by compiled loops."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.camera.rpc_stack import RPCStack
from hrsi.tests.rpc_samples import sample_rpc
from hrsi.tests.test_rpc import rpc_files

CLOSURE_PX = 1e-8  # what `RPC.localize` promises
METRES_PER_DEGREE = 111_320.0


@pytest.fixture(autouse=True, params=["0", "1"], ids=["numpy", "compiled"])
def _way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "1":
        pytest.importorskip("numba")
    monkeypatch.setenv("HRSI_COMPILED", request.param)


def points_of(rpcs: list[RPC], each: int, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which RPC, image points within ``reach`` of its image's half size, and heights within its range."""
    rng = np.random.default_rng(3)
    which = np.repeat(np.arange(len(rpcs)), each)
    unit = rng.uniform(-1.0, 1.0, (len(which), 3))
    xy = [(r.samp_off + reach * r.samp_scale * u, r.line_off + reach * r.line_scale * v)
          for r, (u, v, _) in zip((rpcs[k] for k in which), unit, strict=True)]  # fmt: skip
    heights = [rpcs[k].height_off + rpcs[k].height_scale * h for k, (_, _, h) in zip(which, unit, strict=True)]
    return which, np.array(xy), np.array(heights)


def assert_alike(rpcs: list[RPC], each: int = 7, reach: float = 0.9) -> None:
    """Assert that the stack agrees with each RPC by itself."""
    which, xy, heights = points_of(rpcs, each, reach)
    stack = RPCStack(rpcs)
    ground = stack.localize(which, xy, heights)
    image, jacobian = stack.project_with_metric_jacobian(which, ground)
    for number, rpc in enumerate(rpcs):
        own = which == number
        alone = rpc.localize(xy[own], heights[own])
        assert np.array_equal(np.isfinite(ground[own]).all(axis=1), alone.converged)
        there = np.flatnonzero(own)[alone.converged]
        ours, theirs = ground[there], alone.ground[alone.converged]
        pixel_m = 1.0 / rpc.px_per_m(theirs)
        apart_m = np.abs(ours - theirs)[:, :2].max(axis=1, initial=0.0) * METRES_PER_DEGREE
        assert (apart_m <= 20.0 * CLOSURE_PX * pixel_m).all()  # both close to that, seen obliquely
        single, slopes = rpc.project_with_metric_jacobian(ours)
        np.testing.assert_allclose(image[there], single, rtol=1e-13, atol=1e-9)
        np.testing.assert_allclose(jacobian[there], slopes, rtol=1e-9, atol=1e-9 * np.abs(slopes).max(initial=1.0))
        np.testing.assert_allclose(image[there], xy[there], rtol=0.0, atol=2.0 * CLOSURE_PX)
        np.testing.assert_allclose(stack.px_per_m(which[there], ours), rpc.px_per_m(ours), rtol=1e-9)
        np.testing.assert_array_equal(stack.middles()[number], (rpc.long_off, rpc.lat_off, rpc.height_off))
    finite = np.isfinite(ground).all(axis=1)
    np.testing.assert_array_equal(stack.project(which[finite], ground[finite]), image[finite])


def test_as_each_rpc_of_the_pack_alone(real_data: Path) -> None:
    assert_alike([rpc for _, rpc, _ in rpc_files(real_data)])


def test_no_ground_is_nan() -> None:
    broken = replace(sample_rpc(), samp_num=np.zeros(20))  # every point has the same sample
    ground = RPCStack([sample_rpc(), broken]).localize(np.array([0, 1]), np.array([[200.0, 150.0]] * 2), 300.0)
    assert np.isfinite(ground[0]).all() and np.isnan(ground[1]).all()


@pytest.mark.parametrize(
    ("rpcs", "options"),
    [
        ([sample_rpc(seed) for seed in range(20)], {}),
        ([sample_rpc(seed) for seed in range(3)], {"each": 3000}),
        ([replace(sample_rpc(), long_off=lon) for lon in (180.0 - 1e-4, 1e-4 - 180.0)], {}),
        ([sample_rpc(1), sample_rpc(2)], {"reach": 30.0}),
        ([sample_rpc(1), replace(sample_rpc(2), long_scale=0.2, lat_scale=0.15, height_scale=900.0)], {}),
    ],
    ids=["many", "in parts", "across the 180 degree meridian", "far outside their domain, as crops count", "scales"],
)
def test_as_each_alone(rpcs: list[RPC], options: dict) -> None:
    assert_alike(rpcs, **options)
