"""Drifts that move all images of a block alike: which they are, and that ties without GCPs do not estimate them."""

import re
from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine import judge
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.preparation.preparation import prepare_problem
from hrsi.hrsi_engine.block.block import Block
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground

AFFINE, SHIFT = AdjustOptions(model="affine"), AdjustOptions(model="shift")


def free_block(**changes) -> Block:
    return blocks.block(**{"gcps": 0, "checks": 0, "ties": 60, "drift": 0.0, "bias_px": 2.0} | changes)[0]


def remeasure(block: Block, error) -> Block:
    """Return the block with ``error(image number, xy)`` added to its measurements."""
    rows, xy = block.measurements, block.measurements.xy.copy()
    for index in range(len(block.images)):
        here = rows.image == index
        xy[here] += error(index, xy[here])
    return replace(block, measurements=replace(rows, xy=xy))


@pytest.mark.parametrize(("model", "modes"), [("affine", 6), ("shift", 6), ("object-affine", 6), ("quadratic", 15)])
def test_as_many_as_deformations_of_the_ground(model, modes):
    """Of first degree in plan there are six (with tilts of the heights), of second degree nine more."""
    (common,) = prepare_problem(free_block(), replace(AFFINE, model=model)).common
    np.testing.assert_allclose(common.basis.T @ common.basis, np.eye(common.basis.shape[1]), atol=1e-9)
    assert common.basis.shape[1] == modes


def test_none_where_gcps_or_a_fixed_image_hold_the_block():
    assert not prepare_problem(free_block(gcps=1), AFFINE).common
    assert not prepare_problem(free_block(), replace(AFFINE, fixed_images=("image0",))).common


def test_the_prior_is_what_its_cost_says():
    """The equations that it adds are the derivatives of its cost, and its largest weights hold what F lets go."""
    problem = prepare_problem(free_block(), AFFINE)
    common = problem.common[0].balance_with(np.full(len(problem.common[0].prior_sigma), 10.0), 2.0)
    loop = problem.loop()
    values = np.random.default_rng(3).normal(0.0, 3e-5, problem.prior_weight.shape)
    bare = loop.equations.form_normals(problem.start, problem.weighting.image, problem.weighting.points,
                                       problem.weighting.contributes)  # fmt: skip
    before = bare.blocks.copy(), bare.right.copy()
    common.add_to(bare, values, problem.pattern)
    gradient = np.zeros_like(values)
    for place in np.ndindex(*values.shape):
        step = np.zeros_like(values)
        step[place] = 1e-6
        gradient[place] = (common.compute_cost(values + step) - common.compute_cost(values - step)) / 2e-6
    np.testing.assert_allclose(before[1] - bare.right, gradient, rtol=1e-6, atol=1e-3)
    own = (bare.blocks - before[0])[problem.pattern.diagonal[0]]
    assert 0.5 * values[0] @ own @ values[0] == pytest.approx(
        common.compute_cost(np.where(np.arange(len(values))[:, None] == 0, values, 0.0)), rel=1e-9
    )
    np.testing.assert_allclose(common.weight / common.points_per_error, 2.0 * 0.99 * np.eye(6), atol=1e-9)


def test_a_common_drift_is_not_estimated_but_differences_are():
    """All images see the ground 1e-3 larger: ties cannot tell. One image turned by 1e-3: they can."""
    block = free_block(noise_px=0.1)
    middle = np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(block.points.ids), 1))
    _, truth, _ = blocks.block(gcps=0, checks=0, ties=60, drift=0.0, bias_px=2.0)
    away = ground_difference_m(truth, middle) * [1e-3, 1e-3, 0.0]
    larger = move_ground(truth, away)
    scaled = remeasure(
        block,
        lambda index, xy: (block.images[index].rpc.project(larger) - block.images[index].rpc.project(truth))[
            block.measurements.point[block.measurements.image == index]
        ],
    )
    common = adjust(scaled, AFFINE)
    drifts = common.model.drifts
    assert np.abs(common.values[:, drifts]).max() < 5e-5
    assert "drift-implausible" not in {reason.code for reason in judge(common).reasons}

    def turn(index: int, xy: np.ndarray) -> np.ndarray:
        return (index == 1) * 1e-3 * (xy - 2000.0)[:, ::-1] * [-1.0, 1.0]

    turned = remeasure(block, turn)
    found = adjust(turned, AFFINE)
    ties_px = np.sqrt(np.nanmean(np.sum(found.residual_px**2, axis=1)))
    assert ties_px < 0.2
    reasons = {reason.code: reason for reason in judge(found).reasons}
    # the sensor's 3e-5 and the estimate's own standard deviation together
    sigma = re.search(r"times the standard deviation \((.*?)\)", reasons["drift-implausible"].message)
    assert sigma and 3e-5 < float(sigma[1]) < 5e-5
    shown = adjust(remeasure(free_block(gcps=6, noise_px=0.1), turn), AFFINE)
    assert "drift-implausible" not in {reason.code for reason in judge(shown).reasons}


def test_ties_that_err_alike_count_by_patches():
    """Ties of dense matching with errors of 0.15 px that patches of 300 px share: the affine model tilts nothing."""
    rng = np.random.default_rng(8)
    block = free_block(ties=1500, noise_px=0.05, count=4)
    error = rng.normal(0.0, 0.15, (4, 14, 14, 2))

    def patches(index: int, xy: np.ndarray) -> np.ndarray:
        column, row = np.floor(xy / 300.0).astype(int).T
        return error[index, row, column]

    alike = remeasure(block, patches)
    by_model = [adjust(alike, options) for options in (AFFINE, SHIFT)]
    apart = ground_difference_m(by_model[0].ground, by_model[1].ground)
    assert np.nanmax(np.abs(apart)) < 0.3
    # the patches' errors are three times the standard deviation that is stated, which is told; of the drifts nothing is
    assert {reason.code for reason in judge(by_model[0]).reasons} == {"sigmas-implausible"}
