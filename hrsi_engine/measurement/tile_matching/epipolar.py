"""Epipolar lines by RPCs: the image of a point's ray in another image, which is nearly straight.

The line is found by localizing the point at heights and projecting into the other image. A match is judged by its
distance across the line (which a true match keeps but for the RPCs' bias) and by the height that its position along
the line stands for.
"""

from typing import NamedTuple

import numpy as np

from ...camera.rpc import RPC
from ...foundation.thresholds import threshold, thresholds


@thresholds
class EPIPOLAR:
    """How epipolar lines are taken from RPCs, and which matches agree with them."""

    height_step_m: float = threshold(50.0, "m", "half the height difference over which a line's direction is taken")
    least_stretch: float = threshold(1e-3, "px/m", "along the line by height, below which two views are the same")
    ratio: float = threshold(0.8, "", "of the distances to the nearest and second nearest descriptor", "Lowe 2004")
    batch: int = threshold(2048, "descriptors", "compared at a time: memory")
    mode_px: float = threshold(3.0, "px", "across the lines, within which the true matches of a pair lie")
    neighbours: int = threshold(12, "matches", "with whose median parallax a match is compared")
    fewest: int = threshold(6, "matches", "by which an offset can be judged")
    fewest_for_plane: int = threshold(30, "matches", "by which a plane can be judged")
    jump_px: float = threshold(8.0, "px", "from that median that buildings and trees explain")


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


def compute_epipolar_miss(
    first: RPC, second: RPC, first_xy: np.ndarray, second_xy: np.ndarray, height_m: np.ndarray | float,
    iterations: int = 3,
) -> EpipolarMiss:  # fmt: skip
    """Return distance across and height of matches; ``height_m`` is where the search along the line starts."""
    lowest, highest = first.height_range
    reach = 2.0 * (highest - lowest)
    height = np.full(len(first_xy), height_m, dtype=np.float64)
    for _ in range(iterations):
        below = transfer(first, second, first_xy, height - EPIPOLAR.height_step_m)
        above = transfer(first, second, first_xy, height + EPIPOLAR.height_step_m)
        slope = (above - below) / (2.0 * EPIPOLAR.height_step_m)
        stretch = np.linalg.norm(slope, axis=1)
        distinct = stretch > EPIPOLAR.least_stretch
        direction = np.where(distinct[:, None], slope / np.maximum(stretch, EPIPOLAR.least_stretch)[:, None], (1, 0))
        miss = second_xy - 0.5 * (above + below)
        along = np.einsum("ni,ni->n", miss, direction)
        across = direction[:, 0] * miss[:, 1] - direction[:, 1] * miss[:, 0]
        step = np.where(distinct, along / np.maximum(stretch, EPIPOLAR.least_stretch), 0.0)
        height = np.clip(height + step, lowest - reach, highest + reach)
    return EpipolarMiss(across, height, stretch, np.where(distinct, (height - height_m) * stretch, along))
