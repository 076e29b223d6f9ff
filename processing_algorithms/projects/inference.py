"""`hrsi init FOLDER`: a project file from the images, point files and DEM of a folder, which the user corrects.

Comments in the file state how columns, CRS and ids were interpreted.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

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

POINT_ENDINGS = (".csv", ".tsv", ".txt", ".tab", ".gpkg", ".geojson", ".shp", ".points")
NO_GAPS = "# fill_gaps = 8   # interpolates gaps of the DEM of up to 8 cells"

#: A point file as an option names it, the CRS that it needs, and its points.
FoundPoints = tuple[str, str, PointTables]


@thresholds
class INFERENCE:
    """Limits for the interpretation of the files in a folder."""

    beyond_deg: float = threshold(0.5, "degree", "margin of ground points around the footprints")
    probe_px: int = threshold(2000, "px", "largest number of columns and rows read to find gaps of a DEM")
    widest_gap: int = threshold(1000, "cells", "widest gap of a DEM for interpolation", "maximum of `fill_gaps`")


def write_project(folder: str, path: str, overwrite: bool = False) -> list[str]:
    """Write the project file of a folder; return one line on the interpretation of each file.

    Raises `InputError` if the folder contains no image with an RPC, or the file exists.
    """
    if os.path.exists(path) and not overwrite:
        raise InputError(f"{path} exists: allow `overwrite`, or name another file")
    folder, here = os.path.abspath(folder), os.path.dirname(os.path.abspath(path))
    files: list[str] = []
    for place, folders, names in os.walk(folder):
        if place != folder and set(RESULT_FILES) & set(names):
            folders.clear()  # an earlier result
        else:
            files += [os.path.join(place, name) for name in sorted(names)]
    found = resolve_images([folder], lambda text: None) if os.path.isdir(folder) else ()
    images = [open_image(one) for one in found if one in files]
    if not images:
        raise InputError(f"{folder}: contains no image with an RPC: name the folder of the images")
    outlines = [compute_footprint(image, image.rpc.height_off).exterior.coords for image in images]
    corners = np.concatenate([np.asarray(outline)[:, :2] for outline in outlines])
    texts = [one for one in files if one.lower().endswith(POINT_ENDINGS) and not rpc_reader_of(one)]
    points = {file: _read_point_file(file, corners, [image.id for image in images]) for file in texts}
    unread = [f"# {os.path.basename(file)}: no points were read" for file, one in points.items() if not one]
    dem, gaps = _describe_dem([file for file in files if file.lower().endswith(IMAGE_ENDINGS)], here)
    text = Path(__file__).with_name("project_file.txt").read_text(encoding="utf-8").format(
        title=json_text(os.path.basename(folder)), number=len(images), dem=dem, gaps=gaps,
        images="\n".join(f"  {json_text(os.path.relpath(image.path, here))}," for image in images),
        points="\n".join([*_describe_points([one for one in points.values() if one], here), *unread]),
    )  # fmt: skip
    write_text(path, text)
    return [line[2:] for line in text.splitlines()[2:] if line.startswith("# ") and " = " not in line]


def _read_point_file(file: str, corners: np.ndarray, image_ids: Sequence[str]) -> FoundPoints | None:
    """Return a point file, with columns and CRS added if otherwise its points are not near the corners (n, 2)."""
    utm = f"EPSG:{map_epsg_of(corners)}"
    orders = {"lon,lat": "", "lat,lon": "", "x,y": utm, "y,x": utm}
    specs = [(f"{file}|columns=id,{order},height", crs) for order, crs in orders.items()]
    for spec, crs in [(file, ""), (file, utm), *specs]:
        try:
            tables = read_points(spec, ground_crs=crs or None, image_ids=image_ids)
        except HrsiError:
            continue
        if tables.ground is not None:
            lonlat, beyond = tables.ground.ground[:, :2], INFERENCE.beyond_deg
            near = (lonlat > corners.min(axis=0) - beyond) & (lonlat < corners.max(axis=0) + beyond)
            if np.count_nonzero(near.all(axis=1)) * 2 < len(near):
                continue
        return spec, crs, tables
    return None


def _describe_points(points: Sequence[FoundPoints], here: str) -> list[str]:
    """Return the lines of the project file on control points and measurements."""
    lines, ids = list[str](), dict[str, set[str]]()
    for key, what in (("gcps", "ground"), ("image_points", "image")):
        fit = [one for one in points if getattr(one[2], what) is not None]
        if not fit:
            lines += [f"# no file of {what} points was found", f'# {key} = "points.csv"']
            continue
        spec, crs, tables = fit[0]
        ids[key] = set(map(str, measured := getattr(tables, what).ids))
        notes = [note.partition(": ")[2] for note in tables.warnings if ": read as the columns" in note]
        facts = "; ".join([f"{len(measured)} {what} points", *([f"CRS {crs}"] if crs else []), *notes])
        lines += [f"# {os.path.basename(spec).partition('|')[0]}: {facts}"]
        lines += [f"# {os.path.basename(other)}: {what} points, not used" for other, *_ in fit[1:]]
        lines += [f"{key} = {json_text(os.path.relpath(spec, here))}"]
        lines += [f'ground_crs = "{crs}"'] if crs and what == "ground" else []
    if len(ids) == 2:
        known, seen = ids.values()
        alone = f"; without a ground position: {list_ids(sorted(seen - known))}" if seen - known else ""
        lines.append(f"# {len(known & seen)} of {len(known)} ground points are measured on images{alone}")
    return lines


def _describe_dem(files: Sequence[str], here: str) -> tuple[str, str]:
    """Return the lines on the first raster of heights (one band of signed numbers with a CRS), and on its gaps."""
    opened = ((file, open_dataset(file)[0]) for file in files)
    path, dem = next(((file, dem) for file, dem in opened if dem is not None and _is_dem(dem)), ("", None))
    if dem is None:
        return '# no DEM was found: orthoimages take the heights of the adjusted points\n# dem = "dem.tif"', NO_GAPS
    band, crs = dem.GetRasterBand(1), dem.GetSpatialRef().GetName()
    told = f"# {os.path.basename(path)}: DEM of {band.XSize} x {band.YSize} cells, {crs}"
    told += f"\ndem = {json_text(os.path.relpath(path, here))}"
    step = max(1, -(-max(band.XSize, band.YSize) // INFERENCE.probe_px))
    empty = band.GetMaskBand().ReadAsArray(buf_xsize=-(-band.XSize // step), buf_ysize=-(-band.YSize // step)) == 0
    holes = ndimage.binary_fill_holes(~empty) & empty  # without the area beyond its edge
    if not holes.any():
        return told, NO_GAPS
    widest = step * (2 + int(np.ceil(2.0 * ndimage.distance_transform_edt(holes).max())))
    share = f"# gaps inside of the DEM: {100.0 * holes.mean():.2g} % of its cells, up to {widest} cells wide"
    return told, f"{share}\nfill_gaps = {min(widest, INFERENCE.widest_gap)}   # interpolates them"


def _is_dem(dem: Any) -> bool:
    """Return whether a GDAL dataset has one band of signed numbers, a CRS, and no RPC."""
    on_map = dem.GetSpatialRef() is not None and not dem.GetMetadata("RPC")
    return on_map and dem.RasterCount == 1 and dem.GetRasterBand(1).ReadAsArray(0, 0, 1, 1).dtype.kind in "if"
