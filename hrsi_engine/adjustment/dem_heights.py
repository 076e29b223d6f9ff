"""Heights of a DEM as observations of the tie points' heights, robust against what is no ground.

The height that holds a point is the one below its present position. Trees, buildings, clouds and holes of the DEM make
some of these heights wrong by many standard deviations, which hardly shows in weak geometry: the point simply follows
the DEM. So each height is judged against the one that the point's rays alone give. With the cofactor q of the adjusted
height, in which the DEM has the weight w, that of the rays alone is q / (1 - q w), and

    DEM - rays = (DEM - adjusted) / (1 - q w)        variance sigma² + q / (1 - q w)

The differences are counted from the middle of the bulk of them (a block without height control may lie off as a whole,
which must not silence the DEM). Their weight, the inverse of that variance, stays as it is up to `FITTING` standard
deviations and falls to nothing at `WRONG`; in weak geometry most of the variance is that of the rays, so a doubtful DEM
height gets a variance that makes up for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..foundation.robust_scale import robust_sigma
from ..surface.dem import HeightSurface, surface_heights
from .equations import FREE_POINT_SIGMA_M, PointPriors
from .result import DemAgreement

LOST = 1e-3  # weight factor below which a height counts as left out
FITTING, WRONG = 2.5, 4.0
CUT_AT, CUTS = 2.5, 20
LEAST_BY_RAYS = 1e-4  # share of a height that comes from rays; below, nothing judges the DEM


@dataclass(frozen=True, eq=False)
class DemHeights:
    """Which points ``(k,)`` a DEM holds, and with what standard deviation."""

    dem: HeightSurface
    points: np.ndarray
    sigma_m: float

    def apply(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> PointPriors:
        """Return the priors with the DEM's heights at positions ``(m, 3)``, weighted by how well they fit.

        ``cofactors (m, 3, 3)`` are those of the positions, for the cameras as they are, under the ``priors``.
        """
        target, weight, observed = priors.target.copy(), priors.weight.copy(), priors.observed.copy()
        found = surface_heights(self.dem, ground[self.points, :2])
        known = np.isfinite(found)
        rows = self.points[known]
        target[rows, 2] = found[known]
        factor, of_rays = self._judged(found[known] - ground[rows, 2], cofactors[rows, 2, 2], priors.weight[rows, 2])
        with np.errstate(divide="ignore"):
            variance = (self.sigma_m**2 + of_rays) / factor - of_rays
        weight[rows, 2] = np.maximum(1.0 / variance, 1.0 / FREE_POINT_SIGMA_M**2)
        observed[rows, 2] = factor > LOST
        return replace(priors, target=target, weight=weight, observed=observed)

    def _judged(self, miss_m: np.ndarray, cofactor: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return weight factors ``(k,)`` of the differences DEM - rays, and the variances of the rays' heights."""
        by_rays = np.maximum(1.0 - cofactor * weight, LEAST_BY_RAYS)
        of_rays, apart = cofactor / by_rays, miss_m / by_rays
        if not miss_m.size:
            return apart, of_rays
        sigma = np.sqrt(self.sigma_m**2 + of_rays)
        middle, scale = _core(apart, sigma)
        return falling(np.abs(apart - middle) / (scale * sigma)), of_rays

    def agreement(self, priors: PointPriors, ground: np.ndarray) -> DemAgreement | None:
        """Return how the DEM agrees with the adjusted points; None where it holds none."""
        if not len(self.points):
            return None
        kept = priors.observed[self.points, 2]
        miss = ground[self.points, 2] - priors.target[self.points, 2]
        out = miss[~kept]
        within = miss[kept]
        return DemAgreement(
            points=len(miss),
            left_out=int((~kept).sum()),
            rmse_m=float(np.sqrt(np.mean(within**2))) if within.size else float("nan"),
            left_out_median_m=float(np.median(out)) if out.size else float("nan"),
        )


def falling(t: np.ndarray) -> np.ndarray:
    """Return the weight of a height ``t`` standard deviations off: 1 up to `FITTING`, 0 from `WRONG` (Hampel 1974)."""
    return np.clip((WRONG - t) / (WRONG - FITTING), 0.0, 1.0)


def _core(apart: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Return the median of the bulk of the differences and by how much their sigmas are too small (1 or more).

    Differences far from the median are cut off again and again: a quarter of treetops must not widen the scale.
    """
    middle, scale = float(np.median(apart)), np.inf
    core = np.ones(len(apart), dtype=bool)
    for _ in range(CUTS):
        t = (apart - middle) / sigma
        scale = max(float(robust_sigma(t[core])), 1.0)
        inside = np.abs(t) <= CUT_AT * scale
        middle = float(np.median(apart[inside]))
        if np.array_equal(inside, core):
            break
        core = inside
    return middle, scale
