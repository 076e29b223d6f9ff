"""Held-out ties: chosen evenly and alike in every run, without a say in the cameras; their figures by other code."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import simulated_blocks
from scipy.optimize import least_squares

from hrsi.hrsi_engine import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.hold_out import HOLD_OUT, hold_out_ties
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, ImagePoints, Role
from hrsi.hrsi_engine.foundation.thresholds import SAMPLES
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.results import figures
from hrsi.hrsi_engine.results.figures import summarise_held_out


def make_block(ties: int, seed: int = 1) -> Block:
    return simulated_blocks.block(8, 5, ties, seed=seed, noise_px=0.2)[0]


def held(block: Block) -> np.ndarray:
    return block.points.role == Role.HELD_OUT


def test_a_tenth_of_every_part_of_the_images() -> None:
    block = hold_out_ties(make_block(2000), 0.1)
    assert held(block).sum() == 200 and not (block.known & held(block)).any()
    assert (held(hold_out_ties(make_block(2000), 0.1)) == held(block)).all()
    # Quarters of the first image: a tenth, give or take one for each of their columns of cells, where counting goes on
    rows = block.measurements
    first = (rows.image == 0) & ~block.known[rows.point]
    quarter = 2 * (rows.xy[first, 0] > 2000) + (rows.xy[first, 1] > 2000)
    counts = np.bincount(quarter), np.bincount(quarter, held(block)[rows.point[first]])
    assert counts[1] == pytest.approx(0.1 * counts[0], abs=4.0)


def test_small_blocks_keep_all_and_what_was_held_out_stays_so() -> None:
    small = make_block(HOLD_OUT.fewest_tracks)
    assert hold_out_ties(small, 0.1) is small
    block = hold_out_ties(make_block(600), 0.1)
    assert hold_out_ties(block, 0.3) is block
    assert not held(hold_out_ties(block, 0.0)).any()


def test_a_pair_keeps_its_links() -> None:
    """A fourth image hangs on nine tracks of 600: at most one of them may go, and no fewer than eight stay."""
    block = make_block(600)
    rows = block.measurements
    tie = np.flatnonzero(block.points.role == Role.TIE)
    fourth = simulated_blocks.images(4)
    for shared in (1, 5, 9, 200):
        chosen = tie[:: len(tie) // shared][:shared]
        truth = adjust(block, AdjustOptions(model="shift")).ground[chosen]
        measured = [
            ImagePoints(block.points.ids[rows.point], [block.images[k].id for k in rows.image], rows.xy, 0.2),
            ImagePoints(block.points.ids[chosen], [fourth[3].id] * shared, fourth[3].rpc.project(truth), 0.2),
        ]
        made = hold_out_ties(assemble(fourth, [block.points.select(block.known)], measured), 0.1)
        seen = np.unique(made.measurements.point[made.measurements.image == 3])
        kept = (~held(made)[seen]).sum()
        assert held(made).sum() >= 50
        assert kept >= min(shared, SAMPLES.tested) and kept >= 0.5 * shared


def test_cameras_are_those_of_the_others_alone() -> None:
    block = hold_out_ties(make_block(700), 0.1)
    kept = block.with_measurements(~held(block)[block.measurements.point])
    options = AdjustOptions(model="affine")
    result, alone = adjust(block, options), adjust(kept, options)
    np.testing.assert_allclose(result.values, alone.values, rtol=0, atol=1e-9)
    assert (result.observations, result.redundancy) == (alone.observations, pytest.approx(alone.redundancy))
    assert np.isfinite(result.ground[held(block)]).all()  # they ride along


def test_figures_by_other_code() -> None:
    """Positions by SciPy, epipolar lines by localizing each image point at two heights; three wrong matches apart."""
    block = hold_out_ties(make_block(700, seed=4), 0.1)
    rows = block.measurements
    wrong = np.flatnonzero(held(block))[[3, 30, 55]]
    for number in wrong:
        rows.xy[np.flatnonzero(rows.point == number)[0]] += [7.0, 9.0]
    result = adjust(block, AdjustOptions(model="affine"))
    refined = [result.model.compute_refined_rpc(*pair) for pair in zip(block.images, result.values, strict=True)]
    entry = summarise_held_out(result, refined)
    squares, distances = [], []
    for number in np.setdiff1d(np.flatnonzero(held(block)), wrong):
        here = np.flatnonzero(rows.point == number)
        cameras = [refined[k].rpc for k in rows.image[here]]
        start = result.ground[number]

        def miss(step: np.ndarray, cameras=cameras, here=here, start=start) -> np.ndarray:
            place = move_ground(start[None], step[None])
            return np.concatenate([xy - one.project(place)[0] for one, xy in zip(cameras, rows.xy[here], strict=True)])

        residual = miss(least_squares(miss, np.zeros(3), xtol=1e-14).x).reshape(-1, 2)
        squares += np.sum(residual**2, axis=1).tolist()
        for i, j in combinations(range(len(here)), 2):
            for a, b in ((i, j), (j, i)):
                ray = [cameras[a].localize(rows.xy[here[a]][None], start[2] + up).ground for up in (-50.0, 50.0)]
                one, two = (cameras[b].project(ground)[0] for ground in ray)
                along = (two - one) / np.linalg.norm(two - one)
                off = rows.xy[here[b]] - one
                distances.append(off[0] * along[1] - off[1] * along[0])
    assert entry["points"] == 67 and entry["wrong"] == 3
    assert entry["observations"] == len(squares) == 201
    assert entry["rmse_px"] == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-4)
    # the line's curvature over 100 m of height, and where on it a ray's foot lies
    assert entry["epipolar_rmse_px"] == pytest.approx(np.sqrt(np.mean(np.square(distances))), rel=2e-3)
    # 0.2 px a coordinate; three rays leave 3 of 6 free; two lines that differ by the noise of both
    assert entry["rmse_px"] == pytest.approx(0.2 * np.sqrt(2.0 * 3.0 / 6.0), rel=0.15)
    assert entry["ties"]["rmse_px"] == pytest.approx(entry["rmse_px"], rel=0.15)


def test_of_many_an_even_sample_is_evaluated(monkeypatch: pytest.MonkeyPatch) -> None:
    """The RMSE of a sample of k of 300 tracks differs from that of all by its standard deviation at most, a few times.

    Three rays leave three redundant coordinates: the relative standard deviation of an RMSE is 1 / sqrt(2 * 3 k).
    """
    block = hold_out_ties(make_block(3000, seed=7), 0.1)
    result = adjust(block, AdjustOptions(model="affine"))
    refined = [result.model.compute_refined_rpc(*pair) for pair in zip(block.images, result.values, strict=True)]
    complete = summarise_held_out(result, refined)
    monkeypatch.setattr(figures, "HOLD_OUT", replace(HOLD_OUT, most_evaluated=100))
    sample = summarise_held_out(result, refined)
    assert complete["points"] == complete["tracks"] == sample["tracks"] == 300
    assert sample["points"] + sample["wrong"] == sample["ties"]["points"] + sample["ties"]["wrong"] == 100
    for part, whole in ((sample, complete), (sample["ties"], complete["ties"])):
        assert part["rmse_px"] == pytest.approx(whole["rmse_px"], rel=3.5 / np.sqrt(600.0))
        assert part["epipolar_rmse_px"] == pytest.approx(whole["epipolar_rmse_px"], rel=3.5 / np.sqrt(600.0))
