"""DEMs on disk as height surfaces: any raster and CRS that GDAL reads, with heights converted to the ellipsoid.

Geoid grids that the user names as files are checked before PROJ reads them. Small gaps of a DEM are interpolated when
it is read (`fill_gaps`).

What a raster without RPC is, by its content: heights, a picture on a map, a mask, or none of them.
"""

import os
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pyproj
from osgeo import gdal

from ...block.imaging_geometry import GEOMETRY
from ...foundation.errors import InputError
from ...foundation.thresholds import MEMORY, threshold, thresholds
from ...ground.crs_operations import operations_of
from ...ground.geoids import Geoid, find_geoid
from ...ground.operation_uses import OperationUse, with_geoid
from ...ground.proj_operations import has_heights
from ...surface.grid_surface import GridSurface
from ..opening.budgets import RASTER_BUDGETS, require_heights, require_raster
from ..opening.datasets import call_quiet, check_advice, metadata_of, open_dataset, require_plain
from ..opening.files import read_pixels
from ..opening.georeference import Georeference

#: Metres per unit of height, by the unit names of GDAL's drivers (lower case).
HEIGHT_UNITS_M = {
    "": 1.0, "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us-ft": 1200.0 / 3937.0, "us survey foot": 1200.0 / 3937.0,
}  # fmt: skip

ELLIPSOIDAL_DATUM = "ellipsoidal"
#: Metadata item of rasters whose CRS cannot state that their heights are ellipsoidal, and its content.
VERTICAL_DATUM, ELLIPSOIDAL_HEIGHTS = "VERTICAL_DATUM", "ellipsoidal heights above WGS84"
Undulations = Callable[[np.ndarray], np.ndarray]  # (n, 2) x, y in the DEM's CRS -> (n,) m to add


def open_dem(path: str, height_datum: str = "layer", epoch: float | None = None) -> GridSurface:
    """Open a DEM as a surface of ellipsoidal heights; its cells are read when they are needed.

    path : any raster that GDAL opens, with a geotransform and a CRS; the first band contains the heights
    height_datum : ``layer`` (as the CRS states), ``ellipsoidal``, ``egm96``, ``egm2008`` or a geoid grid file
    epoch : year at which coordinates in a plate-fixed CRS are transformed to WGS84
    Result: ellipsoidal heights; its ``operations`` describe the transformation to WGS84.
    Raises `InputError`: the file is no DEM, has no CRS, does not state its height datum, or a geoid grid is missing.
    """
    dataset, message = open_dataset(path)
    if dataset is None:
        advice = check_advice(path, "check the file")
        raise InputError(f"{path}: cannot be opened as a DEM ({message or 'no raster'}): {advice}")
    require_raster(path, dataset)
    return surface_of_dataset(dataset, path, height_datum, epoch)


def surface_of_dataset(dataset: gdal.Dataset, path: str, height_datum: str, epoch: float | None) -> GridSurface:
    """Return the surface of an open raster; arguments as in `open_dem`, messages name ``path``."""
    place = Georeference(dataset, path, "DEM", endless=True, epoch=epoch)
    is_stated = metadata_of(dataset).get(VERTICAL_DATUM) == ELLIPSOIDAL_HEIGHTS and not has_heights(place.crs)
    datum = ELLIPSOIDAL_DATUM if height_datum == "layer" and is_stated else height_datum
    undulations, operations = _find_heights(path, place, datum)
    reader = _DemReader(dataset, path, place, undulations)
    size = dataset.RasterYSize, place.turn or dataset.RasterXSize
    if min(size) < 2:
        raise InputError(
            f"{path}: has {size[1]} x {size[0]} cells, and a DEM an area of 2 x 2 at least: name another file"
        )
    return GridSurface(size, reader.read, place.to_grid, place.to_lonlat, operations)


def _find_heights(
    path: str, place: Georeference, height_datum: str
) -> tuple[Undulations | None, tuple[OperationUse, ...]]:
    """Return what is added to a DEM's heights (None for ellipsoidal ones), and its operations to WGS84."""
    flat = place.operations
    if height_datum == "layer" and not has_heights(place.crs):
        raise InputError(
            f"{path}: has no height datum: give egm96, egm2008, ellipsoidal or the file of a geoid grid with "
            "`dem_datum` (or `height_datum`)"
        )
    if height_datum == "layer":
        try:
            operations = operations_of(place.crs.to_wkt(), flat.epoch)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

        def find_offsets(xy: np.ndarray) -> np.ndarray:
            offsets = operations.height_offsets(xy)
            if not np.isfinite(offsets).all():
                raise InputError(
                    f"{path}: the grid for {operations.vertical_name!r} does not cover all points: use another datum"
                )
            return offsets

        return find_offsets, operations.uses_at(path, place.nodes_lonlat())
    uses = flat.uses_at(path, place.nodes_lonlat())
    if height_datum == ELLIPSOIDAL_DATUM:
        return None, uses
    geoid = open_geoid(height_datum)
    uses = tuple(use._replace(operation=with_geoid(use.operation, geoid), geoid=geoid) for use in uses)
    return lambda xy: read_geoid_heights(flat.to_wgs84(np.pad(xy, ((0, 0), (0, 1)))), geoid), uses


