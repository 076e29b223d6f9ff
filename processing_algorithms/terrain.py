"""Options on the height of the ground, and the surface they name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .declare import Kind, Param

if TYPE_CHECKING:
    from ..hrsi_engine.dem import HeightSurface

DATUMS = "layer|ellipsoidal|egm96|egm2008|FILE"
GROUND_CRS = Param(
    "ground-crs", Kind.TEXT, "CRS of ground points whose file does not name one (EPSG:code or WKT)", metavar="CRS"
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


def open_terrain(options: Mapping[str, Any]) -> HeightSurface | None:
    """Return the ground surface that the options name; None where they name none."""
    from ..hrsi_engine.dem import ConstantHeight
    from ..hrsi_engine.errors import InputError
    from ..hrsi_engine.io.dems import open_dem

    if options["dem"] is not None and options["height"] is not None:
        raise InputError("--dem and --height both say how high the ground is: give one of them")
    if options["dem"] is not None:
        return open_dem(options["dem"], dem_datum(options))
    return None if options["height"] is None else ConstantHeight(options["height"])
