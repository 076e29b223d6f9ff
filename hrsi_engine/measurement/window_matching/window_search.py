"""Search for windows of one image in another of nearly the same geometry, by normalised cross-correlation.

Each window is searched in a box around its predicted position, long along the epipolar line and narrow across it. The
result is the best whole-pixel position with its correlation and that of the best other peak in the box: for repetitive
patterns this rival is nearly as good.
"""

from typing import NamedTuple

import numpy as np

from .kernel_loading import load_kernels
from .windows import MatchImage


class SearchPeaks(NamedTuple):
    """Best positions ``xy (n, 2)``, their correlation, that of the best other peak (-1 without), and whether the best
    position is inside its box and not at its edge (then the true one may be outside)."""

    xy: np.ndarray
    correlation: np.ndarray
    rival: np.ndarray
    inside: np.ndarray


def search_windows(
    first: MatchImage,
    second: MatchImage,
    centre: np.ndarray,
    predicted: np.ndarray,
    direction: np.ndarray,
    reach: np.ndarray,
    half: int,
) -> SearchPeaks:
    """Search windows of ``2 half + 1`` pixels around whole pixels ``centre (n, 2)`` of the first image in the second.

    predicted : (n, 2) positions in the second image; direction : (n, 2) unit vectors along the boxes
    reach : (n, 2) half length along ``direction`` and half width of each box. Positions whose window contains invalid
    pixels are skipped; without valid positions the correlation is -1.
    """
    centre = np.asarray(centre, dtype=np.int64).reshape(-1, 2)
    best = np.array(predicted, dtype=np.float64)
    figures = np.full((len(centre), 3), -1.0)
    rows = np.flatnonzero(first.mask_clear(half)[centre[:, 1], centre[:, 0]] & np.isfinite(best).all(axis=1))
    if len(rows):
        part = best[rows], figures[rows]
        kernels = load_kernels()
        spreads = second.compute_once(("spreads", half), lambda: kernels.compute_window_spreads(second.grey, half))
        margin = (0, 0), (0, kernels.SIDE_BY_SIDE - 1)
        kernels.search_range(
            0,
            len(rows),
            first.grey,
            second.compute_once("padded", lambda: np.pad(second.grey, margin)),
            second.mask_clear(half),
            spreads,
            centre[rows],
            best[rows],
            direction[rows],
            np.ascontiguousarray(reach[rows]),
            half,
            *part,
        )
        best[rows], figures[rows] = part
    return SearchPeaks(best, figures[:, 0], figures[:, 1], figures[:, 2] > 0.0)
