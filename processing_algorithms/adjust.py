"""`adjust`: the block adjustment from existing image points."""

from __future__ import annotations

from dataclasses import dataclass

from ..hrsi_engine.adjustment.options import AdjustOptions
from ..hrsi_engine.foundation.options import nested, option
from .block_steps.options import BlockOutput, PointFiles, images_option
from .block_steps.summary import summarise
from .files.image_files import open_images
from .files.terrain import DemOptions
from .interface.declare import Algorithm, Context, Kind, Report


@dataclass(frozen=True, kw_only=True)
class AdjustAlgorithmOptions:
    """What `adjust` takes."""

    images: tuple[str, ...] = images_option()
    points: PointFiles = nested(PointFiles)
    tie_points: str | None = option(
        None, "Further image points, measured on two or more images", kind=Kind.POINTS, metavar="FILE"
    )
    dem: DemOptions = nested(DemOptions)
    adjustment: AdjustOptions = nested(AdjustOptions)
    output: BlockOutput = nested(BlockOutput)


def run(options: AdjustAlgorithmOptions, context: Context) -> Report:
    """Adjust a block from the image points in files."""
    from ..hrsi_engine.adjustment.solver import adjust
    from ..hrsi_engine.foundation.progress import stage
    from .block_steps import inputs as block_inputs
    from .block_steps import model_choice, plausibility
    from .block_steps import outputs as block_outputs

    clock = block_outputs.Clock()
    images = open_images(options.images, context.log)
    block_outputs.require_room(options.output, images, context)
    block, warnings = block_inputs.read_block(images, options.points, options.dem, options.tie_points)
    clock.lap("read")
    how = options.adjustment
    reasons = plausibility.input_reasons(block, options.points, options.dem, how.sigma_shift_px, how.sigma_drift)
    clock.lap("check")
    with plausibility.explained_by(reasons):
        chosen = model_choice.choose(block, options.adjustment)
        how = block_inputs.with_dem(chosen.options, options.dem, options.points.height_datum)
        result = adjust(block, how, stage(context.progress, 0.1, 0.6))
    clock.lap("adjust")
    rest = context.stage(0.6, 1.0)
    return block_outputs.write_results(
        "adjust", options, result, [*warnings, *chosen.warnings], clock, rest, chosen.entries, reasons
    )


ALGORITHM = Algorithm(
    name="adjust",
    title="Adjust block",
    group="Triangulation",
    summary="Bundle block adjustment from existing image points",
    help=(
        "Corrects the RPCs of all images of a block together, from ground control points, tie points or both, "
        "and reports how well the check points agree. Writes refined RPCs, residual layers and a report."
    ),
    options=AdjustAlgorithmOptions,
    run=run,
    summarise=summarise,
    layers=("block.gpkg|layername=images", "block.gpkg|layername=ground_points", "block.gpkg|layername=residuals_utm"),
)
