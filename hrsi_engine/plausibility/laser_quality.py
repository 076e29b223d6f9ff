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

    sigma_m: float = threshold(1.0, "m", "largest stated standard deviation")
    misfit_m: float = threshold(1.0, "m", "largest spread of the photons about the fitted segment")
    photons: float = threshold(10.0, "photons", "smallest number of photons of a segment")
    neighbour_reach_m: float = threshold(150.0, "m", "largest distance of a neighbour along the track")


def find_laser_reasons(points: LaserPoints) -> np.ndarray:
    """Return the reason why each laser point is left out, ``(n,)`` text; empty for points that are kept."""
    with np.errstate(invalid="ignore"):
        tests = (
            (points.sigma_m > LASER_QUALITY.sigma_m, f"standard deviation above {LASER_QUALITY.sigma_m:g} m"),
            (points.misfit_m > LASER_QUALITY.misfit_m, f"photons spread by more than {LASER_QUALITY.misfit_m:g} m"),
            (points.photons < LASER_QUALITY.photons, f"fewer than {LASER_QUALITY.photons:g} photons"),
            (np.abs(points.slope) > GROUND.slope, f"slope above {100.0 * GROUND.slope:g} %"),
            (points.canopy_m > GROUND.canopy_m, f"vegetation above {GROUND.canopy_m:g} m"),
        )
    reason = points.doubt.astype("U64")
    for is_bad, cause in tests:
        reason = np.where((reason == "") & is_bad, cause, reason)
    # Points whose height differs from the median of their neighbours on the track by more than slopes explain; points
    # with too few neighbours are not tested
    accepted = np.flatnonzero(reason == "")
    sound_points = points.select(accepted)
    is_outlier = np.zeros(len(sound_points), dtype=bool)
    order = np.argsort(sound_points.track, kind="stable")
    names = sound_points.track[order]
    for rows in np.split(order, np.flatnonzero(names[1:] != names[:-1]) + 1 if len(order) else []):
        if len(rows) <= 3:
            continue
        ground, height = sound_points.ground[rows], sound_points.ground[rows, 2]
        metres = ground_difference_m(ground, ground[:1])[:, :2]
        count = min(SAMPLES.neighbours, len(rows) - 1)
        distance, neighbours = cKDTree(metres).query(
            metres, k=count + 1, distance_upper_bound=LASER_QUALITY.neighbour_reach_m
        )
        distance, neighbours = distance[:, 1:], neighbours[:, 1:]  # the nearest is the point itself
        is_neighbour = np.isfinite(distance)
        has_neighbours = is_neighbour.sum(axis=1) >= 3
        neighbour_heights = np.where(is_neighbour, np.append(height, np.nan)[neighbours], np.nan)[has_neighbours]
        middle = np.nanmedian(neighbour_heights, axis=1)
        spread = 1.4826 * np.nanmedian(np.abs(neighbour_heights - middle[:, None]), axis=1)
        reach = np.nanmedian(np.where(is_neighbour, distance, np.nan)[has_neighbours], axis=1)
        noise = np.hypot(spread, np.nan_to_num(sound_points.sigma_m[rows][has_neighbours]))
        allowed = GROUND.slope * reach + SIGNIFICANCE.certain * noise
        is_outlier[rows[has_neighbours]] = np.abs(height[has_neighbours] - middle) > allowed
    reason[accepted[is_outlier]] = "outlier among its neighbours on the track"
    return reason
