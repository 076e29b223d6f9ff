"""Quality of laser points before the adjustment: flags and statistics of their files, and neighbours on the track.

Photons are also reflected by clouds, fog, the canopy and water. They show by the product's flags, a large standard
deviation, a wide spread of the photons about the fitted segment, few photons, a steep slope (errors of metres in plan
become errors of height), vegetation, and a height that differs from that of their neighbours on the track.
"""

import numpy as np
from scipy.spatial import cKDTree

from ..block.laser import LaserPoints
from ..foundation.thresholds import GROUND, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..ground.geodesy import ground_difference_m


@thresholds
class LASER_QUALITY:
    """Limits for laser points that are used in the adjustment; residuals reduce the weights there."""

    sigma_m: float = threshold(
        1.0, "m", "largest stated standard deviation, and spread of the photons about the segment"
    )
    photons: float = threshold(10.0, "photons", "smallest number of photons of a segment")


def find_laser_reasons(points: LaserPoints) -> np.ndarray:
    """Return the reason why each laser point is left out, ``(n,)`` text; empty for points that are kept."""
    with np.errstate(invalid="ignore"):
        tests = (
            (points.sigma_m > LASER_QUALITY.sigma_m, f"standard deviation above {LASER_QUALITY.sigma_m:g} m"),
            (points.misfit_m > LASER_QUALITY.sigma_m, f"photons spread by more than {LASER_QUALITY.sigma_m:g} m"),
            (points.photons < LASER_QUALITY.photons, f"fewer than {LASER_QUALITY.photons:g} photons"),
            (np.abs(points.slope) > GROUND.slope, f"slope above {100.0 * GROUND.slope:g} %"),
            (points.canopy_m > GROUND.canopy_m, f"vegetation above {GROUND.canopy_m:g} m"),
        )
    reason = points.doubt.astype("U64")
    for is_bad, cause in tests:
        reason = np.where((reason == "") & is_bad, cause, reason)
    # Points whose height differs from the median of their neighbours on the track by more than slopes explain
    accepted = np.flatnonzero(reason == "")
    sound_points = points.select(accepted)
    is_outlier = np.zeros(len(sound_points), dtype=bool)
    order = np.argsort(sound_points.track, kind="stable")
    names = sound_points.track[order]
    for rows in np.split(order, np.flatnonzero(names[1:] != names[:-1]) + 1 if len(order) else []):
        if len(rows) <= SAMPLES.plane:
            continue
        ground, height = sound_points.ground[rows], sound_points.ground[rows, 2]
        metres = ground_difference_m(ground, ground[:1])[:, :2]
        count = min(SAMPLES.tested, len(rows) - 1)
        distance, neighbours = cKDTree(metres).query(metres, k=count + 1)
        distance, neighbours = distance[:, 1:], neighbours[:, 1:]  # the nearest is the point itself
        middle = np.median(height[neighbours], axis=1)
        spread = 1.4826 * np.median(np.abs(height[neighbours] - middle[:, None]), axis=1)
        noise = np.hypot(spread, np.nan_to_num(sound_points.sigma_m[rows]))
        allowed = GROUND.slope * np.median(distance, axis=1) + SIGNIFICANCE.certain * noise
        is_outlier[rows] = np.abs(height - middle) > allowed
    reason[accepted[is_outlier]] = "outlier among its neighbours on the track"
    return reason
