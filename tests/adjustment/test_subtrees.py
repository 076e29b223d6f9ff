"""A block adjusted by its subtrees: what one process gets, whoever the workers are and whichever of them dies."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrsi.benchmarks.adjust_speed import simulated
from hrsi.hrsi_engine.adjustment import Adjustment, AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.equations import find_pattern
from hrsi.hrsi_engine.adjustment.observations import select
from hrsi.hrsi_engine.adjustment.subtrees.division import divide
from hrsi.hrsi_engine.adjustment.subtrees.loop import Elsewhere, open_workers
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.block.laser import LaserPoints
from hrsi.hrsi_engine.block.reference_places import ReferencePlaces
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geodesy import moved_ground
from hrsi.hrsi_engine.io.safety.deposits import FileDeposit
from hrsi.hrsi_engine.surface.dem import GridSurface
from hrsi.processing_algorithms import run

distributed = pytest.importorskip("distributed")
SAME_PX = 1e-8
BARE = AdjustOptions(model="affine", reject_sigma=0.0, test_sigmas=False)


class HereAndNow:
    """Makes calls when they are handed out, in this process."""

    def __init__(self) -> None:
        self.received = 0

    def scheduler_info(self, n_workers: int = 0) -> dict[str, Any]:
        return {"workers": {}}

    def submit(self, function: Callable[..., Any], *given: Any, pure: bool, fifo_timeout: float) -> Any:
        return function(*given)

    def gather(self, found: Any) -> Any:
        return found


@pytest.fixture(scope="module")
def block() -> Block:
    """27 images in triplets: leaves and separators on several floors."""
    return simulated(27, per_image=30)


def assert_same(one: Adjustment, other: Adjustment) -> None:
    """Corrections and residuals in pixels, positions in as much of the pixels of 0.8 m, and what is said of them."""
    np.testing.assert_allclose(other.values, one.values, atol=SAME_PX, rtol=0)
    np.testing.assert_allclose(other.residual_px, one.residual_px, atol=SAME_PX, rtol=0)
    np.testing.assert_allclose(other.ground[:, :2], one.ground[:, :2], atol=SAME_PX * 0.8 / 111e3, rtol=0)
    np.testing.assert_allclose(other.ground[:, 2], one.ground[:, 2], atol=10 * SAME_PX * 0.8, rtol=0)
    for what in ("values_sigma", "ground_sigma_m", "redundancy_numbers", "statistic"):
        np.testing.assert_allclose(getattr(other, what), getattr(one, what), rtol=1e-5, atol=1e-7, err_msg=what)
    np.testing.assert_array_equal(other.decision, one.decision)
    assert (other.converged, other.status, other.solves) == (one.converged, one.status, one.solves)
    assert other.redundancy == pytest.approx(one.redundancy, abs=1e-6)


@pytest.mark.parametrize(
    "options",
    [
        BARE,
        AdjustOptions(),
        AdjustOptions(
            model="shift-drift",
            robust="huber",
            reject_sigma=0.0,
            test_sigmas=False,
            fixed_images=("I000004", "I000020"),
        ),
        replace(BARE, model="shift", shared_images=(("I000000", "I000001"), ("I000010", "I000020"))),
    ],
    ids=["bare", "defaults", "robust, fixed images", "shared parameters"],
)
def test_subtrees_make_what_one_process_makes(block: Block, options: AdjustOptions) -> None:
    assert_same(adjust(block, options), adjust(block, options, elsewhere=Elsewhere(HereAndNow())))


FLAT = GridSurface.from_array(np.full((21, 21), 500.0), (14.0, 4.0), (0.1, 0.1))


def tie_places(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return ids of ties on three images and more, and where an adjustment puts them."""
    result = adjust(block, BARE)
    rays = np.bincount(block.measurements.point, minlength=len(block.points))
    ties = np.flatnonzero((rays > 2) & (block.points.role == Role.TIE))
    return block.points.ids[ties], result.ground[ties]


def test_a_dem_laser_points_and_a_reference_hold_points_on_workers(block: Block) -> None:
    """Judged over the whole block after every step: some of each are wrong and left out, the same on workers."""
    ids, ground = tie_places(block)
    rng = np.random.default_rng(4)
    count = len(ids) // 2
    beside = moved_ground(ground[:count], np.column_stack([rng.normal(0, 2.0, (count, 2)), rng.normal(0, 0.3, count)]))
    beside[:5, 2] += 30.0
    laser = LaserPoints.create(beside, track=np.where(np.arange(count) % 2, "a", "b"), sigma_m=0.2)
    plan = np.column_stack([rng.normal(0, 2.0, (len(ids) - count, 2)), np.zeros(len(ids) - count)])
    away = moved_ground(ground[count:], plan)
    away[:5, 0] += 1e-3
    places = ReferencePlaces(ids[count:], away, 2.0)
    free = adjust(block, AdjustOptions(model="shift", test_sigmas=False))
    for held in (
        {"dem": FLAT, "sigma_dem_m": 120.0},
        {"laser": laser},
        {"dem": FLAT, "sigma_dem_m": 120.0, "laser": laser, "reference": places},
    ):
        options = AdjustOptions(model="shift", test_sigmas=False, **held)
        one, other = (adjust(block, options, elsewhere=where) for where in (None, Elsewhere(HereAndNow())))
        assert_same(one, other)
        for mine, theirs in zip(one.heights, other.heights, strict=True):
            assert (theirs.observations, theirs.left_out) == (mine.observations, mine.left_out)
            assert theirs.sigma_m == pytest.approx(mine.sigma_m, rel=1e-8)
        assert np.nanmax(np.abs(one.residual_px - free.residual_px)) > 0.01  # it does hold points


