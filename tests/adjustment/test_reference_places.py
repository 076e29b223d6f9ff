"""Places of a reference orthoimage beside laser heights: what they may say, and what is found wrong in them."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.tests.laser_scenes import PlacedScene, placed_scene

SIGMA_M = 3.5  # of each coordinate, as the errors are simulated


@pytest.fixture(scope="module")
def scene() -> PlacedScene:
    return placed_scene(11, sensor="worldview-2", images=2, size=8000, looked_up=100, places=160)


def adjusted(scene: PlacedScene, **more) -> Adjustment:
    return adjust(scene.block, AdjustOptions(reference=scene.places, laser=scene.laser.points, **more))


def test_places_and_rpcs_share_by_their_sigmas(scene):
    result, free = adjusted(scene), adjust(scene.laser.block, AdjustOptions(laser=scene.laser.points))
    # all that a reference shares, 0.8 of its sigma, against the RPCs
    assert result.plan is not None and free.plan is None
    # places scatter by what each has by itself; that tells nothing of what all share
    assert np.hypot(0.8, 0.4) * SIGMA_M < result.plan.sigma_m < 1.2 * SIGMA_M
    checks = scene.block.points.role == Role.CHECK
    shared, by_rpcs = 0.8 * SIGMA_M, free.ground_sigma_m[scene.laser.block.points.role == Role.CHECK, 0].mean()
    assert result.plan.share == pytest.approx(shared**-2 / (shared**-2 + by_rpcs**-2), abs=0.06)
    moved = (scene.laser.height_errors_m(result) - scene.laser.height_errors_m(free))[:, :2].mean(axis=0)
    # the share of the way to where the reference alone would put it
    way = moved + result.plan.alone_m
    assert moved @ way / (way @ way) == pytest.approx(result.plan.share, abs=0.12)
    assert result.ground_sigma_m[checks, 0].mean() < by_rpcs
    assert result.ground_sigma_m[checks, 0].mean() > 0.5 * shared  # three hundred places count as one


@pytest.mark.thorough
def test_a_corner_15_m_off_is_named_and_does_no_harm(scene):
    wrong = scene.with_corner(15.0)
    result, good = adjusted(wrong), adjusted(scene)
    named = [group for group in result.plan.groups if group.wrong]
    assert [group.left_out for group in named] == [True] * len(named) and named
    middle = np.nanmedian(scene.block.points.ground[:, :2], axis=0)
    for group in named:
        lon, lat = (float(text) for text in group.name.removeprefix("part about ").split(","))
        assert lon > middle[0] and lat > middle[1]
        assert np.hypot(group.east_m, group.north_m) == pytest.approx(15.0, abs=5.0)
    assert any("reference, part about" in text and "not used" in text for text in result.warnings)
    checks = scene.block.points.role == Role.CHECK
    between = ground_difference_m(result.ground[checks], good.ground[checks])
    assert np.abs(between[:, :2].mean(axis=0)).max() < 0.3  # a sixteenth of its places fewer


def test_single_wrong_places_are_left_out(scene):
    ground = scene.places.ground.copy()
    ground[::10, 0] += 60.0 / 80_000.0
    result = adjust(scene.block, AdjustOptions(
        reference=replace(scene.places, ground=ground), laser=scene.laser.points,
    ))  # fmt: skip
    good = adjusted(scene)
    assert result.plan is not None and result.plan.left_out >= 0.9 * len(ground[::10])
    checks = scene.block.points.role == Role.CHECK
    between = ground_difference_m(result.ground[checks], good.ground[checks])
    assert np.abs(between[:, :2].mean(axis=0)).max() < 0.2


def test_a_reference_that_is_believed_over_the_rpcs_moves_the_block_to_it(scene):
    moved = replace(scene.places, ground=scene.places.ground + [200.0 / 80_000.0, 0.0, 0.0], ignores_rpc_priors=True)
    result = adjusted(replace(scene, places=moved))
    assert result.plan is not None and result.plan.share == 1.0
    assert np.hypot(*result.plan.alone_m) < 2.0
    assert result.rpcs_alone_m is not None and result.rpcs_alone_m[0] == pytest.approx(-200.0, abs=20.0)
