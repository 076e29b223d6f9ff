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
from ...hrsi_engine.foundation.errors import HrsiError, InputError, list_ids
from ...hrsi_engine.foundation.json_values import json_text
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ...hrsi_engine.ground.map_crs import map_epsg_of
from ...hrsi_engine.io.catalogue.deliveries import IMAGE_ENDINGS, resolve_images
from ...hrsi_engine.io.opening.datasets import open_dataset
from ...hrsi_engine.io.output_dir import RESULT_FILES
from ...hrsi_engine.io.pages.report import write_text
from ...hrsi_engine.io.point_files import PointTables, read_points
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
    """A point file, how it is named (``spec``, ``crs``), and what was read of it."""

    spec: str
    crs: str
    tables: PointTables


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
    here = os.path.dirname(os.path.abspath(path))
    dem, gaps = _describe_dem([file for file in files if file.lower().endswith(IMAGE_ENDINGS)], here)
    lines = [
        f"#:schema ./{SCHEMA_FILE}", "# HRSI project: hrsi run makes refined RPCs, orthoimages and a report of it.",
        "# Paths count from this file's folder; hrsi help STEP tells the options of each step.", "",
        f'title = {json_text(os.path.basename(os.path.abspath(folder)))}', 'client = ""', 'place = ""',
        'output_dir = "result"', "", f"# {len(images)} images with RPCs", "images = [",
        *(f"  {json_text(os.path.relpath(image.path, here))}," for image in images), "]",
        *_describe_points(points, here), *dem,
        "", "[triangulate]", '# model = "auto"    # shift, affine, …: the correction of each RPC',
        "", "[orthorectify]", *gaps, "# resolution = 0.5   # m; by default that of the images",
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
        return [FoundPoints(spec, crs, tables)]
    return []


def _describe_points(points: Sequence[FoundPoints], here: str) -> list[str]:
    """Return the lines of the project file on control and measurements."""
    lines, ids = [""], dict[str, set[str]]()
    for key, what in (("gcps", "ground"), ("image_points", "image")):
        one = next((one for one in points if getattr(one.tables, what) is not None), None)
        if one is None:
            lines += [f"# no file of {key.replace('_', ' ')} was found", f'# {key} = "points.csv"']
            continue
        file, bar, rest = one.spec.partition("|")
        found, notes = getattr(one.tables, what).ids, [note.partition(": ")[2] for note in one.tables.warnings]
        ids[key] = set(map(str, found))
        facts = [f"{len(found)} {what} points", *([f"CRS {one.crs}"] if one.crs else []),
                 *(note for note in notes if note.startswith("read as the columns"))]  # fmt: skip
        lines += [f"# {os.path.basename(file)}: {'; '.join(facts)}",
                  f"{key} = {json_text(os.path.relpath(file, here) + bar + rest)}"]  # fmt: skip
        lines += [f'ground_crs = "{one.crs}"'] if one.crs and key == "gcps" else []
    if len(ids) == 2:
        known, seen = ids.values()
        alone = f"; without a ground position: {list_ids(sorted(seen - known))}" if seen - known else ""
        lines.append(f"# {len(known & seen)} of {len(known)} ground points are measured on images{alone}")
    return [*lines, 'height_datum = "layer"   # of the points: ellipsoidal, egm96, egm2008 or a geoid grid file']


def _describe_dem(files: Sequence[str], here: str) -> tuple[list[str], list[str]]:
    """Return the lines on the first raster of heights (a band of signed numbers on a map), and on its gaps."""
    signed = (gdal.GDT_Int16, gdal.GDT_Int32, gdal.GDT_Float32, gdal.GDT_Float64)
    for file, (dem, _) in ((file, open_dataset(file)) for file in files):
        if dem is None or dem.RasterCount != 1 or dem.GetRasterBand(1).DataType not in signed:
            continue
        if (crs := dem.GetSpatialRef()) is not None and not dem.GetMetadata("RPC"):
            break
    else:
        return ["", "# no DEM was found: orthoimages take the heights of the adjusted points", '# dem = "dem.tif"'], []
    told = [
        "", f"# {os.path.basename(file)}: DEM of {dem.RasterXSize} x {dem.RasterYSize} cells, {crs.GetName()}",
        f"dem = {json_text(os.path.relpath(file, here))}",
        'dem_datum = "layer"   # of its heights: as the file says, or ellipsoidal, egm96, egm2008, a geoid grid file',
    ]  # fmt: skip
    band = dem.GetRasterBand(1)
    step = max(1, -(-max(band.XSize, band.YSize) // INFERENCE.probe_px))
    heights = band.ReadAsArray(buf_xsize=band.XSize // step, buf_ysize=band.YSize // step).astype(np.float64)
    empty = ~np.isfinite(heights) | (heights == (np.nan if band.GetNoDataValue() is None else band.GetNoDataValue()))
    holes = ndimage.binary_fill_holes(~empty) & empty  # not what lies beyond its edge
    if not holes.any():
        return told, []
    widest = int(np.ceil(2.0 * step * ndimage.distance_transform_edt(np.pad(holes, 1)).max())) + 2 * step
    return told, [
        f"# the DEM has gaps inside: {100.0 * holes.mean():.2g} % of its cells, up to {widest} cells wide",
        f"fill_gaps = {min(widest, INFERENCE.widest_gap)}   # bridges them by interpolation",
    ]
