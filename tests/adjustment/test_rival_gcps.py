"""Two GCPs explain a misfit, as well as each other or nearly. The expected shares come from plain least squares."""

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import GroundPoints, ImagePoints
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.ground.geodesy import move_ground

ERROR_PX = 15.0


def layout(spread: float) -> np.ndarray:
    """Return seven GCPs, east and north (m): two 300 m apart in the east, and five in the west.

    The closer the five lie to each other, the less they say of which of the two is wrong.
    """
    west = np.array([[-1400.0, -1300.0], [-1500.0, 1400.0], [-700.0, 300.0], [-900.0, -500.0], [-300.0, -1200.0]])
    middle = west.mean(axis=0)
    return np.vstack([middle + spread * (west - middle), [[1500.0, -150.0], [1500.0, 150.0]]])


def shares(metres: np.ndarray, wrong: int) -> np.ndarray:
    """Return how much of the misfit of one wrong point leaving out each point takes away, by that of the wrong one.

    An affine map is fitted without each point in turn; what is left of an error in one coordinate are its squares.
    """
    design, error = np.column_stack([np.ones(len(metres)), metres / 1000.0]), np.eye(len(metres))[wrong]

    def squares(keep: np.ndarray) -> float:
        return float(np.linalg.lstsq(design[keep], error[keep], rcond=None)[1][0])

    every = np.arange(len(metres))
    gain = np.array([squares(every) - squares(np.delete(every, k)) for k in every])
    return gain / gain[wrong]


def adjusted(metres: np.ndarray, wrong: int):
    """Return the adjustment of one image whose GCP ``wrong`` was measured 15 px beside."""
    image = blocks.images(1)[0]
    rng = np.random.default_rng(4)
    heights = rng.uniform(-50.0, 100.0, len(metres))
    ground = move_ground(np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (len(metres), 1)),
                          np.column_stack([metres, heights]))  # fmt: skip
    ids = [f"G{k}" for k in range(len(metres))]
    xy = image.rpc.project(ground) + rng.normal(0.0, 0.05, (len(metres), 2))
    xy[wrong] += [ERROR_PX, ERROR_PX]
    block = assemble(
        [image], [GroundPoints(ids, ground, 0, 0.05)], [ImagePoints(ids, [image.id] * len(ids), xy, 0.1)],
        defaults=DefaultSigmas(0.1, 0.05, 0.05),
    )  # fmt: skip
    return adjust(block, AdjustOptions(test_sigmas=False, model="affine", reject_sigma=4.0))


@pytest.mark.parametrize("spread", [1.0, 0.4])
def test_what_explains_less_of_the_misfit_is_no_rival(spread: float):
    metres = layout(spread)
    assert 0.75 < np.sort(shares(metres, 6))[-2] < 0.96
    findings = adjusted(metres, 6).findings
    assert [(finding.id, finding.left_out) for finding in findings] == [("G6", True)]


@pytest.mark.parametrize("spread", [0.15, 0.07])
def test_what_explains_it_as_well_is_named_and_nothing_is_left_out(spread: float):
    metres = layout(spread)
    assert 0.99 < np.sort(shares(metres, 6))[-2] < 0.998  # not equal: noise decides which of the two comes first
    findings = adjusted(metres, 6).findings
    assert [finding.left_out for finding in findings] == [False]
    assert all(name in findings[0].message for name in ("G5", "G6"))
    assert all(name not in findings[0].message for name in ("G0", "G1", "G2", "G3", "G4"))
