"""Surfaces from files: rasters, lidar clouds (LAS, LAZ), layers of points with heights, laser altimeter granules.

Points become a grid of about four points a cell, whose height is their mean; small gaps are interpolated. Of a cloud
only first returns are used, or ground points for a terrain model; noise and withheld points are not used.
"""

import os
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pyproj
from osgeo import gdal

from ..foundation.errors import InputError
from ..foundation.thresholds import MEMORY, threshold, thresholds
from ..ground.geodesy import continuous_longitudes, metres_per_degree
from ..surface.grid_surface import GridSurface
from .laser_files import HDF5_HEAD, read_laser
from .opening.datasets import open_dataset, read_head
from .point_files.find import split_spec
from .rasters.dems import fill_gaps, open_dem, surface_of_dataset

LAS_HEAD = b"LASF"
POINT_SUFFIXES = (".csv", ".txt", ".geojson", ".json", ".shp", ".parquet", ".fgb")
GROUND_CLASS, NOISE_CLASSES = 2, (7, 18)  # ASPRS LAS 1.4, table 17


@thresholds
class CLOUD:
    """Conversion of a point cloud to a grid of heights."""

    spacings: float = threshold(2.0, "spacings", "side of a cell: four points per cell")
    gap: int = threshold(3, "cells", "largest gap of a grid that is interpolated")


def is_cloud(path: str) -> bool:
    """Return whether a file is a lidar cloud (LAS, LAZ)."""
    return os.path.isfile(path) and read_head(path, len(LAS_HEAD)).startswith(LAS_HEAD)


def open_dtm(path: str, height_datum: str = "layer", epoch: float | None = None) -> GridSurface:
    """Open a DEM as `open_dem`; of a lidar cloud (LAS, LAZ) the ground points are used."""
    if is_cloud(path):
        return _open_cloud(path, height_datum, None, epoch, "dtm")
    return open_dem(path, height_datum, epoch)


def open_surface(
    spec: str, height_datum: str = "layer", ground_crs: str | None = None, epoch: float | None = None, kind: str = "dsm"
) -> GridSurface:
    """Open a surface of ellipsoidal heights.

    spec : a raster; a lidar cloud (LAS, LAZ); ``FILE[|layername=L]`` of points with heights; a granule of ICESat-2 or
    GEDI
    height_datum, ground_crs, epoch : as in `open_dem` and `read_laser`
    kind : with ``dtm`` only the ground points of a cloud are used

    Raises `InputError` if the file has no heights, or does not state their position.
    """
    path, layer = split_spec(spec)
    if is_cloud(path):
        return _open_cloud(path, height_datum, ground_crs, epoch, kind)
    head = read_head(path, len(HDF5_HEAD)) if os.path.isfile(path) else b""
    of_points = bool(layer) or head.startswith((HDF5_HEAD, b"PAR1")) or path.lower().endswith(POINT_SUFFIXES)
    if not of_points and (open_dataset(path)[0] is not None or not os.path.exists(path)):
        return open_dem(path, height_datum, epoch)
    points = read_laser(spec, height_datum, ground_crs, epoch)
    # The surface from positions (n, 3): lon, lat in degrees, ellipsoidal height in metres
    ground = points.ground[points.doubt == ""]
    ground = np.column_stack([continuous_longitudes(ground[:, 0]), ground[:, 1:]])
    scale = metres_per_degree(np.median(ground, axis=0)[None])[0, :2]
    xy = ground[:, :2] * scale
    sample = xy[:: 1 + len(xy) // MEMORY.rows]
    from scipy.spatial import KDTree

    spacing_m = float(np.median(KDTree(xy).query(sample, k=2)[0][:, 1])) if len(xy) > 1 else 0.0
    grid = _Grid(xy.min(axis=0), xy.max(axis=0), CLOUD.spacings * spacing_m, spec)
    grid.add(np.column_stack([xy, ground[:, 2]]))
    west, north = (grid.corner + 0.5 * grid.cell * np.array([1.0, -1.0])) / scale
    step = grid.cell / scale
    surface = GridSurface.from_array(grid.means, (west, north), (step[0], -step[1]))
    surface.operations = points.operations
    return fill_gaps(surface, CLOUD.gap)


class _Grid:
    """Sums of heights in the cells of a map grid; ``corner (2,)`` is its north-western corner, ``cell`` their side."""

    def __init__(self, low: np.ndarray, high: np.ndarray, cell: float, spec: str) -> None:
        extent = high - low
        if not np.isfinite(extent).all() or extent.min() <= 0.0:
            raise InputError(f"{spec}: its points have no extent in plan: name a surface that covers the block")
        self.cell = max(cell, float(np.sqrt(np.prod(extent) / MEMORY.cells)))
        self.corner, self.spec = np.array([low[0], high[1]]), spec
        self.columns, self.rows = (np.floor(extent / self.cell).astype(int) + 2).tolist()
        self._sums, self._counts = np.zeros((2, self.rows * self.columns))

    def add(self, xyz: np.ndarray) -> None:
        """Add points ``(n, 3)``."""
        column, row = np.floor((xyz[:, :2] - self.corner) / self.cell * [1.0, -1.0]).astype(np.int64).T
        inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows) & np.isfinite(xyz[:, 2])
        cells = (row * self.columns + column)[inside]
        self._sums += np.bincount(cells, xyz[inside, 2], len(self._sums))
        self._counts += np.bincount(cells, minlength=len(self._counts))

    @property
    def means(self) -> np.ndarray:
        """Mean heights ``(rows, columns)``, NaN for empty cells. Raises `InputError` if all are empty."""
        if not self._counts.any():
            raise InputError(f"{self.spec}: none of its points is usable: noise, withheld or of another class")
        with np.errstate(invalid="ignore"):
            return (self._sums / self._counts).reshape(self.rows, self.columns)


