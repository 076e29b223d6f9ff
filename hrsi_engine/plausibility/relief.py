"""Comparison of a DEM with the heights of the adjusted tie points: another relief, a displacement, undeclared nodata.

A correct DEM differs from the tie points by its errors, trees and roofs, by a constant if the height datums differ, and
by a tilt of a block without GCPs: by metres otherwise, also on steep ground. A DEM that is displaced, mirrored, of
another quantity or filled with an undeclared nodata value differs by as much as the relief. The displacement and its
covariance are those of `surface.matching`.
"""

import numpy as np

from ..foundation.reasons import Level, Reason
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import EQUALITY, GROUND, MEMORY, SAMPLES, SIGNIFICANCE, threshold, thresholds
from ..surface.dem import HeightSurface, cell_size_m, dem_sigma_m, surface_heights
from ..surface.matching import SurfaceMatch, match_surface
from .accuracy import SIMULATED


@thresholds
class RELIEF:
    """Limits for a DEM that does not show the ground of the adjusted tie points."""

    unlike_m: float = threshold(15.0, "m", "scatter of height differences that is reported", SIMULATED)
    far_off_share: float = threshold(0.01, "", "… and smallest share of all tie points")
    same_value_m: float = threshold(2.0, "m", "largest range of an undeclared nodata value (by undulations)")
    displacement_cells: float = threshold(2.0, "cells", "smallest displacement that is reported", SIMULATED)
    searched_cells: float = threshold(20.0, "cells", "largest displacement along each axis that is searched")


def find_relief_reasons(
    ground: np.ndarray, surface: HeightSurface, sigma_plan_m: float = 0.0, sigma_h_m: float = 0.0, holds: bool = False
) -> list[Reason]:
    """Return the reason for a DEM that does not show the ground of a block; empty if it does, or with too few points.

    ground : (n, 3) lon, lat, height of tie points as adjusted
    sigma_plan_m : standard deviation of the block's position in plan: 0 where GCPs determine it
    sigma_h_m : standard deviation of the height difference between points and DEM
    holds : True if only the DEM determines the block's height
    """
    ground = ground[:: 1 + len(ground) // MEMORY.rows]
    of_dem = surface_heights(surface, ground[:, :2])
    inside = np.isfinite(of_dem)
    ground, of_dem = ground[inside], of_dem[inside]
    if len(ground) < SAMPLES.trend:
        return []
    miss = ground[:, 2] - of_dem
    is_far = np.abs(miss - np.median(miss)) > GROUND.margin_m
    if max(SAMPLES.redundant, RELIEF.far_off_share * len(is_far)) <= is_far.sum() < len(is_far):
        low, value, high = np.percentile(of_dem[is_far], [20.0, 50.0, 80.0])
        is_isolated = abs(value - np.median(of_dem[~is_far])) > GROUND.margin_m
    else:
        low, value, high, is_isolated = 0.0, 0.0, 0.0, False
    if is_isolated and high - low < RELIEF.same_value_m:
        message = (
            f"the DEM has the height {value:.0f} m at {is_far.sum()} of {len(is_far)} tie points, whose ground is at "
            f"{np.median(ground[is_far, 2]):.0f} m: probably an undeclared nodata value"
        )
        advice = "declare it (gdal_translate -a_nodata), or name a DEM without gaps"
        return [Reason("dem-unlike-ground", Level.DOUBTFUL, message, advice)]
    scatter, relief = robust_sigma(miss - np.median(miss)), robust_sigma(ground[:, 2] - np.median(ground[:, 2]))
    cell_m = cell_size_m(surface, ground[0])
    exceeds_errors = scatter > np.hypot(dem_sigma_m(cell_m), sigma_h_m)
    match = match_surface(ground, surface, RELIEF.searched_cells * cell_m) if exceeds_errors else None
    if match is not None and _is_displaced(match, cell_m, sigma_plan_m):
        east, north, _ = match.displacement_m.tolist()
        message = (
            f"the DEM is displaced by {abs(east):.0f} m {'east' if east > 0.0 else 'west'} and {abs(north):.0f} m "
            f"{'north' if north > 0.0 else 'south'} from the ground of the block: {len(ground)} tie points differ from "
            f"it by {match.before_m:.1f} m, and by {match.scatter_m:.1f} m without the displacement"
        )
        advice = "check georeference and CRS of the DEM, and those of the ground points"
        return [Reason("dem-unlike-ground", Level.DOUBTFUL, message, advice)]
    scatter = robust_sigma(_without_tilt(ground, miss, SIGNIFICANCE.certain * sigma_h_m))
    if scatter > max(RELIEF.unlike_m, EQUALITY.majority * relief):
        message = (
            f"the heights of {len(ground)} tie points and the DEM differ by {scatter:.0f} m (robust standard "
            f"deviation), while the relief is {relief:.0f} m: the DEM does not show this terrain"
        )
        advice = (
            "check that the file contains heights of this area, in metres and in the correct orientation, and that "
            "each RPC is that of its image"
        )
        return [Reason("dem-unlike-ground", Level.UNUSABLE if holds else Level.DOUBTFUL, message, advice)]
    return []


def _without_tilt(ground: np.ndarray, miss_m: np.ndarray, largest_m: float) -> np.ndarray:
    """Return height differences (n,) without their mean and the tilt of a block of uncertain height.

    largest_m : largest height of the tilt from the middle to the edges of the block; more belongs to the DEM
    """
    place = ground[:, :2] - ground[:, :2].mean(axis=0)
    place /= np.maximum(np.abs(place).max(axis=0), np.finfo(float).tiny)
    slope = np.linalg.lstsq(place, miss_m - miss_m.mean(), rcond=None)[0]
    tilted = miss_m - place @ np.clip(slope, -largest_m, largest_m)
    return np.asarray(tilted - np.median(tilted))


def _is_displaced(match: SurfaceMatch, cell_m: float, sigma_plan_m: float) -> bool:
    """Return whether a displacement is larger than its errors, and explains most of the differences."""
    plan_m = match.displacement_m[:2]
    sigma_m = float(np.sqrt(np.linalg.eigvalsh(match.covariance_m2[:2, :2])[-1]))
    least_m = max(RELIEF.displacement_cells * cell_m, SIGNIFICANCE.certain * np.hypot(sigma_plan_m, sigma_m))
    explains = match.scatter_m < EQUALITY.majority * match.before_m
    return bool(match.is_decided and explains and np.hypot(*plan_m) > least_m)
