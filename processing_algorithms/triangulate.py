"""`triangulate`: from images and ground points to refined RPCs, residual layers and a report."""

from collections.abc import Sequence

from ..hrsi_engine.adjustment.hold_out import hold_out_ties
from ..hrsi_engine.block.block import Image, ImagePoints
from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.measurement.tie_points import find_overlapping_pairs
from ..hrsi_engine.surface.dem import HeightSurface
from .block_steps import inputs as block_inputs
from .block_steps import laser_points, plausibility
from .block_steps import outputs as block_outputs
from .block_steps.inputs import EarlierBlock
from .block_steps.reference_control import read_reference_block, reference_reasons
from .block_steps.summary import choice_entries, choice_warnings
from .block_steps.summary import summarise as summarise
from .block_steps.tie_search import connection_entries, find_ties, join_ties
from .declarations.triangulation import TriangulateOptions
from .files.opening import dem_surface
from .interface.declare import Context, Report
from .interface.option_groups import AUTOMATIC_TIES, ReferenceImage, SearchOptions

#: Progress after the search for tie points, reading and adjustment; with a search in the images, and without it.
SHARES = {True: (0.8, 0.84, 0.94), False: (0.0, 0.1, 0.6)}


def run(options: TriangulateOptions, context: Context) -> Report:
    """Find or read tie points, adjust the block, and write the results."""
    clock = block_outputs.Clock()
    automatic = options.tie_points == AUTOMATIC_TIES
    file = None if automatic else options.tie_points
    block_inputs.refuse_idle_matches(options.search, automatic, "tie_points")
    images, earlier = block_inputs.open_joined_images(
        options.images, options.growth, file, options.adjustment.shared_images, context
    )
    _require_possible(earlier, automatic, options.reference)
    block_outputs.require_room(options.output, images, context)
    points = options.points
    dem = dem_surface(options.dem, points.height_datum, points.gcp_epoch)
    clock.lap("read")
    # Progress at the end of each step: the search for tie points in images takes most of the time
    found_at, read_at, adjusted_at = SHARES[automatic]
    ties, pairs, kept, warnings, held = [*earlier.ties], None, tuple[str, ...](), list[str](), Report()
    if automatic and context.dry_run:  # pairs are counted, not matched
        pairs = len(find_overlapping_pairs(images, options.search.search, dem, earlier.image_ids))
        if pairs and not points.gcps and not points.image_points and not ties:
            return block_outputs.plan_results(options.output, images, None, [], [], context, pairs)
    elif automatic:
        folder, searching = options.output.folder.output_dir, context.stage(0.0, found_at)
        ties, kept, warnings, held = _find_new_ties(images, earlier, options.search, dem, folder, searching)
    clock.lap("tie_points")
    places, entries = None, Report()
    if options.reference.reference and not context.dry_run:
        part, sigma_dem_m = context.stage(found_at, read_at), options.adjustment.sigma_dem_m
        block, places, told, entries = read_reference_block(
            images, points, dem, file, ties, options.reference, sigma_dem_m, part
        )
    else:
        block, told = block_inputs.read_block(images, points, dem, file, ties, earlier.known)
    warnings += told
    block = hold_out_ties(block, options.hold_out)
    how = earlier.adjust_options(options.adjustment)
    how, block, of_surface = laser_points.with_surface(how, options.surface, points, block)
    surface = how.dem or dem
    reasons = plausibility.input_reasons(block, surface, how.sigma_shift_px, how.sigma_drift)
    reasons += reference_reasons(entries)
    clock.lap("check")
    with plausibility.explain_failures(reasons):
        laser, block, told = laser_points.add_laser_points(block, options.laser, points, context)
        warnings += [*told, *of_surface]
        if context.dry_run:
            return block_outputs.plan_results(options.output, images, block, warnings, reasons, context, pairs)
        how = laser_points.add_height_control(how, dem, laser, places)
        part = context.stage(read_at, adjusted_at)
        result, few = laser_points.adjust_at_laser_points(block, how, options.search.threads, part)
    clock.lap("adjust")
    offset = plausibility.offset_warning(result, surface, how.sigma_dem_m)
    reasons += plausibility.ground_reasons(result, surface, how.sigma_dem_m)
    of_laser, useless = laser_points.describe_laser(result, options.laser)
    warnings += [*few, *choice_warnings(result.choice), *useless, *offset]
    entries |= choice_entries(how.model, result.choice) | held | of_laser
    rest = context.stage(adjusted_at, 1.0)
    return block_outputs.finish_block(options.output, result, warnings, reasons, entries, clock, rest, kept)


def _require_possible(earlier: EarlierBlock, automatic: bool, reference: ReferenceImage) -> None:
    """Raise `InputError` if images cannot join an earlier block with these options."""
    if reference.reference and earlier.images:
        raise InputError("`reference` cannot be combined with `add_to`: remove one of them")
    if automatic and earlier.joint is not None:
        raise InputError(
            "new images need tie points to the earlier images, which are not available with observed cameras: set "
            "`earlier_cameras` to free, or search `tie_points` first"
        )


def _find_new_ties(
    images: Sequence[Image], earlier: EarlierBlock, search: SearchOptions, dem: HeightSurface | None, folder: str,
    context: Context,
) -> tuple[list[ImagePoints], tuple[str, ...], list[str], Report]:  # fmt: skip
    """Return tie points, the folders to be removed after writing the results, warnings, and entries of the report."""
    found, discarded = find_ties(images, search, dem, folder, context, earlier.image_ids)
    points = found.image_points
    for table in earlier.ties:
        points, *_ = join_ties(points, table)
    return [*earlier.ties, points], discarded, list(found.warnings), connection_entries(found)
