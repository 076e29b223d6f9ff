"""How well held-out tie points fit the refined RPCs, beside as many of those that adjusted them.

Both are intersected with the refined RPCs and judged alike: by the residuals that remain at the intersected positions,
and by the distance of each image point from the epipolar lines of the others of its track. Nobody has tested the
held-out tracks before, so wrong matches are taken from both by a test that no error of a camera triggers
(`evaluation.find_wrong_tracks`), and counted.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..adjustment.evaluation import PairFit, TrackFit, find_wrong_tracks, fit_pairs, fit_tracks
from ..adjustment.hold_out import sample_tracks
from ..adjustment.observations import Observations
from ..adjustment.result import Adjustment
from ..block.block import Role
from ..foundation.thresholds import threshold, thresholds
from ..refinement.model import RefitRPC
from .residuals import radial_rmse, rmse


@thresholds
class HELD_OUT:
    """Which held-out tracks count."""

    wrong_match: float = threshold(4.0, "robust sigma", "across epipolar lines, beyond the pair's trend: not counted")


NONE_HELD_OUT = {"points": 0, "observations": 0, "rmse_px": None, "epipolar_rmse_px": None, "wrong": 0}


def summarise_held_out(result: Adjustment, refined: Sequence[RefitRPC]) -> dict[str, Any]:
    """Return the report's entry on held-out tie points, which took no part in the adjustment.

    ``points``, ``observations``, ``rmse_px`` (2D), ``epipolar_rmse_px``, the number of ``wrong`` matches that these are
    without, and under ``ties`` the same figures of as many tie points that adjusted the cameras.
    """
    block = result.block
    held = block.points.role == Role.HELD_OUT
    if not held.any():
        return NONE_HELD_OUT | {"ties": NONE_HELD_OUT}
    adjusted = result.took_part & (block.points.role == Role.TIE)[block.measurements.point]
    seen = block.with_cameras([new.rpc for new in refined])
    seen = seen.with_measurements(adjusted | held[block.measurements.point])
    several = seen.rays_per_point() >= 2
    ties, held = several & ~held, several & held
    chosen = np.zeros(len(held), dtype=bool)
    chosen[sample_tracks(seen, ties, min(1.0, held.sum() / max(ties.sum(), 1)))] = True
    observations, fit = fit_tracks(seen, held | chosen)
    pairs = fit_pairs(observations, fit)
    wrong = find_wrong_tracks(observations, [pairs], HELD_OUT.wrong_match)
    figures = [
        _describe_fit(observations, fit, pairs, tracks, wrong)
        for tracks in (held[observations.points], chosen[observations.points])
    ]
    return figures[0] | {"ties": figures[1]}


def _describe_fit(
    observations: Observations, fit: TrackFit, pairs: Sequence[PairFit], tracks: np.ndarray, wrong: np.ndarray
) -> dict[str, Any]:
    """Return the figures of some ``tracks (m,)`` without the ``wrong (m,)`` ones."""
    known = tracks & np.isfinite(fit.ground).all(axis=1)
    tracks = known & ~wrong
    rows = tracks[observations.point]
    distances = [pair.epipolar_px[tracks[pair.points]].ravel() for pair in pairs]
    return {
        "points": int(tracks.sum()),
        "observations": int(rows.sum()),
        "rmse_px": radial_rmse(fit.fit_px[rows]),
        "epipolar_rmse_px": rmse(np.concatenate([np.zeros(0), *distances])),
        "wrong": int((known & wrong).sum()),
    }
