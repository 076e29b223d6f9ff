"""Laser points hold the heights of a block without GCPs; groups of heights that lie off are named."""

from dataclasses import replace

import numpy as np
import pytest
from laser_scenes import LaserScene, laser_scene

from hrsi.hrsi_engine.adjustment import Adjustment, AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.external.laser_heights import MISFIT, NO_TIES_NEAR, LaserHeights, fit_planes
from hrsi.hrsi_engine.adjustment.external.shared_errors import (
    CommonError,
    GroupHistory,
    GroupOffset,
    find_outlying_groups,
)
from hrsi.hrsi_engine.block.laser import LaserPoints
from hrsi.hrsi_engine.foundation.thresholds import ITERATIONS
from hrsi.hrsi_engine.ground.geodesy import metres_per_degree, move_ground
from hrsi.hrsi_engine.laboratory.simulation.options import LaserSpec
from hrsi.hrsi_engine.plausibility.laser_quality import find_laser_reasons
from hrsi.hrsi_engine.results.judged_block import judge
from hrsi.hrsi_engine.surface.grid_surface import GridSurface

OPTIONS = AdjustOptions(model="shift")


def adjusted(scene: LaserScene, points: LaserPoints | None = None, **more: object) -> Adjustment:
    return adjust(scene.block, replace(OPTIONS, laser=scene.points if points is None else points, **more))


@pytest.fixture(scope="module")
def scene() -> LaserScene:
    return laser_scene(2)


def test_laser_points_hold_the_height(scene):
    free = scene.height_errors_m(adjust(scene.block, OPTIONS))[:, 2]
    result = adjusted(scene)
    held = scene.height_errors_m(result)[:, 2]
    assert result.converged
    assert abs(free.mean()) > 5.0  # two RPCs of 4.4 m, at 24 degrees
    assert abs(held.mean()) < 0.3  # passes are biased by 0.1 m; three of them, and canopy
    assert np.sqrt(np.mean(held**2)) < 0.9  # the check points' own rays: 0.6 m
    assert result.heights[0].source == "laser" and result.heights[0].share == 1.0
    assert any("position in plan" in text for text in result.warnings)


def test_every_laser_point_says_what_became_of_it(scene):
    found = adjusted(scene).laser
    left = scene.points.doubt != ""
    assert (found.reason[left] == scene.points.doubt[left]).all()
    assert set(np.unique(found.reason[~left])) <= {"", NO_TIES_NEAR, MISFIT}
    used = found.reason == ""
    assert (found.ties[used] > 0).all() and np.isfinite(found.residual_m[used]).all()
    wrong = (np.abs(scene.laser.error_m) > 8.0) & ~left & (found.reason != NO_TIES_NEAR)
    assert wrong.sum() > 5 and not used[wrong].any()


@pytest.mark.coverage
def test_canopy_and_clouds_do_little_harm():
    """The same scene with and without canopy and clouds.

    Power (comparison): one seed; a loss of 10 % of the height's RMSE is seen, and canopy that is taken for ground moves
    it by metres.
    """
    clean = laser_scene(5, LaserSpec(3, canopy=0.0, clouds=0.0))
    dirty = laser_scene(5, LaserSpec(3, canopy=0.25, clouds=0.05))
    errors = [one.height_errors_m(adjusted(one))[:, 2] for one in (clean, dirty)]
    good, bad = (np.sqrt(np.mean(error**2)) for error in errors)
    assert bad < 1.1 * good


def shifted_track(points: LaserPoints, by_m: float) -> tuple[LaserPoints, str]:
    """Return the points with the heights of one track off, and its name."""
    name = str(np.unique(points.track)[0])
    ground = points.ground.copy()
    ground[points.track == name, 2] += by_m
    return replace(points, ground=ground), name


def test_a_track_in_the_other_datum_is_named_and_left_out(scene):
    points, name = shifted_track(scene.points, 48.0)
    result = adjusted(scene, points)
    assert [group.name for group in result.heights[0].groups if group.left_out] == [f"track {name}"]
    assert abs(scene.height_errors_m(result)[:, 2].mean()) < 0.3
    assert any(name in text and "+4" in text and "not used" in text for text in result.warnings)


def test_two_tracks_that_differ_accuse_one_another(scene):
    chosen = np.isin(scene.points.track, np.unique(scene.points.track)[:2])
    points, _ = shifted_track(scene.points.select(chosen), 8.0)
    result = adjusted(scene, points)
    assert not any(group.left_out for group in result.heights[0].groups)
    assert any("cannot be identified" in text for text in result.warnings)