class _DemReader:
    """Reads windows of a DEM as ellipsoidal heights; for one thread at a time, which `GridSurface` ensures."""

    def __init__(self, dataset: gdal.Dataset, path: str, place: Georeference, undulations: Undulations | None) -> None:
        self._dataset, self._path, self._place, self._undulations = dataset, path, place, undulations
        band = dataset.GetRasterBand(1)
        self._scale, self._offset = band.GetScale() or 1.0, band.GetOffset() or 0.0
        # Metres per unit of height: from the band, else from the vertical part of the CRS
        unit, parts = (band.GetUnitType() or "").lower(), place.crs.sub_crs_list
        if unit not in HEIGHT_UNITS_M:
            raise InputError(
                f"{path}: heights are in {unit!r}, which is no unit of length known here: convert to metres"
            )
        has_own_unit = not unit and len(parts) > 1
        self._metres = float(parts[1].axis_info[0].unit_conversion_factor) if has_own_unit else HEIGHT_UNITS_M[unit]

    def read(self, row: int, column: int, rows: int, columns: int) -> np.ndarray:
        """Return the ellipsoidal heights of a window, NaN where there are none.

        Raises `InputError` if it cannot be read, contains impossible heights, or a geoid grid does not cover it.
        """
        turn, begin = self._place.turn, column + self._place.first
        if not turn:
            heights = self._read_heights(row, column, rows, columns)
        else:  # around the Earth: the window may continue at the first column
            begin %= turn
            columns_before = min(columns, turn - begin)
            heights = self._read_heights(row, begin, rows, columns_before)
            if columns_before < columns:
                heights = np.hstack([heights, self._read_heights(row, 0, rows, columns - columns_before)])
        finite = np.isfinite(heights)
        if self._undulations is not None and finite.any():
            i, j = np.nonzero(finite)
            cells = np.column_stack([column + j, row + i]).astype(np.float64)
            heights[finite] += self._undulations(self._place.to_map(cells))
        return heights

    def _read_heights(self, row: int, column: int, rows: int, columns: int) -> np.ndarray:
        """Return the heights of a window (m) as in the file, NaN where there are none."""
        (cells,), mask = read_pixels(self._path, self._dataset, [1], (column, row, columns, rows), masked=True)
        heights = (cells.astype(np.float64) * self._scale + self._offset) * self._metres
        heights[mask == 0] = np.nan
        heights[~np.isfinite(heights)] = np.nan
        require_heights(
            heights.ravel(), lambda i: f"{self._path}, row {row + i // columns}, column {column + i % columns}"
        )
        return np.asarray(heights)


def open_geoid(datum: str) -> Geoid:
    """Return the geoid model of `find_geoid`, without printed messages, after a check of the file.

    PROJ allocates memory for all cells that the header of a ``.gtx`` grid declares before it reads them; damage of
    other formats it reports itself. ``datum`` is ``egm96``, ``egm2008`` or the path of a grid; ``stands_for`` of the
    result names the model that it replaces. Raises `InputError` if the grid is missing or damaged.
    """
    require_plain(datum)
    if datum.lower().endswith(".gtx") and os.path.isfile(datum):
        with open(datum, "rb") as file:
            head = file.read(40)  # big-endian: latitude and longitude of the first cell, their steps, rows, columns
        rows, columns = struct.unpack(">4d2i", head)[4:] if len(head) == 40 else (0, 0)
        if min(rows, columns) < 2 or os.path.getsize(datum) < 40 + 4 * rows * columns:  # float32 follow
            raise InputError(
                f"{datum}: is no geoid grid: its header declares {rows} x {columns} cells, which the file does not "
                "contain: obtain it again"
            )
    return call_quiet(find_geoid, datum)


def read_geoid_heights(ground: np.ndarray, geoid: Geoid) -> np.ndarray:
    """Return the undulations ``(n,)`` of a geoid as `Geoid.heights`, without printed messages."""
    return call_quiet(geoid.heights, ground)


