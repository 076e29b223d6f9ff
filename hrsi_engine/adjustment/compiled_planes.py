"""The compiled search of `consensus`: which of many planes most parallaxes of an image pair are near."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def find_nearest_planes(
    terms: np.ndarray, y: np.ndarray, sigma: np.ndarray, tried: np.ndarray, kept: np.ndarray
) -> np.ndarray:
    """Return the plane ``(p,)`` of each image pair whose distance number ``kept`` (the smallest is 0) is the least.

    A plane is given up as soon as more parallaxes are at least as far as the best one's distance than may be.

    terms, y, sigma : (p, s, c), (p, s) and (p, s) of the parallaxes
    tried : (p, t, c) planes, c of 3 or 1 for level ones
    kept : (p,) numbers
    """
    pairs, sample = y.shape
    apart, chosen = np.empty(sample), np.zeros(pairs, dtype=np.int64)
    for pair in range(pairs):
        least = np.inf
        most = sample - 1 - kept[pair]
        for number in range(tried.shape[1]):
            farther, at = 0, 0
            while at < sample and farther <= most:
                plane = 0.0
                for term in range(terms.shape[2]):
                    plane += tried[pair, number, term] * terms[pair, at, term]
                apart[at] = abs(y[pair, at] - plane) / sigma[pair, at]
                farther += not apart[at] < least
                at += 1
            if farther <= most:
                least, chosen[pair] = np.sort(apart)[kept[pair]], number
    return chosen
