"""`triangulate`: the main job, from images and ground points to refined RPCs, residual layers and a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..hrsi_engine.adjustment.options import AdjustOptions
from ..hrsi_engine.foundation.options import nested, option
from .adjust import ALGORITHM as ADJUST
from .block_steps.options import BlockOutput, PointFiles, images_option
from .block_steps.reference_control import ReferenceImage
from .block_steps.tie_search import SearchOptions
from .files.image_files import open_images
from .files.terrain import DemOptions
from .interface.declare import Context, Kind, Report

if TYPE_CHECKING:
    from ..hrsi_engine.block.block import Image, ImagePoints
    from .block_steps.tie_search import Finished

NO_TIE_POINTS, AUTOMATIC = "none", "auto"


@dataclass(frozen=True, kw_only=True)
class TriangulateOptions:
    """What `triangulate` takes."""

    images: tuple[str, ...] = images_option()
    points: PointFiles = nested(PointFiles)
    tie_points: str = option(
        AUTOMATIC,
        "auto finds them in the images, none does without, FILE reads them",
        kind=Kind.POINTS,
        metavar="auto|none|FILE",
    )
    dem: DemOptions = nested(DemOptions)
    reference: ReferenceImage = nested(ReferenceImage)
    search: SearchOptions = nested(SearchOptions)
    adjustment: AdjustOptions = nested(AdjustOptions)
    output: BlockOutput = nested(BlockOutput)


def run(options: TriangulateOptions, context: Context) -> Report:
    """Find or read tie points, adjust, write."""
    from ..hrsi_engine.adjustment.solver import adjust
    from ..hrsi_engine.foundation.progress import stage
    from .block_steps import dem_offset, model_choice, plausibility, reference_control
    from .block_steps import inputs as block_inputs
    from .block_steps import outputs as block_outputs

    clock = block_outputs.Clock()
    images = open_images(options.images, context.log)
    block_outputs.require_room(options.output, images, context)
    clock.lap("read")
    searching = context.stage(0.0, 0.4)
    found, warnings, finished = _automatic_ties(images, options, searching)
    clock.lap("tie_points")
    file = None if options.tie_points in (NO_TIE_POINTS, AUTOMATIC) else options.tie_points
    reading = context.stage(0.4, 0.5)
    sigma_dem_m = options.adjustment.sigma_dem_m
    block, more, entries = reference_control.read_block(
        images, options.points, options.dem, file, found, options.reference, sigma_dem_m, reading
    )
    how = options.adjustment
    reasons = plausibility.input_reasons(block, options.points, options.dem, how.sigma_shift_px, how.sigma_drift)
    clock.lap("check")
    with plausibility.explained_by(reasons):
        chosen = model_choice.choose(block, options.adjustment)
        how = block_inputs.with_dem(chosen.options, options.dem, options.points.height_datum)
        result = adjust(block, how, stage(context.progress, 0.5, 0.7))
    clock.lap("adjust")
    rest = context.stage(0.7, 1.0)
    offset = dem_offset.offset_warning(result, options.dem, options.points.height_datum, sigma_dem_m)
    warnings += [*more, *chosen.warnings, *offset]
    report = block_outputs.write_results(
        "triangulate", options, result, warnings, clock, rest, {**entries, **chosen.entries}, reasons
    )
    if finished is not None:
        finished.remove()
    return report


def _automatic_ties(
    images: Sequence[Image], options: TriangulateOptions, context: Context
) -> tuple[list[ImagePoints], list[str], Finished | None]:
    if options.tie_points != AUTOMATIC:
        return [], [], None
    from .block_steps.tie_search import find

    surface = options.dem.surface(options.points.height_datum)
    found, finished = find(images, options.search, surface, options.output.folder.output_dir, context)
    return [found.image_points], list(found.warnings), finished


ALGORITHM = replace(
    ADJUST,
    name="triangulate",
    title="Triangulate block",
    summary="Tie points and GCPs to refined RPCs, residual layers and a report",
    help=(
        "The main job. Finds tie points between overlapping images, takes ground control points from a vector layer or "
        "CSV, corrects all RPCs in one bundle block adjustment and reports how well the check points agree. "
        "GCPs may also come from an orthoimage (`reference`, with `dem`). "
        "Without any GCP the block is held where its RPCs put it, and the images fit one another. "
        "The refined images are ready for gdalwarp -rpc."
    ),
    options=TriangulateOptions,
    run=run,
    packages=("cv2", "dask"),
)
