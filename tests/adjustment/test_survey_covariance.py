"""GCPs with a covariance of their own: against dense least squares, transformed axes, and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from dense_adjustment import dense_solution
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import GroundPoints, ImagePoints, Role
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.refinement import MODELS


def random_covariances(count: int, seed: int) -> np.ndarray:
    """Return covariances with sigmas of 0.05 to 1 m along axes of any direction, ``(count, 3, 3)``."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    sigma = np.exp(rng.uniform(np.log(0.05), np.log(1.0), (count, 3)))
    return (axes * sigma[:, None, :] ** 2) @ axes.swapaxes(1, 2)


def with_covariances(block, covariance):
    """Return the block with covariances of its GCPs, which come first."""
    every = np.full((len(block.points), 3, 3), np.nan)
    every[: len(covariance)] = covariance
    return replace(block, points=replace(block.points, covariance_m2=every))


CASES = mark_beyond(2, "thorough", [("affine", "0"), ("affine", "1"), ("shift", "0"), ("generic-shift", "0")])


@pytest.mark.parametrize(("name", "compiled"), CASES)
def test_equals_dense_least_squares(name, compiled, monkeypatch):
    monkeypatch.setenv("HRSI_COMPILED", compiled)
    block, _, _ = blocks.block(gcps=6, checks=0, ties=15, noise_m=0.2)
    block = with_covariances(block, random_covariances(6, 3))
    result = adjust(
        block, AdjustOptions(test_sigmas=False, model=name, reject_sigma=0.0)
    )  # the dense solution leaves nothing out
    dense = dense_solution(block, MODELS[name])
    assert np.abs((result.values - dense.values) / result.values_sigma).max() < 1e-4
    assert np.abs(ground_difference_m(dense.ground, result.ground)).max() < 1e-4  # a tenth of a millimetre
    np.testing.assert_allclose(result.values_sigma, max(result.sigma0, 1.0) * np.sqrt(dense.values_cofactor), rtol=1e-5)
    np.testing.assert_allclose(result.ground_sigma_m, dense.ground_sigma_m(max(result.sigma0, 1.0)), rtol=1e-5)


def test_an_infinite_variance_leaves_the_other_coordinates_their_own_sigmas():
    block, _, _ = blocks.block(gcps=6, checks=4, ties=20)
    covariance = np.tile(np.diag([0.04, 0.09, np.inf]), (6, 1, 1))
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.03
    result = adjust(with_covariances(block, covariance), AdjustOptions(test_sigmas=False))
    moved = blocks.move_surveys(block, np.arange(6), [0.0, 0.0, 50.0])  # a height that is not surveyed has no say
    again = adjust(with_covariances(moved, covariance), AdjustOptions(test_sigmas=False))
    np.testing.assert_allclose(result.values, again.values, atol=1e-5)
    taking_part = (block.points.role != Role.CHECK)[block.measurements.point].sum()
    assert result.observations == 2 * taking_part + 12


@pytest.mark.thorough
def test_correlations_bring_the_residuals_to_their_share():
    """Survey errors drawn from the covariances: misses weighted with them are chi² with the right redundancy."""
    sigma0 = []
    covariance = random_covariances(12, 9) * 25.0
    root = np.linalg.cholesky(covariance)
    for seed in range(30):
        block, truth, _ = blocks.block(gcps=12, checks=0, ties=10, seed=seed, noise_m=1e-6)
        error = np.einsum("kij,kj->ki", root, np.random.default_rng(seed + 300).normal(size=(12, 3)))
        ground = block.points.ground.copy()
        ground[:12] = move_ground(truth[:12], error)
        made = with_covariances(replace(block, points=replace(block.points, ground=ground)), covariance)
        sigma0.append(adjust(made, AdjustOptions(test_sigmas=False, model="affine")).sigma0 ** 2)
    # 30 x about 70 degrees of freedom: a variance factor known to 3 %
    assert np.mean(sigma0) == pytest.approx(1.0, abs=0.1)
    one_metre = np.full((len(made.points), 2), 1.0)
    ignored = replace(made, points=replace(made.points, covariance_m2=None, sigma_m=one_metre))
    assert adjust(ignored, AdjustOptions(test_sigmas=False, model="affine")).sigma0 ** 2 > 1.5  # the test can fail


def test_cross_validation_and_tests_take_correlated_surveys():
    block, _, _ = blocks.block(gcps=8, checks=0, ties=30, noise_m=0.1)
    covariance = np.tile(np.array([[0.04, 0.03, 0.0], [0.03, 0.04, 0.01], [0.0, 0.01, 0.09]]), (8, 1, 1))
    bad = with_covariances(blocks.move_surveys(block, 2, [25.0, -10.0, 0.0]), covariance)
    result = adjust(bad, AdjustOptions(test_sigmas=False, reject_sigma=4.0, cross_validate=True, model="affine"))
    assert [(finding.id, finding.what, finding.left_out) for finding in result.findings] == [("P0002", "ground", True)]
    assert len(result.cross_validation.ids) == 7
    assert np.abs(result.cross_validation.error_m).max() < 3.0


@pytest.mark.thorough
def test_variance_components_of_correlated_surveys():
    """Covariances given a quarter of what they are come out scaled by 2, as a whole."""
    factors = []
    covariance = random_covariances(25, 5)
    root = np.linalg.cholesky(covariance)
    for seed in range(6):
        block, truth, _ = blocks.block(gcps=25, checks=0, ties=20, seed=seed, noise_px=0.05)
        error = 2.0 * np.einsum("kij,kj->ki", root, np.random.default_rng(seed + 80).normal(size=(25, 3)))
        ground = block.points.ground.copy()
        ground[:25] = move_ground(truth[:25], error)
        made = with_covariances(replace(block, points=replace(block.points, ground=ground)), covariance)
        result = adjust(made, AdjustOptions(test_sigmas=False, model="affine", variance_components=True))
        found = {part.group: part.factor for part in result.variance_components}
        factors.append(found["GCP covariances"])
    assert np.mean(factors) == pytest.approx(2.0, rel=0.1)  # 450 residuals: 3.5 %


def test_a_covariance_that_cannot_be_is_named():
    image = blocks.images(1)[0]
    truth = blocks.ground(4, 3)
    ids = [f"G{k}" for k in range(4)]
    covariance = np.tile(np.eye(3), (4, 1, 1))
    covariance[1, 0, 1] = covariance[1, 1, 0] = 0.9
    covariance[1, 0, 2] = covariance[1, 2, 0] = 0.9
    covariance[1, 1, 2] = covariance[1, 2, 1] = -0.9  # each is possible, all three are not
    known = GroundPoints(ids, truth, Role.GCP, covariance_m2=covariance)
    with pytest.raises(InputError, match="G1 has a covariance that is not positive definite"):
        assemble([image], [known], [ImagePoints(ids, [image.id] * 4, image.rpc.project(truth))])
