"""Georeference of a raster: longitude and latitude to column and row, and back."""

import threading

import numpy as np
import pyproj
from osgeo import gdal

from ...foundation.errors import InputError
from ...foundation.thresholds import EQUALITY
from ...ground.crs_operations import operations_of
from ...ground.geodesy import ground_difference_m, longitudes_near, wrap_degrees
from ...ground.proj_operations import without_heights
from .budgets import RASTER_BUDGETS


class Georeference:
    """Geotransform and CRS of a raster; columns and rows refer to the centre of the first pixel.

    ``what`` is its kind in messages: DEM, orthoimage. Raises `InputError` if CRS or geotransform is missing.

    If it is ``endless``, a raster around the complete Earth has no first column: its columns begin at the meridian
    opposite to the first point that is requested, so that the surroundings of that point are continuous. Column
    ``k`` is column ``(first + k) % turn`` of the file.
    """

    def __init__(
        self, dataset: gdal.Dataset, path: str, noun: str, endless: bool = False, epoch: float | None = None
    ) -> None:
        wkt = dataset.GetProjection()
        if not wkt:
            raise InputError(f"{path}: has no coordinate reference system: assign one (gdal_edit.py -a_srs EPSG:…)")
        try:
            self.crs = pyproj.CRS.from_wkt(wkt)
        except (pyproj.exceptions.CRSError, UnicodeError) as error:
            message = f"PROJ does not understand its CRS ({error}): assign one with gdal_edit.py"
            raise InputError(f"{path}: {message}") from None
        geotransform = dataset.GetGeoTransform(can_return_null=True)
        inverse = None if geotransform is None else gdal.InvGeoTransform(geotransform)
        if geotransform is None or inverse is None:
            raise InputError(f"{path}: has no geotransform, so its cells have no place: georeference the {noun}")
        self._geotransform, self._inverse = geotransform, inverse
        self.horizontal = without_heights(self.crs)
        self._geographic = bool(self.horizontal.is_geographic)
        try:
            self.operations = operations_of(self.horizontal.to_wkt(), epoch)
        except InputError as error:
            raise InputError(f"{path}: {error}, or assign another CRS with gdal_edit.py") from None
        self.first, self._size = 0, (dataset.RasterXSize, dataset.RasterYSize)
        # Check the position of the middle, and the size of the cells
        lonlat = self.to_lonlat(np.array(self._size) / 2.0 + [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        sides = np.linalg.norm(ground_difference_m(*(_at_height_0(lonlat[k]) for k in ([1, 2], [0, 0]))), axis=1)
        if not np.isfinite(lonlat).all() or np.abs(lonlat[:, 1]).max() > 90.0:
            raise InputError(f"{path}: its middle is nowhere on Earth: correct its geotransform and CRS")
        if sides.min() < RASTER_BUDGETS.cell_m[0] or sides.max() > RASTER_BUDGETS.cell_m[1]:
            raise InputError(f"{path}: its cells are {sides[0]:g} x {sides[1]:g} m: correct its geotransform and CRS")
        (west, _), (middle, _), (east, _) = self._xy(
            np.array([[0.0, 0.5], [0.5, 0.5], [1.0, 0.5]]) * [dataset.RasterXSize, dataset.RasterYSize]
        )
        self._middle_x, self._half_width = float(middle), min(180.0, 0.5 * abs(float(east - west)))
        # Columns of a whole turn, 0 for a raster that has an edge
        columns = 360.0 / geotransform[1] if endless and self._geographic and geotransform[1] > 0.0 else 0.0
        is_full_turn = abs(columns - round(columns)) < EQUALITY.file_px and round(columns) <= dataset.RasterXSize
        self.turn = round(columns) if is_full_turn else 0
        self._placed = not self.turn
        self._lock = threading.Lock()

    def to_grid(self, lonlat: np.ndarray) -> np.ndarray:
        """Return column and row of points ``(n, 2)`` lon, lat; (0, 0) is the centre of the first cell."""
        x, y = self.operations.from_wgs84(lonlat).T
        if not self._placed:
            self._begin_opposite(x)
        if self._geographic:
            x = longitudes_near(x, self._middle_x, self._half_width)
        x0, dx_column, dx_row, y0, dy_column, dy_row = self._inverse
        return np.column_stack(
            [x0 + dx_column * x + dx_row * y - 0.5 - self.first, y0 + dy_column * x + dy_row * y - 0.5]
        )  # corner to centre

    def _begin_opposite(self, lon_deg: np.ndarray) -> None:
        """Set the first column opposite to the first finite longitude."""
        with self._lock:
            finite = lon_deg[np.isfinite(lon_deg)]
            if self._placed or not len(finite):
                return
            x0, dx_column = self._inverse[:2]
            self.first = round(x0 + dx_column * float(finite[0]) - 0.5 * self.turn)
            self._middle_x = float((self.first + 0.5 * self.turn - x0) / dx_column)
            self._half_width = 180.0
            self._placed = True

    def to_map(self, grid: np.ndarray) -> np.ndarray:
        """Return map coordinates ``(n, 2)`` of columns and rows ``(n, 2)``."""
        return self._xy(grid + [self.first + 0.5, 0.5])

    def nodes_lonlat(self) -> np.ndarray:
        """Return lon, lat ``(n, 2)`` of nodes over the raster, without those for which there are none."""
        columns, rows = self._size
        node = np.stack(np.meshgrid(*(np.linspace(0.0, end, 5) for end in (columns - 1.0, rows - 1.0))), -1)
        lonlat = self.to_lonlat(node.reshape(-1, 2) - [self.first, 0.0])
        return lonlat[np.isfinite(lonlat).all(axis=1)]

    def to_lonlat(self, grid: np.ndarray) -> np.ndarray:
        """Return lon, lat ``(n, 2)`` of columns and rows ``(n, 2)``."""
        lonlat = self.operations.to_wgs84(_at_height_0(self.to_map(grid)))[:, :2]
        lonlat[:, 0] = wrap_degrees(lonlat[:, 0])
        return lonlat

    def _xy(self, corner: np.ndarray) -> np.ndarray:
        """Return map coordinates of GDAL's pixel and line ``(n, 2)``, which refer to the corner."""
        x0, dx_column, dx_row, y0, dy_column, dy_row = self._geotransform
        column, row = corner.T
        return np.column_stack([x0 + dx_column * column + dx_row * row, y0 + dy_column * column + dy_row * row])


def _at_height_0(xy: np.ndarray) -> np.ndarray:
    return np.column_stack([xy, np.zeros(len(xy))])
