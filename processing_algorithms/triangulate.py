"""`triangulate`: the main job, from images and ground points to refined RPCs, residual layers and a report."""

from collections.abc import Sequence

from ..hrsi_engine.adjustment.hold_out import hold_out_ties
from ..hrsi_engine.block.block import Image, ImagePoints
from ..hrsi_engine.block.exposures import join_exposures
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.measurement.tie_points import find_overlapping_pairs
from ..hrsi_engine.results.block_results import assemble_result
from .block_steps import inputs as block_inputs
from .block_steps import laser_points, plausibility
from .block_steps import outputs as block_outputs
from .block_steps.inputs import EarlierBlock
from .block_steps.reference_control import read_reference_block, reference_reasons
from .block_steps.summary import choice_entries, choice_warnings
from .block_steps.summary import summarise as summarise
from .block_steps.tie_search import connection_entries, find_ties, join_ties
from .declarations.triangulation import TriangulateOptions
from .files.opening import dem_surface, open_images
from .interface.declare import Context, Report
from .interface.option_groups import AUTOMATIC_TIES

#: Where tie points are found, points read, the block adjusted: with a search for tie points in the images, and without.
SHARES = {True: (0.8, 0.84, 0.94), False: (0.0, 0.1, 0.6)}


def run(options: TriangulateOptions, context: Context) -> Report:
    """Find or read tie points, adjust, write."""
    clock = block_outputs.Clock()
    automatic = options.tie_points == AUTOMATIC_TIES
    file = None if automatic else options.tie_points
    block_inputs.refuse_idle_matches(options.search, automatic, "tie_points")
    images = open_images(options.images, context)
    earlier = block_inputs.read_earlier(options.growth, images, file)
    if options.reference.reference and earlier.images:
        raise InputError("`reference` cannot be combined with `add_to`: remove one of them")
    if automatic and earlier.joint is not None:
        raise InputError(
            "new images need tie points to the earlier images, which are not available with observed cameras: set "
            "`earlier_cameras` to free, or search `tie_points` first"
        )
    images = join_exposures([*earlier.images, *images])
    block_inputs.tell_tiles(images, options.adjustment, context.log)
    block_outputs.require_room(options.output, images, context)
    clock.lap("read")
    if context.dry_run:
        return _plan_run(images, earlier, options, context)
    # The share of the time that each step takes: where tie points are found in the images, that is most of it
    found_at, read_at, adjusted_at = SHARES[automatic]
    searching = context.stage(0.0, found_at)
    found, warnings, kept, held = _automatic_ties(images, earlier, options, searching)
    clock.lap("tie_points")
    points, dem, ties = options.points, options.dem, [*earlier.ties, *found]
    places, entries = None, Report()
    if options.reference.reference:
        part, sigma_dem_m = context.stage(found_at, read_at), options.adjustment.sigma_dem_m
        block, places, more, entries = read_reference_block(
            images, points, dem, file, ties, options.reference, sigma_dem_m, part
        )
    else:
        block, more = block_inputs.read_block(images, points, dem, file, ties, earlier.known)
    block = hold_out_ties(block, options.hold_out)
    how = earlier.adjust_options(options.adjustment)
    how, block, of_surface = laser_points.with_surface(how, options.surface, points, block)
    reasons = plausibility.input_reasons(block, points, dem, how.sigma_shift_px, how.sigma_drift, how.dem)
    reasons += reference_reasons(entries)
    clock.lap("check")
    with plausibility.explain_failures(reasons):
        laser = laser_points.read_laser_points(images, options.laser, options.points, context)
        block, told = laser_points.name_operations(block, laser, options.points.strict_datum)
        how = laser_points.with_free_control(how, options.dem, options.points, laser, places)
        part = context.stage(read_at, adjusted_at)
        result, few = laser_points.adjust_at_laser_points(block, how, options.search.threads, part)
    clock.lap("adjust")
    rest = context.stage(adjusted_at, 1.0)
    surface = how.dem or dem_surface(dem, points.height_datum, points.gcp_epoch)
    offset = plausibility.offset_warning(result, surface, how.sigma_dem_m)
    reasons += plausibility.ground_reasons(result, surface, how.sigma_dem_m)
    of_laser, useless = laser_points.describe_laser(result, options.laser)
    warnings += [*more, *told, *of_surface, *few, *choice_warnings(result.choice), *useless, *offset]
    entries |= choice_entries(how.model, result.choice) | held | of_laser
    with plausibility.explain_failures(reasons):
        assembled = assemble_result(result, context.record, warnings, reasons, entries, clock.lap)
    return block_outputs.write_results(options.output, assembled, clock, rest, kept)


def _plan_run(images: Sequence[Image], earlier: EarlierBlock, options: TriangulateOptions, context: Context) -> Report:
    """Return what would be done: the pairs are counted, not matched, and checks look at the points that files hold."""
    laser = laser_points.read_laser_points(images, options.laser, options.points, context)
    points, how, pairs = options.points, options.adjustment, None
    file = None if options.tie_points == AUTOMATIC_TIES else options.tie_points
    if options.tie_points == AUTOMATIC_TIES:
        surface = dem_surface(options.dem, points.height_datum, points.gcp_epoch)
        pairs = len(find_overlapping_pairs(images, options.search.search, surface, earlier.image_ids))
    if pairs and not points.gcps and not points.image_points and not earlier.ties:
        return block_outputs.plan_results(options.output, images, None, [], [], context, pairs)
    block, warnings = block_inputs.read_block(images, points, options.dem, file, earlier.ties, earlier.known)
    block, told = laser_points.name_operations(block, laser, points.strict_datum)
    how, block, of_surface = laser_points.with_surface(how, options.surface, points, block)
    block = hold_out_ties(block, options.hold_out)
    reasons = plausibility.input_reasons(block, points, options.dem, how.sigma_shift_px, how.sigma_drift, how.dem)
    warnings += [*told, *of_surface]
    return block_outputs.plan_results(options.output, images, block, warnings, reasons, context, pairs)


def _automatic_ties(
    images: Sequence[Image], earlier: EarlierBlock, options: TriangulateOptions, context: Context
) -> tuple[list[ImagePoints], list[str], tuple[str, ...], Report]:
    """Return tie points, warnings, the folders to discard when the results are written, and the report's entries."""
    if options.tie_points != AUTOMATIC_TIES:
        return [], [], (), {}
    surface = dem_surface(options.dem, options.points.height_datum, options.points.gcp_epoch)
    folder = options.output.folder.output_dir
    found, discarded = find_ties(images, options.search, surface, folder, context, earlier.image_ids)
    points = found.image_points
    for table in earlier.ties:
        points, *_ = join_ties(points, table)
    return [points], list(found.warnings), discarded, connection_entries(found)
