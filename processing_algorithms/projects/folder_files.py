"""The files of a folder: images, points, rasters of heights, reference orthoimages, laser points, others.

A raster is judged by its content: a band of signed or floating numbers on a map is a surface of heights, several bands
of whole numbers a picture. Every file gets a role and the reason for it.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from osgeo import gdal
from scipy import ndimage

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.foundation.errors import HrsiError, InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.map_crs import map_epsg_of
from ...hrsi_engine.ground.proj_operations import has_heights
from ...hrsi_engine.io.catalogue.deliveries import resolve_images
from ...hrsi_engine.io.laser_files import read_laser
from ...hrsi_engine.io.opening.budgets import GROUND_HEIGHTS
from ...hrsi_engine.io.opening.datasets import open_dataset
from ...hrsi_engine.io.output_dir import RESULT_FILES
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.rasters.dems import surface_of_dataset
from ...hrsi_engine.io.rasters.georeference import Georeference
from ...hrsi_engine.io.rasters.images import open_image_and_source
from ...hrsi_engine.io.rpc_files.find import rpc_reader_of
from ...hrsi_engine.surface.grid_surface import GridSurface
from .point_sources import PointSource, read_sources, state_datum

RASTER_ENDINGS = (
    ".tif", ".tiff", ".vrt", ".img", ".asc", ".hgt", ".dem", ".dt0", ".dt1", ".dt2", ".bil", ".flt", ".grd", ".jp2",
    ".gtx", ".pix", ".zip",
)  # fmt: skip
POINT_ENDINGS = (
    ".csv", ".tsv", ".txt", ".tab", ".gz", ".gpkg", ".geojson", ".json", ".shp", ".points", ".gcp", ".kml", ".match",
    ".xml", ".db",
)  # fmt: skip
LASER_ENDINGS, CLOUD_ENDINGS = (".parquet", ".h5"), (".las", ".laz")
#: Fields of laser altimeters that surveys do not have.
LASER_FIELDS = {"slope", "misfit", "photons", "canopy", "rgt", "cycle"}
COMPANIONS = (".dbf", ".shx", ".prj", ".cpg", ".qix", ".aux.xml", ".ovr", ".tfw", ".qpj", ".sbn", ".sbx", ".hdr")


@thresholds
class RASTERS:
    """Sampling of the rasters of a folder."""

    nodes: int = threshold(600, "nodes", "largest number of heights along a side that are read to find gaps of a DEM")
    widest_gap: int = threshold(1000, "cells", "widest gap of a DEM for interpolation", "maximum of `fill_gaps`")
    mask_values: int = threshold(3, "values", "largest number of grey values of a mask")


@dataclass
class FileRole:
    """What a file is, and the reason; ``sure`` if its content shows it, not only its name."""

    path: str
    role: str
    reason: str = ""
    sure: bool = True


@dataclass
class HeightRaster:
    """A raster of heights: its CRS, height datum ('' if stated by the CRS, None if unknown), and gaps near the images.

    nodata : a value that means no height and is not declared; share : of the images' ground with heights
    """

    path: str
    crs: str
    datum: str | None
    surface: GridSurface
    is_dsm: bool = False
    nodata: float | None = None
    share: float = 0.0
    gap_cells: int = 0


@dataclass
class FolderContent:
    """Everything that was found in a folder."""

    folder: str
    images: list[Image]
    roles: list[FileRole]
    sources: list[PointSource] = field(default_factory=list)
    heights: list[HeightRaster] = field(default_factory=list)
    references: list[str] = field(default_factory=list)
    laser: list[str] = field(default_factory=list)
    clouds: list[str] = field(default_factory=list)


def read_folder(folder: str) -> FolderContent:
    """Open all files of a folder and return what they are.

    Raises `InputError` if the folder contains no image with an RPC.
    """
    files, results = list[str](), list[str]()
    for place, folders, names in os.walk(folder):
        if place != folder and (set(RESULT_FILES) & set(names) or "project.toml" in names):
            folders.clear()
            results.append(place)
        else:
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            files += [os.path.join(place, name) for name in sorted(names) if not name.startswith(".")]
    paths = resolve_images([folder], lambda text: None) if os.path.isdir(folder) else ()
    opened = [open_image_and_source(one) for one in paths if not any(one.startswith(place) for place in results)]
    if not opened:
        raise InputError(f"{folder}: contains no image with an RPC: name the folder of the images")
    images = {image.id: image for image, _ in opened}
    content = FolderContent(folder, list(images.values()), [])
    for image, found in opened:
        what = "image" if image.raster is not None else "RPC without pixels"
        size = "" if image.size is None else f"{image.size[0]} x {image.size[1]} px, "
        content.roles.append(FileRole(image.path, what, f"{size}{found.summary}"))
    content.roles += [FileRole(place, "earlier result", "not used") for place in results]
    outlines = [compute_footprint(image, image.middle_height_m).exterior.coords for image in content.images]
    corners = np.concatenate([np.asarray(outline)[:, :2] for outline in outlines])
    region = np.array([corners.min(axis=0), corners.max(axis=0)])
    others = [one for one in files if one not in paths and not one.lower().endswith(COMPANIONS)]
    rasters = [one for one in others if one.lower().endswith(RASTER_ENDINGS)]
    crs_names = [f"EPSG:{map_epsg_of(corners)}"]
    for path in rasters:
        _add_raster(content, path, region, crs_names)
    _add_points(content, [one for one in others if one not in rasters], images, region, crs_names)
    known = {one.path for one in content.roles} | {one.path.removeprefix("/vsigzip/") for one in content.sources}
    for path in others:
        if path not in known and os.path.basename(path) != "project.toml":
            content.roles.append(_describe_other(path))
    return content


# ---- rasters --------------------------------------------------------------------------------------------------------


def _add_raster(content: FolderContent, path: str, region: np.ndarray, crs_names: list[str]) -> None:
    """Add the role of a raster without RPC."""
    name = os.path.basename(path).lower()
    dataset, _ = open_dataset(path)
    if dataset is None or dataset.RasterCount == 0:
        return
    try:
        crs = Georeference(dataset, path, "raster").crs
    except InputError as error:
        content.roles.append(FileRole(path, "raster, not used", str(error).partition(": ")[2].partition(":")[0]))
        return
    if path.lower().endswith(".gtx") or "geoid" in name or "undulation" in name:
        content.roles.append(FileRole(path, "geoid grid", "can be named as height datum"))
        return
    if dataset.RasterCount == 1 and dataset.GetRasterBand(1).DataType not in (gdal.GDT_Byte, gdal.GDT_UInt16):
        found = open_heights(dataset, path, has_heights(crs), crs.name, region)
        if found is None:
            content.roles.append(FileRole(path, "DEM, not used", "has no heights where the images lie"))
            return
        content.heights.append(found)
        kind = "DSM" if found.is_dsm else "DEM"
        size = f"{dataset.RasterXSize} x {dataset.RasterYSize} cells, {crs.name}"
        content.roles.append(FileRole(path, kind, size))
        flat = crs.sub_crs_list[0] if crs.sub_crs_list else crs
        if flat.is_projected and (text := flat.to_string()) not in crs_names:
            crs_names.append(text)  # points may be in it
        return
    step = max(1, max(dataset.RasterXSize, dataset.RasterYSize) // 200)
    sample = dataset.GetRasterBand(1).ReadAsArray(
        buf_xsize=-(-dataset.RasterXSize // step), buf_ysize=-(-dataset.RasterYSize // step)
    )
    if dataset.RasterCount == 1 and len(np.unique(sample)) <= RASTERS.mask_values:
        content.roles.append(FileRole(path, "mask", "not used"))
        return
    content.references.append(path)
    content.roles.append(FileRole(path, "reference orthoimage", f"{dataset.RasterCount} bands, {crs.name}"))


def open_heights(dataset: Any, path: str, is_stated: bool, crs_name: str, region: np.ndarray) -> HeightRaster | None:
    """Return a raster of heights with its gaps near the images; None if it has no heights there."""
    nodata = None
    band = dataset.GetRasterBand(1)
    try:
        surface = surface_of_dataset(dataset, path, "ellipsoidal", None)
        heights = _sample_heights(surface, region)
    except InputError:  # heights of no ground: a value that means nodata is not declared
        nodata = _find_fill_value(band)
        if nodata is None:
            return None
        surface = surface_of_dataset(declare_nodata(dataset, nodata), path, "ellipsoidal", None)
        heights = _sample_heights(surface, region)
    if heights is None or not np.isfinite(heights[0]).any():
        return None
    name = os.path.basename(path).lower()
    known = np.isfinite(heights[0])
    holes = ndimage.binary_fill_holes(known) & ~known  # without the area beyond its edge
    gap = heights[1] * (2 + int(np.ceil(2.0 * ndimage.distance_transform_edt(holes).max()))) if holes.any() else 0
    datum = "" if is_stated else state_datum(name, crs_name)
    gap = min(gap, RASTERS.widest_gap)
    return HeightRaster(path, crs_name, datum, surface, "dsm" in name or "surface" in name, nodata, gap_cells=gap)


def _sample_heights(surface: GridSurface, region: np.ndarray) -> tuple[np.ndarray, int] | None:
    """Return heights on a lattice of cells where the surface and the images' ground overlap, and its step in cells."""
    (west, south), (east, north) = region
    cells = surface.grid_coordinates(np.array([[west, south], [west, north], [east, south], [east, north]]))
    rows, columns = surface.shape
    low = np.maximum(np.floor(cells.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(cells.max(axis=0)), (columns - 1, rows - 1)).astype(int)
    if (high <= low).any():
        return None
    step = max(1, int((high - low).max()) // RASTERS.nodes)
    column, row = np.meshgrid(np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step))
    heights = surface.heights(np.column_stack([column.ravel(), row.ravel()]).astype(np.float64))
    return heights.reshape(column.shape), step


def _find_fill_value(band: Any) -> float | None:
    """Return the value of a band that is no height on Earth and is repeated; None if there is none."""
    step = max(1, max(band.XSize, band.YSize) // RASTERS.nodes)
    values = band.ReadAsArray(buf_xsize=-(-band.XSize // step), buf_ysize=-(-band.YSize // step)).ravel()
    wrong = (values < GROUND_HEIGHTS.lowest_m) | (values > GROUND_HEIGHTS.highest_m)
    wrong |= values == GROUND_HEIGHTS.no_data_m
    fills = np.unique(values[wrong])
    return float(fills[0]) if len(fills) == 1 else None


def declare_nodata(dataset: Any, nodata: float, path: str = "") -> Any:
    """Return a virtual raster of a dataset that declares its nodata value; with a path it is written there."""
    return gdal.Translate(path, dataset, format="VRT", noData=nodata)


# ---- points ---------------------------------------------------------------------------------------------------------


def _add_points(
    content: FolderContent, paths: Sequence[str], images: Mapping[str, Image], region: np.ndarray,
    crs_names: Sequence[str],
) -> None:  # fmt: skip
    """Add laser points, point clouds and point files."""
    rpc_files = set(_rpc_files(paths))
    content.roles += [FileRole(path, "RPC", "not used: its image is not here, or has another RPC") for path in
                      sorted(rpc_files)]  # fmt: skip
    points = []
    for path in (one for one in paths if one not in rpc_files):
        if path.lower().endswith(CLOUD_ENDINGS):
            content.clouds.append(path)
            content.roles.append(FileRole(path, "lidar point cloud"))
        elif path.lower().endswith(LASER_ENDINGS) or (path.lower().endswith(POINT_ENDINGS) and _has_laser_fields(path)):
            try:
                count = len(read_laser(path))
            except HrsiError:
                continue
            content.laser.append(path)
            content.roles.append(FileRole(path, "laser points", f"{count} points"))
        elif path.lower().endswith(POINT_ENDINGS):
            points.append(f"/vsigzip/{os.path.abspath(path)}" if path.lower().endswith(".gz") else path)
    content.sources = read_sources(points, images, region, crs_names)


def _rpc_files(paths: Sequence[str]) -> Iterator[str]:
    for path in paths:
        try:
            if rpc_reader_of(path):
                yield path
        except InputError:
            continue


def _has_laser_fields(path: str) -> bool:
    try:
        columns = read_table(path).columns
    except HrsiError:
        return False
    return "height" in columns and len(LASER_FIELDS & columns.keys()) > 1


def _describe_other(path: str) -> FileRole:
    """Return the role of a file that is not used: an area, or unknown."""
    if path.lower().endswith((".json", ".geojson", ".shp", ".gpkg", ".kml")):
        vector = gdal.OpenEx(path, gdal.OF_VECTOR)
        layer = vector.GetLayer(0) if vector is not None and vector.GetLayerCount() else None
        feature = layer.GetNextFeature() if layer is not None else None
        shape = feature.GetGeometryRef() if feature is not None else None
        if shape is not None and "POLYGON" in shape.GetGeometryName():
            return FileRole(path, "area", "footprint or area of interest, not used")
    return FileRole(path, "unknown", "not used", sure=False)
