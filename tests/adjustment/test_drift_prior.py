"""The prior of the images' drift, estimated from blocks whose drift is known."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.benchmarks.adjust_speed import simulated
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust, drift_prior
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.hrsi_engine.laboratory.direct_methods import DIRECT
from hrsi.hrsi_engine.refinement import MODELS

ESTIMATED = AdjustOptions(test_sigmas=False, model="affine", variance_components=True)
DRIFT_OF_SIMULATED = 1.0 / 12000  # px/px, of the blocks of `adjust_speed`


def drift_of(result):
    return next(part for part in result.variance_components if part.group == "drift of the images")


def check_squares(block, truth, result):
    check = block.points.role == Role.CHECK
    return np.mean(ground_difference_m(truth[check], result.ground[check]) ** 2)


def test_which_parameters_drift():
    expected = {
        "shift": "", "affine": "sample_s sample_l line_s line_l", "conformal": "scale rotation",
        "shift-drift": "sample_l line_l", "generic-shift": "", "direct": "",
        "generic-12": "xs_s xs_l ys_s ys_l psi_x_s psi_x_l psi_y_s psi_y_l",
        "object-scale-shift": "east_east north_north up_up",
    }  # fmt: skip
    for name, parameters in expected.items():
        model = (MODELS | DIRECT)[name]
        found = [parameter for parameter, yes in zip(model.parameters, model.drifts, strict=True) if yes]
        assert found == parameters.split(), name


@pytest.mark.parametrize("drift", mark_beyond(1, "coverage", [3e-5, 1e-4]))
def test_the_drift_is_found(drift):
    """Four images with four drifts each: a block knows the sigma to about 20 %, the mean of twelve to 6 %.

    Power (normal, 6 %, 0.8 to 1.2): 1.00 fails with 0 %, 1.35 with 97 %.
    """
    found = []
    for seed in range(12):
        block, _, _ = blocks.block(gcps=10, checks=0, ties=80, count=4, drift=drift, seed=seed, noise_px=0.1)
        found.append(drift_of(adjust(block, ESTIMATED)).sigma)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(drift, rel=0.2)


@pytest.mark.parametrize(("gcps", "drift"), [(3, 3e-5), (4, 0.0), (12, 3e-4)])
@pytest.mark.coverage
def test_it_is_never_worse_than_a_loose_prior_or_none_at_all(gcps, drift):
    """Shift and affine are each wrong somewhere; the estimated prior keeps up with the better one.

    Power (comparison): on the same twelve blocks; a prior that costs 10 % of the RMSE is seen, smaller losses are not.
    """
    squares = {"shift": [], "affine": [], "estimated": []}
    for seed in range(12):
        block, truth, _ = blocks.block(gcps=gcps, checks=40, ties=60, drift=drift, seed=seed)
        squares["shift"].append(
            check_squares(block, truth, adjust(block, AdjustOptions(model="shift", test_sigmas=False)))
        )
        squares["affine"].append(
            check_squares(block, truth, adjust(block, AdjustOptions(test_sigmas=False, model="affine")))
        )
        squares["estimated"].append(check_squares(block, truth, adjust(block, ESTIMATED)))
    rms = {name: float(np.sqrt(np.mean(values))) for name, values in squares.items()}
    assert rms["estimated"] < 1.1 * min(rms["shift"], rms["affine"])
    assert max(rms["shift"], rms["affine"]) > 1.1 * rms["estimated"] or gcps == 4


def test_a_drift_that_the_user_states_is_kept():
    block, _, _ = blocks.block()
    result = adjust(block, AdjustOptions(test_sigmas=False, model="affine", variance_components=True, sigma_drift=1e-5))
    assert all(part.group != "drift of the images" for part in result.variance_components)


def test_cross_validation_uses_the_estimated_prior():
    block, _, _ = blocks.block(gcps=4, checks=0, ties=60, drift=0.0)
    loose = adjust(block, AdjustOptions(test_sigmas=False, model="affine", cross_validate=True)).cross_validation
    held = adjust(
        block, AdjustOptions(test_sigmas=False, model="affine", cross_validate=True, variance_components=True)
    ).cross_validation
    assert np.mean(held.error_m**2) < np.mean(loose.error_m**2)


@pytest.mark.large
def test_the_drift_of_many_images_is_found():
    """63 000 measurements, 700 an image: as large as that it is no dense pair, and its GCPs are as they were said."""
    result = adjust(simulated(90, per_image=700))
    (drift,) = result.variance_components
    assert result.model.name == "affine" and not result.warnings
    assert drift.sigma == pytest.approx(DRIFT_OF_SIMULATED, rel=3.0 / np.sqrt(2 * drift.redundancy))


@pytest.mark.thorough
def test_corrections_at_a_solution_spare_solutions(monkeypatch):
    """Where each correction is followed by a solution, and until 0.1 %, more solutions give the same sizes."""
    block = simulated(90)
    quick = adjust(block)
    monkeypatch.setattr(drift_prior, "ITERATIONS", replace(drift_prior.ITERATIONS, coarse=1e-3, most=1))
    slow = adjust(block)
    of_images = np.abs(quick.values - slow.values)[:, quick.model.drifts] / slow.values_sigma[:, slow.model.drifts]
    assert quick.solves < slow.solves
    assert drift_of(quick).sigma == pytest.approx(drift_of(slow).sigma, rel=0.01)
    assert of_images.max() < 0.1
