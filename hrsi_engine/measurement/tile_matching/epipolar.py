"""Where a point of one image lies in another: on the projection of its ray, a nearly straight epipolar line.

The line is found by localizing the point at heights and projecting into the other image. A match is judged by its
distance across the line (which a true match keeps but for the RPCs' bias) and by the height that its position along
the line stands for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...camera.rpc import RPC

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
