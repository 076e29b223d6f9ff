"""Predicted accuracies hold: with the defaults as in `benchmarks/sigma_coverage.py`, and by RPCs' own error terms."""

from dataclasses import replace

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.benchmarks.sigma_coverage import CONFIGURATIONS, run
from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.statistics.precision import CIRCLE_90, LINE_90
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m

SEEDS = range(100, 108)
#: Shares of single blocks scatter by up to 0.08 about 0.9 (docs/protocols/coverage.md), the mean of eight by 0.03.
LEAST, MOST = 0.81, 0.99


@pytest.mark.parametrize(
    "name",
    [
        "QuickBird, 3 images, 6 GCPs",  # drifts that a shift does not follow
        pytest.param(
            "Pleiades, 3 images, 10 GCPs stated 5 x too small", marks=pytest.mark.coverage
        ),  # 0.2 with the sigmas as stated
    ],
)
def test_nine_of_ten_check_errors_are_inside_ce90_and_le90(name):
    """Eight blocks, whose mean share is known to 0.03.

    Power (normal, 3.3 %, 0.81 to 0.99): 0.90 fails with 0.2 %, 0.75 with 99 %: a CE90 that is 22 % too small.
    """
    shares = run(CONFIGURATIONS[name], SEEDS)[:, :2].mean(axis=0)
    assert (shares > LEAST).all() and (shares < MOST).all()


ERR_BIAS_M = 4.0  # pixels of one metre


@pytest.mark.coverage
def test_stated_ce90_and_le90_hold_at_their_rate_over_100_seeds():
    """Biases of the images are drawn from ERR_BIAS; sigmas of the image points are given three times too large.

    Power (binomial, 100 trials, 82 to 97): 0.90 fails with 0.6 %, 0.73 with 98 %: a CE90 that is 25 % too small;
    Power (chi², 100 values, 0.8 to 1.2): 1.00 fails with 0.5 %, 1.40 with 98 %.
    """
    inside_circle, inside_line, scaled = [], [], []
    for seed in range(100):
        block, truth, _ = blocks.block(gcps=0, checks=0, ties=30, seed=seed, bias_px=ERR_BIAS_M, drift=0.0)
        images = tuple(replace(image, rpc=replace(image.rpc, err_bias=ERR_BIAS_M)) for image in block.images)
        sigma = np.full(len(block.measurements), 0.9)
        result = adjust(
            replace(block, images=images, measurements=replace(block.measurements, sigma_px=sigma)),
            AdjustOptions(test_sigmas=False),
        )
        east, north, height = result.parts[0].sigma_m
        error = ground_difference_m(result.ground, truth).mean(axis=0)
        inside_circle.append(np.hypot(*error[:2]) <= CIRCLE_90 * np.hypot(east, north))
        inside_line.append(abs(error[2]) <= LINE_90 * height)
        scaled.append(error / [east, north, height])
    rates = np.mean(inside_circle), np.mean(inside_line)
    # binomial, 100 trials at 90 %: 82 to 97 with 99 %
    assert all(0.82 <= rate <= 0.97 for rate in rates)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(scaled), axis=0)), 1.0, atol=0.2)
