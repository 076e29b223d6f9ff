"""The contract of every refinement model, over all of `SINGLE_IMAGE_MODELS`."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.block.pointing import POINTING
from hrsi.hrsi_engine.camera.rpc_fit import FIT, fit_rpc
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.refinement import MODELS, Priors
from hrsi.hrsi_engine.refinement.estimate import CONTROL_ONLY, Control, estimate
from hrsi.hrsi_engine.refinement.model import CONTROLLED, UNCONTROLLED_DRIFT, select_priors
from hrsi.hrsi_engine.refinement.pseudo_rays import compute_sensor_frame
from hrsi.hrsi_engine.refinement.stacked_cameras import linearise_images, project_to_images
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS
from hrsi.tests.test_rpc import synthetic_rpc
from hrsi.tests.test_rpc_fit import pushbroom_points

SEVERAL_PX = Priors(shift_px=100.0, drift=1e-3)  # a tenth of it: as large as vendors' errors are
SAME_PX = 1e-6


#: `generic-full` has all of their parameters.
PARTS_OF_FULL = ("generic-affine", "generic-12")


@pytest.fixture(
    params=[
        pytest.param(model, id=name, marks=[pytest.mark.thorough] if name in PARTS_OF_FULL else [])
        for name, model in SINGLE_IMAGE_MODELS.items()
    ]
)
def model(request):
    return request.param


@pytest.fixture
def image():
    return blocks.images(1)[0]


def values_of(model, image, seed=3):
    """Corrections of several pixels."""
    rng = np.random.default_rng(seed)
    sigma = model.prior_sigmas(image, SEVERAL_PX) * (0.01 if model.name == "direct" else 0.1)
    return sigma * rng.uniform(-1, 1, len(sigma))


def test_name_is_the_key(model):
    assert SINGLE_IMAGE_MODELS[model.name] is model
    assert len(set(model.parameters)) == len(model.parameters)
    assert model.title
    assert model.least_points >= (0 if model.name == "none" else 1)


def test_zero_values_leave_the_camera_as_it_is(model, image):
    ground = blocks.ground(50, 1)
    zero = np.zeros(len(model.parameters))
    np.testing.assert_array_equal(model.project(image, zero, ground), image.rpc.project(ground))
    observed = image.rpc.project(ground)
    np.testing.assert_allclose(model.equations(image, observed)(zero, ground).computed, observed, atol=SAME_PX)
    refined = model.compute_refined_rpc(image, zero)
    assert refined.rpc == image.rpc
    assert refined.fit_max_px == 0.0


def test_many_images_at_once_are_as_one_by_one(model):
    """A few points on each of several images, in any order, one image without points; parameters of each its own."""
    images = blocks.images(4)
    values = np.stack([values_of(model, image, seed) for seed, image in enumerate(images)])
    which = np.random.default_rng(5).permutation(np.repeat([0, 1, 3], [7, 1, 9]))
    ground = blocks.ground(len(which), 6)
    observed = np.stack(
        [images[k].rpc.project(place[None])[0] for k, place in zip(which.tolist(), ground, strict=True)]
    ).reshape(-1, 2)
    together = linearise_images(model, images, which, observed, values, ground)
    projected = project_to_images(model, images, which, values, ground)
    for k in (0, 1, 3):
        rows = which == k
        alone = model.equations(images[k], observed[rows])(values[k], ground[rows])
        for whole, part in zip(together, alone, strict=True):
            largest = max(float(np.abs(part).max(initial=0.0)), 1.0)
            np.testing.assert_allclose(whole[rows], part, rtol=1e-9, atol=1e-10 * largest)  # rounding of pixels by 1e4
        np.testing.assert_allclose(
            projected[rows], model.project(images[k], values[k], ground[rows]), atol=SAME_PX / 100
        )


def test_equations_compute_what_project_does(model, image):
    """Also where the points were observed some pixels from where the corrected camera sees them."""
    ground, values = blocks.ground(50, 2), values_of(model, image)
    expected = model.project(image, values, ground)
    at = model.equations(image, expected)(values, ground)
    np.testing.assert_allclose(at.computed, expected, atol=SAME_PX)
    beside = model.equations(image, expected + [10.0, -10.0])(values, ground)
    np.testing.assert_allclose(beside.computed, expected, atol=0.01)


def test_derivatives_by_values_are_those_of_differences(model, image):
    ground, values = blocks.ground(20, 4), values_of(model, image)
    analytic = model.equations(image, model.project(image, values, ground))(values, ground).by_values
    for index, sigma in enumerate(model.prior_sigmas(image, SEVERAL_PX)):
        step = np.zeros(len(values))
        step[index] = 1e-3 * sigma
        numeric = (model.project(image, values + step, ground) - model.project(image, values - step, ground)) / 2.0
        np.testing.assert_allclose(analytic[:, :, index] * step[index], numeric, atol=2e-6, rtol=1e-5)


def test_derivatives_by_ground_are_those_of_differences(model, image):
    ground, values = blocks.ground(20, 5), values_of(model, image)
    analytic = model.equations(image, model.project(image, values, ground))(values, ground).by_ground
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1.0
        ahead, behind = (model.project(image, values, move_ground(ground, sign * step)) for sign in (1, -1))
        np.testing.assert_allclose(analytic[:, :, axis], (ahead - behind) / 2.0, atol=2e-6)  # px per m: curvature


def test_refined_rpc_does_what_the_model_does(model, image):
    values = values_of(model, image)
    refined = model.compute_refined_rpc(image, values)
    ground = blocks.ground(500, 6)
    difference = np.abs(refined.rpc.project(ground) - model.project(image, values, ground)).max()
    assert difference <= 2.0 * refined.fit_max_px + 1e-5  # the grid of the check is not dense
    assert refined.fit_max_px < 0.01


def test_refined_rpc_keeps_the_vendors_accuracy_terms(model, image):
    stated = replace(image, rpc=replace(image.rpc, err_bias=4.0, err_rand=0.5))
    refined = model.compute_refined_rpc(stated, values_of(model, stated)).rpc
    assert (refined.err_bias, refined.err_rand) == (4.0, 0.5)


def test_priors_come_from_the_rpcs_own_accuracy_only_without_control(image):
    stated = replace(image, rpc=replace(image.rpc, err_bias=4.0))
    assert select_priors(stated, controlled=True) == CONTROLLED
    # of an unknown sensor in metres on the ground, where it was 5 px of the file (issue 37)
    assert select_priors(image, controlled=False).shift_px == pytest.approx(POINTING.unknown_m, rel=0.01)  # GSD is 1 m
    assert select_priors(image, controlled=False).drift == UNCONTROLLED_DRIFT
    assert select_priors(stated, controlled=False).shift_px == pytest.approx(4.0, rel=0.01)  # GSD is 1 m


# ---- estimation ----------------------------------------------------------------------------------------------------


def simulated_control(model, image, values, count=60, noise_px=0.3, seed=7):
    rng = np.random.default_rng(seed)
    ground = blocks.ground(count, seed)
    observed = model.project(image, values, ground) + rng.normal(0.0, noise_px, (count, 2))
    return Control(ground, observed, None, noise_px, (1e-3, 1e-3))


def test_simulated_parameters_come_back_within_three_sigma(model, image):
    values = values_of(model, image)
    found = estimate(model, image, simulated_control(model, image, values), SEVERAL_PX)
    excess = np.abs(found.values - values) / np.where(found.sigmas > 0.0, found.sigmas, 1.0)
    assert found.converged or (model.name in ("idkf", "slss") and "passed over the points once" in found.status)
    assert found.sigma0 == pytest.approx(1.0, abs=3.0 / np.sqrt(2.0 * found.redundancy))
    assert excess.max(initial=0.0) <= 3.0


@pytest.mark.parametrize("name", list(MODELS))
def test_the_camera_comes_back(name, image):
    """Also where parameters cannot be told apart: what they do together is right.

    Not for the direct methods: 78 coefficients follow the noise of 60 points wherever their priors let them.
    """
    model = SINGLE_IMAGE_MODELS[name]
    values = values_of(model, image)
    found = estimate(model, image, simulated_control(model, image, values), CONTROL_ONLY)
    ground = blocks.ground(200, 8)
    difference = model.project(image, found.values, ground) - model.project(image, values, ground)
    assert np.sqrt(np.mean(difference**2)) < 0.3  # noise of one measurement; 60 carry up to 20 parameters


@pytest.mark.parametrize("name", list(SINGLE_IMAGE_MODELS))
def test_the_origin_of_the_image_does_not_matter(name, image):
    model = SINGLE_IMAGE_MODELS[name]
    here = Image("image", image.rpc)
    there = Image("image", image.rpc.shift(1000.0, -500.0))
    control = simulated_control(SINGLE_IMAGE_MODELS["affine"], here, np.array([5.0, 1e-3, 0.0, -3.0, 0.0, 5e-4]), 20)
    moved = replace(control, xy=control.xy + [1000.0, -500.0])
    ground = blocks.ground(50, 9)
    expected = model.project(here, estimate(model, here, control).values, ground)
    found = model.project(there, estimate(model, there, moved).values, ground)
    np.testing.assert_allclose(found - [1000.0, -500.0], expected, atol=1e-3)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "none"])
def test_the_unit_of_the_image_does_not_matter(name, image):
    """Pixels of half the size: twice the numbers."""
    model, rpc = SINGLE_IMAGE_MODELS[name], image.rpc
    finer = replace(
        rpc, samp_off=2 * rpc.samp_off, line_off=2 * rpc.line_off, samp_scale=2 * rpc.samp_scale,
        line_scale=2 * rpc.line_scale,
    )  # fmt: skip
    here, there = Image("image", rpc), Image("image", finer)
    control = simulated_control(SINGLE_IMAGE_MODELS["affine"], here, np.array([5.0, 1e-3, 0.0, -3.0, 0.0, 5e-4]), 20)
    scaled = replace(control, xy=2.0 * control.xy, sigma_px=2.0 * control.sigma_px)
    ground = blocks.ground(50, 9)
    expected = model.project(here, estimate(model, here, control).values, ground)
    found = model.project(there, estimate(model, there, scaled).values, ground)
    np.testing.assert_allclose(found / 2.0, expected, atol=1e-3)


@pytest.mark.parametrize("name", ["shift", "affine"])
def test_sigmas_of_parameters_follow_from_the_residuals(name, image):
    """Sigmas given a third of what they are, or three times: sigma0 tells, and the parameters are as good as before."""
    control = simulated_control(SINGLE_IMAGE_MODELS[name], image, values_of(SINGLE_IMAGE_MODELS[name], image), 20)
    given = estimate(SINGLE_IMAGE_MODELS[name], image, control)
    for factor in (1.0 / 3.0, 3.0):
        other = replace(control, sigma_px=factor * control.sigma_px, sigma_m=factor * control.sigma_m)
        found = estimate(SINGLE_IMAGE_MODELS[name], image, other)
        assert found.sigma0 == pytest.approx(given.sigma0 / factor, rel=1e-3)
        np.testing.assert_allclose(found.sigmas, given.sigmas, rtol=1e-3)  # the priors are loose


def test_priors_of_drift_say_what_it_may_be_at_the_edge_of_the_image():
    """A drift of 1e-4 px/px over 2000 px from the middle are 0.2 px there, whatever the degree of its monomial."""
    model = SINGLE_IMAGE_MODELS["quadratic"]
    image = Image("image", blocks.oblique_rpc(0.0, 0.0), (4001, 3001))
    sigma = model.prior_sigmas(image, Priors(shift_px=7.0, drift=1e-4))
    corner = image.rpc.localize(np.array([[4000.0, 1500.0 + 2000.0]]), blocks.HEIGHT).ground  # u = v = 2000
    reach = [
        np.abs(model.project(image, np.eye(len(sigma))[k] * value, corner) - image.rpc.project(corner)).max()
        for k, value in enumerate(sigma)
    ]
    expected = [7.0 if name.endswith("_0") else 0.2 for name in model.parameters]
    np.testing.assert_allclose(reach, expected, rtol=1e-3)


@pytest.mark.parametrize("name", ["shift", "affine", "quadratic", "ground-linear", "generic-affine", "object-affine"])
def test_residuals_of_points_left_out_are_those_of_leaving_them_out(name, image):
    model = SINGLE_IMAGE_MODELS[name]
    control = simulated_control(model, image, values_of(model, image), 15)
    found = estimate(model, image, control)
    for index in range(0, 15, 4):
        without = estimate(model, image, control.select(np.arange(15) != index))
        left_out = control.xy[index] - model.project(image, without.values, control.ground[[index]])[0]
        np.testing.assert_allclose(found.left_out_px[index], left_out, atol=0.01)


# ---- direct methods ------------------------------------------------------------------------------------------------


def test_filter_and_batch_agree_where_the_problem_is_linear(image):
    """Point by point, in one step, and iterated: the same normal equations (small corrections are linear)."""
    control = simulated_control(SINGLE_IMAGE_MODELS["shift"], image, np.array([0.05, -0.03]), 20, 0.01)
    ground = blocks.ground(50, 10)
    results = [
        SINGLE_IMAGE_MODELS[n].project(image, estimate(SINGLE_IMAGE_MODELS[n], image, control).values, ground)
        for n in ("bils", "idkf", "slss")
    ]
    np.testing.assert_allclose(results[1], results[0], atol=1e-3)
    np.testing.assert_allclose(results[2], results[0], atol=1e-3)


def test_the_pseudo_sensor_of_a_line_scanner_is_at_its_height() -> None:
    """The rays of a line meet where the sensor was: within 5 %, for an RPC smooths them."""
    frame = compute_sensor_frame(Image("a", fit_rpc(*pushbroom_points(FIT.grid)).rpc, (20001, 20001)))
    np.testing.assert_allclose(frame.heights_m, 700e3, rtol=0.05)


def test_the_pseudo_sensor_of_parallel_rays_is_in_a_low_orbit() -> None:
    """Rays of an affine RPC meet nowhere: any height of satellites that have such cameras does."""
    rpc, one = synthetic_rpc(10.0, 0.0), np.eye(20)
    affine = replace(rpc, samp_num=one[1] + 0.1 * one[3], line_num=-one[2], samp_den=one[0], line_den=one[0])
    assert all(300e3 < height < 1000e3 for height in compute_sensor_frame(Image("a", affine, (10800, 11000))).heights_m)
