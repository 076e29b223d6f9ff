"""Do the heights of surveyed points and of a DEM refer to the same datum?

Heights above a geoid taken for heights above the ellipsoid are wrong by the geoid's undulation N, up to 100 m. Where
both GCPs and a DEM are given, their median difference tells: about +N, and the DEM's heights are above the geoid
although they count as ellipsoidal; about -N, and the GCPs' are (or the other was converted though it need not be).
"""

from dataclasses import dataclass

import numpy as np

from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import threshold, thresholds


@thresholds
class HEIGHT_DATUM:
    """When surveyed heights and those of a DEM refer to different datums."""

    fewest_points: int = threshold(3, "points", "below, no difference is significant")
    significant_sigmas: float = threshold(4.0, "sigma", "of the median, which a difference must exceed")
    smallest_difference_m: float = threshold(5.0, "m", "trees, buildings and a coarse DEM may do so much")
    geoid_share: float = threshold(0.25, "", "share of the undulation within which a difference looks like it")


@dataclass(frozen=True)
class HeightDifference:
    """Surveyed heights less the DEM's at the same places: median, robust spread, number; and the geoid's median N.

    Parameters
    ----------
    median_m : float
        Median of the differences.
    spread_m : float
        Their robust standard deviation.
    points : int
        Their number.
    undulation_m : float
        Median of the geoid's N; NaN where no geoid grid is at hand.
    """

    median_m: float
    spread_m: float
    points: int
    undulation_m: float

    @property
    def significant(self) -> bool:
        """Whether the two disagree by more than a DEM's usual errors."""
        of_median_m = 1.2533 * self.spread_m / np.sqrt(self.points)
        limit = max(HEIGHT_DATUM.smallest_difference_m, HEIGHT_DATUM.significant_sigmas * of_median_m)
        return self.points >= HEIGHT_DATUM.fewest_points and abs(self.median_m) > limit

    @property
    def sign_of_geoid(self) -> int:
        """1 where the difference is about N, -1 where it is about -N, 0 otherwise."""
        least_m = HEIGHT_DATUM.smallest_difference_m
        tolerance = max(HEIGHT_DATUM.geoid_share * abs(self.undulation_m), least_m, 2.0 * self.spread_m)
        if not self.significant or not abs(self.undulation_m) > least_m:
            return 0
        return next((sign for sign in (1, -1) if abs(self.median_m - sign * self.undulation_m) <= tolerance), 0)


def height_difference(surveyed_m: np.ndarray, dem_m: np.ndarray, undulation_m: np.ndarray) -> HeightDifference | None:
    """Return how surveyed heights ``(n,)`` and a DEM's at the same places differ; NaN heights do not count.

    Parameters
    ----------
    surveyed_m : (n,) ndarray
        Surveyed heights.
    dem_m : (n,) ndarray
        The DEM's.
    undulation_m : (n,) ndarray
        The geoid's heights there, NaN where not known.

    Returns
    -------
    HeightDifference or None
        None without any pair of heights.
    """
    known = np.isfinite(surveyed_m) & np.isfinite(dem_m)
    if not known.any():
        return None
    difference = surveyed_m[known] - dem_m[known]
    middle = float(np.median(difference))
    spread = float(robust_sigma(difference - middle))
    of_geoid = undulation_m[known]
    return HeightDifference(
        middle, spread, len(difference), float(np.median(of_geoid)) if np.isfinite(of_geoid).all() else float("nan")
    )
