"""Orthoimages opened as references: any georeferenced raster that GDAL reads, in any CRS."""

from dataclasses import dataclass

import numpy as np
from osgeo import gdal

from ...block.orthoimage import Orthoimage
from .georeference import Georeference
from .images import GdalRaster


@dataclass(frozen=True, eq=False)
class BandMean:
    """The mean of an image's bands, which is what a panchromatic sensor sees of them; valid where all are."""

    bands: tuple[GdalRaster, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Number of samples and lines."""
        return self.bands[0].size

    def read(self, sample: int, line: int, samples: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
        """As `Raster.read`."""
        total, valid = np.zeros((lines, samples), dtype=np.float32), np.ones((lines, samples), dtype=bool)
        for band in self.bands:
            grey, known = band.read(sample, line, samples, lines)
            total += np.where(known, grey, 0)
            valid &= known
        return np.where(valid, total / np.float32(len(self.bands)), np.float32(0.0)), valid


def open_reference(path: str, band: int | None = None, epoch: float | None = None) -> Orthoimage:
    """Open an orthoimage.

    Parameters
    ----------
    path : str
        Any raster that GDAL opens, with a CRS and a geotransform.
    band : int, optional
        The band that is used, 1 is the first; by default the mean of all but alpha.
    epoch : float, optional
        Year in which a CRS fixed to a plate is brought to WGS84.

    Returns
    -------
    Orthoimage
        Its grey values on the ground.

    Raises
    ------
    InputError
        It cannot be opened, or has no CRS or geotransform.
    """
    first = GdalRaster(path, band or 1)
    place = Georeference(first.dataset, path, "orthoimage", epoch=epoch)
    shown = [
        number
        for number in range(1, first.dataset.RasterCount + 1)
        if first.dataset.GetRasterBand(number).GetColorInterpretation() != gdal.GCI_AlphaBand
    ]
    several = band is None and len(shown) > 1
    raster = BandMean(tuple(GdalRaster(path, number) for number in shown)) if several else first
    uses = place.operations.uses_at(path, place.nodes_lonlat())
    return Orthoimage(raster, place.to_grid, place.to_lonlat, path, uses)
