"""`triangulate`: the main job, from images and ground points to refined RPCs, residual layers and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .adjust import ALGORITHM as ADJUST
from .block_params import ADJUST_PARAMS, BLOCK_OUTPUT_PARAMS, IMAGES, POINT_PARAMS
from .declare import Context, Kind, Param, Report
from .image_files import open_images
from .terrain import DEM, DEM_DATUM

if TYPE_CHECKING:
    from ..hrsi_engine.block import Image, ImagePoints

NO_TIE_POINTS, AUTOMATIC = "none", "auto"


def run(options: Mapping[str, Any], context: Context) -> Report:
    """Find or read tie points, adjust, write."""
    from ..hrsi_engine.adjustment import adjust
    from ..hrsi_engine.io.output_dir import check_output_dir
    from ..hrsi_engine.progress import stage
    from . import block_inputs, block_outputs, model_choice

    check_output_dir(options["output_dir"], options["overwrite"])
    clock = block_outputs.Clock()
    images = open_images(options["images"], context.log)
    clock.lap("read")
    found, warnings = _automatic_ties(images, options, Context(stage(context.progress, 0.0, 0.5), context.log))
    clock.lap("tie_points")
    file = None if options["tie_points"] in (NO_TIE_POINTS, AUTOMATIC) else options["tie_points"]
    block, more = block_inputs.read_block(images, dict(options) | {"tie_points_file": file}, found)
    chosen = model_choice.choose(block, options)
    result = adjust(block, block_inputs.adjust_options(chosen.options), stage(context.progress, 0.5, 0.7))
    clock.lap("adjust")
    rest = Context(stage(context.progress, 0.7, 1.0), context.log)
    return block_outputs.write_results(
        "triangulate", options, result, [*warnings, *more, *chosen.warnings], clock, rest, chosen.entries
    )


def _automatic_ties(
    images: Sequence[Image], options: Mapping[str, Any], context: Context
) -> tuple[list[ImagePoints], list[str]]:
    if options["tie_points"] != AUTOMATIC:
        return [], []
    from ..hrsi_engine.measurement.tie_points import TieOptions, find_tie_points
    from . import block_inputs

    heights = block_inputs.terrain_heights(images, options)
    found = find_tie_points(images, TieOptions(heights, margin_px=options["search_margin"]), context.progress)
    for (first, second), count in found.matches.items():
        context.log(f"{first} - {second}: {count} matches")
    return [found.image_points], list(found.warnings)


ALGORITHM = replace(
    ADJUST,
    name="triangulate",
    title="Triangulate block",
    summary="Tie points and GCPs to refined RPCs, residual layers and a report",
    help=(
        "The main job. Finds tie points between overlapping images, takes ground control points from a vector layer or "
        "CSV, corrects all RPCs in one bundle block adjustment and reports how well the check points agree. "
        "Without any GCP the block is held where its RPCs put it, and the images fit one another. "
        "The refined images are ready for gdalwarp -rpc."
    ),
    params=(
        IMAGES,
        *POINT_PARAMS,
        Param(
            "tie-points", Kind.TEXT, "auto finds them in the images, none does without, FILE reads them",
            default=AUTOMATIC, metavar="auto|none|FILE",
        ),
        DEM,
        DEM_DATUM,
        Param(
            "search-margin", Kind.NUMBER, "How far the RPCs may be off when tie points are searched", default=128.0,
            minimum=0.0, unit="px", advanced=True, metavar="PX",
        ),
        *ADJUST_PARAMS,
        *BLOCK_OUTPUT_PARAMS,
    ),
    run=run,
)  # fmt: skip
