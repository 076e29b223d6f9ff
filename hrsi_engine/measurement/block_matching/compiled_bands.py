"""Compiled loop of the comparison within bands (needs numba); `bands` has the method and the way without numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...foundation.compiled_code import OPTIONS


@njit(**OPTIONS)
def compare_in_bands(
    similarity: np.ndarray, origin: np.ndarray, direction: np.ndarray, reach: np.ndarray, xy: np.ndarray,
    margin_px: float, best: np.ndarray, second: np.ndarray, nearest: np.ndarray, back_best: np.ndarray,
    back: np.ndarray,
) -> None:  # fmt: skip
    """Find the most similar point within each line's band, and the most similar line of each point.

    Parameters
    ----------
    similarity : (l, p) of lines and points
    origin, direction, reach : (l, 2), (l, 2) and (l,) of the lines
    xy : (p, 2) points
    margin_px : half the width of the band
    best, second, nearest : (l,) largest and second largest similarity within the band, whose the largest is; written
    back_best, back : (p,) largest similarity of a line whose band a point is in, and the line; updated
    """
    for i in range(len(origin)):
        x, y, dx, dy = origin[i, 0], origin[i, 1], direction[i, 0], direction[i, 1]
        far = reach[i] + margin_px
        first_value, second_value, at = np.float32(-1.0), np.float32(-1.0), -1
        for j in range(len(xy)):
            px, py = xy[j, 0] - x, xy[j, 1] - y
            if abs(dx * py - dy * px) <= margin_px and abs(dx * px + dy * py) <= far:
                value = similarity[i, j]
                if value > first_value:
                    second_value, first_value, at = first_value, value, j
                elif value > second_value:
                    second_value = value
                if value > back_best[j]:
                    back_best[j], back[j] = value, i
        best[i], second[i], nearest[i] = first_value, second_value, at
