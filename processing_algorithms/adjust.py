"""`adjust`: the block adjustment from existing image points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .block_steps.params import ADJUST_PARAMS, BLOCK_OUTPUT_PARAMS, IMAGES, POINT_PARAMS
from .block_steps.summary import summarise
from .files.image_files import open_images
from .files.terrain import DEM, DEM_DATUM
from .interface.declare import Algorithm, Context, Kind, Param, Report


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Adjust a block from the image points in files."""
    from ..hrsi_engine.adjustment import adjust
    from ..hrsi_engine.foundation.progress import stage
    from ..hrsi_engine.io.output_dir import check_output_dir
    from .block_steps import inputs as block_inputs
    from .block_steps import model_choice, plausibility
    from .block_steps import outputs as block_outputs

    check_output_dir(options["output_dir"], options["overwrite"])
    clock = block_outputs.Clock()
    images = open_images(options["images"], context.log)
    block, warnings = block_inputs.read_block(images, dict(options) | {"tie_points_file": options["tie_points"]})
    clock.lap("read")
    reasons = plausibility.input_reasons(block, options)
    clock.lap("check")
    with plausibility.explained_by(reasons):
        chosen = model_choice.choose(block, options)
        result = adjust(block, block_inputs.adjust_options(chosen.options), stage(context.progress, 0.1, 0.6))
    clock.lap("adjust")
    rest = Context(stage(context.progress, 0.6, 1.0), context.log)
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
    params=(
        IMAGES,
        *POINT_PARAMS,
        Param("tie-points", Kind.POINTS, "Further image points, measured on two or more images", metavar="FILE"),
        DEM,
        DEM_DATUM,
        *ADJUST_PARAMS,
        *BLOCK_OUTPUT_PARAMS,
    ),
    run=run,
    summarise=summarise,
    layers=("block.gpkg|layername=images", "block.gpkg|layername=ground_points", "block.gpkg|layername=residuals_utm"),
)