def dem_of(scene: LaserScene, above_m: float, step_m: float = 30.0) -> GridSurface:
    """Return the scene's terrain in cells of a free DEM."""
    spec, terrain = scene.simulated.spec, scene.simulated.scene.terrain
    cell = step_m / metres_per_degree(np.array([[spec.lon_deg, spec.lat_deg, 0.0]]))[0, :2]
    side = int(2.0 * 4500.0 / step_m)
    origin = np.array([spec.lon_deg, spec.lat_deg]) - 0.5 * (side - 1) * cell * [1.0, -1.0]
    lon, lat = np.meshgrid(origin[0] + cell[0] * np.arange(side), origin[1] - cell[1] * np.arange(side))
    height = terrain.height_at(np.column_stack([lon.ravel(), lat.ravel()])).reshape(side, side)
    return GridSurface.from_array(height + above_m, tuple(origin), (cell[0], -cell[1]))


def test_thousands_of_dem_heights_do_not_outvote_the_laser(scene):
    result = adjusted(scene, dem=dem_of(scene, 4.0), sigma_dem_m=3.0)
    shares = {one.source: one.share for one in result.heights}
    assert shares["laser"] > 0.9
    assert abs(scene.height_errors_m(result)[:, 2].mean()) < 0.4


def codes(result: Adjustment) -> set[str]:
    return {reason.code for reason in judge(result).reasons}


@pytest.mark.wrong_inputs
def test_the_verdict_doubts_sources_that_contradict(scene):
    """Laser heights in the other datum beside a DEM; two passes of which one must be wrong. Sound sources: nothing."""
    dem = dem_of(scene, 1.0)
    assert "sources-disagree" not in codes(adjusted(scene, dem=dem, sigma_dem_m=3.0)) | codes(adjusted(scene))
    ground = scene.points.ground + [0.0, 0.0, 48.0]
    lifted = adjusted(scene, replace(scene.points, ground=ground), dem=dem, sigma_dem_m=3.0)
    assert "sources-disagree" in codes(lifted)
    chosen = np.isin(scene.points.track, np.unique(scene.points.track)[:2])
    points, name = shifted_track(scene.points.select(chosen), 8.0)
    of_passes, *others = [
        reason for reason in judge(adjusted(scene, points)).reasons if reason.code == "sources-disagree"
    ]
    assert name in of_passes.message and "cannot be identified" in of_passes.message
    # points of the lower pass are rejected, so that the higher one may also be canopy
    assert len(others) <= 1 and all("may be canopy or roofs" in reason.message for reason in others)


def with_heights(points: LaserPoints, height_m: np.ndarray) -> LaserPoints:
    return replace(points, ground=np.column_stack([points.ground[:, :2], height_m]))


@pytest.mark.wrong_inputs
def test_the_verdict_doubts_laser_points_on_tops(scene):
    """Two thirds of the points on 15 m of canopy hold the block too high; those on the ground are the lower ones."""
    height = scene.points.ground[:, 2]
    of_canopy = adjusted(
        scene, with_heights(scene.points, height + 15.0 * (np.sin(np.arange(len(height)) / 30.0) > -0.5))
    )
    assert "sources-disagree" in codes(of_canopy)
    assert np.median(scene.height_errors_m(of_canopy)[:, 2]) > 10.0
    assert not {"sources-disagree"} & codes(adjusted(scene))
    for seed in (31, 32):
        wooded = laser_scene(seed, LaserSpec(3, canopy=0.3, clouds=0.05))
        assert not {"sources-disagree"} & codes(adjusted(wooded))


@pytest.mark.thorough
def test_the_verdict_doubts_heights_of_something_else(scene):
    """Heights that have nothing to do with the ground below: 30 m about it, stated to be decimetres."""
    other = scene.points.ground[:, 2] + np.random.default_rng(1).normal(0.0, 30.0, len(scene.points))
    assert "sources-disagree" in codes(adjusted(scene, with_heights(scene.points, other)))


LASER, DEM = CommonError(0.05, can_be_biased_as_a_whole=False), CommonError(1.2, can_be_biased_as_a_whole=True)


def said(laser: list[float], dem: list[float] = []) -> list[GroupOffset]:  # noqa: B006  # it is not changed
    """Return group_offsets of laser tracks (0.14 m) and of parts of a DEM (1.2 m)."""
    return [
        *(GroupOffset(0, k, offset, 0.02, 50) for k, offset in enumerate(laser)),
        *(GroupOffset(1, k, offset, 1.44, 50) for k, offset in enumerate(dem)),
    ]


def test_opinions_are_joined_robustly():
    off, decided, middle = find_outlying_groups(said([0.0, 0.1, 8.0]), [LASER])
    assert off.tolist() == decided.tolist() == [False, False, True] and middle == pytest.approx(0.05)
    off, decided, _ = find_outlying_groups(said([0.0, 8.0]), [LASER])
    assert off.any() and not decided.any()
    off, decided, _ = find_outlying_groups(said([0.0, 8.0], [0.5, -0.5]), [LASER, DEM])  # a DEM's two parts tell which
    assert off.tolist() == decided.tolist() == [False, True, False, False]
    # which of the first two is right is not decided; that the third is not, is
    off, decided, _ = find_outlying_groups(said([0.0, 0.8, 48.0], [0.5, -0.5]), [LASER, DEM])
    assert off.sum() == 2 and decided.tolist() == [False, False, True, False, False]
    assert find_outlying_groups([], [])[2] == 0.0


