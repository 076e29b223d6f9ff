"""Options on the height of the ground, and the surface they name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..interface.declare import Kind, Param

if TYPE_CHECKING:
    import numpy as np

    from ...hrsi_engine.block.points import GroundPoints
    from ...hrsi_engine.surface.dem import HeightSurface

DATUMS = "layer|ellipsoidal|egm96|egm2008|FILE"
GROUND_CRS = Param(
    "ground-crs", Kind.CRS, "CRS of ground points whose file does not name one (EPSG:code or WKT)", metavar="CRS"
)
HEIGHT_DATUM = Param(
    "height-datum", Kind.TEXT,
    "What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96, egm2008 or a geoid "
    "grid file",
    default="layer", metavar=DATUMS,
)  # fmt: skip
DEM = Param("dem", Kind.RASTER, "DEM of the ground, in any CRS", metavar="FILE")
DEM_DATUM = Param(
    "dem-datum", Kind.TEXT, "What the heights of the DEM refer to, where it is not what --height-datum says",
    advanced=True, metavar=DATUMS,
)  # fmt: skip
TERRAIN_PARAMS = (
    DEM,
    Param("height", Kind.NUMBER, "Ellipsoidal height of the ground, instead of a DEM", unit="m", metavar="M"),
    HEIGHT_DATUM,
    DEM_DATUM,
)


def dem_datum(options: Mapping[str, Any]) -> str:
    """Return what the heights of the DEM refer to."""
    return options.get("dem_datum") or options["height_datum"]


def datum_warning(tables: Sequence[GroundPoints], surface: HeightSurface, options: Mapping[str, Any]) -> list[str]:
    """Return a warning where the heights of surveyed points and DEM seem to have different datums."""
    import numpy as np

    from ...hrsi_engine.ground import height_datum
    from ...hrsi_engine.surface.dem import surface_heights

    ground = np.concatenate([table.ground for table in tables])
    of_dem = surface_heights(surface, ground[:, :2])
    known = np.isfinite(of_dem) & np.isfinite(ground[:, 2])
    if not known.any():
        return []
    found = height_datum.height_difference(ground[known, 2], of_dem[known], _undulations(ground[known]))
    text = (
        ""
        if found is None
        else height_datum.height_difference_warning(found, tables[0].source or "the GCPs", options["dem"])
    )
    return [text] if text else []


def _undulations(ground: np.ndarray) -> np.ndarray:
    """Return the geoid's heights by any grid that is installed, NaN without one."""
    import numpy as np

    from ...hrsi_engine.foundation.errors import InputError
    from ...hrsi_engine.ground.geodesy import GEOID_GRIDS, geoid_heights

    for name in GEOID_GRIDS:
        try:
            return geoid_heights(ground, name)
        except InputError:
            continue
    return np.full(len(ground), np.nan)


def open_terrain(options: Mapping[str, Any]) -> HeightSurface | None:
    """Return the ground surface that the options name; None where they name none."""
    from ...hrsi_engine.foundation.errors import InputError
    from ...hrsi_engine.io.dems import open_dem
    from ...hrsi_engine.surface.dem import ConstantHeight

    if options["dem"] is not None and options["height"] is not None:
        raise InputError("--dem and --height both say how high the ground is: give one of them")
    if options["dem"] is not None:
        return open_dem(options["dem"], dem_datum(options))
    return None if options["height"] is None else ConstantHeight(options["height"])
