"""The block adjustment against dense least squares, simulated truth and the Hobart field."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from dense_adjustment import dense_solution
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import WEIGHTS, AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.outcome import assembly
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.foundation.errors import InputError, SolveError
from hrsi.hrsi_engine.foundation.reasons import Level
from hrsi.hrsi_engine.refinement import MODELS
from hrsi.hrsi_engine.results.judged_block import judge


def test_without_gcps_equals_dense_least_squares(monkeypatch):
    """But for the translation to the RPCs' own position (`test_rpc_position`)."""
    monkeypatch.setattr(assembly, "keep_rpc_position", lambda problem, loop, solution, precise: (solution, precise))
    block, _, _ = blocks.block(gcps=0, checks=0, ties=40, bias_px=2.0)
    result = adjust(block, AdjustOptions(test_sigmas=False, model="shift"))
    dense = dense_solution(block, MODELS["shift"], controlled=False)
    # The weak priors of the points stand elsewhere in the dense solution, and pull as the square of the images' own:
    # these are 7 m, and were 5 px before issue 37
    np.testing.assert_allclose(result.values, dense.values, atol=1e-3 * (7.0 / 5.0) ** 2)
    # the RPCs' error terms hold the block, whatever sigma0 says of the image points
    np.testing.assert_allclose(result.values_sigma, np.sqrt(dense.values_cofactor), rtol=1e-4)
    assert sum(part.by_priors for part in result.parts) == pytest.approx(
        3.0, abs=0.5
    )  # three translations are not in the ties


def test_check_points_do_not_touch_the_cameras():
    block, _, _ = blocks.block(gcps=6, checks=10, ties=10)
    moved = blocks.move_measurements(block, block.points.role[block.measurements.point] == Role.CHECK, [50.0, 50.0])
    np.testing.assert_allclose(
        adjust(moved, AdjustOptions(test_sigmas=False)).values,
        adjust(block, AdjustOptions(test_sigmas=False)).values,
        atol=1e-9,
    )
    # else the spoilt ones are left out as blunders
    with_ties = AdjustOptions(test_sigmas=False, check_as_ties=True, reject_sigma=0.0)
    assert np.abs(adjust(moved, with_ties).values - adjust(block, with_ties).values).max() > 1.0


@pytest.mark.parametrize("away_px", [30.0, 300.0, 3000.0])
def test_iterations_end_at_a_ten_thousandth_of_a_sigma_from_the_minimum(away_px):
    """2 x the last predicted decrease is the squared distance in sigmas; sigma0 enters where it is above 1."""
    block, *_ = blocks.block(gcps=4, checks=0, ties=20, seed=0)
    rows = block.measurements
    xy = rows.xy + away_px * np.array([1.0, -0.5]) * (1.0 + rows.image[:, None])
    moved = replace(block, measurements=replace(rows, xy=xy))
    options = AdjustOptions(test_sigmas=False, model="affine", reject_sigma=0.0, tolerance=0.0)
    last = adjust(moved, options).history[-1]
    redundancy = 2 * len(xy) + 3 * 4 - 3 * 24 - 3 * 6
    sigma0 = np.sqrt(max(2.0 * last.cost / redundancy, 1.0))
    assert np.sqrt(2.0 * last.predicted_decrease) <= 1e-4 * sigma0


@pytest.mark.parametrize("name", [name for name in WEIGHTS if name != "none"])
def test_robust_weights_are_95_percent_efficient(name):
    """What they cost where errors are normal (Holland and Welsch 1977): E[psi']^2 / E[psi^2], psi = t w(t), is 0.95."""
    t = np.linspace(-9.0, 9.0, 18_001)
    weight = WEIGHTS[name](np.abs(t))
    density = np.exp(-0.5 * t**2) / np.exp(-0.5 * t**2).sum()
    psi = t * weight
    efficiency = (density @ np.gradient(psi, t)) ** 2 / (density @ psi**2)
    assert efficiency == pytest.approx(0.95, abs=0.005)
    assert weight[9000] == pytest.approx(1.0, abs=1e-9)
    assert np.all(np.diff(weight[9000:]) <= 1e-12)


@pytest.mark.parametrize("robust", mark_beyond(1, "thorough", [name for name in WEIGHTS if name != "none"]))
def test_robust_weights_hold_against_blunders(robust):
    block, _, errors = blocks.block(gcps=4, checks=0, ties=60, seed=5)
    true = np.array([error.ravel() for error in errors])
    reach = np.array([1.0, 2000.0, 2000.0, 1.0, 2000.0, 2000.0])  # px at the image's edge
    rng = np.random.default_rng(8)
    ties = np.flatnonzero(block.points.role[block.measurements.point] == Role.TIE)
    spoilt = blocks.move_measurements(block, rng.choice(ties, 9, replace=False), rng.uniform(10, 40, (9, 2)))

    def camera_error_px(block, **options):
        """Each way by itself: nothing is left out unless the options say so."""
        result = adjust(
            block, AdjustOptions(**{"test_sigmas": False, "model": "affine", "reject_sigma": 0.0} | options)
        )
        return np.sqrt(np.mean(((result.values - true) * reach) ** 2))

    clean = camera_error_px(block)
    assert camera_error_px(spoilt, robust=robust) < 1.25 * clean
    assert camera_error_px(spoilt, reject_sigma=4.0) < 1.25 * clean
    assert camera_error_px(spoilt) > 2.0 * clean


def test_rejected_measurements_have_no_residual_and_no_weight():
    block, _, _ = blocks.block()
    worst = int(np.flatnonzero(block.points.role[block.measurements.point] == Role.TIE)[4])
    spoilt = blocks.move_measurements(block, worst, [30.0, 30.0])
    result = adjust(spoilt, AdjustOptions(test_sigmas=False, model="affine", reject_sigma=4.0))
    assert result.weight[worst] == 0.0
    assert np.isnan(result.residual_px[worst]).all()


def test_too_few_observations_name_the_image():
    block, _, _ = blocks.block(gcps=2, checks=0, ties=0)
    with pytest.raises(SolveError, match=r"image0.*4 observations for the 6 parameters"):
        adjust(block, AdjustOptions(test_sigmas=False, model="affine"))


def test_nothing_to_adjust():
    block, _, _ = blocks.block(gcps=0, checks=0, ties=5, count=1)
    with pytest.raises(SolveError, match="no point is measured in two images"):
        adjust(block, AdjustOptions(test_sigmas=False))


def test_unknown_model_is_named():
    with pytest.raises(InputError, match="nonsense"):
        adjust(blocks.block()[0], AdjustOptions(test_sigmas=False, model="nonsense"))


@pytest.mark.parametrize("model", mark_beyond(1, "wrong_inputs", ["shift", "affine", "generic-shift"]))
@pytest.mark.parametrize("moved", [(0.0, -6.0, 0.0), (40.0, 80.0, 0.0), (0.0, 0.0, 5e6)])
def test_points_on_the_other_side_of_the_earth_end_in_words(moved: tuple[float, float, float], model: str) -> None:
    """GCPs kilometres or continents away: the error that says what to do, or a result whose verdict is unusable."""
    right, _, _ = blocks.block(seed=5)
    known = right.points.role == Role.GCP
    ground = right.points.ground + np.where(known[:, None], moved, 0.0)
    said, result = "", None
    try:
        result = adjust(replace(right, points=replace(right.points, ground=ground)), AdjustOptions(model=model))
    except SolveError as error:
        said = str(error)
    if result is None:
        assert "GCP" in said
    else:
        assert result.sigma0 > 100.0  # image points are off by hundreds of their standard deviations
        assert judge(result).level == Level.UNUSABLE
