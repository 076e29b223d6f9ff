"""`localize`: image points to ground points."""

import numpy as np

from ..hrsi_engine.block.block import Image
from ..hrsi_engine.foundation.errors import InputError, list_ids
from ..hrsi_engine.io.geopackage.declared_layers import LocalizedPointRows
from ..hrsi_engine.io.point_files.find import ImagePositions, read_image_positions
from ..hrsi_engine.surface.dem import HeightSurface, Status, intersect_surface
from .declarations.rpcs import POINTS_FILE, LocalizeOptions
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

LOCALIZED_LINE = "sample line height"
LOCALIZED_KEYS = ("id", "image", "lon", "lat", "height", "status")  #: of the points in a report


def run(options: LocalizeOptions, context: Context) -> Report:
    """Read image points from a file or standard input and intersect their rays with the ground."""
    check_folder(options.folder, context)
    images = open_images(options.images, context, always=False)
    surface = open_terrain(options.terrain)
    ids = [image.id for image in images]
    if options.points:
        points = read_image_positions(options.points, ids)
    elif len(images) > 1:
        raise InputError("lines on standard input belong to one image: give one image")
    else:  # the text after the coordinates is the id
        numbers, rest = parse_lines(standard_input(LOCALIZED_LINE), LOCALIZED_LINE.split())
        points = ImagePositions(np.array(rest, dtype=str), np.full(len(rest), ids[0]), numbers[:, :2], numbers[:, 2])
    if context.dry_run:
        counts = {"images": len(images), "image points": len(points.ids)}
        return plan_folder(options.folder, POINTS_FILE, counts, [], context)
    rows, warnings = _localize_points(images, points, surface)
    tell(warnings, context)
    report: Report = {
        **context.record,
        "images": ids,
        "from_file": bool(options.points),
        "count": len(rows.id),
        "warnings": warnings,
    }
    write_points(options.folder, report, POINTS_FILE, rows, LOCALIZED_KEYS, context)
    return report


def _localize_points(
    images: list[Image], points: ImagePositions, surface: HeightSurface | None
) -> tuple[LocalizedPointRows, list[str]]:
    """Return one row for each point, and warnings on points without ground position."""
    if unknown := sorted(set(points.image_ids.tolist()) - {image.id for image in images}):
        raise InputError(f"the points name the image {unknown[0]!r}, which is not given: add it, or remove its points")
    ground, status = np.full((len(points.ids), 3), np.nan), np.full(len(points.ids), int(Status.NO_RAY))
    beside: list[str] = []  # images with no point inside
    for image in images:
        rows = np.flatnonzero(points.image_ids == image.id)
        # Each at its own height, otherwise on the surface
        ground[rows], converged = image.rpc.localize(points.image[rows], points.height_m[rows])
        status[rows[converged]] = int(Status.FOUND)
        without = rows[np.isnan(points.height_m[rows])]
        if len(without) and surface is None:
            name = f" ({points.ids[without[0]]})" if points.ids[without[0]] else ""
            raise InputError(
                f"point {without[0] + 1}{name} has no height: add it to the point, or give `dem` or `height`"
            )
        if len(without) and surface is not None:
            ground[without], status[without] = intersect_surface(image.rpc, points.image[without], surface)
        beside += [image.id] if len(rows) and not is_on_image(image, points.image[rows]).any() else []
    lost = {kind: np.count_nonzero(status == kind) for kind in Status if kind != Status.FOUND}
    warnings = [f"{count} points have no ground position: {kind.label}" for kind, count in lost.items() if count]
    warnings += [f"all points of {list_ids(beside)} are outside the image: check sample and line"] if beside else []
    located = LocalizedPointRows(
        id=points.ids,
        image=points.image_ids,
        sample=points.image[:, 0],
        line=points.image[:, 1],
        lon=ground[:, 0],
        lat=ground[:, 1],
        height=ground[:, 2],
        status=np.array([Status(code).label for code in status], dtype=str),
    )
    return located, warnings


def summarise(report: Report) -> str:
    """Return the ground points as lines; with their ids and images if they are from a file."""
    return list_points(report, "ground points", LOCALIZED_KEYS, ("lon", "lat", "height", "id"))
