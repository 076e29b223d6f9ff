"""Blocks that only their RPCs hold: the RPCs' mean position, whatever the tie points seem to say of it."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.following import BlockUpdater
from hrsi.hrsi_engine.adjustment.outcome import assembly
from hrsi.hrsi_engine.adjustment.outcome.final_cameras import keep_rpc_position
from hrsi.hrsi_engine.adjustment.solver import run_adjuster
from hrsi.hrsi_engine.adjustment.statistics.precision import compute_precision
from hrsi.hrsi_engine.block.block import Block, Image
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, move_ground
from hrsi.hrsi_engine.refinement.model import select_priors

ALIKE_PX, PATCH_PX = 0.4, 300.0
FREE = AdjustOptions(model="shift")


@pytest.fixture(scope="module")
def free_block() -> Block:
    """Return a triplet whose tie points err alike within patches; its first image points worse than the others."""
    made = blocks.block(gcps=0, checks=0, ties=400, drift=3e-5, bias_px=2.0, noise_px=0.1)[0]
    first = replace(made.images[0], rpc=replace(made.images[0].rpc, err_bias=11.0))
    rng, xy = np.random.default_rng(8), made.measurements.xy.copy()
    for index in range(len(made.images)):
        here = made.measurements.image == index
        patch = np.unique(np.floor(xy[here] / PATCH_PX), axis=0, return_inverse=True)[1].ravel()
        xy[here] += rng.normal(0.0, ALIKE_PX, (patch.max() + 1, 2))[patch]
    return replace(made, images=(first, *made.images[1:]), measurements=replace(made.measurements, xy=xy))


def differentiate(image: Image) -> np.ndarray:
    """Return what the image's middle moves by when the ground moves east, north and up, ``(2, 3)`` px per m."""
    middle = np.array([[blocks.LON, blocks.LAT, blocks.HEIGHT]])
    moved = [image.rpc.project(move_ground(middle, step[None]))[0] for step in np.eye(3)]
    return np.stack(moved, axis=1) - image.rpc.project(middle).T


def find_translation_m(block: Block, shifts: np.ndarray) -> np.ndarray:
    """Return the translation of the ground that shifts ``(images, 2)`` amount to, by their weighted least squares."""
    sigma = np.array([select_priors(image, False).shift_px for image in block.images])[:, None]
    design = np.concatenate([differentiate(image) / one for image, one in zip(block.images, sigma, strict=True)])
    return np.linalg.lstsq(design, (shifts / sigma).ravel(), rcond=None)[0]


def test_the_corrections_are_the_smallest_that_a_translation_allows(free_block, monkeypatch):
    kept = adjust(free_block, FREE)
    monkeypatch.setattr(assembly, "keep_rpc_position", lambda problem, loop, solution, precise: (solution, precise))
    by_ties = adjust(free_block, FREE)
    before, after = (find_translation_m(free_block, one.cameras.values[:, :2]) for one in (by_ties, kept))
    assert np.linalg.norm(before) > 0.02  # or the block is not one that tests anything
    assert np.linalg.norm(after) < 1e-3
    moved = ground_difference_m(kept.ground, by_ties.ground)
    np.testing.assert_allclose(moved, np.broadcast_to(before, moved.shape), atol=0.02 * np.linalg.norm(before))
    # a translation of all of it: shape and residuals stay
    assert np.abs(moved - moved.mean(axis=0)).max() < 1e-3
    assert np.abs(kept.residual_px - by_ties.residual_px).max() < 1e-4


def test_equals_a_dense_constrained_solution(free_block):
    """Values and covariance of all cameras, by the inverse of the equations bordered with "no translation"."""
    _, adjuster = run_adjuster(free_block, FREE)
    problem, loop, solution = adjuster.problem, adjuster.loop, adjuster.solution
    precise = compute_precision(loop, solution)
    moved, more_precise = keep_rpc_position(problem, loop, solution, precise)
    p, k = loop.pattern.parameters, loop.pattern.cameras
    normal = np.diag(loop.prior_weight.ravel())
    for block, row, column in zip(solution.normals.blocks, loop.pattern.rows, loop.pattern.columns, strict=True):
        normal[row * p : row * p + p, column * p : column * p + p] += block
        if row != column:
            normal[column * p : column * p + p, row * p : row * p + p] += block.T
    border = np.zeros((k * p, 3))  # the normal equations of the translation by the shifts alone
    prior = np.zeros((3, 3))
    for place, image in enumerate(free_block.images):
        slope, weight = differentiate(image), loop.prior_weight[place, :2]
        border[place * p : place * p + 2] = weight[:, None] * slope
        prior += slope.T @ (weight[:, None] * slope)
    border = border @ np.linalg.inv(prior)
    whole = np.linalg.inv(np.block([[normal, border], [border.T, np.zeros((3, 3))]]))
    inner, gain = whole[: k * p, : k * p], whole[: k * p, k * p :]
    step = -gain @ (border.T @ solution.state.values.ravel())
    np.testing.assert_allclose(
        (moved.state.values - solution.state.values).ravel(), step, atol=1e-4 * np.abs(step).max()
    )
    covariance = inner + gain @ np.linalg.inv(prior) @ gain.T  # as uncertain as the RPCs
    for block, row, column in zip(more_precise.cameras, loop.pattern.rows, loop.pattern.columns, strict=True):
        expected = covariance[row * p : row * p + p, column * p : column * p + p]
        np.testing.assert_allclose(block, expected, rtol=2e-3, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(more_precise.parameters.ravel(), covariance.diagonal(), rtol=2e-3)
    # the points have the same: by their cameras, all of them
    spread = loop.equations.compute_cofactors(moved.state, moved.weight, moved.normals, more_precise.cameras)
    np.testing.assert_allclose(more_precise.points, spread.points, rtol=1e-3, atol=1e-4)


def test_the_position_does_not_depend_on_which_tie_points_there_are(free_block):
    first, second = (
        adjust(free_block.with_measurements(free_block.measurements.point % 2 == half), FREE) for half in (0, 1)
    )
    by_first, by_second = (find_translation_m(free_block, one.cameras.values[:, :2]) for one in (first, second))
    assert np.linalg.norm(by_first - by_second) < 0.01


@pytest.mark.parametrize("how", ["a GCP", "a fixed image", "tie points that tell"])
def test_what_something_else_holds_stays(free_block, how):
    block, options = free_block, FREE
    if how == "a GCP":
        block = blocks.block(gcps=1, checks=0, ties=40)[0]
    elif how == "a fixed image":
        options = replace(options, fixed_images=("image1",))
    else:  # pointing of 1 km, and cameras that do not drift: their directions tell the height
        options = replace(options, sigma_shift_px=1e5, sigma_drift=0.0)
    _, adjuster = run_adjuster(block, options)
    solution = adjuster.solution
    precise = compute_precision(adjuster.loop, solution)
    moved, same = keep_rpc_position(adjuster.problem, adjuster.loop, solution, precise)
    upwards = ground_difference_m(solution.state.ground, moved.state.ground)[:, 2]
    assert np.abs(upwards).max() < 1e-3
    np.testing.assert_allclose(same.points[:, 2, 2], precise.points[:, 2, 2], rtol=1e-6)


def test_an_adjustment_that_follows_edits_stays_there(free_block):
    """A point that is the same as before moves no camera."""
    follower = BlockUpdater(free_block, FREE)
    one = free_block.points.ids[free_block.measurements.point] == free_block.points.ids[5]
    update = follower.follow([str(free_block.points.ids[5])], free_block.with_measurements(one))
    np.testing.assert_allclose(update.values, follower.result.values, atol=1e-4)