# ---- lidar clouds ----------------------------------------------------------------------------------------------------


def _open_cloud(path: str, height_datum: str, ground_crs: str | None, epoch: float | None, kind: str) -> GridSurface:
    """Return the surface of a lidar cloud; its cells are parallel to the axes of its own CRS."""
    try:
        import laspy
    except ImportError:
        raise InputError(
            f"{path}: reading LAS and LAZ needs laspy (pip install 'laspy[lazrs]'), or grid the cloud with PDAL and "
            "name the raster"
        ) from None
    try:
        with laspy.open(path) as file:
            header = file.header
            crs = header.parse_crs()
            low, high = (np.array(ends[:2], dtype=np.float64) for ends in (header.mins, header.maxs))
            area = float(np.prod(np.maximum(high - low, 0.0)))
            grid = _Grid(low, high, CLOUD.spacings * np.sqrt(area / max(header.point_count, 1)), path)
            for xyz in _read_points(file.chunk_iterator(MEMORY.values), kind):
                grid.add(xyz)
    except InputError:
        raise
    except Exception as error:  # laspy and lazrs have their own errors, and pass on those of damaged values
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read as LAS ({reason}): obtain it again") from None
    if crs is None and ground_crs is None:
        raise InputError(f"{path}: has no CRS: give it with `ground_crs`")
    crs = pyproj.CRS.from_user_input(ground_crs if crs is None else crs)
    # as a DEM with the same cells
    dataset = gdal.GetDriverByName("MEM").Create("", grid.columns, grid.rows, 1, gdal.GDT_Float64)
    dataset.SetGeoTransform((grid.corner[0], grid.cell, 0.0, grid.corner[1], 0.0, -grid.cell))
    dataset.SetProjection(crs.to_wkt("WKT1_GDAL" if len(crs.sub_crs_list) < 2 else "WKT2_2019"))
    band = dataset.GetRasterBand(1)
    factor = crs.axis_info[0].unit_conversion_factor if crs.is_projected and len(crs.sub_crs_list) < 2 else 1.0
    band.SetNoDataValue(np.nan)
    band.WriteArray(grid.means * factor)  # without a vertical CRS, heights are in the map's unit
    return fill_gaps(surface_of_dataset(dataset, path, height_datum, epoch), CLOUD.gap)


def _read_points(chunks: Iterable[Any], kind: str) -> Iterator[np.ndarray]:
    """Yield the usable points ``(n, 3)`` from the chunks of a cloud."""
    for chunk in chunks:
        kinds = np.asarray(chunk.classification)
        use = ~np.isin(kinds, NOISE_CLASSES)
        if "withheld" in chunk.point_format.dimension_names:
            use &= np.asarray(chunk.withheld) == 0
        use &= kinds == GROUND_CLASS if kind == "dtm" else np.asarray(chunk.return_number) <= 1
        yield np.column_stack([np.asarray(values)[use] for values in (chunk.x, chunk.y, chunk.z)])
