"""Images are brought together before measurements are judged, however badly their RPCs point."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment import Decision
from hrsi.hrsi_engine.adjustment.equations import State
from hrsi.hrsi_engine.adjustment.gauss_newton import Solution, Weighting
from hrsi.hrsi_engine.adjustment.preparation.image_alignment import bound_heights
from hrsi.hrsi_engine.adjustment.preparation.preparation import prepare_problem
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.laboratory.simulation.options import Noise, PointCounts, SceneSpec
from hrsi.hrsi_engine.laboratory.simulation.sensors import SENSORS, OrientationError
from hrsi.hrsi_engine.laboratory.simulation.synthesis import BlockSimulation, simulate_block
from hrsi.hrsi_engine.laboratory.simulation.views import make_strip_views


def simulate_strip(
    pointing_px: float, drift_px: float = 0.1, blunders: float = 0.0, image_px: float = 0.1, frames: int = 5,
    ties: int = 600,
) -> BlockSimulation:  # fmt: skip
    """Return frames of a strip in two looks, neighbours on almost parallel rays, that point to ``pointing_px``."""
    sensor, rng = SENSORS["worldview-2"], np.random.default_rng(3)
    views = make_strip_views(sensor, 1, frames, 2, (800, 600), 0.4)
    errors = rng.normal(0.0, pointing_px * sensor.detector_angle_rad, (len(views), 2))
    drifts = rng.normal(0.0, drift_px * sensor.detector_angle_rad, (len(views), 2))
    views = tuple(
        replace(view, vendor_error=OrientationError(attitude_rad=(*error, 0.0), attitude_drift_rad=(*drift, 0.0)))
        for view, error, drift in zip(views, errors.tolist(), drifts.tolist(), strict=True)
    )
    noise = Noise(image_px=image_px, blunders=blunders)
    return simulate_block(SceneSpec(seed=3), views, PointCounts(0, 5, ties), noise)


@pytest.mark.parametrize("model", mark_beyond(1, "thorough", ["auto", "shift", "generic-shift"]))
def test_frames_50_px_apart_lose_no_right_tie(model):
    block = simulate_strip(50.0).block
    result = adjust(block, AdjustOptions(model=model))
    assert result.converged
    assert (result.decision != Decision.KEPT).mean() < 0.002
    assert np.sqrt(np.nanmean((result.residual_px**2).sum(axis=1))) < 0.2


@pytest.mark.thorough
def test_blunders_are_found_between_frames_100_px_apart():
    simulated = simulate_strip(100.0, blunders=0.05)
    decision = adjust(simulated.block).decision
    assert (decision[simulated.truth.blunder] != Decision.KEPT).all()


def test_residuals_that_neighbours_share_are_no_blunders():
    """A shift does not follow a drift of two pixels, and no measurement is wrong."""
    result = adjust(simulate_strip(50.0, drift_px=2.0).block, AdjustOptions(model="shift", sigma_drift=0.0))
    assert (result.decision != Decision.KEPT).mean() < 0.01


@pytest.mark.parametrize(
    ("model", "sigma_drift"), mark_beyond(1, "thorough", [("shift", 0.0), ("generic-shift", None)])
)
def test_a_drift_that_no_parameter_follows_does_not_move_the_block(model, sigma_drift):
    """Frames drift by 2 px and matching is good to 0.02 px: ties must not outweigh where the RPCs say the block is."""
    simulated = simulate_strip(15.0, drift_px=2.0, image_px=0.02)
    result = adjust(simulated.block, AdjustOptions(model=model, sigma_drift=sigma_drift))
    assert result.converged
    off = np.nanmean(ground_difference_m(simulated.truth.ground, result.ground), axis=0)
    assert (np.abs(off) < 3.0 * np.array(result.parts[0].sigma_m)).all()


def test_heights_alone_are_bound_by_the_height_range_of_the_rpc():
    """No plan position has a prior but those of surveys, which keep their own."""
    block, *_ = blocks.block(gcps=3, checks=0, ties=5)
    observations = prepare_problem(block, AdjustOptions(model="shift")).observations
    weight = bound_heights(observations, block.points.ground).weight
    surveyed = block.points.role == Role.GCP
    assert surveyed.sum() == 3
    np.testing.assert_allclose(weight[surveyed], 1.0 / 0.1**2)  # m, stated for all three coordinates
    reach = abs(block.images[0].rpc.height_scale)
    np.testing.assert_allclose(weight[~surveyed, 2], 1.0 / reach**2)
    assert weight[~surveyed, :2].max() <= 1.0 / 10e3**2  # 10 km, against singular equations


@pytest.mark.parametrize(("frames", "ties"), [(5, 600), (1, 12)])
def test_the_start_meets(frames, ties):
    """Also with fewer ties of a pair of images than are taken of a pair that has many."""
    problem = prepare_problem(simulate_strip(50.0, frames=frames, ties=ties).block, AdjustOptions(model="shift"))
    apart = np.linalg.norm(problem.equations.compute_residuals(problem.start), axis=1)
    assert np.quantile(apart, 0.99) < 0.5
    heights = problem.start.ground[:, 2]
    assert np.ptp(heights) < 500.0


def test_the_cost_is_what_the_equations_lower():
    """Weak priors pull points on almost parallel rays: left out of the cost, no step lowered it at the minimum."""
    problem = prepare_problem(simulate_strip(50.0).block, AdjustOptions(model="shift"))
    loop, points = problem.loop(), len(problem.start.ground)
    weighting = Weighting(np.zeros(problem.observations.count), problem.weighting.points, np.ones(points, dtype=bool))
    direction = np.random.default_rng(1).normal(0.0, 1.0, (points, 3))

    def form_solution(metres: float) -> Solution:
        ground = move_ground(problem.start.ground, [0.0, 0.0, 300.0] + metres * direction)
        return loop.form_solution(State(problem.start.values, ground), weighting, np.ones(len(weighting.image)))

    slope = (form_solution(1.0).cost - form_solution(-1.0).cost) / 2.0
    assert slope == pytest.approx(-float((form_solution(0.0).normals.point_right * direction).sum()), rel=1e-3)
    assert slope != 0.0
