"""`adjust`: the block adjustment from existing image points."""

from ..hrsi_engine.adjustment.hold_out import hold_out_ties
from ..hrsi_engine.adjustment.solver import adjust
from ..hrsi_engine.foundation.progress import stage
from .block_steps import inputs as block_inputs
from .block_steps import laser_points, plausibility
from .block_steps import outputs as block_outputs
from .block_steps.plausibility import ground_reasons
from .block_steps.summary import choice_entries, choice_warnings
from .block_steps.summary import summarise as summarise
from .declarations.triangulation import AdjustAlgorithmOptions
from .files.opening import dem_surface
from .interface.declare import Context, Report


def run(options: AdjustAlgorithmOptions, context: Context) -> Report:
    """Adjust a block from the image points in files."""
    clock = block_outputs.Clock()
    images, earlier = block_inputs.open_joined_images(
        options.images, options.growth, options.tie_points, options.adjustment.shared_images, context
    )
    block_outputs.require_room(options.output, images, context)
    points = options.points
    dem = dem_surface(options.dem, points.height_datum, points.gcp_epoch)
    block, warnings = block_inputs.read_block(images, points, dem, options.tie_points, earlier.ties, earlier.known)
    block = hold_out_ties(block, options.hold_out)
    clock.lap("read")
    how = earlier.adjust_options(options.adjustment)
    how, block, of_surface = laser_points.with_surface(how, options.surface, points, block)
    surface = how.dem or dem
    reasons = plausibility.input_reasons(block, surface, how.sigma_shift_px, how.sigma_drift)
    clock.lap("check")
    laser, block, told = laser_points.add_laser_points(block, options.laser, points, context)
    warnings += [*told, *of_surface]
    if context.dry_run:
        return block_outputs.plan_results(options.output, images, block, warnings, reasons, context)
    with plausibility.explain_failures(reasons):
        how = laser_points.add_height_control(how, dem, laser)
        result = adjust(block, how, stage(context.progress, 0.1, 0.6))
    clock.lap("adjust")
    rest = context.stage(0.6, 1.0)
    of_laser, few = laser_points.describe_laser(result, options.laser)
    warnings += [*choice_warnings(result.choice), *few]
    entries = choice_entries(how.model, result.choice) | of_laser
    reasons += ground_reasons(result, surface, how.sigma_dem_m)
    return block_outputs.finish_block(options.output, result, warnings, reasons, entries, clock, rest)
