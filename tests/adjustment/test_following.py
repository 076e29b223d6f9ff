"""An adjustment that follows edits: the same cameras and positions as adjusting the edited block anew."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment.following import BlockUpdater
from hrsi.hrsi_engine.adjustment.options import AdjustOptions
from hrsi.hrsi_engine.adjustment.solver import adjust
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m
from hrsi.tests import simulated_blocks

#: Half the last digit that the panel shows. Other points' equations are taken as linear (to 2e-4 px here), and what the
#: delivered cameras take over of a drift as it was (to 4e-3 px).
PX, METRES = 0.005, 0.005
PLAIN = {"reject_sigma": 0.0, "test_sigmas": False}  # the same weights before and after the edit


def rows_of(block: Block, name: str) -> np.ndarray:
    return np.flatnonzero(block.points.ids[block.measurements.point] == name)


def moved(block: Block, name: str, px: float = 3.0) -> Block:
    """Return the block with a point's first measurement elsewhere."""
    return simulated_blocks.move_measurements(block, rows_of(block, name)[0], (px, -px))


def without_rows(block: Block, rows: np.ndarray) -> Block:
    keep = np.ones(len(block.measurements), dtype=bool)
    keep[rows] = False
    return block.with_measurements(keep)


def with_role(block: Block, name: str, role: Role) -> Block:
    roles = np.where(block.points.ids == name, np.int8(role), block.points.role)
    return replace(block, points=replace(block.points, role=roles))


#: What a user does, as (block before, block after) of a block, with the point that it is done to.
EDITS: dict[str, tuple[str, Callable[[Block], tuple[Block, Block]]]] = {
    "a GCP is measured elsewhere": ("P0002", lambda block: (block, moved(block, "P0002"))),
    "a tie point is measured elsewhere": ("P0030", lambda block: (block, moved(block, "P0030"))),
    "a check point is measured elsewhere": ("P0012", lambda block: (block, moved(block, "P0012"))),
    "a measurement is taken away": (
        "P0003", lambda block: (block, without_rows(block, rows_of(block, "P0003")[:1])),
    ),
    "a measurement is new": (
        "P0004", lambda block: (without_rows(block, rows_of(block, "P0004")[:1]), block),
    ),
    "a point is new": ("P0005", lambda block: (without_rows(block, rows_of(block, "P0005")), block)),
    "a tie point is new": ("P0031", lambda block: (without_rows(block, rows_of(block, "P0031")), block)),
    "a point is gone": ("P0006", lambda block: (block, without_rows(block, rows_of(block, "P0006")))),
    "a GCP becomes a check point": ("P0007", lambda block: (block, with_role(block, "P0007", Role.CHECK))),
    "a check point becomes a GCP": ("P0013", lambda block: (block, with_role(block, "P0013", Role.GCP))),
}  # fmt: skip


@pytest.mark.parametrize("edit", mark_beyond(4, "thorough", EDITS))
@pytest.mark.parametrize("model", ["shift", "affine"])
def test_following_is_adjusting_anew(edit: str, model: str) -> None:
    block, _, _ = simulated_blocks.block(gcps=10, checks=10, ties=30, count=3, seed=4)
    name, make = EDITS[edit]
    before, after = make(block)
    options = AdjustOptions(model=model, **PLAIN)
    follower, anew = BlockUpdater(before, options), adjust(after, options)
    of_point = after.points.ids[after.measurements.point] == name
    followed = follower.follow({name}, without_rows(after, np.flatnonzero(~of_point)))
    off, stayed = (np.abs(values - anew.values).max() for values in (followed.values, follower.result.values))
    assert off < PX, edit
    assert off < 0.4 * stayed or "check point is" in edit  # cameras that do not follow are further off
    others = np.isfinite(followed.ground).all(axis=1)
    assert others.sum() >= 19 and not others[after.points.ids == name].any()
    assert np.abs(ground_difference_m(anew.ground[others], followed.ground[others])).max() < METRES
    index = int(np.flatnonzero(after.points.ids == name)[0])
    if of_point.sum() > 1:
        here = followed.edited_ground[index : index + 1]
        assert np.abs(ground_difference_m(anew.ground[index : index + 1], here)).max() < METRES


def test_two_images_that_had_nothing_in_common() -> None:
    """The first tie point between two images is a new block of the reduced equations."""
    block, _, _ = simulated_blocks.block(gcps=12, checks=0, ties=1, count=2, seed=5)
    tie = rows_of(block, "P0012")
    single = np.concatenate([rows_of(block, f"P{k:04d}")[k % 2 : k % 2 + 1] for k in range(12)])
    after = without_rows(block, single)
    before = without_rows(block, np.concatenate([single, tie]))
    options = AdjustOptions(model="shift", **PLAIN)
    of_tie = after.points.ids[after.measurements.point] == "P0012"
    followed = BlockUpdater(before, options).follow({"P0012"}, without_rows(after, np.flatnonzero(~of_tie)))
    assert np.abs(followed.values - adjust(after, options).values).max() < PX


def test_what_was_found_stays() -> None:
    """Drift that the model does not follow, sigmas estimated, blunders left out: an edit of nothing changes nothing."""
    block, _, _ = simulated_blocks.block(gcps=12, checks=8, ties=60, count=3, seed=6, drift=3e-4, noise_px=0.8)
    wrong = moved(block, "P0050", 40.0)
    follower = BlockUpdater(wrong, AdjustOptions(model="shift"))
    assert (follower.result.decision != 0).any()
    nobody = without_rows(wrong, np.arange(len(wrong.measurements)))
    followed = follower.follow(set(), nobody)
    assert np.abs(followed.values - follower.result.values).max() < PX
    known = np.isfinite(followed.ground).all(axis=1)
    assert np.abs(ground_difference_m(follower.result.ground[known], followed.ground[known])).max() < METRES
    same = without_rows(wrong, np.flatnonzero(wrong.points.ids[wrong.measurements.point] != "P0050"))
    assert np.abs(follower.follow({"P0050"}, same).values - follower.result.values).max() < PX
