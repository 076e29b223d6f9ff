"""Options on the height of the ground, and the surface they name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...hrsi_engine.foundation.options import option
from ..interface.declare import Kind, made_options, params_of

if TYPE_CHECKING:
    from ...hrsi_engine.surface.dem import HeightSurface

DATUMS = "layer|ellipsoidal|egm96|egm2008|FILE"


def ground_crs_option() -> Any:
    """Return the field of the CRS of ground points."""
    return option(
        None, "CRS of ground points whose file does not name one (EPSG:code or WKT)", kind=Kind.CRS, metavar="CRS"
    )


def height_datum_option() -> Any:
    """Return the field of what heights refer to."""
    return option(
        "layer",
        "What heights of ground points and DEM refer to: layer (as their CRS says), ellipsoidal, egm96, egm2008 or a "
        "geoid grid file",
        metavar=DATUMS,
    )


def dem_datum_option() -> Any:
    """Return the field of what the heights of a DEM refer to."""
    return option(
        None,
        "What the heights of the DEM refer to, where it is not what `height_datum` says",
        advanced=True,
        metavar=DATUMS,
    )


@dataclass(frozen=True)
class DemOptions:
    """A DEM of the ground; ``height_datum``, which it shares with ground points, is theirs."""

    dem: str | None = option(None, "DEM of the ground, in any CRS", kind=Kind.RASTER, metavar="FILE")
    dem_datum: str | None = dem_datum_option()

    def surface(self, height_datum: str) -> HeightSurface | None:
        """Return the DEM, opened; None where there is none. ``height_datum`` counts where it has no own."""
        from ...hrsi_engine.io.dems import open_dem

        return open_dem(self.dem, self.dem_datum or height_datum) if self.dem else None


@dataclass(frozen=True)
class TerrainOptions:
    """How high the ground is: a DEM or one height."""

    dem: str | None = option(None, "DEM of the ground, in any CRS", kind=Kind.RASTER, metavar="FILE")
    height: float | None = option(None, "Ellipsoidal height of the ground, instead of a DEM", unit="m", metavar="M")
    height_datum: str = height_datum_option()
    dem_datum: str | None = dem_datum_option()


TERRAIN_PARAMS = params_of(TerrainOptions)
DEM, _, HEIGHT_DATUM, DEM_DATUM = TERRAIN_PARAMS


@dataclass(frozen=True)
class _GroundCrs:
    ground_crs: str | None = ground_crs_option()


(GROUND_CRS,) = params_of(_GroundCrs)


def dem_datum(options: Mapping[str, Any]) -> str:
    """Return what the heights of the DEM refer to."""
    return options.get("dem_datum") or options["height_datum"]


def open_terrain(options: TerrainOptions | Mapping[str, Any]) -> HeightSurface | None:
    """Return the ground surface that the options name; None where they name none."""
    from ...hrsi_engine.foundation.errors import InputError
    from ...hrsi_engine.io.dems import open_dem
    from ...hrsi_engine.surface.dem import ConstantHeight

    if isinstance(options, Mapping):
        options = made_options(TerrainOptions, options)
    if options.dem is not None and options.height is not None:
        raise InputError("`dem` and `height` both say how high the ground is: give one of them")
    if options.dem is not None:
        return open_dem(options.dem, options.dem_datum or options.height_datum)
    return None if options.height is None else ConstantHeight(options.height)
