"""Orthoimages opened as references: any georeferenced raster that GDAL reads, in any CRS."""

from __future__ import annotations

from ..block.orthoimage import Orthoimage
from .georeference import Georeference
from .rasters import GdalRaster


def open_reference(path: str, band: int = 1) -> Orthoimage:
    """Open an orthoimage of which one band is used.

    Parameters
    ----------
    path : str
        Any raster that GDAL opens, with a CRS and a geotransform.
    band : int
        The band, 1 is the first.

    Returns
    -------
    Orthoimage
        Its grey values on the ground.

    Raises
    ------
    InputError
        It cannot be opened, or has no CRS or geotransform.
    """
    raster = GdalRaster(path, band)
    place = Georeference(raster.dataset, path, "orthoimage")
    return Orthoimage(raster, place.to_grid, place.to_lonlat, path)
