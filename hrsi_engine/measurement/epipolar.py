"""Where a point of one image lies in another: on the projection of its ray, a nearly straight epipolar line.

The line is found by localizing the point at heights and projecting into the other image. A match is judged by its
distance across the line (which a true match keeps but for the RPCs' bias) and by the height that its position along
the line stands for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..rpc import RPC

HEIGHT_STEP_M = 50.0  # half the height difference over which the line's direction is taken
MIN_STRETCH = 1e-3  # px per metre: below, the views are the same and a match says nothing of the height


class EpipolarMiss(NamedTuple):
    """Of each match: signed distance across the epipolar line (px), height (m), px per metre along the line, and how
    far along the line (px) the match is from where ``height_m`` puts it.

    Where two images have the same view there is no line: its direction is then that of the samples.
    """

    across_px: np.ndarray
    height_m: np.ndarray
    stretch: np.ndarray
    along_px: np.ndarray


def transfer(source: RPC, target: RPC, xy: np.ndarray, height_m: np.ndarray | float) -> np.ndarray:
    """Return where points of one image at given heights appear in the other, ``(n, 2)``; NaN where nowhere."""
    return target.project(source.localize(xy, height_m).ground)


def epipolar_miss(
    first: RPC,
    second: RPC,
    first_xy: np.ndarray,
    second_xy: np.ndarray,
    height_m: np.ndarray | float,
    iterations: int = 3,
) -> EpipolarMiss:
    """Return distance across and height of matches; ``height_m`` is where the search along the line starts."""
    lowest, highest = first.height_range
    reach = 2.0 * (highest - lowest)
    height = np.full(len(first_xy), height_m, dtype=np.float64)
    for _ in range(iterations):
        below = transfer(first, second, first_xy, height - HEIGHT_STEP_M)
        above = transfer(first, second, first_xy, height + HEIGHT_STEP_M)
        slope = (above - below) / (2.0 * HEIGHT_STEP_M)
        stretch = np.linalg.norm(slope, axis=1)
        distinct = stretch > MIN_STRETCH
        direction = np.where(distinct[:, None], slope / np.maximum(stretch, MIN_STRETCH)[:, None], (1.0, 0.0))
        miss = second_xy - 0.5 * (above + below)
        along = np.einsum("ni,ni->n", miss, direction)
        across = direction[:, 0] * miss[:, 1] - direction[:, 1] * miss[:, 0]
        step = np.where(distinct, along / np.maximum(stretch, MIN_STRETCH), 0.0)
        height = np.clip(height + step, lowest - reach, highest + reach)
    return EpipolarMiss(across, height, stretch, np.where(distinct, (height - height_m) * stretch, along))


def overlap_window(
    first: RPC, second: RPC, window: tuple[float, float, float, float], heights: tuple[float, float], margin_px: float
) -> tuple[float, float, float, float]:
    """Return the window of the second image where a window of the first can appear between two heights.

    Windows are (first sample, last sample, first line, last line). All NaN where it appears nowhere.
    """
    s0, s1, l0, l1 = window
    corners = np.array([(s, line) for s in (s0, 0.5 * (s0 + s1), s1) for line in (l0, 0.5 * (l0 + l1), l1)])
    seen = np.concatenate([transfer(first, second, corners, height) for height in heights])
    seen = seen[np.isfinite(seen).all(axis=1)]
    if not len(seen):
        return (np.nan,) * 4
    low, high = seen.min(axis=0) - margin_px, seen.max(axis=0) + margin_px
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
