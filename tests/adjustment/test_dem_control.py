"""Tie-point heights held by a DEM: weak geometry mended, in spite of trees, buildings and errors of the DEM."""

from pathlib import Path

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.external import shared_errors
from hrsi.hrsi_engine.adjustment.result import Decision
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints, Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, metres_per_degree
from hrsi.hrsi_engine.surface.grid_surface import GridSurface
from hrsi.processing_algorithms import run

SIGMA_DEM_M = 2.0
TILTS = (0.10, 0.19)  # 5 degrees of convergence: 0.3 px of noise are 3 m of height, and a bias of 5 px 50 m


def surfaces(wrong: float, seed: int) -> tuple[GridSurface, GridSurface, GridSurface]:
    """Return true terrain, a DEM of it, and the same DEM without its wrong cells.

    The DEM has noise, and a share of its cells is 15 to 60 m wrong, most of them too high.
    """
    rng = np.random.default_rng(seed)
    side, step_m = 120, 40.0
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    terrain = 250.0 + 30.0 * np.sin(x / 17.0) + 25.0 * np.cos(y / 13.0)
    wrong_cells = rng.random((side // 4, side // 4)) < wrong
    height = np.where(rng.random(wrong_cells.shape) < 0.8, 1.0, -1.0) * rng.uniform(15.0, 60.0, wrong_cells.shape)
    dem = terrain + rng.normal(0.0, SIGMA_DEM_M, terrain.shape) + np.kron(wrong_cells * height, np.ones((4, 4)))
    cell = step_m / metres_per_degree(np.array([[blocks.LON, blocks.LAT, 0.0]]))[0, :2]
    origin = tuple(np.array([blocks.LON, blocks.LAT]) - 0.5 * (side - 1) * cell * [1.0, -1.0])
    holes = np.where(np.kron(wrong_cells, np.ones((4, 4))) > 0.0, np.nan, dem)
    made = [GridSurface.from_array(z, origin, (cell[0], -cell[1])) for z in (terrain, dem, holes)]
    return made[0], made[1], made[2]


def weak_block(
    terrain: GridSurface, seed: int, gcps: int = 0, tilts: tuple[float, ...] = TILTS
) -> tuple[Block, np.ndarray]:
    """Return images with biases of 5 px each and 400 tie points on the terrain, and the true ground points."""
    rng = np.random.default_rng(seed)
    cameras = [Image(f"n{k}", blocks.oblique_rpc(tilt, 0.0), (4001, 4001)) for k, tilt in enumerate(tilts)]
    truth = blocks.ground(400 + gcps, seed)
    truth[:, 2] = terrain.heights(terrain.grid_coordinates(truth[:, :2]))
    ids = [f"P{k:03d}" for k in range(len(truth))]
    rows = []
    for camera in cameras:
        xy = camera.rpc.project(truth) + rng.normal(0, 5.0, 2) + rng.normal(0, 0.3, (len(ids), 2))
        rows.append(ImagePoints(ids, [camera.id] * len(ids), xy, 0.3))
    return assemble(cameras, [GroundPoints(ids[:gcps], truth[:gcps], Role.GCP, 0.1)], rows), truth


def height_error_m(block: Block, truth: np.ndarray, options: AdjustOptions) -> np.ndarray:
    """Return the mean and the RMS height error of the tie points."""
    error = ground_difference_m(adjust(block, options).ground, truth)[:, 2]
    return np.array([error.mean(), np.sqrt(np.mean(error**2))])


@pytest.mark.parametrize("seed", mark_beyond(1, "thorough", [1, 2, 3]))
def test_a_quarter_of_wrong_heights_does_little_harm(seed, monkeypatch):
    terrain, dirty, known = surfaces(0.25, seed)
    block, truth = weak_block(terrain, seed)
    free = height_error_m(block, truth, AdjustOptions(test_sigmas=False))
    good = height_error_m(block, truth, AdjustOptions(test_sigmas=False, dem=known, sigma_dem_m=SIGMA_DEM_M))
    robust = height_error_m(block, truth, AdjustOptions(test_sigmas=False, dem=dirty, sigma_dem_m=SIGMA_DEM_M))
    monkeypatch.setattr(shared_errors, "hampel_weight", np.ones_like)
    plain = height_error_m(block, truth, AdjustOptions(test_sigmas=False, dem=dirty, sigma_dem_m=SIGMA_DEM_M))
    print(f"seed {seed}, least squares: {plain}")
    print(f"seed {seed}: mean and RMS of heights without DEM {free}, wrong heights known {good}, unknown {robust}")
    assert abs(good[0]) < 0.8  # 300 points of 5 m each by a pair of rays: 0.3 m
    assert abs(robust[0]) < min(2.0, 0.4 * plain[0])  # rays tell errors of 15 m from nothing by 3 sigma only
    # Least squares takes less harm since all of a DEM weighs with the 0.8 of its sigma that it is off as a whole: 0.45
    assert robust[1] < min(1.7 * good[1], 0.45 * plain[1])
    assert free[1] > 3.0 * robust[1]


def test_wrong_heights_are_counted_and_named():
    terrain, dirty, _ = surfaces(0.25, 1)
    block, _ = weak_block(terrain, 1)
    result = adjust(block, AdjustOptions(test_sigmas=False, dem=dirty, sigma_dem_m=SIGMA_DEM_M))
    assert 0.15 < result.heights[0].left_out / result.heights[0].observations < 0.35
    assert result.heights[0].rmse_m < 7.0  # the rays' own 5 m
    assert result.heights[0].left_out_median_m < -15.0
    assert any("heights of the DEM are outliers" in text for text in result.warnings)
    _, clean, _ = surfaces(0.0, 1)
    result = adjust(block, AdjustOptions(test_sigmas=False, dem=clean, sigma_dem_m=SIGMA_DEM_M))
    assert result.heights[0].left_out <= 4
    assert not any("heights of the DEM" in text for text in result.warnings)


def test_blunders_of_image_points_are_found_although_a_dem_holds_them():
    terrain, dirty, _ = surfaces(0.25, 4)
    block, truth = weak_block(terrain, 4, tilts=(0.10, 0.19, -0.2))
    rows = block.measurements
    wrong = np.arange(0, len(rows), 45)
    result = adjust(
        blocks.move_measurements(block, wrong, [0.0, 30.0]),  # across the epipolar lines
        AdjustOptions(test_sigmas=False, dem=dirty, sigma_dem_m=SIGMA_DEM_M, reject_sigma=4.0),
    )
    assert np.mean(result.decision[wrong] != int(Decision.KEPT)) > 0.95
    good = np.setdiff1d(np.arange(len(rows)), wrong)
    beside = np.isin(rows.point[good], rows.point[wrong])
    assert np.mean(result.decision[good[~beside]] != int(Decision.KEPT)) < 0.005  # wrong DEM heights accuse no ray
    error = ground_difference_m(result.ground, truth)[:, 2]
    assert abs(np.nanmean(error)) < 1.0


def test_heights_of_a_single_strip_between_gcps_of_one_image():
    """GCPs hold the first image; the DEM says where the second one lies along the epipolar lines."""
    terrain, dirty, _ = surfaces(0.15, 5)
    block, truth = weak_block(terrain, 5, gcps=5)
    rows = block.measurements
    known = block.points.role == Role.GCP
    block = block.with_measurements(~(known[rows.point] & (rows.image == 1)))
    free, held = (
        height_error_m(block, truth, options)[0]
        for options in (
            AdjustOptions(test_sigmas=False),
            AdjustOptions(test_sigmas=False, dem=dirty, sigma_dem_m=SIGMA_DEM_M),
        )
    )
    assert abs(free) > 5.0
    assert abs(held) < 1.0


@pytest.mark.parametrize("off_m", mark_beyond(1, "thorough", [-20.0, -49.0, 20.0]))
def test_gcps_that_agree_outvote_a_dem_that_is_off_as_a_whole(off_m, monkeypatch):
    """Heights of points are compared with the terrain that made them: six GCPs of 0.1 m know better than a DEM."""
    terrain, dem, _ = surfaces(0.0, 4)
    block, truth = weak_block(terrain, 4, gcps=6)
    right = dem.heights
    monkeypatch.setattr(dem, "heights", lambda grid: right(grid) + off_m)
    options = AdjustOptions(model="shift", dem=dem, sigma_dem_m=SIGMA_DEM_M)
    result = adjust(block, options)
    ties = block.points.role == Role.TIE
    error = ground_difference_m(result.ground[ties], truth[ties])[:, 2]
    alone = adjust(block, AdjustOptions(model="shift"))
    without = ground_difference_m(alone.ground[ties], truth[ties])[:, 2]
    assert abs(np.median(error)) < max(2.0 * abs(np.median(without)), 1.0)
    (agreement,) = result.heights
    assert agreement.contradicts and agreement.left_out == agreement.observations


def test_walls_of_a_dem_do_not_keep_the_adjustment_moving(tmp_path: Path):
    """Tie points on walls, where a DEM of 0.1 m changes by metres within their errors in plan."""
    made = tmp_path / "made"
    run(
        "simulate", images=3, along="-15,3,20", size=560, landform="city", gcps=20, checks=0, ties=2000, seed=22,
        noise_gcp_xy=0.02, noise_gcp_h=0.02, pixels=False, output_dir=str(made),
    )  # fmt: skip
    report = run(
        "adjust", images=[str(made / f"image_{k}_RPC.TXT") for k in (1, 2, 3)], gcps=str(made / "ground_points.csv"),
        image_points=str(made / "image_points.csv"), dem=str(made / "dem.tif"), sigma_dem=0.1,
        height_datum="ellipsoidal", report=False, force_write=True, output_dir=str(tmp_path / "result"),
    )  # fmt: skip
    assert "not-converged" not in {reason["code"] for reason in report["verdict"]["reasons"]}
