"""The files of a folder: images, points, rasters of heights, reference orthoimages, laser points, others.

A raster is judged by its content: a band of signed or floating numbers on a map is a surface of heights, several bands
of whole numbers a picture. Every file gets a role and the reason for it.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.foundation.errors import HrsiError, InputError
from ...hrsi_engine.ground.map_crs import map_epsg_of
from ...hrsi_engine.io.catalogue.deliveries import resolve_images
from ...hrsi_engine.io.laser_files import read_laser
from ...hrsi_engine.io.opening.datasets import open_dataset
from ...hrsi_engine.io.output_dir import RESULT_FILES
from ...hrsi_engine.io.point_files.find import read_table
from ...hrsi_engine.io.point_files.ogr_layer import is_area
from ...hrsi_engine.io.rasters.dems import RasterKind, find_raster_kind
from ...hrsi_engine.io.rasters.images import open_image_and_source
from ...hrsi_engine.io.rpc_files.find import read_rpc_or_none, rpc_reader_of
from ..files.opening import require_ids
from .height_rasters import OWN_ENDING, HeightRaster, find_heights, merge_tiles, parts_of
from .point_sources import PointSource, read_sources

RASTER_ENDINGS = (
    ".tif", ".tiff", ".vrt", ".img", ".asc", ".hgt", ".dem", ".dt0", ".dt1", ".dt2", ".bil", ".flt", ".grd", ".jp2",
    ".gtx", ".pix", ".zip",
)  # fmt: skip
POINT_ENDINGS = (
    ".csv", ".tsv", ".txt", ".gz", ".gpkg", ".geojson", ".json", ".shp", ".points", ".gcp", ".kml", ".match",
    ".xml", ".db", ".xlsx", ".xls", ".ods", ".gpx", ".gml", ".fgb", ".kmz", ".dxf", ".tab", ".sqlite",
)  # fmt: skip
LASER_ENDINGS, CLOUD_ENDINGS = (".parquet", ".h5"), (".las", ".laz")
#: Fields of laser altimeters that surveys do not have.
LASER_FIELDS = {"slope", "misfit", "photons", "canopy", "rgt", "cycle"}
#: Results and truth of simulated blocks; inputs of a block have other names.
OWN_FILES = {*RESULT_FILES, "project.toml", "report.html", "truth.gpkg", "truth.json"}
BROKEN_IMAGE = "image, not used"  #: role of an image whose RPC cannot be read
ARCHIVE_ENDINGS = (".zip", ".tar", ".tgz", ".tar.gz")
PREVIEW_WORDS = re.compile(r"preview|quick.?look|browse|overview|thumb|(?<![a-z])icon", re.IGNORECASE)
COMPANIONS = (".dbf", ".shx", ".prj", ".cpg", ".qix", ".aux.xml", ".ovr", ".tfw", ".qpj", ".sbn", ".sbx", ".hdr")


@dataclass
class FileRole:
    """What a file is, and the reason; ``sure`` if its content shows it, not only its name."""

    path: str
    role: str
    reason: str = ""
    sure: bool = True


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

    Raises `InputError` if the folder contains no image with an RPC, or two with the same id.
    """
    files, results = _list_files(folder)
    opened = [open_image_and_source(one) for one in _find_images(folder, files, results)]
    require_ids([image.path for image, _ in opened], [image.id for image, _ in opened])
    images = {image.id: image for image, _ in opened}
    content = FolderContent(folder, list(images.values()), [])
    for image, found in opened:
        what = "image" if image.raster is not None else "RPC without pixels"
        size = "" if image.size is None else f"{image.size[0]} x {image.size[1]} px, "
        content.roles.append(FileRole(image.path, what, f"{size}{found.summary}"))
    content.roles += [FileRole(place, "earlier result", "not used") for place in results]
    paths = {image.path for image, _ in opened}
    virtual = [
        one for one in files if one.lower().endswith(".vrt") and one not in paths and not one.endswith(OWN_ENDING)
    ]
    wholes = [*(image.path for image in content.images if image.raster is not None), *virtual]
    parts = {part: os.path.basename(one) for one in wholes for part in parts_of(one, RASTER_ENDINGS)}
    content.roles += [FileRole(path, f"part of {owner}") for path, owner in parts.items() if path in files]
    outlines = [compute_footprint(image, image.middle_height_m).exterior.coords for image in content.images]
    corners = np.concatenate([np.asarray(outline)[:, :2] for outline in outlines])
    region = np.array([corners.min(axis=0), corners.max(axis=0)])
    own = [one for one in files if os.path.basename(one) in OWN_FILES or one.endswith(OWN_ENDING)]
    content.roles += [FileRole(path, "file of HRSI", "not used") for path in own]
    others = [one for one in files if one not in {*paths, *own, *parts} and not one.lower().endswith(COMPANIONS)]
    rasters = [one for one in others if one.lower().endswith(RASTER_ENDINGS)]
    content.roles += [role for path in rasters if (role := _judge_raster(content, path, region)) is not None]
    content.heights = merge_tiles(content.heights, region)
    # the CRSs of DEMs, in which points may be too
    flat = [crs.sub_crs_list[0] if crs.sub_crs_list else crs for one in content.heights if (crs := one.facts.crs)]
    names = [f"EPSG:{map_epsg_of(corners)}", *(one.to_string() for one in flat if one.is_projected)]
    _add_points(content, [one for one in others if one not in rasters], images, region, list(dict.fromkeys(names)))
    known = {one.path for one in content.roles} | {one.path.removeprefix("/vsigzip/") for one in content.sources}
    content.roles += [_describe_other(path, content.images) for path in others if path not in known]
    return content