@pytest.mark.parametrize("shared", [(), (("I000000", "I000001"),)], ids=["all", "two cameras that are one now"])
def test_observed_cameras_on_workers(block: Block, shared: tuple[tuple[str, ...], ...]) -> None:
    """What an earlier adjustment says of all cameras together is said leaf by leaf, on top of other points."""
    rows = block.measurements
    early, later = (replace(block, measurements=rows.select(rows.point % 2 == which)) for which in (0, 1))
    known = adjust(early, BARE).joint
    options = replace(BARE, earlier=known, shared_images=shared)
    one, other = (adjust(later, options, elsewhere=where) for where in (None, Elsewhere(HereAndNow())))
    assert_same(one, other)
    assert np.abs(one.values - adjust(later, BARE).values).max() > 0.01


def test_every_point_and_camera_has_one_place() -> None:
    observations = select(simulated(90, per_image=20))
    pattern = find_pattern(observations, 2)
    division = divide(pattern)
    assert len(division.leaves) >= 3
    own = np.concatenate([node.own for node in division.nodes])
    np.testing.assert_array_equal(np.sort(own), np.arange(90))
    leaf = division.leaf_of_points(observations)[observations.point]
    inner = np.isin(division.node_of_camera[observations.camera], division.leaves)
    np.testing.assert_array_equal(division.node_of_camera[observations.camera][inner], leaf[inner])


def test_one_two_and_four_workers_and_one_that_dies(block: Block, tmp_path: Path) -> None:
    """The same bits, whoever computes them; parts that died with a worker are computed again."""
    one = adjust(block, BARE)
    found = []
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster:
        for count in (1, 2, 4):
            cluster.scale(count)
            with open_workers(cluster.scheduler_address, deposit=FileDeposit(str(tmp_path / "parts"))) as elsewhere:
                elsewhere.client.wait_for_workers(count)
                found.append(adjust(block, BARE, elsewhere=elsewhere))
        killed: list[int] = []
        with open_workers(cluster.scheduler_address, deposit=FileDeposit(str(tmp_path / "parts"))) as elsewhere:

            def kill(_fraction: float, message: str) -> bool:
                if message.endswith("iteration 2") and not killed:
                    killed.append(elsewhere.client.run(os.getpid).popitem()[1])
                    os.kill(killed[0], signal.SIGKILL)
                return True

            found.append(adjust(block, BARE, kill, elsewhere=elsewhere))
        assert killed
    assert_same(one, found[0])
    for other in found[1:]:
        np.testing.assert_array_equal(other.values, found[0].values)
        np.testing.assert_array_equal(other.residual_px, found[0].residual_px)
        np.testing.assert_array_equal(other.ground_sigma_m, found[0].ground_sigma_m)


def test_the_command_leaves_nothing_but_its_result(tmp_path: Path) -> None:
    run("simulate", sensor="pleiades", images=3, along="-6,0,6", size=160, gcps=6, checks=3, ties=20, seed=3,
        output_dir=str(tmp_path / "scene"))  # fmt: skip
    scene = {
        "images": [str(tmp_path / "scene" / f"image_{k}.tif") for k in (1, 2, 3)], "write": "none", "report": False,
        "gcps": str(tmp_path / "scene" / "ground_points.csv"),
        "image_points": str(tmp_path / "scene" / "image_points.csv"),
    }  # fmt: skip
    here = run("adjust", output_dir=str(tmp_path / "here"), **scene)
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as cluster:
        given = {**scene, "scheduler": cluster.scheduler_address}
        there = run("adjust", output_dir=str(tmp_path / "there"), **given)
        dem = {"dem": str(tmp_path / "scene" / "dem.tif"), "sigma_dem": 2.0}
        held = run("adjust", output_dir=str(tmp_path / "dem"), **given, **dem)
    alone = run("adjust", output_dir=str(tmp_path / "alone"), **scene, **dem)
    assert held["sigma0"] == pytest.approx(alone["sigma0"], rel=1e-9)
    assert held["sigma0"] != pytest.approx(here["sigma0"], rel=1e-4)
    assert there["sigma0"] == pytest.approx(here["sigma0"], rel=1e-9)
    assert there["check"]["predicted"] == pytest.approx(here["check"]["predicted"], rel=1e-6)
    assert sorted(os.listdir(tmp_path / "there")) == sorted(os.listdir(tmp_path / "here"))


def test_parts_that_others_changed_are_not_read(tmp_path: Path) -> None:
    """Objects come back from the bytes that were laid down, and from no others."""
    deposit = FileDeposit(str(tmp_path / "parts"))
    laid = deposit.put("part", {"values": [1.0, 2.0]})
    assert laid() == {"values": [1.0, 2.0]}
    with open(laid.path, "ab") as file:
        file.write(b"more")
    with pytest.raises(InputError, match="changed by another program"):
        laid()
