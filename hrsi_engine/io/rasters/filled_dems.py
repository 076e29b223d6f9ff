"""DEMs whose small gaps are interpolated while they are read."""

import numpy as np
from osgeo import gdal

from ...surface.grid_surface import GridSurface


def fill_gaps(surface: GridSurface, cells: int) -> GridSurface:
    """Return a surface whose cells without height take those around them, found up to ``cells`` cells away.

    GDAL's interpolation by inverse distance; only as much of the surface as is needed is read. Wider gaps stay.
    """

    def read(row: int, column: int, rows: int, columns: int) -> np.ndarray:
        low = np.array([column - cells, row - cells])
        high = np.array([column + columns - 1 + cells, row + rows - 1 + cells])
        first_row, first_column, heights = surface.window(low, high)
        top, left = row - first_row, column - first_column
        return _fill_gaps(heights, cells)[top : top + rows, left : left + columns]

    return GridSurface(surface.shape, read, surface.grid_coordinates, surface.operations)


def _fill_gaps(heights: np.ndarray, cells: int) -> np.ndarray:
    """Return heights with their gaps (NaN) filled where there are others within reach."""
    known = np.isfinite(heights)
    if known.all() or not known.any():
        return heights
    rows, columns = heights.shape
    dataset = gdal.GetDriverByName("MEM").Create("", columns, rows, 2, gdal.GDT_Float64)
    band, mask = dataset.GetRasterBand(1), dataset.GetRasterBand(2)
    band.SetNoDataValue(np.nan)
    band.WriteArray(heights)
    mask.WriteArray(known.astype(np.float64))
    gdal.FillNodata(band, mask, cells, 0)
    return np.asarray(band.ReadAsArray(), dtype=np.float64)
