"""`hrsi init FOLDER`: a project file from what a folder holds: images with RPCs, point files, a DEM.

What was understood stands beside it in comments, for a person to correct: columns, CRS, how many ids are measured.
"""

import os
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from osgeo import gdal
from scipy import ndimage

from ...hrsi_engine.block.block import Image
from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.block.points import GroundPoints, ImagePoints
from ...hrsi_engine.foundation.errors import HrsiError, InputError, list_ids
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.map_crs import map_epsg_of
from ...hrsi_engine.io.catalogue.deliveries import IMAGE_ENDINGS, resolve_images
from ...hrsi_engine.io.opening.datasets import open_dataset, quiet
from ...hrsi_engine.io.output_dir import RESULT_FILES
from ...hrsi_engine.io.pages.report import write_text
from ...hrsi_engine.io.point_files import read_points
from ...hrsi_engine.io.rasters.images import open_image
from ...hrsi_engine.io.rpc_files import rpc_reader_of
from .project_file import project_schema

POINT_ENDINGS = (".csv", ".tsv", ".txt", ".tab", ".gpkg", ".geojson", ".shp", ".points")
PROJECT_FILE, SCHEMA_FILE = "project.toml", "project.schema.json"


@thresholds
class INFERENCE:
    """What a file of a folder is taken for."""

    beyond_deg: float = threshold(0.5, "degree", "distance of ground points from the images' footprints")
    probe_px: int = threshold(2000, "px", "samples and lines of a DEM that are read to see its gaps")
    widest_gap: int = threshold(1000, "cells", "widest gap of a DEM that is bridged", "most that `fill_gaps` takes")


class FoundPoints(NamedTuple):
    """A point file, how it is named and read, and what it holds."""

    spec: str
    crs: str
    told: str
    ground: GroundPoints | None
    image: ImagePoints | None


def write_project(folder: str, path: str, overwrite: bool, log: Callable[[str], None]) -> list[str]:
    """Write the project file of a folder and its schema beside it; return their paths.

    Raises `InputError` where the folder holds no image with an RPC, or the file is there.
    """
    if os.path.exists(path) and not overwrite:
        raise InputError(f"{path} exists: allow `overwrite`, or name another file")
    images = [open_image(one) for one in resolve_images([folder], lambda text: None) if not _is_of_result(one, folder)]
    files = sorted(
        os.path.join(place, name) for place, _, names in os.walk(folder) for name in names
        if not _is_of_result(os.path.join(place, name), folder)
    )  # fmt: skip
    points = [one for file in files if file.lower().endswith(POINT_ENDINGS) for one in _read_point_file(file, images)]
    taken = {os.path.realpath(image.path) for image in images}
    dems = [file for file in files if file.lower().endswith(IMAGE_ENDINGS) and os.path.realpath(file) not in taken]
    here = os.path.dirname(os.path.abspath(path))
    lines = [
        f"#:schema ./{SCHEMA_FILE}", "# HRSI project: hrsi run makes refined RPCs, orthoimages and a report of it.",
        "# Paths count from this file's folder; hrsi help STEP tells the options of each step.", "",
        f'title = {json_text(os.path.basename(os.path.abspath(folder)))}', 'client = ""', 'place = ""',
        'output_dir = "result"', "", f"# {len(images)} images with RPCs", "images = [",
        *(f"  {json_text(os.path.relpath(image.path, here))}," for image in images), "]",
        *_describe_points(points, here), *_describe_dem(dems, here),
        "", "[triangulate]", '# model = "auto"    # shift, affine, …: the correction of each RPC',
        "", "[orthorectify]", *_describe_gaps(dems), "# resolution = 0.5   # m; by default that of the images",
        "", "[ortho-check]", "", "[evaluate]", 'tracks = "auto"   # "none" compares at the known points only',
    ]  # fmt: skip
    for line in lines[9:]:
        if line.startswith("#") and " = " not in line:
            log(line.removeprefix("# "))
    schema = os.path.join(here, SCHEMA_FILE)
    write_text(path, "\n".join(lines) + "\n")
    write_text(schema, json_text(project_schema(), indent=1) + "\n")
    return [path, schema]


def _is_of_result(file: str, folder: str) -> bool:
    """Tell whether a file below a folder belongs to a result, at any depth."""
    place = os.path.dirname(file)
    while len(place) > len(folder.rstrip(os.sep)):
        if any(os.path.exists(os.path.join(place, name)) for name in RESULT_FILES):
            return True
        place = os.path.dirname(place)
    return False


