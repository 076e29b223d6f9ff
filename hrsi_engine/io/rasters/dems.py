"""DEMs on disk as height surfaces: any raster of GDAL's, any CRS, heights brought to the ellipsoid on reading."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pyproj
from osgeo import gdal

from ...foundation.errors import InputError
from ...ground.crs_operations import operations_of
from ...ground.operation_uses import OperationUse, with_geoid
from ...ground.proj_operations import has_heights
from ...surface.grid_surface import GridSurface
from ..opening.budgets import require_heights, require_raster
from ..opening.datasets import check_advice, gdal_messages, open_dataset
from .geoid_grids import open_geoid, read_geoid_heights
from .georeference import Georeference

#: Metres per unit of height, by the names that drivers give (lower case).
HEIGHT_UNITS_M = {
    "": 1.0, "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us-ft": 1200.0 / 3937.0, "us survey foot": 1200.0 / 3937.0,
}  # fmt: skip

Undulations = Callable[[np.ndarray], np.ndarray]  # (n, 2) x, y in the DEM's CRS -> (n,) m to add


def open_dem(path: str, height_datum: str = "layer", epoch: float | None = None) -> GridSurface:
    """Open a DEM as a surface of ellipsoidal heights; its cells are read when they are needed.

    Parameters
    ----------
    path : str
        Any raster that GDAL opens, with a geotransform and a CRS; the first band holds the heights.
    height_datum : str
        ``layer`` (as the CRS of the file says), ``ellipsoidal``, ``egm96``, ``egm2008`` or a geoid grid file.
    epoch : float, optional
        Year in which a CRS fixed to a plate is brought to WGS84.

    Returns
    -------
    GridSurface
        Ellipsoidal heights; its ``operations`` say how it came to WGS84.

    Raises
    ------
    InputError
        The file is no DEM, has no CRS, does not say what its heights refer to, or a geoid grid is missing.
    """
    dataset, message = open_dataset(path)
    if dataset is None:
        advice = check_advice(path, "check the file")
        raise InputError(f"{path}: cannot be opened as a DEM ({message or 'no raster'}): {advice}")
    require_raster(path, dataset)
    place = Georeference(dataset, path, "DEM", endless=True, epoch=epoch)
    heights = _find_heights(path, place, height_datum)
    reader = _DemReader(dataset, path, place, heights.undulations)
    size = dataset.RasterYSize, place.turn or dataset.RasterXSize
    return GridSurface(size, reader.read, place.to_grid, heights.operations)


class _Heights(NamedTuple):
    """What is to be added to a DEM's heights at map coordinates ``(n, 2)``, None for ellipsoidal ones; and why."""

    undulations: Undulations | None
    operations: tuple[OperationUse, ...]


def _find_heights(path: str, place: Georeference, height_datum: str) -> _Heights:
    """Return how a DEM's heights become ellipsoidal, and how it comes to WGS84."""
    flat = place.operations
    if height_datum == "layer" and not has_heights(place.crs):
        raise InputError(
            f"{path}: does not say what its heights refer to: name egm96, egm2008, ellipsoidal or the file of a geoid "
            "grid with `dem_datum` or `height_datum`, whichever the command has"
        )
    if height_datum == "layer":
        try:
            own = operations_of(place.crs.to_wkt(), flat.epoch)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        return _Heights(lambda xy: _require_coverage(own.height_offsets(xy), path, own.vertical_name),
                        own.uses_at(path, place.nodes_lonlat()))  # fmt: skip
    uses = flat.uses_at(path, place.nodes_lonlat())
    if height_datum == "ellipsoidal":
        return _Heights(None, uses)
    geoid = open_geoid(height_datum)
    uses = tuple(use._replace(operation=with_geoid(use.operation, geoid), geoid=geoid) for use in uses)
    return _Heights(lambda xy: read_geoid_heights(flat.to_wgs84(np.pad(xy, ((0, 0), (0, 1)))), geoid), uses)


def _require_coverage(undulations: np.ndarray, path: str, datum: str) -> np.ndarray:
    """Return undulations; raises `InputError` where there are none."""
    if not np.isfinite(undulations).all():
        raise InputError(f"{path}: the grid for {datum!r} does not cover all points: use another datum")
    return undulations


def _metres_per_unit(band: gdal.Band, crs: pyproj.CRS, path: str) -> float:
    """Return metres per unit of height: as the band says, else as the vertical part of the CRS says."""
    unit = (band.GetUnitType() or "").lower()
    if unit not in HEIGHT_UNITS_M:
        raise InputError(f"{path}: heights are in {unit!r}, which is no unit of length known here: convert to metres")
    if not unit and len(crs.sub_crs_list) > 1:
        return float(crs.sub_crs_list[1].axis_info[0].unit_conversion_factor)
    return HEIGHT_UNITS_M[unit]


class _DemReader:
    """Reads windows of a DEM and places its cells; used by one thread at a time (`GridSurface` sees to that)."""

    def __init__(self, dataset: gdal.Dataset, path: str, place: Georeference, undulations: Undulations | None) -> None:
        self._dataset, self._path, self._place, self._undulations = dataset, path, place, undulations
        band = dataset.GetRasterBand(1)
        self._scale, self._offset = band.GetScale() or 1.0, band.GetOffset() or 0.0
        self._metres = _metres_per_unit(band, place.crs, path)

    def _cell_name(self, row: int, column: int) -> str:
        return f"{self._path}, row {row}, column {column}"

    def read(self, row: int, column: int, rows: int, columns: int) -> np.ndarray:
        """Return a window's ellipsoidal heights, NaN where there are none.

        Raises `InputError` where it cannot be read, holds what is no height, or a geoid grid does not cover it.
        """
        turn, begin = self._place.turn, column + self._place.first
        if not turn:
            heights = self._read_heights(row, column, rows, columns)
        else:  # round the Earth: the window may go on with the file's first column
            begin %= turn
            before = min(columns, turn - begin)
            heights = self._read_heights(row, begin, rows, before)
            if before < columns:
                heights = np.hstack([heights, self._read_heights(row, 0, rows, columns - before)])
        known = np.isfinite(heights)
        if self._undulations is not None and known.any():
            i, j = np.nonzero(known)
            cells = np.column_stack([column + j, row + i]).astype(np.float64)
            heights[known] += self._undulations(self._place.to_map(cells))
        return heights

    def _read_heights(self, row: int, column: int, rows: int, columns: int) -> np.ndarray:
        """Return a window's heights (m) as the file has them, NaN where there are none."""
        band, cells, mask = self._dataset.GetRasterBand(1), None, None
        with gdal_messages() as messages:
            cells = band.ReadAsArray(column, row, columns, rows)
            mask = band.GetMaskBand().ReadAsArray(column, row, columns, rows)
        if cells is None or mask is None:
            reason = messages[-1] if messages else "unknown reason"
            raise InputError(f"{self._path}: heights at row {row}, column {column} cannot be read ({reason})")
        heights = (cells.astype(np.float64) * self._scale + self._offset) * self._metres
        heights[mask == 0] = np.nan
        heights[~np.isfinite(heights)] = np.nan
        require_heights(heights.ravel(), lambda cell: self._cell_name(row + cell // columns, column + cell % columns))
        return np.asarray(heights)
