"""Search for windows of one image in another of nearly the same geometry, by normalised cross-correlation.

Each window is searched in a box around its predicted position, long along the epipolar line and narrow across it. The
result is the best whole-pixel position with its correlation and that of the best other peak in the box: for repetitive
patterns this rival is nearly as good.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import uniform_filter

from ...foundation import compiled_code
from .windows import MATCHING, MatchImage


class SearchPeaks(NamedTuple):
    """Best positions ``xy (n, 2)``, their correlation, that of the best other peak (-1 without), and whether the best
    position is inside its box and not at its edge (then the true one may be outside)."""

    xy: np.ndarray
    correlation: np.ndarray
    rival: np.ndarray
    inside: np.ndarray


def search_windows(
    first: MatchImage, second: MatchImage, centre: np.ndarray, predicted: np.ndarray, direction: np.ndarray,
    reach: np.ndarray, half: int,
) -> SearchPeaks:  # fmt: skip
    """Search windows of ``2 half + 1`` pixels around whole pixels ``centre (n, 2)`` of the first image in the second.

    predicted : (n, 2) positions in the second image; direction : (n, 2) unit vectors along the boxes
    reach : (n, 2) half length along ``direction`` and half width of each box. Positions whose window contains invalid
    pixels are skipped; without valid positions the correlation is -1.
    """
    centre = np.asarray(centre, dtype=np.int64).reshape(-1, 2)
    best = np.array(predicted, dtype=np.float64)
    figures = np.full((len(centre), 3), -1.0)
    usable = first.mask_clear(half)[centre[:, 1], centre[:, 0]] & np.isfinite(best).all(axis=1)
    rows = np.flatnonzero(usable)
    if len(rows):
        part = best[rows], figures[rows]
        inputs = centre[rows], best[rows].copy(), direction[rows], np.ascontiguousarray(reach[rows])
        search = _search_by_numba if compiled_code.is_wanted() else _search_by_numpy
        search(first, second, inputs, half, part)
        best[rows], figures[rows] = part
    return SearchPeaks(best, figures[:, 0], figures[:, 1], figures[:, 2] > 0.0)


Inputs = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _search_by_numba(
    first: MatchImage, second: MatchImage, inputs: Inputs, half: int, results: tuple[np.ndarray, np.ndarray]
) -> None:
    from .lsm_kernels import SIDE_BY_SIDE, compute_window_spreads, search_range

    spreads = second.compute_once(("spreads", half), lambda: compute_window_spreads(second.grey, half))
    grey = second.compute_once("padded", lambda: np.pad(second.grey, ((0, 0), (0, SIDE_BY_SIDE - 1))))
    search_range(0, len(inputs[0]), first.grey, grey, second.mask_clear(half), spreads, *inputs, half, *results)


def _search_by_numpy(
    first: MatchImage, second: MatchImage, inputs: Inputs, half: int, results: tuple[np.ndarray, np.ndarray]
) -> None:
    """Search by NumPy, for windows with boxes of equal size together."""
    size = 2 * np.ceil(np.hypot(*inputs[3].T)).astype(np.int64) + 1
    for length in np.unique(size):
        same = np.flatnonzero(size == length)
        for begin in range(0, len(same), MATCHING.search_batch):
            rows = same[begin : begin + MATCHING.search_batch]
            part = tuple(column[rows] for column in inputs)
            scores, corner = _correlate_boxes(first, second, part, half, int(length))
            results[0][rows], results[1][rows] = _find_peaks(scores, corner, part[1])


def _correlate_boxes(
    first: MatchImage, second: MatchImage, inputs: Inputs, half: int, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return correlations ``(n, size, size)``, -2 where not computed, and the boxes' first positions ``(n, 2)``."""
    centre, predicted, direction, reach = inputs
    side = 2 * half + 1
    template = sliding_window_view(first.grey, (side, side))[centre[:, 1] - half, centre[:, 0] - half]
    template = template.reshape(len(centre), -1)
    template = template - template.mean(axis=1, keepdims=True, dtype=np.float64).astype(np.float32)
    norm = np.einsum("np,np->n", template, template)
    corner = np.round(predicted).astype(np.int64) - size // 2
    scores = np.full((len(centre), size, size), -2.0)
    clear = second.mask_clear(half)
    spreads = second.compute_once(("spreads", half), lambda: _compute_spreads(second.grey, half))
    windows = sliding_window_view(second.grey, (side, side))  # indexed by their first pixels
    row, column = np.mgrid[:size, :size]
    away_x, away_y = ((corner[:, k] - predicted[:, k])[:, None, None] + grid for k, grid in ((0, column), (1, row)))
    dx, dy = direction.T[:, :, None, None]
    tried = np.abs(away_x * dx + away_y * dy) <= reach[:, 0, None, None]
    tried &= np.abs(away_x * dy - away_y * dx) <= reach[:, 1, None, None]
    number, row, column = np.nonzero(tried)
    x, y = corner[number, 0] + column, corner[number, 1] + row
    inside = (x >= half) & (y >= half) & (x < clear.shape[1] - half) & (y < clear.shape[0] - half)
    inside[inside] = clear[y[inside], x[inside]]
    number, row, column, x, y = (values[inside] for values in (number, row, column, x, y))
    for begin in range(0, len(number), MATCHING.place_batch):
        part = slice(begin, begin + MATCHING.place_batch)
        seen = windows[y[part] - half, x[part] - half].reshape(-1, side * side)
        product = np.einsum("np,np->n", seen, template[number[part]])  # the mean of `seen` cancels
        power = norm[number[part]] * spreads[y[part], x[part]]
        scores[number[part], row[part], column[part]] = product / np.sqrt(np.maximum(power, 1e-20))
    return scores, corner


def _compute_spreads(grey: np.ndarray, half: int) -> np.ndarray:
    """Return the sum of squared deviations from the mean of the window around each pixel of the image."""
    side = 2 * half + 1
    mean = uniform_filter(grey, side, output=np.float64)
    square = uniform_filter(np.square(grey, dtype=np.float64), side)
    spread = np.maximum(square - mean**2, MATCHING.rounding_share * square) * side**2
    return spread.astype(np.float32)


def _find_peaks(scores: np.ndarray, corner: np.ndarray, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return best positions and figures (correlation, rival, inside) of boxes of correlations."""
    count, size, _ = scores.shape
    best, figures = predicted.copy(), np.full((count, 3), -1.0)
    padded = np.pad(scores, ((0, 0), (1, 1), (1, 1)), constant_values=-2.0)
    around = [padded[:, 1 + b : 1 + b + size, 1 + a : 1 + a + size] for b in (-1, 0, 1) for a in (-1, 0, 1)]
    peak = scores >= np.max(around, axis=0)
    flat = scores.reshape(count, -1).argmax(axis=1)
    row, column = np.divmod(flat, size)
    top = scores.reshape(count, -1)[np.arange(count), flat]
    grid = np.arange(size)
    near = (
        np.maximum(np.abs(grid[:, None] - row[:, None, None]), np.abs(grid - column[:, None, None]))
        <= MATCHING.rival_px
    )
    rival = np.where(peak & ~near, scores, -1.0).max(axis=(1, 2), initial=-1.0)
    lowest = np.min([layer[np.arange(count), row, column] for layer in around], axis=0)
    known = top > -1.5
    best[known] = np.column_stack([column, row])[known] + corner[known]
    figures[known] = np.column_stack([top, rival, np.where(lowest > -1.5, 1.0, 0.0)])[known]
    return best, figures
