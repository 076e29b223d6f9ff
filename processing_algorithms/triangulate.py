"""`triangulate`: from images and ground points to refined RPCs, residual layers and a report."""

from .block_steps.block_run import BlockRun
from .block_steps.inputs import refuse_idle_matches
from .block_steps.summary import summarise as summarise
from .declarations.triangulation import TriangulateOptions
from .interface.declare import Context, Report
from .interface.option_groups import AUTOMATIC_TIES


def run(options: TriangulateOptions, context: Context) -> Report:
    """Find or read tie points, adjust the block, and write the results."""
    searching, adjustment = options.tie_points == AUTOMATIC_TIES, options.adjustment
    file = None if searching else options.tie_points
    refuse_idle_matches(options.search, searching, "tie_points")
    block_run = BlockRun(context, options.output, options.points, searching)
    block_run.open_images(options.images, options.growth, file, adjustment.shared_images)
    block_run.open_dem(options.dem)
    if searching:
        block_run.search(options.search, options.output.folder.output_dir)
    if block_run.has_points:
        block_run.read(file, options.reference, adjustment.sigma_dem_m)
        block_run.check(adjustment, options.hold_out, options.surface, options.laser)
    if context.dry_run:
        return block_run.plan()
    block_run.adjust(options.search.threads)
    return block_run.write()