def test_a_dem_on_trees_is_one_fault_against_two_tracks():
    off, decided, middle = find_outlying_groups(said([0.0, 0.1], [10.0 + 0.1 * k for k in range(16)]), [LASER, DEM])
    assert off.tolist() == decided.tolist() == [False, False, *16 * [True]] and middle == pytest.approx(0.05)
    off, decided, _ = find_outlying_groups(said([0.0], [10.0 + 0.1 * k for k in range(16)]), [LASER, DEM])
    assert off.any() and not decided.any()  # one track and a DEM


def test_parts_of_a_dem_are_told_from_its_common_error():
    off, decided, _ = find_outlying_groups(said([0.0, 0.1], [*13 * [-2.0], *3 * [6.0]]), [LASER, DEM])
    assert off.tolist() == decided.tolist() == [*15 * [False], *3 * [True]]


def test_planes_follow_slopes_and_leave_roofs_out():
    rng = np.random.default_rng(1)
    away = rng.uniform(-10.0, 10.0, (50, 8, 2))
    height = 5.0 + away @ [0.1, -0.05] + rng.normal(0.0, 0.1, (50, 8))
    height[:, 0] += 6.0
    planes = fit_planes(away, height, np.ones((50, 8), dtype=bool))
    np.testing.assert_allclose(planes.slope.mean(axis=0), [0.1, -0.05], atol=0.01)
    assert np.median(planes.share[:, 0]) < 0.02
    single = fit_planes(away[:, :1], height[:, :1], np.ones((50, 1), dtype=bool))
    np.testing.assert_allclose(single.share, 1.0)
    assert np.abs(single.slope).max() < 1e-3


def make_level_ties() -> tuple[LaserHeights, np.ndarray]:
    """Return a laser point without stated sigma over level ground, and tie points 10 m apart around it."""
    east, north = np.meshgrid(np.arange(-300.0, 301.0, 10.0), np.arange(-100.0, 101.0, 10.0))
    ground = move_ground(
        np.tile([7.0, 45.0, 300.0], (east.size, 1)), np.column_stack([east.ravel(), north.ravel(), 0.0 * east.ravel()])
    )
    laser = LaserPoints(np.array([[7.0, 45.0, 300.0]]))
    return LaserHeights(laser, np.arange(1), np.arange(len(ground)), 15.0, 0.0), ground


def test_laser_points_in_grass_are_kept_and_those_in_forests_are_left_out():
    """Images show the ground between grass and shrubs, and the crowns of a forest: 15 m (FAO: above 5 m)."""
    points = LaserPoints(np.array([[7.0, 45.0, 300.0], [7.1, 45.0, 300.0]]), canopy_m=np.array([0.5, 15.0]))
    assert [bool(reason) for reason in find_laser_reasons(points)] == [False, True]


def test_laser_heights_that_state_no_sigma_have_a_usual_one():
    """Of ICESat-2 over land: 0.1 m on ice (Brunt 2019) to 1 m in forests (Neuenschwander 2020)."""
    heights, ground = make_level_ties()
    assert 0.1 < heights.observe_heights(ground, np.zeros(0)).sigma_m[0] < 1.0


@pytest.mark.parametrize(("moved_m", "others"), [(0.01, False), (100.0, True)])
def test_a_block_that_moves_is_observed_where_it_comes_to(moved_m: float, others: bool):
    """The last iterations keep the tie points of each laser point; those of a block far off are others."""
    heights, ground = make_level_ties()
    before = heights.observe_heights(ground, np.zeros(0))
    ahead = heights.observe_heights(move_ground(ground, np.tile([moved_m, 0.0, 0.0], (len(ground), 1))), np.zeros(0))
    assert bool(set(before.point.tolist()) & set(ahead.point.tolist())) != others
    assert (ahead.point is before.point) != others


def test_a_group_that_comes_back_again_and_again_stays_out():
    """Left out, it fits; taken back, it does not: without an end to that the adjustment has none either."""
    memory, group = GroupHistory(), ("laser", 4)
    seen = [memory.decide_exclusion(group, decided=number % 2 == 0) for number in range(40)]
    assert not all(seen[: 2 * ITERATIONS.repeated - 1])
    assert all(seen[2 * ITERATIONS.repeated - 1 :])
    assert not memory.decide_exclusion(("laser", 5), decided=False)
    assert memory.decide_exclusion(("laser", 5), decided=True) and not memory.decide_exclusion(
        ("laser", 5), decided=False
    )
