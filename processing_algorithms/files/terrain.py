"""Options on the height of the ground, and the surface they name."""

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.ground.operation_uses import require_strict_datums
from ...hrsi_engine.io.rasters.dems import open_dem
from ...hrsi_engine.surface.dem import HeightSurface
from ...hrsi_engine.surface.grid_surface import ConstantHeight, GridSurface
from ..interface.option_groups import DemOptions, TerrainOptions


def dem_surface(dem: DemOptions, height_datum: str, epoch: float | None = None) -> GridSurface | None:
    """Return the DEM that options name, opened; None without. ``height_datum`` counts where it has no own."""
    return open_dem(dem.dem, dem.dem_datum or height_datum, epoch) if dem.dem else None


def open_terrain(options: TerrainOptions) -> HeightSurface | None:
    """Return the ground surface that the options name; None where they name none."""
    if options.dem.dem is not None and options.height is not None:
        raise InputError("`dem` and `height` both say how high the ground is: give one of them")
    if options.height is not None:
        return ConstantHeight(options.height)
    surface = dem_surface(options.dem, options.height_datum)
    if surface is not None:
        require_strict_datums(surface.operations, options.strict_datum)
    return surface
