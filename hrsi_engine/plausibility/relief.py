"""Comparison of a DEM with the heights of the adjusted tie points: another relief, a displacement, undeclared nodata.

A correct DEM differs from the tie points by its errors, trees and roofs, and by a constant if the height datums differ:
by metres, also on steep ground. A DEM that is displaced, mirrored, of another quantity or filled with an undeclared
nodata value differs by as much as the relief. The displacement d of a DEM follows from the height differences, which
grow with the slope (Nuth and Kääb, 2011)::

    height of the point - height of the DEM = c + d · gradient of the DEM
"""

import numpy as np

from ..foundation.large_arrays import finite_rows
from ..foundation.reasons import Level, Reason
from ..foundation.robust_scale import robust_sigma
from ..foundation.thresholds import threshold, thresholds
from ..ground.geodesy import metres_per_degree
from ..surface.dem import HeightSurface, cell_size_m, surface_heights
from .accuracy import SIMULATED


@thresholds
class RELIEF:
    """Limits for a DEM that does not show the ground of the adjusted tie points."""

    fewest_points: int = threshold(30, "points", "fewest tie points with a height of the DEM that are tested")
    most_points: int = threshold(20_000, "points", "largest number of points that are compared")
    unlike_m: float = threshold(15.0, "m", "scatter of height differences that is reported", SIMULATED)
    unlike_share: float = threshold(0.5, "", "… over the scatter of heights (all three exceeded)", SIMULATED)
    unlike_sigmas: float = threshold(5.0, "sigma", "… in standard deviations of the points' heights", SIMULATED)
    far_off_m: float = threshold(50.0, "m", "difference that vegetation, buildings and changes do not explain")
    far_off_points: int = threshold(
        5, "points", "smallest number of such differences: more than a few wrong tie points"
    )
    far_off_share: float = threshold(0.01, "", "… and smallest share of all tie points")
    same_value_m: float = threshold(2.0, "m", "largest range of an undeclared nodata value (by undulations)")
    displacement_cells: float = threshold(2.0, "cells", "smallest displacement that is reported", SIMULATED)
    displacement_sigmas: float = threshold(5.0, "sigma", "… in standard deviations of the position", SIMULATED)
    left_of_scatter: float = threshold(0.5, "", "largest scatter after a displacement over that before", SIMULATED)
    left_of_relief: float = threshold(0.2, "", "… and over the scatter of heights", SIMULATED)
    beyond_share: float = threshold(0.3, "", "largest share of points outside the displaced DEM")
    most_steps: int = threshold(12, "steps", "largest number of iterations for the displacement")


def find_relief_reasons(
    ground: np.ndarray, surface: HeightSurface, sigma_plan_m: float = 0.0, sigma_h_m: float = 0.0, holds: bool = False
) -> list[Reason]:
    """Return the reason for a DEM that does not show the ground of a block; empty if it does, or with too few points.

    ground : (n, 3) lon, lat, height of tie points as adjusted
    sigma_plan_m : standard deviation of the block's position in plan: 0 where GCPs determine it
    sigma_h_m : standard deviation of the height difference between points and DEM
    holds : True if only the DEM determines the block's height
    """
    ground = ground[:: 1 + len(ground) // RELIEF.most_points]
    of_dem = surface_heights(surface, ground[:, :2])
    inside = np.isfinite(of_dem)
    ground, of_dem = ground[inside], of_dem[inside]
    if len(ground) < RELIEF.fewest_points:
        return []
    miss = ground[:, 2] - of_dem
    is_far = np.abs(miss - np.median(miss)) > RELIEF.far_off_m
    if max(RELIEF.far_off_points, RELIEF.far_off_share * len(is_far)) <= is_far.sum() < len(is_far):
        low, value, high = np.percentile(of_dem[is_far], [20.0, 50.0, 80.0])
        is_isolated = abs(value - np.median(of_dem[~is_far])) > RELIEF.far_off_m
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
    east, north, left = _estimate_displacement(ground, surface)
    distance = float(np.hypot(east, north))
    if left < min(RELIEF.left_of_scatter * scatter, RELIEF.left_of_relief * relief) and distance > max(
        RELIEF.displacement_cells * cell_size_m(surface, ground[0]), RELIEF.displacement_sigmas * sigma_plan_m
    ):
        message = (
            f"the DEM is displaced by {abs(east):.0f} m {'east' if east > 0.0 else 'west'} and {abs(north):.0f} m "
            f"{'north' if north > 0.0 else 'south'} from the ground of the block: {len(ground)} tie points differ from "
            f"it by {scatter:.1f} m, and by {left:.1f} m without the displacement"
        )
        advice = "check georeference and CRS of the DEM, and those of the ground points"
        return [Reason("dem-unlike-ground", Level.DOUBTFUL, message, advice)]
    if scatter > max(RELIEF.unlike_m, RELIEF.unlike_share * relief, RELIEF.unlike_sigmas * sigma_h_m):
        message = (
            f"the heights of {len(ground)} tie points and the DEM differ by {scatter:.0f} m (robust standard "
            f"deviation), while the relief is {relief:.0f} m: the DEM does not show this terrain"
        )
        advice = "check that the file contains heights of this area, in metres and in the correct orientation"
        return [Reason("dem-unlike-ground", Level.UNUSABLE if holds else Level.DOUBTFUL, message, advice)]
    return []


def _estimate_displacement(ground: np.ndarray, surface: HeightSurface) -> tuple[float, float, float]:
    """Return the displacement of a DEM east and north, and the robust scatter of the differences without it, in m."""
    cell = cell_size_m(surface, ground[0])
    degrees = 1.0 / metres_per_degree(ground)[:, :2]
    shift, step = np.zeros(2), 2.0 * cell
    best = (0.0, 0.0, np.inf)
    for _ in range(RELIEF.most_steps):
        shifted = ground[:, :2] + shift * degrees
        middle = surface_heights(surface, shifted)
        sides = [
            [surface_heights(surface, shifted + sign * step * np.eye(2)[axis] * degrees) for sign in (-1.0, 1.0)]
            for axis in (0, 1)
        ]
        gradient = np.column_stack([(high - low) / (2.0 * step) for low, high in sides])
        miss = ground[:, 2] - middle
        finite = np.isfinite(miss) & finite_rows(gradient)
        if finite.sum() < max(RELIEF.fewest_points, (1.0 - RELIEF.beyond_share) * len(finite)):
            break
        miss = miss[finite] - np.median(miss[finite])
        scatter = float(robust_sigma(miss))
        if scatter < best[2]:
            best = (float(shift[0]), float(shift[1]), scatter)
        inliers = np.abs(miss) <= 3.0 * scatter
        design = np.column_stack([gradient[finite][inliers], np.ones(inliers.sum())])
        solved, _, rank, _ = np.linalg.lstsq(design, miss[inliers], rcond=None)
        if rank < design.shape[1]:
            break
        shift = shift + solved[:2]
        if np.hypot(*solved[:2]) < 0.1 * cell:
            break
    return best
