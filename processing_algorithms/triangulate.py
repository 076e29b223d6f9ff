"""`triangulate`: the main job, from images and ground points to refined RPCs, residual layers and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .adjust import ALGORITHM as ADJUST
from .block_steps.params import ADJUST_PARAMS, BLOCK_OUTPUT_PARAMS, IMAGES, POINT_PARAMS
from .block_steps.reference_control import REFERENCE, REFERENCE_PARAMS
from .block_steps.tie_search import SEARCH_PARAMS
from .files.image_files import open_images
from .files.terrain import DEM, DEM_DATUM, dem_datum
from .interface.declare import Context, Kind, Param, Report

if TYPE_CHECKING:
    from ..hrsi_engine.block.block import Image, ImagePoints
    from .block_steps.tie_search import Finished

NO_TIE_POINTS, AUTOMATIC = "none", "auto"


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Find or read tie points, adjust, write."""
    from ..hrsi_engine.adjustment import adjust
    from ..hrsi_engine.foundation.progress import stage
    from ..hrsi_engine.io.output_dir import check_output_dir
    from .block_steps import dem_offset, model_choice, plausibility, reference_control
    from .block_steps import inputs as block_inputs
    from .block_steps import outputs as block_outputs

    check_output_dir(options["output_dir"], options["overwrite"])
    clock = block_outputs.Clock()
    images = open_images(options["images"], context.log)
    clock.lap("read")
    searching = Context(stage(context.progress, 0.0, 0.4), context.log)
    found, warnings, finished = _automatic_ties(images, options, searching)
    clock.lap("tie_points")
    file = None if options["tie_points"] in (NO_TIE_POINTS, AUTOMATIC) else options["tie_points"]
    reading = Context(stage(context.progress, 0.4, 0.5), context.log)
    block, more, entries = reference_control.read_block(
        images, dict(options) | {"tie_points_file": file}, found, reading
    )
    reasons = plausibility.input_reasons(block, options)
    clock.lap("check")
    with plausibility.explained_by(reasons):
        chosen = model_choice.choose(block, options)
        result = adjust(block, block_inputs.adjust_options(chosen.options), stage(context.progress, 0.5, 0.7))
    clock.lap("adjust")
    rest = Context(stage(context.progress, 0.7, 1.0), context.log)
    warnings += [*more, *chosen.warnings, *dem_offset.offset_warning(result, options)]
    report = block_outputs.write_results(
        "triangulate", options, result, warnings, clock, rest, {**entries, **chosen.entries}, reasons
    )
    if finished is not None:
        finished.remove()
    return report


def _automatic_ties(
    images: Sequence[Image], options: Mapping[str, Any], context: Context
) -> tuple[list[ImagePoints], list[str], Finished | None]:
    if options["tie_points"] != AUTOMATIC:
        return [], [], None
    from ..hrsi_engine.io.dems import open_dem
    from .block_steps.tie_search import find

    surface = open_dem(options["dem"], dem_datum(options)) if options["dem"] else None
    found, finished = find(images, options, surface, context)
    return [found.image_points], list(found.warnings), finished


ALGORITHM = replace(
    ADJUST,
    name="triangulate",
    title="Triangulate block",
    summary="Tie points and GCPs to refined RPCs, residual layers and a report",
    help=(
        "The main job. Finds tie points between overlapping images, takes ground control points from a vector layer or "
        "CSV, corrects all RPCs in one bundle block adjustment and reports how well the check points agree. "
        "GCPs may also come from an orthoimage (--reference, with --dem). "
        "Without any GCP the block is held where its RPCs put it, and the images fit one another. "
        "The refined images are ready for gdalwarp -rpc."
    ),
    params=(
        IMAGES,
        *POINT_PARAMS,
        Param(
            "tie-points", Kind.POINTS, "auto finds them in the images, none does without, FILE reads them",
            default=AUTOMATIC, metavar="auto|none|FILE",
        ),
        DEM,
        DEM_DATUM,
        REFERENCE,
        *REFERENCE_PARAMS,
        *SEARCH_PARAMS,
        *ADJUST_PARAMS,
        *BLOCK_OUTPUT_PARAMS,
    ),
    run=run,
    packages=("cv2", "dask"),
)  # fmt: skip
