"""`triangulate`: the main job, from images and ground points to refined RPCs, residual layers and a report."""

from __future__ import annotations

from collections.abc import Sequence

from ..hrsi_engine.block.block import Block, Image, ImagePoints
from .block_steps import dem_offset, plausibility
from .block_steps import inputs as block_inputs
from .block_steps import outputs as block_outputs
from .block_steps.laser_points import (
    adjust_at_laser_points,
    laser_entries,
    laser_warnings,
    read_laser_points,
    with_laser,
)
from .block_steps.model_choice import choice_entries, choice_warnings
from .block_steps.summary import summarise as summarise
from .declarations.triangulate import TriangulateOptions
from .files.image_files import open_images
from .files.terrain import dem_surface
from .interface.declare import Context, Report
from .interface.option_groups import AUTOMATIC_TIES


def run(options: TriangulateOptions, context: Context) -> Report:
    """Find or read tie points, adjust, write."""
    clock = block_outputs.Clock()
    images = open_images(options.images, context.log)
    block_inputs.tell_tiles(images, options.adjustment, context.log)
    block_outputs.require_room(options.output, images, context)
    clock.lap("read")
    searching = context.stage(0.0, 0.4)
    found, warnings, kept, held = _automatic_ties(images, options, searching)
    clock.lap("tie_points")
    block, more, entries = _read(images, options, found, context.stage(0.4, 0.5))
    how = options.adjustment
    reasons = plausibility.input_reasons(block, options.points, options.dem, how.sigma_shift_px, how.sigma_drift)
    clock.lap("check")
    with plausibility.explained_by(reasons):
        laser = read_laser_points(images, options.laser, context)
        how = with_laser(how, laser, options.dem, options.points)
        how = block_inputs.with_dem(how, options.dem, options.points.height_datum)
        result, few = adjust_at_laser_points(block, how, options.search.threads, context.stage(0.5, 0.7))
    clock.lap("adjust")
    rest = context.stage(0.7, 1.0)
    offset = dem_offset.offset_warning(result, options.dem, options.points.height_datum, how.sigma_dem_m)
    warnings += [*more, *few, *choice_warnings(result.choice), *laser_warnings(result), *offset]
    entries |= choice_entries(how.model, result.choice) | held | laser_entries(result, options.laser)
    return block_outputs.write_results(options, result, warnings, clock, rest, entries, reasons, kept)


def _automatic_ties(
    images: Sequence[Image], options: TriangulateOptions, context: Context
) -> tuple[list[ImagePoints], list[str], tuple[str, ...], Report]:
    """Return tie points, warnings, the folders to discard when the results are written, and the report's entries."""
    if options.tie_points != AUTOMATIC_TIES:
        return [], [], (), {}
    from .block_steps.tie_search import find, held_entries  # needs OpenCV, which a QGIS may lack

    surface = dem_surface(options.dem, options.points.height_datum)
    found, finished = find(images, options.search, surface, options.output.folder.output_dir, context)
    return [found.image_points], list(found.warnings), finished.discarded, held_entries(found)


def _read(
    images: Sequence[Image], options: TriangulateOptions, ties: Sequence[ImagePoints], context: Context
) -> tuple[Block, list[str], Report]:
    """Return the block, warnings and entries of the report; with GCPs of a reference where one is named."""
    points, dem = options.points, options.dem
    file = None if options.tie_points == AUTOMATIC_TIES else options.tie_points
    if not options.reference.reference:
        return *block_inputs.read_block(images, points, dem, file, ties), {}
    from .block_steps.reference_control import read_reference_block  # needs OpenCV, too

    sigma_dem_m = options.adjustment.sigma_dem_m
    return read_reference_block(images, points, dem, file, ties, options.reference, sigma_dem_m, context)
