"""Readings of tie points on a few images of many: only the pairs with these images are looked at again."""

from dataclasses import replace

import numpy as np

from hrsi.benchmarks.adjust_speed import simulated
from hrsi.hrsi_engine.plausibility import ties
from hrsi.hrsi_engine.plausibility.accuracy import estimate_accuracies
from hrsi.hrsi_engine.plausibility.mistakes import PIXEL_MISTAKES

IMAGES, SLIPPED = 60, 7


def mistaken_pairs() -> ties.PairSample:
    """Return pairs of a block one of whose images has sample and line exchanged."""
    block = simulated(IMAGES)
    rows = block.measurements
    xy = np.where((rows.image == SLIPPED)[:, None], rows.xy[:, ::-1], rows.xy)
    block = replace(block, measurements=replace(rows, xy=xy))
    pairs = ties.sample_pairs(block, estimate_accuracies(block.images))
    assert pairs is not None
    return pairs


def test_readings_of_some_images_are_those_of_the_whole_block() -> None:
    pairs = mistaken_pairs()
    given = ties.check_pairs(pairs)
    suspects = ties._select_suspects(pairs, given, np.flatnonzero(given.good < ties.EQUALITY.majority))
    assert SLIPPED in suspects
    undo = dict(zip((slip for slip, _ in PIXEL_MISTAKES), (undo for _, undo in PIXEL_MISTAKES), strict=True))
    compared = 0
    for slip, images, share in ties._iterate_hypotheses(pairs, given, suspects):
        if slip in undo and slip.length == 1.0:  # a stretch would count for the tolerance of all others too
            assert share == ties.check_pairs(pairs, xy=ties._undo_pixel_mistake(pairs, undo[slip], images)).share
            compared += 1
    assert compared >= len(suspects)


def test_the_slip_of_one_image_among_many_is_named() -> None:
    pairs = mistaken_pairs()
    [reason] = ties.find_tie_reasons(pairs.block, pairs.accuracies)
    assert reason.code == "image-axes"
    assert reason.images == (pairs.block.images[SLIPPED].id,)


def test_of_pairs_that_fail_the_image_that_is_in_all_of_them_is_named() -> None:
    """An RPC far beside the others makes no neighbour suspicious."""
    block = simulated(IMAGES)
    images = list(block.images)
    images[SLIPPED] = replace(images[SLIPPED], rpc=images[SLIPPED].rpc.shift(3000.0, 2000.0))
    block = replace(block, images=tuple(images))
    [reason] = ties.find_tie_reasons(block, estimate_accuracies(block.images))
    assert reason.code == "ties-wrong"
    assert reason.images == (images[SLIPPED].id,)
    assert images[SLIPPED].id in reason.message


def test_both_images_of_a_pair_that_fails_by_itself_are_named() -> None:
    assert ties._select_common_images(np.array([[3, 1], [5, 6], [3, 8], [2, 3]])) == [3, 5, 6]
    assert ties._select_common_images(np.array([[0, 1], [1, 0]])) == [0, 1]
    assert ties._select_common_images(np.empty((0, 2), np.int64)) == []


def mode_of(values: np.ndarray, tolerance: float) -> float:
    """Return the middle of the longest run of finite values within twice the tolerance; the first of equal ones."""
    ordered = sorted(values[np.isfinite(values)].tolist())
    runs = [[other for other in ordered[k:] if other <= one + 2.0 * tolerance] for k, one in enumerate(ordered)]
    longest = max(runs, key=len, default=[0.0])
    return 0.5 * (longest[0] + longest[-1])


def test_modes_are_those_of_each_pair() -> None:
    rng = np.random.default_rng(2)
    sizes = rng.integers(1, 70, 200)
    values = rng.normal(size=sizes.sum())
    values[rng.random(len(values)) < 0.02] = np.nan
    starts = np.r_[0, np.cumsum(sizes)[:-1]]
    alone = [mode_of(part, 0.5) for part in np.split(values, starts[1:])]
    np.testing.assert_array_equal(ties._compute_modes(values, np.full(len(values), 0.5), starts, sizes), alone)


def test_a_wave_of_parallaxes_is_no_wrong_match() -> None:
    """Half of a sine's values lie at its crests, twice its amplitude from each other: all of them are right."""
    wave = 3.0 * np.sin(np.linspace(0.0, 20.0, 60))
    [mode] = ties._compute_modes(wave, np.full(60, 4.0), np.zeros(1, np.int64), np.array([60]))
    assert np.abs(wave - mode).max() <= 4.0


def test_right_ties_join_images_with_nearly_parallel_rays() -> None:
    """Neighbours of one strip see their points along nearly parallel rays; so hilly ground must not part these."""
    block = simulated(90)
    pairs = ties.sample_pairs(block, estimate_accuracies(block.images))
    flat = ties.compute_sightlines(block.images, pairs.image.ravel(), pairs.xy.reshape(-1, 2))
    length = np.hypot(*(flat.slope[::2] - flat.slope[1::2]).T)
    good = ties.check_pairs(pairs).good
    narrow = np.isfinite(good) & (np.maximum.reduceat(length, pairs.starts) < 0.04)
    assert narrow.sum() >= 20
    assert good[narrow].min() > 0.9
