"""Does a block without GCPs lie on the DEM that was named, though nothing holds it there?"""

from __future__ import annotations

import numpy as np

from ...hrsi_engine.adjustment.result import Adjustment
from ...hrsi_engine.block.block import Role
from ...hrsi_engine.foundation.robust_scale import robust_sigma
from ...hrsi_engine.surface.dem import surface_heights
from ..files.terrain import dem_surface
from ..interface.option_groups import DemOptions

LEAST_POINTS = 10
LEAST_OFFSET_M = 1.0  # grass, interpolation and a DEM's own errors may do so much
LIMIT = 4.0  # standard deviations of the median that an offset must exceed


def offset_warning(result: Adjustment, dem: DemOptions, height_datum: str, sigma_dem_m: float | None) -> list[str]:
    """Return a warning where the tie points of a block without GCPs lie clearly off the DEM, and it does not hold them.

    Orthoimages made with this DEM are then displaced against one another by the offset times the difference of the
    tangents of their view angles.
    """
    role = result.block.points.role
    if sigma_dem_m is not None or np.any(role == Role.GCP):
        return []
    surface = dem_surface(dem, height_datum)
    if surface is None:
        return []
    ground = result.ground[(role == Role.TIE) & np.isfinite(result.ground).all(axis=1)]
    above = ground[:, 2] - surface_heights(surface, ground[:, :2])
    above = above[np.isfinite(above)]
    if len(above) < LEAST_POINTS:
        return []
    middle = float(np.median(above))
    spread = float(robust_sigma(above - middle))
    if abs(middle) <= max(LEAST_OFFSET_M, LIMIT * 1.2533 * spread / np.sqrt(len(above))):
        return []
    return [
        f"the tie points lie {abs(middle):.1f} m {'above' if middle > 0.0 else 'below'} the DEM (median of "
        f"{len(above)}), and without GCPs nothing holds the block to it: orthoimages made with this DEM will not "
        "fit one another; give `sigma_dem_m`, the DEM's accuracy in metres"
    ]
