"""Does a DEM show the ground that the images show? Its relief against that of the adjusted tie points.

A right DEM differs from the tie points by its errors, trees and roofs, and by one height where their datums differ:
metres, however steep the ground is. A DEM that is displaced, mirrored, of another quantity or full of a value that
means no data differs by the relief itself. The displacement d of a DEM follows from the differences of the heights
(Nuth and Kääb, 2011), which grow with the slope::

    height of the point - height of the DEM = c + d · gradient of the DEM
"""

from __future__ import annotations

import numpy as np

from ..foundation.large_arrays import finite_rows
from ..foundation.reasons import Level, Reason
from ..foundation.robust_scale import robust_sigma
from ..ground.geodesy import metres_per_degree
from ..surface.dem import HeightSurface, cell_size_m, surface_heights

LEAST_COMPARED = 30
UNLIKE_M, UNLIKE_SHARE = 15.0, 0.5  # scatter of the differences: metres, and share of the relief's own
UNLIKE_SIGMAS = 5.0  # of the points' heights
FAR_OFF_M = 50.0  # of a DEM's height: no tree, house or change of the ground
FAR_OFF_POINTS, FAR_OFF_SHARE = 5, 0.01  # from which on it is no matter of a few wrong tie points
SAME_VALUE_M = 2.0  # within which undulations spread one value over a block
LEAST_CELLS, LEAST_SIGMAS = 2.0, 5.0  # of a displacement: cells of the DEM, sigmas of the block's place
MOST_LEFT, MOST_UNLIKE = 0.5, 0.2  # of the scatter, and of the relief, without the displacement
MOST_BEYOND = 0.3  # of the points may be beyond the DEM when it is moved
MOST_COMPARED = 20_000
MOST_STEPS = 12


def find_relief_reasons(
    ground: np.ndarray,
    surface: HeightSurface,
    sigma_plan_m: float = 0.0,
    sigma_h_m: float = 0.0,
    holds: bool = False,
) -> list[Reason]:
    """Return what says that a DEM does not show the ground of a block.

    Parameters
    ----------
    ground : (n, 3) ndarray
        Lon, lat, height of tie points as adjusted.
    surface : HeightSurface
        The DEM.
    sigma_plan_m : float
        Standard deviation of the block's place: 0 where GCPs hold it.
    sigma_h_m : float
        Standard deviation of the difference that points and DEM may have.
    holds : bool
        Whether the DEM alone holds the block's height.

    Returns
    -------
    list of Reason
        One at most; none where too few points have a height in the DEM.
    """
    ground = ground[:: 1 + len(ground) // MOST_COMPARED]
    of_dem = surface_heights(surface, ground[:, :2])
    inside = np.isfinite(of_dem)
    ground, of_dem = ground[inside], of_dem[inside]
    if len(ground) < LEAST_COMPARED:
        return []
    miss = ground[:, 2] - of_dem
    far = np.abs(miss - np.median(miss)) > FAR_OFF_M
    if max(FAR_OFF_POINTS, FAR_OFF_SHARE * len(far)) <= far.sum() < len(far):
        low, value, high = np.percentile(of_dem[far], [20.0, 50.0, 80.0])
        alone = abs(value - np.median(of_dem[~far])) > FAR_OFF_M
    else:
        low, value, high, alone = 0.0, 0.0, 0.0, False
    if alone and high - low < SAME_VALUE_M:
        return [
            Reason(
                "dem-nodata", Level.DOUBTFUL,
                f"the DEM has the height {value:.0f} m at {far.sum()} of {len(far)} tie points, whose ground is at "
                f"{np.median(ground[far, 2]):.0f} m: a value that means no data and is not declared",
                "declare it (gdal_translate -a_nodata), or name a DEM without holes",
            )
        ]  # fmt: skip
    scatter, relief = robust_sigma(miss - np.median(miss)), robust_sigma(ground[:, 2] - np.median(ground[:, 2]))
    east, north, left = _estimate_displacement(ground, surface)
    away = float(np.hypot(east, north))
    if left < min(MOST_LEFT * scatter, MOST_UNLIKE * relief) and away > max(
        LEAST_CELLS * cell_size_m(surface, ground[0]), LEAST_SIGMAS * sigma_plan_m
    ):
        return [
            Reason(
                "dem-displaced", Level.DOUBTFUL,
                f"the DEM lies {abs(east):.0f} m {'east' if east > 0.0 else 'west'} and {abs(north):.0f} m "
                f"{'north' if north > 0.0 else 'south'} of the block's ground: {len(ground)} tie points differ from it "
                f"by {scatter:.1f} m, and by {left:.1f} m without that",
                "check the DEM's georeference and CRS, and those of the ground points",
            )
        ]  # fmt: skip
    if scatter > max(UNLIKE_M, UNLIKE_SHARE * relief, UNLIKE_SIGMAS * sigma_h_m):
        return [
            Reason(
                "dem-unlike-ground", Level.UNUSABLE if holds else Level.DOUBTFUL,
                f"the heights of {len(ground)} tie points and the DEM differ by {scatter:.0f} m (robust standard "
                f"deviation), where the ground itself varies by {relief:.0f} m: it does not show this ground",
                "check that the file holds heights, in metres, of this place and the right way up",
            )
        ]  # fmt: skip
    return []


def _estimate_displacement(ground: np.ndarray, surface: HeightSurface) -> tuple[float, float, float]:
    """Return metres by which a DEM lies too far east and north, and the scatter of the differences without that."""
    cell = cell_size_m(surface, ground[0])
    degrees = 1.0 / metres_per_degree(ground)[:, :2]
    shift, step = np.zeros(2), 2.0 * cell
    best = (0.0, 0.0, np.inf)
    for _ in range(MOST_STEPS):
        at = ground[:, :2] + shift * degrees
        middle = surface_heights(surface, at)
        sides = [
            [surface_heights(surface, at + sign * step * np.eye(2)[axis] * degrees) for sign in (-1.0, 1.0)]
            for axis in (0, 1)
        ]
        gradient = np.column_stack([(high - low) / (2.0 * step) for low, high in sides])
        miss = ground[:, 2] - middle
        known = np.isfinite(miss) & finite_rows(gradient)
        if known.sum() < max(LEAST_COMPARED, (1.0 - MOST_BEYOND) * len(known)):
            break
        miss = miss[known] - np.median(miss[known])
        scatter = float(robust_sigma(miss))
        if scatter < best[2]:
            best = (float(shift[0]), float(shift[1]), scatter)
        used = np.abs(miss) <= 3.0 * scatter
        design = np.column_stack([gradient[known][used], np.ones(used.sum())])
        solved, _, rank, _ = np.linalg.lstsq(design, miss[used], rcond=None)
        if rank < design.shape[1]:
            break
        shift = shift + solved[:2]
        if np.hypot(*solved[:2]) < 0.1 * cell:
            break
    return best
