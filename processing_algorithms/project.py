"""`project`: ground points to image points."""

from functools import partial

import numpy as np

from ..hrsi_engine.block.block import GroundPoints
from ..hrsi_engine.foundation.errors import InputError, list_ids
from ..hrsi_engine.ground.operation_uses import list_operation_warnings, require_strict_datums
from ..hrsi_engine.io.geopackage.declared_layers import ProjectedPointRows
from ..hrsi_engine.io.point_files import read_points
from ..hrsi_engine.io.point_files.positions import Reference, ground_positions
from ..hrsi_engine.io.point_files.table import PointTable
from ..hrsi_engine.refinement.refine import require_axes_in_order
from ..hrsi_engine.surface.dem import surface_heights
from .declarations.rpcs import POINTS_FILE, ProjectOptions
from .files.opening import (
    is_on_image,
    list_points,
    open_images,
    open_terrain,
    parse_lines,
    standard_input,
)
from .files.result_folder import check_folder, plan_folder, tell, write_points
from .interface.declare import Context, Report

PROJECTED_LINE = "lon lat height"
PROJECTED_KEYS = ("id", "image", "sample", "line")  #: of the points in a report


def run(options: ProjectOptions, context: Context) -> Report:
    """Read ground points from a file or standard input and project them into every image."""
    check_folder(options.folder, context)
    images = open_images(options.images, context, always=False)
    surface = open_terrain(options.terrain)
    if options.points:
        heights = None if surface is None else partial(surface_heights, surface)
        datum = options.terrain.height_datum
        tables = read_points(options.points, ground_crs=options.ground_crs, height_datum=datum, surface=heights)
        if tables.ground is None:
            raise InputError(f"{options.points}: has no ground positions (geometry, lon and lat, x and y): add them")
        points, warnings = tables.ground, [*tables.warnings, *list_operation_warnings(tables.ground.operations)]
        require_strict_datums(points.operations, options.terrain.strict_datum)
    else:
        points, warnings = _place_lines(*parse_lines(standard_input(PROJECTED_LINE), PROJECTED_LINE.split()), options)
        lost = np.flatnonzero(np.isnan(points.ground[:, 2]))
        if lost.size and surface is None:
            raise InputError(f"point {lost[0] + 1} has no height: add it to the line, or give `dem` or `height`")
        if lost.size and surface is not None:
            points.ground[lost, 2] = surface_heights(surface, points.ground[lost, :2])
            count = np.count_nonzero(np.isnan(points.ground[:, 2]))
            warnings += [f"the DEM has no height for {count} points"] if count else []
    ids, ground = points.ids, points.ground
    require_axes_in_order(images, ground, ids if options.points else None)
    if context.dry_run:
        counts = {"images": len(images), "ground points": len(ids)}
        return plan_folder(options.folder, POINTS_FILE, counts, warnings, context)
    # One row for each point and image
    parts = [image.rpc.project(ground) for image in images]
    xy, inside = np.concatenate(parts), np.concatenate(list(map(is_on_image, images, parts)))
    repeated = np.tile(ground, (len(images), 1))
    rows = ProjectedPointRows(
        id=np.tile(ids, len(images)),
        image=np.repeat([image.id for image in images], len(ids)),
        sample=xy[:, 0],
        line=xy[:, 1],
        inside=inside,
        lon=repeated[:, 0],
        lat=repeated[:, 1],
        height=repeated[:, 2],
    )
    seen = set(rows.image[inside].tolist())
    bare = [image.id for image in images if image.id not in seen] if len(ids) else []
    warnings += [f"no point lies on {list_ids(bare)}: check the CRS and the columns of the points"] if bare else []
    tell(warnings, context)
    report: Report = {
        **context.record, "images": [image.id for image in images],
        "from_file": bool(options.points), "count": len(rows.id), "warnings": warnings,
        "crs_operations": [use.entry() for use in points.operations],
    }  # fmt: skip
    write_points(options.folder, report, POINTS_FILE, rows, PROJECTED_KEYS, context)
    return report


def _place_lines(numbers: np.ndarray, rest: list[str], options: ProjectOptions) -> tuple[GroundPoints, list[str]]:
    """Return the points of lines in WGS84; the text after the coordinates is the id, missing heights stay NaN."""
    axes = ("x", "y", "height") if options.ground_crs else ("lon", "lat", "height")
    given = dict(zip(axes, np.nan_to_num(numbers).T, strict=True))
    table = PointTable("standard input", given, axes, lambda row: f"line {row + 1}")
    datum = options.terrain.height_datum
    datum = "ellipsoidal" if datum == "layer" and not options.ground_crs else datum
    placed = ground_positions(table, Reference(options.ground_crs or "", datum))
    ground = np.where(np.isnan(numbers), np.nan, placed.ground)
    points = GroundPoints(np.array(rest, dtype=str), ground, operation=placed.operation, operations=placed.operations)
    return points, [*placed.warnings, *list_operation_warnings(placed.operations)]


def summarise(report: Report) -> str:
    """Return the image points as lines; with their ids and images if they are from a file."""
    return list_points(report, "image points", PROJECTED_KEYS, ("sample", "line", "id"))
