"""`adjust`: the block adjustment from existing image points."""

from .block_steps.block_run import BlockRun
from .block_steps.summary import summarise as summarise
from .declarations.triangulation import AdjustAlgorithmOptions
from .interface.declare import Context, Report


def run(options: AdjustAlgorithmOptions, context: Context) -> Report:
    """Adjust a block from the image points in files."""
    block_run = BlockRun(context, options.output, options.points)
    block_run.open_images(options.images, options.growth, options.tie_points, options.adjustment.shared_images)
    block_run.open_dem(options.dem)
    block_run.read(options.tie_points)
    block_run.check(options.adjustment, options.hold_out, options.surface, options.laser)
    if context.dry_run:
        return block_run.plan()
    block_run.adjust()
    return block_run.write()