def _list_files(folder: str) -> tuple[list[str], list[str]]:
    """Return the files below a folder, and the folders of earlier results, which are not searched."""
    files, results = list[str](), list[str]()
    for place, folders, names in os.walk(folder):
        if place != folder and (set(RESULT_FILES) & set(names) or "project.toml" in names):
            folders.clear()
            results.append(place)
        else:
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            files += [os.path.join(place, name) for name in sorted(names) if not name.startswith(".")]
    return files, results


def _find_images(folder: str, files: Sequence[str], results: Sequence[str]) -> list[str]:
    """Return the images below a folder, else in the archives there, without previews of others."""
    if not os.path.isdir(folder):
        raise InputError(f"{folder}: is no folder: name the folder of the images")
    try:
        found = resolve_images([folder], lambda text: None)
    except InputError:
        if not (archives := [one for one in files if one.lower().endswith(ARCHIVE_ENDINGS)]):
            raise
        found = resolve_images(archives, lambda text: None)
    found = tuple(one for one in found if not one.startswith(tuple(results)))
    paths = [one for one in found if not PREVIEW_WORDS.search(os.path.basename(one))] or list(found)
    if not paths:
        raise InputError(f"{folder}: has no image with an RPC next to earlier results: name the folder of the images")
    return paths


# ---- rasters --------------------------------------------------------------------------------------------------------


def _judge_raster(content: FolderContent, path: str, region: np.ndarray) -> FileRole | None:
    """Return the role of a raster without RPC, and add it to the heights or references; None if it shows none."""
    if PREVIEW_WORDS.search(os.path.basename(path)):
        return FileRole(path, "preview", "not used", sure=False)
    if not path.lower().endswith(ARCHIVE_ENDINGS) and (fault := _read_rpc(path)[1]):
        return FileRole(path, BROKEN_IMAGE, fault.removeprefix(f"{path}: "))
    try:
        facts = find_raster_kind(path)
        heights = find_heights(path, facts, region) if facts is not None else None
    except InputError as error:
        return FileRole(path, "raster, not used", str(error).removeprefix(f"{path}: "))
    if facts is None or (path.lower().endswith(ARCHIVE_ENDINGS) and heights is None):
        return None
    crs = facts.crs if heights is None else heights.facts.crs
    size = f"{facts.size[0]} x {facts.size[1]} cells, {crs.name if crs is not None else ''}"
    if heights is not None:
        content.heights.append(heights)
        size += f" ({heights.crs}, by the place of the images)" if heights.crs else ""
        return FileRole(path, "DSM" if heights.is_dsm else "DEM", size)
    if facts.kind is RasterKind.PICTURE:
        source = (dataset := open_dataset(path)[0]) and dataset.GetMetadataItem("HRSI_SOURCE")
        if any(source == os.path.basename(image.path) for image in content.images):
            return FileRole(path, "orthoimage of HRSI", f"not used: made from {source}, it is no control for it")
        content.references.append(path)
        return FileRole(path, "reference orthoimage", f"{facts.bands} bands, {size}")
    unused = {
        RasterKind.HEIGHTS: ("DEM, not used", "has no heights where the images lie"),
        RasterKind.UNPLACED: ("raster, not used", "has no RPC, and no CRS with a place near the images"),
    }
    return FileRole(path, *unused.get(facts.kind, (facts.kind.value, "not used")))


