"""A block without GCPs on a surface: its relief brings displaced RPCs back, and flat ground says that it cannot."""

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.benchmarks import surface_triplet as triplet
from hrsi.hrsi_engine import find_tie_points, open_image
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Image, ImagePoints, Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, metres_per_degree, move_ground
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.hrsi_engine.surface.matching import match_surface

NOISE_M = 1.0  # of the DEM's cells of 20 m
TILTS = (-0.2, 0.0, 0.2)


def make_terrain(relief_m: float, seed: int) -> tuple[GridSurface, GridSurface]:
    """Return hills as high as that, and a DEM of them with noise."""
    side, step_m = 240, 20.0
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    heights = 250.0 + relief_m * (np.sin(x / 17.0 + y / 40.0) + 0.8 * np.cos(y / 13.0) + 0.5 * np.sin(x * y / 900.0))
    cell = step_m / metres_per_degree(np.array([[blocks.LON, blocks.LAT, 0.0]]))[0, :2]
    origin = tuple(np.array([blocks.LON, blocks.LAT]) - 0.5 * (side - 1) * cell * [1.0, -1.0])
    noise = np.random.default_rng(seed).normal(0.0, NOISE_M, heights.shape)
    dems = [GridSurface.from_array(z, origin, (cell[0], -cell[1])) for z in (heights, heights + noise)]
    return dems[0], dems[1]


def place_points(terrain: GridSurface, seed: int) -> np.ndarray:
    """Return ground points on the terrain."""
    truth = blocks.ground(900, seed)
    truth[:, 2] = terrain.heights(terrain.grid_coordinates(truth[:, :2]))
    return truth


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_displacement_is_found_and_its_covariance_holds(seed):
    terrain, dem = make_terrain(40.0, seed)
    away = np.random.default_rng(seed).uniform(-40.0, 40.0, 3)
    found = match_surface(move_ground(place_points(terrain, seed), -away), dem, 100.0)
    assert found is not None and found.is_decided
    error = found.displacement_m - away
    assert error @ np.linalg.solve(found.covariance_m2, error) < 16.3  # chi² of 3, 99.9 %
    assert np.hypot(*error[:2]) < 1.0 and abs(error[2]) < 0.3


@pytest.mark.parametrize("seed", mark_beyond(1, "thorough", [1, 2]))
def test_displaced_rpcs_come_back(seed):
    terrain, dem = make_terrain(40.0, seed)
    rng, truth = np.random.default_rng(seed), place_points(terrain, seed)
    shift = rng.uniform(15.0, 25.0, 3) * rng.choice([-1.0, 1.0], 3)
    cameras = [Image(f"n{k}", blocks.oblique_rpc(tilt, 0.0), (4001, 4001)) for k, tilt in enumerate(TILTS)]
    ids = [f"P{k:03d}" for k in range(len(truth))]
    seen = [one.rpc.project(move_ground(truth, shift)) + rng.normal(0.0, 0.3, (len(ids), 2)) for one in cameras]
    rows = [ImagePoints(ids, [one.id] * len(ids), xy, 0.3) for one, xy in zip(cameras, seen, strict=True)]
    result = adjust(assemble(cameras, [], rows), AdjustOptions(dem=dem, sigma_dem_m=NOISE_M))
    error = np.median(ground_difference_m(result.ground, truth), axis=0)
    (surface,) = result.surfaces
    assert not surface.open
    np.testing.assert_allclose(surface.match.displacement_m, -shift, atol=1.5)
    assert np.hypot(*error[:2]) < result.parts[0].ce90_m
    assert abs(error[2]) < result.parts[0].le90_m
    assert np.hypot(*shift[:2]) > 3.0 * result.parts[0].ce90_m  # so that the former says something


def test_flat_ground_says_that_it_holds_no_plan():
    terrain, dem = make_terrain(0.0, 1)
    truth = place_points(terrain, 1)
    rng = np.random.default_rng(1)
    cameras = [Image(f"n{k}", blocks.oblique_rpc(tilt, 0.0), (4001, 4001)) for k, tilt in enumerate(TILTS)]
    ids = [f"P{k:03d}" for k in range(len(truth))]
    rows = [
        ImagePoints(ids, [one.id] * len(ids), one.rpc.project(truth) + rng.normal(0.0, 0.3, (len(ids), 2)), 0.3)
        for one in cameras
    ]
    result = adjust(assemble(cameras, [], rows), AdjustOptions(dem=dem, sigma_dem_m=NOISE_M))
    assert any("does not determine" in text and "in plan" in text for text in result.warnings)
    without = adjust(assemble(cameras, [], rows), AdjustOptions(dem=dem, sigma_dem_m=NOISE_M, surface_search_m=0.0))
    assert result.parts[0].ce90_m == pytest.approx(without.parts[0].ce90_m)


def test_a_warm_start_ends_where_a_cold_one_does():
    terrain, dem = make_terrain(40.0, 3)
    rng, truth = np.random.default_rng(3), place_points(terrain, 3)
    cameras = [Image(f"n{k}", blocks.oblique_rpc(tilt, 0.0), (4001, 4001)) for k, tilt in enumerate(TILTS)]
    ids = [f"P{k:03d}" for k in range(len(truth))]
    seen = [one.rpc.project(move_ground(truth, [35.0, -30.0, 12.0])) for one in cameras]
    rows = [
        ImagePoints(ids, [one.id] * len(ids), xy + rng.normal(0.0, 0.3, xy.shape), 0.3)
        for one, xy in zip(cameras, seen, strict=True)
    ]
    block, options = assemble(cameras, [], rows), AdjustOptions(dem=dem, sigma_dem_m=NOISE_M)
    cold = adjust(block, options)
    warm = adjust(block, options, start=cold.values)
    np.testing.assert_allclose(ground_difference_m(warm.ground, cold.ground), 0.0, atol=0.05)  # 5 % of a cell's noise


@pytest.mark.real
def test_the_displaced_triplet_comes_back(real_data, tmp_path):
    images = [open_image(str(triplet.FOLDER / f"img_0{k}.tif")) for k in (1, 2, 3)]
    ties, judge = find_tie_points(images).image_points, triplet.Judge()
    coarse = triplet.write_degraded(str(tmp_path))
    for offset in triplet.draw_vectors(12)[[1, 9]]:
        block = assemble([triplet.displace_rpc(image, offset) for image in images], [], [ties])
        # what was asked for: 0.5 m in plan and 0.3 m in height; 3 m with cells of 30 m
        for dem, sigma_m, plan_m, height_m in ((str(triplet.DSM), 1.0, 0.5, 0.3), (coarse, 3.0, 3.0, 3.0)):
            result, _ = triplet.adjust_on(block, dem, sigma_m, 100.0)
            error = judge.find_offset(result.ground[result.block.points.role == Role.TIE])
            assert np.hypot(*error[:2]) < min(plan_m, result.parts[0].ce90_m)
            assert abs(error[2]) < min(height_m, result.parts[0].le90_m)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_trees_on_a_terrain_model_lift_no_points(seed):
    terrain, dtm = make_terrain(40.0, seed)
    rng, points = np.random.default_rng(seed), place_points(terrain, seed)
    trees_m = np.where(rng.random(len(points)) < 0.35, rng.uniform(2.0, 8.0, len(points)), 0.0)
    points[:, 2] += trees_m + rng.normal(0.0, 1.0, len(points))
    found = match_surface(points, dtm, 100.0, "dtm")
    assert found is not None and abs(found.displacement_m[2]) < 0.5