def _read_point_file(file: str, images: Sequence[Image]) -> list[FoundPoints]:
    """Return a point file as it is read best: as it is, else with the columns and CRS that bring it to the images."""
    try:
        if rpc_reader_of(file) is not None:
            return []
    except InputError:
        return []
    footprints = (compute_footprint(image, image.rpc.height_off) for image in images)
    corners = np.concatenate([np.asarray(footprint.exterior.coords) for footprint in footprints])[:, :2]
    utm = f"EPSG:{map_epsg_of(corners)}"
    names = [f"{file}|columns={names}" for names in ("id,lon,lat,height", "id,lat,lon,height", "id,x,y,height")]
    for spec, crs in [(file, ""), (file, utm), *((spec, "") for spec in names[:2]), (names[2], utm)]:
        try:
            tables = read_points(spec, ground_crs=crs or None, image_ids=[image.id for image in images])
        except HrsiError:
            continue
        ground, beyond = tables.ground, INFERENCE.beyond_deg
        if ground is not None:
            lonlat = ground.ground[:, :2]
            near = (lonlat > corners.min(axis=0) - beyond) & (lonlat < corners.max(axis=0) + beyond)
            if np.mean(near.all(axis=1)) < 0.5:
                continue
        told = next((note.partition(": ")[2] for note in tables.warnings if "read as the columns" in note), "")
        return [FoundPoints(spec, crs, told, ground, tables.image)]
    return []


def _describe_points(points: Sequence[FoundPoints], here: str) -> list[str]:
    """Return the lines of the project file on control and measurements."""
    ground = next((one for one in points if one.ground is not None), None)
    measured = next((one for one in points if one.image is not None), None)
    lines = [""]
    for one, key in ((ground, "gcps"), (measured, "image_points")):
        if one is None:
            lines += [f"# no file of {key.replace('_', ' ')} was found", f'# {key} = "points.csv"']
            continue
        file, bar, rest = one.spec.partition("|")
        count = f"{len(one.ground)} ground points" if key == "gcps" and one.ground is not None else ""
        count = count or f"{len(one.image.ids)} image points" if one.image is not None else count
        where = f", CRS {one.crs}" if one.crs else ""
        lines += [
            f"# {os.path.basename(file)}: {count}{where}{f'; {one.told}' if one.told else ''}",
            f"{key} = {json_text(os.path.relpath(file, here) + bar + rest)}",
            *([f'ground_crs = "{one.crs}"'] if one.crs and key == "gcps" else []),
        ]
    if ground is not None and measured is not None and ground.ground is not None and measured.image is not None:
        known, seen = set(ground.ground.ids.tolist()), set(map(str, measured.image.ids))
        lines.append(f"# {len(known & seen)} of {len(known)} ground points are measured on images")
        if alone := sorted(seen - known):
            lines.append(f"# measured, but without a ground position: {list_ids(alone)}")
    return [*lines, 'height_datum = "layer"   # of the points: ellipsoidal, egm96, egm2008 or a geoid grid file']


def _find_dem(files: Sequence[str]) -> tuple[str, gdal.Dataset] | None:
    """Return the first raster of heights: one band of signed numbers on a map."""
    for file in files:
        dataset, _ = open_dataset(file)
        kinds = (gdal.GDT_Int16, gdal.GDT_Int32, gdal.GDT_Float32, gdal.GDT_Float64)
        if dataset is None or dataset.RasterCount != 1 or dataset.GetRasterBand(1).DataType not in kinds:
            continue
        if dataset.GetSpatialRef() is not None:
            return file, dataset
    return None


def _describe_dem(files: Sequence[str], here: str) -> list[str]:
    """Return the lines of the project file on the DEM."""
    found = _find_dem(files)
    if found is None:
        return ["", "# no DEM was found: orthoimages take the heights of the adjusted points", '# dem = "dem.tif"']
    file, dataset = found
    with quiet():
        size, crs = f"{dataset.RasterXSize} x {dataset.RasterYSize} cells", dataset.GetSpatialRef().GetName()
    return [
        "", f"# {os.path.basename(file)}: DEM of {size}, {crs}", f"dem = {json_text(os.path.relpath(file, here))}",
        'dem_datum = "layer"   # of its heights: as the file says, or ellipsoidal, egm96, egm2008, a geoid grid file',
    ]  # fmt: skip


def _describe_gaps(files: Sequence[str]) -> list[str]:
    """Return the option that bridges the gaps of the DEM, where it has some."""
    found = _find_dem(files)
    if found is None:
        return []
    band = found[1].GetRasterBand(1)
    step = max(1, -(-max(band.XSize, band.YSize) // INFERENCE.probe_px))
    heights = band.ReadAsArray(buf_xsize=band.XSize // step, buf_ysize=band.YSize // step).astype(np.float64)
    empty = ~np.isfinite(heights) if band.GetNoDataValue() is None else (
        ~np.isfinite(heights) | (heights == band.GetNoDataValue())
    )  # fmt: skip
    holes = ndimage.binary_fill_holes(~empty) & empty  # not what lies beyond its edge
    if not holes.any():
        return []
    widest = int(np.ceil(2.0 * step * ndimage.distance_transform_edt(np.pad(holes, 1)).max())) + 2 * step
    return [
        f"# the DEM has gaps inside: {100.0 * holes.mean():.2g} % of its cells, up to {widest} cells wide",
        f"fill_gaps = {min(widest, INFERENCE.widest_gap)}   # bridges them by interpolation",
    ]