def _read_rpc(path: str) -> tuple[bool, str]:
    """Return whether a file has an RPC that can be read, and why it cannot be read; empty if it has none."""
    try:
        return read_rpc_or_none(path) is not None, ""
    except InputError as error:
        return False, str(error)


# ---- points ---------------------------------------------------------------------------------------------------------


def _add_points(
    content: FolderContent,
    paths: Sequence[str],
    images: Mapping[str, Image],
    region: np.ndarray,
    crs_names: Sequence[str],
) -> None:
    """Add laser points, point clouds and point files."""
    rpc_files = dict(_rpc_files(paths))
    for path, fault in rpc_files.items():
        # The image with this RPC, by the file that it was read from or by the product
        folder, name = os.path.split(path)
        product = os.path.join(folder, name.replace("RPC_", "DIM_", 1))
        owners = (one.path for one in content.roles if name in one.reason or one.path == product != path)
        owner = os.path.basename(next(owners, ""))
        belongs = f"of {owner}" if owner else "not used: its image is not here, or has another RPC"
        content.roles.append(FileRole(path, "RPC", f"not used: {fault}" if fault else belongs))
    points = []
    for path in (one for one in paths if one not in rpc_files):
        if path.lower().endswith(CLOUD_ENDINGS):
            content.clouds.append(path)
            content.roles.append(FileRole(path, "lidar point cloud"))
        elif path.lower().endswith(LASER_ENDINGS) or (path.lower().endswith(POINT_ENDINGS) and _has_laser_fields(path)):
            with suppress(HrsiError):
                content.roles.append(FileRole(path, "laser points", f"{len(read_laser(path))} points"))
                content.laser.append(path)
        elif path.lower().endswith(POINT_ENDINGS):
            points.append(f"/vsigzip/{os.path.abspath(path)}" if path.lower().endswith(".gz") else path)
    content.sources = read_sources(points, images, region, crs_names)


def _rpc_files(paths: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the RPC files, and the fault of those that cannot be read."""
    for path in (one for one in paths if not one.lower().endswith(ARCHIVE_ENDINGS)):
        with suppress(InputError):
            if rpc_reader_of(path):
                has_rpc, fault = _read_rpc(path)
                if has_rpc or (fault and not path.lower().endswith((".xml", ".dim"))):
                    yield path, fault.removeprefix(f"{path}: ")


def _has_laser_fields(path: str) -> bool:
    """Return whether a table has heights and at least two further fields of laser points."""
    with suppress(HrsiError):
        columns = read_table(path).columns
        return "height" in columns and len(LASER_FIELDS & columns.keys()) > 1
    return False


def _describe_other(path: str, images: Sequence[Image]) -> FileRole:
    """Return the role of a file that is not used: metadata of an image, an area, or unknown."""
    if path.lower().endswith(ARCHIVE_ENDINGS):
        used = any(path in one.path for one in images)
        return FileRole(path, "archive", "its images are used" if used else "not used: the images are here unpacked")
    owners = [one.path for one in images if path.startswith(os.path.splitext(one.path)[0])]
    if owners:
        return FileRole(path, "metadata", f"of {os.path.basename(max(owners, key=len))}", sure=False)
    if path.lower().endswith((".json", ".geojson", ".shp", ".gpkg", ".kml")) and is_area(path):
        return FileRole(path, "area", "footprint or area of interest, not used")
    return FileRole(path, "unknown", "not used", sure=False)
