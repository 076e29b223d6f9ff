"""Blunders by the dozen, and GCPs that are wrong together; `benchmarks/blunders.py` has the long study."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.benchmarks.adjust_speed import visible_sigmas
from hrsi.hrsi_engine.adjustment import AdjustOptions, Decision, adjust
from hrsi.hrsi_engine.adjustment.blunders.discrepancies import compute_discrepancies
from hrsi.hrsi_engine.adjustment.preparation.preparation import prepare_problem
from hrsi.hrsi_engine.adjustment.solver import Adjuster
from hrsi.hrsi_engine.adjustment.starting_values.consensus import (
    Parallaxes,
    _compute_parallaxes,
    _fit_planes,
    _measure_departures,
)
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import GroundPoints, ImagePoints, Role
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m

TESTED = AdjustOptions(reject_sigma=4.0)


def with_wrong_ties(block, share, size_px, seed):
    """Return the block with a share of its tie measurements moved in any direction, their rows and errors."""
    rng = np.random.default_rng(seed)
    ties = np.flatnonzero(block.points.role[block.measurements.point] == Role.TIE)
    rows = rng.choice(ties, round(share * len(ties)), replace=False)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(rows))
    error = size_px * np.column_stack([np.cos(angle), np.sin(angle)])
    return blocks.move_measurements(block, rows, error), rows, error


@pytest.mark.parametrize(
    ("images", "share", "least"),
    mark_beyond(1, "thorough", [(2, 0.3, 0.95), (3, 0.3, 0.95), (3, 0.4, 0.9), (4, 0.4, 0.9)]),
)
def test_ties_wrong_by_the_dozen(images, share, least):
    """RPCs tens of pixels off, errors of 30 px: no start from all measurements finds its way here."""
    found, shown, alarms, right = 0, 0, 0, 0
    for seed in range(2):
        block, truth, _ = blocks.block(8, 60, 300, count=images, seed=seed, bias_px=40.0, drift=2e-5)
        clean = adjust(block, TESTED)
        bad, rows, error = with_wrong_ties(block, share, 30.0, seed)
        result = adjust(bad, TESTED)
        out = result.decision != Decision.KEPT
        visible = visible_sigmas(bad, clean, rows, error) > 10.0
        found, shown = found + out[rows][visible].sum(), shown + visible.sum()
        touched = np.isin(bad.measurements.point, bad.measurements.point[rows])
        alarms, right = alarms + out[~touched].sum(), right + (~touched).sum()
        assert not result.findings  # no GCP is wrong
        assert np.all(blocks.check_rmse_m(truth, result) < 1.05 * blocks.check_rmse_m(truth, clean))
    assert found >= least * shown
    assert alarms <= 0.001 * right


@pytest.mark.parametrize("seed", mark_beyond(1, "thorough", range(4)))
def test_two_wrong_heights_do_not_hide_each_other(seed):
    block, _, _ = blocks.block(gcps=6, checks=0, ties=100, seed=seed, drift=2e-5)
    result = adjust(blocks.move_surveys(block, [1, 4], [0.0, 0.0, 25.0]), TESTED)
    assert {(finding.id, finding.what, finding.left_out) for finding in result.findings} == {
        ("P0001", "height", True), ("P0004", "height", True)
    }  # fmt: skip
    for finding in result.findings:
        assert finding.unit == "m"
        assert finding.size == pytest.approx(25.0, abs=2.0)  # four sigmas of the height of three rays
        assert "too high" in finding.message


def test_a_group_of_gcps_that_agree_on_another_datum_is_named():
    block, _, _ = blocks.block(gcps=15, checks=0, ties=100, drift=2e-5)
    wrong = [0, 2, 5, 9, 13]
    result = adjust(blocks.move_surveys(block, wrong, [0.0, 0.0, -30.0]), TESTED)
    assert {finding.id for finding in result.findings if finding.left_out} == {f"P{k:04d}" for k in wrong}


def test_of_two_halves_nobody_can_tell_which_is_wrong():
    block, _, _ = blocks.block(gcps=6, checks=0, ties=100, drift=2e-5)
    result = adjust(blocks.move_surveys(block, [0, 2, 4], [0.0, 0.0, 40.0]), TESTED)
    (finding,) = result.findings
    assert not finding.left_out
    halves = [{"P0000", "P0002", "P0004"}, {"P0001", "P0003", "P0005"}]
    assert set(finding.group) in halves
    assert set(finding.rivals) in halves
    assert set(finding.concerned) == halves[0] | halves[1]
    assert all(name in finding.message for name in finding.concerned)


@pytest.mark.coverage
def test_height_control_is_tested_as_such():
    """1000 m in plan lends the heights no credit, is no reason to accuse anybody, and hides no wrong height.

    Power (binomial, 10 trials, 9 to 10): 0.99 fails with 0.4 %, 0.60 with 95 %, for what is found;
    Power (binomial, 10 trials, 0 to 0): 0.001 fails with 1 %, 0.30 with 97 %, for what is accused.
    """
    accused, found = 0, 0
    for seed in range(10):
        block, _, _ = blocks.block(gcps=6, checks=0, ties=100, seed=seed, drift=2e-5)
        sigma = block.points.sigma_m.copy()
        sigma[:, 0] = 1000.0
        block = replace(block, points=replace(block.points, sigma_m=sigma))
        accused += len(adjust(block, TESTED).findings)
        result = adjust(blocks.move_surveys(block, [3], [0.0, 0.0, 25.0]), TESTED)
        found += [(finding.id, finding.what) for finding in result.findings] == [("P0003", "height")]
    assert accused == 0
    assert found >= 9


def test_leaving_out_by_cofactors_is_leaving_out():
    """What `Discrepancies` says of a group equals the fall of the cost of a new solution without it."""
    block, _, _ = blocks.block(gcps=6, checks=0, ties=60, drift=2e-5)
    rounds = Adjuster(prepare_problem(blocks.move_surveys(block, [1, 4], [0.3, -0.2, 0.5]), AdjustOptions()))
    solution = rounds.solve(None, silent)
    gcps = np.flatnonzero(rounds.problem.observations.surveyed)
    control = compute_discrepancies(rounds.problem, rounds.loop, solution, gcps)
    heights = np.flatnonzero(np.isin(control.point, [1, 4]) & (control.axis == 2))
    squares, dimensions = control.test_subset(heights)
    assert dimensions == 2
    rounds.survey_weight[gcps[[1, 4]], 2] = 0.0
    without = rounds.solve(solution, silent)
    # the loop ends at 1e-9 of the cost; the equations are linear to some 1e-6 over metres
    assert squares == pytest.approx(2.0 * (solution.cost - without.cost), rel=1e-4)
    errors = ground_difference_m(
        rounds.problem.observations.survey[gcps[[1, 4]]], without.state.ground[gcps[[1, 4]]]
    )[:, 2]  # fmt: skip
    np.testing.assert_allclose(control.estimate_errors(heights), errors, atol=1e-3)
    one_by_one = control.test_subset(heights[:1])[0] + control.exclude(heights[:1]).test_subset(
        np.flatnonzero((control.exclude(heights[:1]).point == 4) & (control.exclude(heights[:1]).axis == 2))
    )[0]  # fmt: skip
    assert one_by_one == pytest.approx(squares, rel=1e-9)


@pytest.mark.large
def test_many_wrong_gcps_cost_no_solution_each():
    """Of 60 GCPs each is compared with its neighbourhood; those left out are so by cofactors, all of them at once."""
    block, _, _ = blocks.block(gcps=60, checks=0, ties=200, drift=2e-5)
    clean = adjust(block, TESTED)
    wrong = [3, 11, 24, 25, 40, 57]
    lateral = blocks.move_surveys(block, wrong, np.repeat([[0.0, 0.0, 25.0], [-15.0, 10.0, 0.0]], 3, axis=0))
    result = adjust(lateral, TESTED)
    assert not clean.findings
    assert {finding.id: finding.what for finding in result.findings if finding.left_out} == {
        f"P{number:04d}": "height" if number < 25 else "ground" for number in wrong
    }
    assert result.solves <= clean.solves + 6  # one more run of the loop, and one that tells drifts from mistakes


def test_compute_parallaxes_on_one_diagonal_carry_a_level_and_no_plane():
    """Features in the corners of cells lie on diagonals; a plane through such three is not determined at all."""
    rng = np.random.default_rng(3)
    along = np.linspace(-0.9, 0.9, 30)
    terms = np.column_stack([np.ones(30), along, 0.125 - along])
    y = 7.0 + rng.normal(0.0, 0.1, 30)
    y[::4] += rng.uniform(20.0, 60.0, 8)
    three = np.random.default_rng(1).integers(0, 30, (1, 80, 3))
    surest = np.array([8])  # three tenths of thirty, counted from zero
    (plane,) = _fit_planes(three, terms[None], y[None], np.full((1, 30), 0.1), surest)
    right = np.arange(30) % 4 > 0
    assert np.abs(y - terms @ plane)[right].max() < 0.5  # five sigmas of 0.1


def test_departures_are_in_sigmas_from_the_plane_of_the_image_pair():
    """Three image pairs in any order, each with a plane of its own, a third of the parallaxes wrong."""
    rng = np.random.default_rng(12)
    rows = np.arange(1200).reshape(-1, 2)
    image = np.repeat([[0, 1], [2, 0], [1, 2]], 200, axis=0).ravel()  # of the second pair the larger one comes first
    observations = SimpleNamespace(image=image, images=range(3), places=rng.uniform(-1.0, 1.0, (1200, 2)))
    on_first = np.where(image[rows[:, 0]] < image[rows[:, 1]], rows[:, 0], rows[:, 1])
    planes = np.repeat(rng.normal(0.0, 20.0, (3, 3)), 200, axis=0)
    sigma, wrong = rng.uniform(0.1, 0.8, 600), rng.uniform(size=600) < 1.0 / 3.0
    y = np.einsum("nc,nc->n", planes, np.column_stack([np.ones(600), observations.places[on_first]]))
    y += rng.normal(0.0, sigma) + np.where(wrong, rng.choice([-1.0, 1.0], 600) * rng.uniform(30.0, 60.0, 600), 0.0)
    shuffled = rng.permutation(600)
    pairs = Parallaxes(rows[shuffled, 0], rows[shuffled, 1], y[shuffled], sigma[shuffled])
    departure, judged = _measure_departures(observations, pairs)
    assert judged.all()
    right = ~wrong[shuffled]
    # normal, and the plane through three of the parallaxes is off by as much again at most
    assert 0.6745 * 0.8 < np.median(np.abs(departure[right])) < 0.6745 * 1.5
    assert np.abs(departure[right]).max() < 8.0
    assert np.abs(departure[~right]).min() > 25.0 / 0.8


def test_departures_of_few_parallaxes_are_those_from_their_level():
    """Forty image pairs with six parallaxes each, about 50 px and alike, but for the last of each, 30 px away."""
    rng = np.random.default_rng(13)
    rows = np.arange(480).reshape(-1, 2)
    image = np.repeat(np.arange(80).reshape(-1, 2), 6, axis=0).ravel()
    observations = SimpleNamespace(image=image, images=range(80), places=rng.uniform(-1.0, 1.0, (480, 2)))
    y, wrong = 50.0 + rng.normal(0.0, 0.2, 240), np.arange(240) % 6 == 5
    pairs = Parallaxes(rows[:, 0], rows[:, 1], y + 30.0 * wrong, np.full(240, 0.2))
    departure, _ = _measure_departures(observations, pairs)
    assert np.abs(departure[~wrong]).max() < 6.0
    assert np.abs(departure[wrong] - 150.0).max() < 6.0


def test_an_image_that_was_delivered_twice_does_not_stop_the_others():
    """The rays of the two are parallel: there is no epipolar line between them, but there is with the other image."""
    cameras = blocks.images(2)
    cameras.append(replace(cameras[0], id="twin"))
    truth, rng = blocks.ground(80, 5), np.random.default_rng(4)
    ids = [f"P{k:04d}" for k in range(80)]
    measured = [
        ImagePoints(ids, [image.id] * 80, image.rpc.project(truth) + rng.normal(0.0, 0.3, (80, 2)), 0.3)
        for image in cameras
    ]
    role = np.repeat([Role.GCP, Role.CHECK], [6, 10])
    control = GroundPoints(ids[:16], truth[:16], role, 0.1)
    problem = prepare_problem(assemble(cameras, [control], measured), TESTED)
    observations = problem.observations
    pairs = _compute_parallaxes(
        problem.equations, observations, problem.start, np.flatnonzero(observations.contributing_points)
    )
    assert np.isfinite(pairs.y).all() and len(pairs.y) == 140  # with the other image only: twice 70 points
    without, result = (adjust(assemble(cameras[:n], [control], measured[:n]), TESTED) for n in (2, 3))
    assert result.status == "converged" and not result.findings
    assert (result.decision == Decision.KEPT).all()
    assert np.all(blocks.check_rmse_m(truth, result) < 1.1 * blocks.check_rmse_m(truth, without))