def fill_gaps(surface: GridSurface, cells: int) -> GridSurface:
    """Return a surface whose cells without height are interpolated from cells up to ``cells`` cells away.

    GDAL's interpolation by inverse distance; only the required part of the surface is read. Wider gaps remain.
    """

    def read(row: int, column: int, rows: int, columns: int) -> np.ndarray:
        low = np.array([column - cells, row - cells])
        high = np.array([column + columns - 1 + cells, row + rows - 1 + cells])
        first_row, first_column, heights = surface.window(low, high)
        finite = np.isfinite(heights)
        if finite.any() and not finite.all():
            dataset = gdal.GetDriverByName("MEM").Create("", *heights.shape[::-1], 2, gdal.GDT_Float64)
            band, mask = dataset.GetRasterBand(1), dataset.GetRasterBand(2)
            band.SetNoDataValue(np.nan)
            band.WriteArray(heights)
            mask.WriteArray(finite.astype(np.float64))
            gdal.FillNodata(band, mask, cells, 0)
            heights = np.asarray(band.ReadAsArray(), dtype=np.float64)
        top, left = row - first_row, column - first_column
        return heights[top : top + rows, left : left + columns]

    return GridSurface(surface.shape, read, surface.grid_coordinates, surface.to_lonlat, surface.operations)


class RasterKind(StrEnum):
    """What a raster is."""

    HEIGHTS = "heights"
    PICTURE = "picture"
    MASK = "mask"
    GEOID = "geoid grid"
    UNPLACED = "raster without position"


@thresholds
class RASTER_KINDS:
    """Sampling of a raster whose kind is determined."""

    mask_values: int = threshold(3, "values", "largest number of different values of a mask")


@dataclass(eq=False)
class RasterFacts:
    """Kind of a raster, its columns and rows, number of bands, CRS, and the surface of its heights.

    centre, cell : (2,) x, y of the middle, and size of a cell in x and y, in the CRS; None without geotransform
    nodata : value that is no height and is not declared as nodata, None if there is none
    surface : ellipsoidal heights, as stored if the CRS does not state their datum; None for other kinds
    """

    kind: RasterKind
    size: tuple[int, int]
    bands: int
    crs: pyproj.CRS | None = None
    centre: tuple[float, float] | None = None
    cell: tuple[float, float] = (1.0, 1.0)
    nodata: float | None = None
    surface: GridSurface | None = None


def find_raster_kind(path: str, crs: str = "") -> RasterFacts | None:
    """Return what a raster is; None if GDAL opens no raster. ``crs`` is that of a raster that states none."""
    dataset, _ = open_dataset(path)
    if dataset is None or dataset.RasterCount == 0:
        return None
    if crs:
        dataset = gdal.Translate("", dataset, format="VRT", outputSRS=crs)
    facts = RasterFacts(RasterKind.UNPLACED, (dataset.RasterXSize, dataset.RasterYSize), dataset.RasterCount)
    transform = dataset.GetGeoTransform(can_return_null=True)
    if transform is not None:
        facts.centre = tuple(gdal.ApplyGeoTransform(transform, 0.5 * facts.size[0], 0.5 * facts.size[1]))
        facts.cell = transform[1], transform[5]
    try:
        facts.crs = Georeference(dataset, path, "raster").crs
    except InputError:
        return facts
    name, band = os.path.basename(path).lower(), dataset.GetRasterBand(1)
    if name.endswith(".gtx") or "geoid" in name or "undulation" in name:
        facts.kind = RasterKind.GEOID
        return facts
    step = max(1, max(band.XSize, band.YSize) // MEMORY.window_px)
    values = band.ReadAsArray(buf_xsize=-(-band.XSize // step), buf_ysize=-(-band.YSize // step))
    values = np.empty(0) if values is None else np.asarray(values).ravel()
    if facts.bands == 1 and band.DataType not in (gdal.GDT_Byte, gdal.GDT_UInt16):
        values = values[values != band.GetNoDataValue()]
        # A fill value that the file does not state: the only one that is no height of the ground
        fills = np.unique(values[(values <= RASTER_BUDGETS.no_data_m) | (values > GEOMETRY.highest_height_m)])
        facts.kind, facts.nodata = RasterKind.HEIGHTS, float(fills[0]) if len(fills) == 1 else None
        heights = dataset if facts.nodata is None else gdal.Translate("", dataset, format="VRT", noData=facts.nodata)
        datum = "layer" if has_heights(facts.crs) else "ellipsoidal"
        facts.surface = surface_of_dataset(heights, path, datum, None)
        return facts
    is_mask = facts.bands == 1 and len(np.unique(values)) <= RASTER_KINDS.mask_values
    facts.kind = RasterKind.MASK if is_mask else RasterKind.PICTURE
    return facts


def write_virtual_raster(paths: Sequence[str], target: str, crs: str = "", nodata: float | None = None) -> None:
    """Write a virtual raster of one or several files, with the CRS and the nodata value that they do not state."""
    gdal.BuildVRT(target, list(paths), outputSRS=crs or None, srcNodata=nodata, VRTNodata=nodata)
