"""The files of a folder: images, points, rasters of heights, reference orthoimages, laser points, others.

A raster is judged by its content: a band of signed or floating numbers on a map is a surface of heights, several bands
of whole numbers a picture. Every file gets a role and the reason for it.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.foundation.errors import HrsiError, InputError
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.map_crs import map_epsg_of
from ...hrsi_engine.ground.proj_operations import has_heights
from ...hrsi_engine.io.catalogue.deliveries import resolve_images
from ...hrsi_engine.io.laser_files import read_laser
from ...hrsi_engine.io.opening.datasets import open_dataset
from ...hrsi_engine.io.output_dir import RESULT_FILES
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.ogr_layer import is_area
from ...hrsi_engine.io.rasters.images import open_image_and_source
from ...hrsi_engine.io.rasters.raster_kinds import RASTER_KINDS, RasterKind, find_raster_kind
from ...hrsi_engine.io.rpc_files.find import read_rpc_or_none, rpc_reader_of
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
#: Results and truth of simulated blocks; inputs of a block have other names.
OWN_FILES = {*RESULT_FILES, "project.toml", "report.html", "truth.gpkg", "truth.json"}
COMPANIONS = (".dbf", ".shx", ".prj", ".cpg", ".qix", ".aux.xml", ".ovr", ".tfw", ".qpj", ".sbn", ".sbx", ".hdr")


@thresholds
class RASTERS:
    """Limit for the interpolation of rasters."""

    widest_gap: int = threshold(1000, "cells", "widest gap of a DEM for interpolation", "maximum of `fill_gaps`")


@dataclass
class FileRole:
    """What a file is, and the reason; ``sure`` if its content shows it, not only its name."""

    path: str
    role: str
    reason: str = ""
    sure: bool = True


@dataclass
class HeightRaster:
    """A raster of heights: its height datum ('' if stated by the CRS, None if unknown), and gaps near the images.

    nodata : a value that means no height and is not declared; share : of the images' ground with heights
    """

    path: str
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
    parts = _parts_of(content.images)
    content.roles += [FileRole(path, f"part of {owner}") for path, owner in parts.items() if path in files]
    outlines = [compute_footprint(image, image.middle_height_m).exterior.coords for image in content.images]
    corners = np.concatenate([np.asarray(outline)[:, :2] for outline in outlines])
    region = np.array([corners.min(axis=0), corners.max(axis=0)])
    own = [one for one in files if os.path.basename(one) in OWN_FILES]
    content.roles += [FileRole(path, "file of HRSI", "not used") for path in own]
    others = [one for one in files if one not in {*paths, *own, *parts} and not one.lower().endswith(COMPANIONS)]
    rasters = [one for one in others if one.lower().endswith(RASTER_ENDINGS)]
    crs_names = [f"EPSG:{map_epsg_of(corners)}"]
    for path in rasters:
        _add_raster(content, path, region, crs_names)
    _add_points(content, [one for one in others if one not in rasters], images, region, crs_names)
    known = {one.path for one in content.roles} | {one.path.removeprefix("/vsigzip/") for one in content.sources}
    for path in others:
        if path not in known:
            content.roles.append(_describe_other(path, content.images))
    return content


def _parts_of(images: Sequence[Image]) -> dict[str, str]:
    """Return the other files of which images consist, with the name of the image: tiles, sources of virtual rasters."""
    parts = dict[str, str]()
    for image in images:
        dataset = open_dataset(image.path)[0] if image.raster is not None else None
        files = (dataset.GetFileList() or []) if dataset is not None else []
        ours = {os.path.abspath(one) for one in files if one.lower().endswith(RASTER_ENDINGS)} - {image.path}
        parts |= dict.fromkeys(sorted(ours), os.path.basename(image.path))
    return parts


# ---- rasters --------------------------------------------------------------------------------------------------------


def _add_raster(content: FolderContent, path: str, region: np.ndarray, crs_names: list[str]) -> None:
    """Add the role of a raster without RPC; ``crs_names`` gets the CRS of a DEM, in which points may be too."""
    try:
        facts = find_raster_kind(path)
        heights = _sample_heights(facts.surface, region) if facts is not None and facts.surface is not None else None
    except InputError as error:
        content.roles.append(FileRole(path, "raster, not used", str(error).removeprefix(f"{path}: ")))
        return
    if facts is None:
        return
    name = os.path.basename(path).lower()
    size = f"{facts.size[0]} x {facts.size[1]} cells, {facts.crs.name}" if facts.crs is not None else ""
    if facts.kind == RasterKind.PICTURE:
        content.references.append(path)
        content.roles.append(FileRole(path, "reference orthoimage", f"{facts.bands} bands, {size}"))
    elif facts.surface is None or facts.crs is None:
        content.roles.append(FileRole(path, facts.kind.value, "not used"))
    elif heights is None or not np.isfinite(heights[0]).any():
        content.roles.append(FileRole(path, "DEM, not used", "has no heights where the images lie"))
    else:
        known = np.isfinite(heights[0])
        holes = ndimage.binary_fill_holes(known) & ~known  # without the area beyond its edge
        gap = heights[1] * (2 + int(np.ceil(2.0 * ndimage.distance_transform_edt(holes).max()))) if holes.any() else 0
        datum = "" if has_heights(facts.crs) else state_datum(name, facts.crs.name)
        is_dsm = "dsm" in name or "surface" in name
        content.heights.append(HeightRaster(path, datum, facts.surface, is_dsm, facts.nodata,
                                            gap_cells=min(gap, RASTERS.widest_gap)))  # fmt: skip
        content.roles.append(FileRole(path, "DSM" if is_dsm else "DEM", size))
        flat = facts.crs.sub_crs_list[0] if facts.crs.sub_crs_list else facts.crs
        if flat.is_projected and (text := flat.to_string()) not in crs_names:
            crs_names.append(text)


def _sample_heights(surface: GridSurface, region: np.ndarray) -> tuple[np.ndarray, int] | None:
    """Return heights on a lattice of cells where the surface and the images' ground overlap, and its step in cells."""
    (west, south), (east, north) = region
    cells = surface.grid_coordinates(np.array([[west, south], [west, north], [east, south], [east, north]]))
    rows, columns = surface.shape
    low = np.maximum(np.floor(cells.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(cells.max(axis=0)), (columns - 1, rows - 1)).astype(int)
    if (high <= low).any():
        return None
    step = max(1, int((high - low).max()) // RASTER_KINDS.sample)
    column, row = np.meshgrid(np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step))
    heights = surface.heights(np.column_stack([column.ravel(), row.ravel()]).astype(np.float64))
    return heights.reshape(column.shape), step


# ---- points ---------------------------------------------------------------------------------------------------------


def _add_points(
    content: FolderContent, paths: Sequence[str], images: Mapping[str, Image], region: np.ndarray,
    crs_names: Sequence[str],
) -> None:  # fmt: skip
    """Add laser points, point clouds and point files."""
    rpc_files = set(_rpc_files(paths))
    for path in sorted(rpc_files):
        owner = _owner_of(path, content)
        belongs = f"of {owner}" if owner else "not used: its image is not here, or has another RPC"
        content.roles.append(FileRole(path, "RPC", belongs))
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


def _owner_of(path: str, content: FolderContent) -> str:
    """Return the name of the image with an RPC file; empty if it is of no image."""
    name = os.path.basename(path)
    product = os.path.join(os.path.dirname(path), name.replace("RPC_", "DIM_", 1))
    owners = (one.path for one in content.roles if name in one.reason or one.path == product != path)
    return os.path.basename(next(owners, ""))


def _rpc_files(paths: Sequence[str]) -> Iterator[str]:
    for path in paths:
        try:
            if rpc_reader_of(path) and read_rpc_or_none(path) is not None:
                yield path
        except InputError:
            continue


def _has_laser_fields(path: str) -> bool:
    try:
        columns = read_table(path).columns
    except HrsiError:
        return False
    return "height" in columns and len(LASER_FIELDS & columns.keys()) > 1


def _describe_other(path: str, images: Sequence[Image]) -> FileRole:
    """Return the role of a file that is not used: metadata of an image, an area, or unknown."""
    owners = [one.path for one in images if path.startswith(os.path.splitext(one.path)[0])]
    if owners:
        return FileRole(path, "metadata", f"of {os.path.basename(max(owners, key=len))}", sure=False)
    if path.lower().endswith((".json", ".geojson", ".shp", ".gpkg", ".kml")) and is_area(path):
        return FileRole(path, "area", "footprint or area of interest, not used")
    return FileRole(path, "unknown", "not used", sure=False)
