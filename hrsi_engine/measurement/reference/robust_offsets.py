"""Robust estimation of an image's affine bias from measured offsets, a majority of which may be false.

The densest place of the offsets gives the start, an affine function with Tukey's weights follows it over the image.
The agreement is told from chance by the number of offsets that would fall within the tolerance if every match were
somewhere in its search window.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from ...foundation.robust_scale import ROBUST
from ...foundation.thresholds import threshold, thresholds


@thresholds
class OFFSETS:
    """When the offsets of an image agree on one affine bias."""

    rounds: int = threshold(20, "rounds", "of reweighting")
    fewest: int = threshold(6, "offsets", "that agree, below which there is no bias")
    least_spread: float = threshold(0.05, "", "standard deviation over the tolerance: offsets agree no better")
    affine_from: int = threshold(12, "offsets", "fewer only give a shift")


TUKEY = 4.685


@dataclass(frozen=True, eq=False)
class Agreement:
    """An affine bias and the offsets that follow it.

    coefficients : (2, 3): per axis the constant and the change by normalised sample and line
    centre, half_size : normalisation, ``(2,)`` each
    residual_px : (n, 2) offset - bias; agreeing : (n,) mask; spread_px : robust standard deviation of a coordinate
    chance_log10 : log10 of the probability that as many false matches would agree
    """

    coefficients: np.ndarray
    centre: np.ndarray
    half_size: np.ndarray
    residual_px: np.ndarray
    agreeing: np.ndarray
    spread_px: float
    chance_log10: float

    def bias(self, xy: np.ndarray) -> np.ndarray:
        """Return the bias at image points, ``(n, 2)``."""
        return _build_design(xy, self.centre, self.half_size) @ self.coefficients.T


def find_agreement(
    xy: np.ndarray, offset: np.ndarray, centre: np.ndarray, half_size: np.ndarray, reach_px: float, tolerance_px: float
) -> Agreement | None:
    """Return the affine bias on which most offsets agree; None where fewer than six do.

    xy, offset : (n, 2) image points and their offsets, each found within ``reach_px`` of what was expected
    tolerance_px : offsets this near to the densest place belong to the start
    """
    if len(offset) < OFFSETS.fewest:
        return None
    near = np.hypot(*(offset[:, None] - offset[None]).transpose(2, 0, 1)) <= tolerance_px
    start = near[int(near.sum(axis=1).argmax())]
    if start.sum() < OFFSETS.fewest:
        return None
    design = _build_design(xy, centre, half_size)
    coefficients = np.zeros((2, 3))
    coefficients[:, 0] = np.median(offset[start], axis=0)
    residual, spread, used = offset - design @ coefficients.T, tolerance_px / 2.0, start
    for _ in range(OFFSETS.rounds):
        columns = 3 if used.sum() >= OFFSETS.affine_from else 1
        weight = np.maximum(1.0 - ((np.hypot(*residual.T) / (spread * np.sqrt(2.0))) / TUKEY) ** 2, 0.0) ** 2
        root = np.sqrt(weight)[:, None]
        values = np.linalg.lstsq(design[:, :columns] * root, offset * root, rcond=1e-8)[0]
        coefficients = np.zeros((2, 3))
        coefficients[:, :columns] = values.T
        residual = offset - design @ coefficients.T
        # The robust standard deviation of a coordinate, from the median length (of a Rayleigh distribution)
        length = np.hypot(*residual[used].T)
        spread = float(np.clip(np.median(length) / 1.1774, OFFSETS.least_spread * tolerance_px, tolerance_px))
        within = np.hypot(*residual.T) <= ROBUST.outlier * spread
        if within.sum() < OFFSETS.fewest:
            return None
        if np.array_equal(within, used):
            break
        used = within
    radius = ROBUST.outlier * spread
    chance = min(np.pi * radius**2 / (2.0 * reach_px + 1.0) ** 2, 1.0)
    # the place was chosen among all offsets: that many places could have been the densest
    log10 = float(stats.binom.logsf(used.sum() - 2, len(offset) - 1, chance) / np.log(10.0) + np.log10(len(offset)))
    return Agreement(coefficients, centre, half_size, residual, used, spread, log10)


def _build_design(xy: np.ndarray, centre: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(xy)), (xy - centre) / np.maximum(half_size, 1.0)])
