"""The compiled search of `consensus`: which of many planes most parallaxes of an image pair are near."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def nearest_planes(
    terms: np.ndarray, y: np.ndarray, sigma: np.ndarray, tried: np.ndarray, kept: np.ndarray, chosen: np.ndarray
) -> None:
    """Find the plane of each image pair whose distance number ``kept`` (the smallest is 0) is the least.

    A plane is given up as soon as more parallaxes are at least as far as the best one's distance than may be.

    Parameters
    ----------
    terms, y, sigma : (p, s, 3), (p, s) and (p, s) of the parallaxes
    tried : (p, t, 3) planes
    kept : (p,) numbers
    chosen : (p,) the first such plane, filled here
    """
    pairs, sample = y.shape
    apart = np.empty(sample)
    for pair in range(pairs):
        least, chosen[pair] = np.inf, 0
        most = sample - 1 - kept[pair]
        for number in range(tried.shape[1]):
            level, along, across = tried[pair, number]
            farther, at = 0, 0
            while at < sample and farther <= most:
                plane = level * terms[pair, at, 0] + along * terms[pair, at, 1] + across * terms[pair, at, 2]
                apart[at] = abs(y[pair, at] - plane) / sigma[pair, at]
                farther += not apart[at] < least
                at += 1
            if farther <= most:
                least, chosen[pair] = np.sort(apart)[kept[pair]], number
