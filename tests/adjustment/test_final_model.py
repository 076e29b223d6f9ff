"""The model that is delivered: leave-one-out of the GCPs by that very model, against adjustments without each GCP."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.solver import find_judging_gcps, predict_left_out, run_adjuster
from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.refinement.selection import NESTED_MODELS

#: A drift of a known size, and no blunders: with and without a GCP the adjustment is the same.
KNOWN = AdjustOptions(sigma_drift=1e-4, test_sigmas=False, reject_sigma=0.0)


@pytest.mark.parametrize("asked", mark_beyond(1, "thorough", NESTED_MODELS))
def test_leave_one_out_is_what_adjustments_without_each_gcp_predict(asked):
    block, _, _ = blocks.block(gcps=6, checks=0, ties=20, drift=1e-4)
    _, adjuster = run_adjuster(block, replace(KNOWN, model=asked))
    gcps = find_judging_gcps(adjuster.problem, adjuster.solution, adjuster.survey_weight)
    control = adjuster.compute_control(adjuster.solution, gcps)
    squared, _ = predict_left_out(adjuster.problem, adjuster.loop, adjuster.solution, control)
    rows = block.measurements
    for name in NESTED_MODELS:
        for number, point in enumerate(np.flatnonzero(block.points.role == Role.GCP).tolist()):
            role = block.points.role.copy()
            role[point] = int(Role.CHECK)
            without = replace(block, points=replace(block.points, role=role))
            # the priors of `asked` hold: those of a drift that a model follows and of one that it does not are the same
            result = adjust(without, replace(KNOWN, model=name))
            here = rows.point == point
            errors = [
                xy
                - result.model.project(block.images[image], result.values[image], block.points.ground[point][None])[0]
                for xy, image in zip(rows.xy[here], rows.image[here], strict=True)
            ]
            # what a model takes over of the drift depends a little on where the point was measured
            assert squared[name][number] == pytest.approx(np.mean(np.sum(np.square(errors), axis=1)), rel=0.06)


def test_the_simplest_model_that_predicts_as_well_is_delivered_with_its_figures():
    """Without drift a shift; the same result as with the shift asked for. With a large drift an affine correction."""
    block, _, _ = blocks.block(gcps=10, checks=10, ties=30, drift=0.0)
    chosen, asked = adjust(block), adjust(block, AdjustOptions(model="shift"))
    assert chosen.model.name == chosen.choice.model == "shift"
    assert f"shift {chosen.choice.delivered['shift']:.3f} px" in chosen.choice.reason
    np.testing.assert_allclose(chosen.values, asked.values, rtol=0.02, atol=2e-3)
    np.testing.assert_allclose(chosen.ground_sigma_m, asked.ground_sigma_m, rtol=0.02)
    assert chosen.cameras.model.parameters == asked.cameras.model.parameters
    drifting, _, _ = blocks.block(gcps=10, checks=10, ties=30, drift=3e-4)
    chosen = adjust(drifting)
    assert chosen.model.name == "affine"
    assert chosen.choice.delivered["affine"] < chosen.choice.delivered["shift"]


def test_ties_that_show_a_drift_are_not_left_to_the_shift():
    """Three GCPs cannot tell; the ties can: no model that leaves them worse is delivered."""
    block, _, _ = blocks.block(gcps=3, checks=0, ties=80, drift=1e-4, noise_px=0.1)
    assert adjust(block).model.name == "affine"
