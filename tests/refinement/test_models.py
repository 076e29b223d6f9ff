"""The contract of every refinement model."""

from __future__ import annotations

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.geodesy import moved_ground
from hrsi.hrsi_engine.refinement import MODELS
from hrsi.hrsi_engine.refinement.model import CONTROLLED, UNCONTROLLED, priors_of


@pytest.fixture(params=MODELS.values(), ids=MODELS.keys())
def model(request):
    return request.param


@pytest.fixture
def image():
    return blocks.images(1)[0]


def values_of(model, image, seed=3):
    """Corrections of several pixels, as large as vendors' errors are."""
    rng = np.random.default_rng(seed)
    sigma = model.prior_sigmas(image, CONTROLLED)
    return 0.1 * sigma * rng.uniform(-1, 1, len(sigma))


def test_name_is_the_key(model):
    assert MODELS[model.name] is model
    assert len(set(model.parameters)) == len(model.parameters)
    assert model.title


def test_zero_values_leave_the_camera_as_it_is(model, image):
    ground = blocks.ground(50, 1)
    zero = np.zeros(len(model.parameters))
    np.testing.assert_array_equal(model.project(image, zero, ground), image.rpc.project(ground))
    refined = model.refined_rpc(image, zero)
    assert refined.rpc == image.rpc
    assert refined.fit_max_px == 0.0


def test_equations_compute_what_project_does(model, image):
    ground, values = blocks.ground(50, 2), values_of(model, image)
    equations = model.equations(image, image.rpc.project(ground))(values, ground)
    np.testing.assert_allclose(equations.computed, model.project(image, values, ground), atol=1e-9)


def test_derivatives_by_values_are_those_of_differences(model, image):
    ground, values = blocks.ground(20, 4), values_of(model, image)
    analytic = model.equations(image, image.rpc.project(ground))(values, ground).by_values
    for index, sigma in enumerate(model.prior_sigmas(image, CONTROLLED)):
        step = np.zeros(len(values))
        step[index] = 1e-3 * sigma
        numeric = (model.project(image, values + step, ground) - model.project(image, values - step, ground)) / 2.0
        np.testing.assert_allclose(analytic[:, :, index] * step[index], numeric, atol=1e-8)


def test_derivatives_by_ground_are_those_of_differences(model, image):
    ground, values = blocks.ground(20, 5), values_of(model, image)
    analytic = model.equations(image, image.rpc.project(ground))(values, ground).by_ground
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1.0
        ahead, behind = (model.project(image, values, moved_ground(ground, sign * step)) for sign in (1, -1))
        np.testing.assert_allclose(analytic[:, :, axis], (ahead - behind) / 2.0, atol=2e-6)  # px per m: curvature


def test_refined_rpc_does_what_the_model_does(model, image):
    values = values_of(model, image)
    refined = model.refined_rpc(image, values)
    ground = blocks.ground(500, 6)
    difference = np.abs(refined.rpc.project(ground) - model.project(image, values, ground)).max()
    assert difference <= max(refined.fit_max_px, 1e-7)
    assert refined.fit_max_px < 0.01


def test_refined_rpc_keeps_the_vendors_accuracy_terms(model, image):
    from dataclasses import replace

    stated = replace(image, rpc=replace(image.rpc, err_bias=4.0, err_rand=0.5))
    refined = model.refined_rpc(stated, values_of(model, stated)).rpc
    assert (refined.err_bias, refined.err_rand) == (4.0, 0.5)


def test_priors_come_from_the_rpcs_own_accuracy_only_without_control(image):
    from dataclasses import replace

    stated = replace(image, rpc=replace(image.rpc, err_bias=4.0))
    assert priors_of(stated, controlled=True) == CONTROLLED
    assert priors_of(image, controlled=False) == UNCONTROLLED
    assert priors_of(stated, controlled=False).shift_px == pytest.approx(4.0, rel=0.01)  # GSD is 1 m
