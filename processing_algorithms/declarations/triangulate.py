"""`triangulate`: the main job, from images and ground points to refined RPCs, residual layers and a report."""

from __future__ import annotations

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    AUTOMATIC_TIES,
    NO_TIES,
    BlockGrowthOptions,
    BlockOutput,
    DemOptions,
    LaserFile,
    PointFiles,
    ReferenceImage,
    SearchOptions,
    hold_out_option,
    images_option,
)


@options(kw_only=True)
class TriangulateOptions:
    """What `triangulate` takes."""

    images: tuple[str, ...] = images_option()
    points: PointFiles = nest_options(PointFiles)
    tie_points: str = option(
        AUTOMATIC_TIES,
        f"{AUTOMATIC_TIES} finds them in the images, {NO_TIES} does without, FILE or a result's folder has them",
        kind=Kind.POINTS,
        metavar=f"{AUTOMATIC_TIES}|{NO_TIES}|FILE",
    )
    dem: DemOptions = nest_options(DemOptions)
    laser: LaserFile = nest_options(LaserFile)
    reference: ReferenceImage = nest_options(ReferenceImage)
    growth: BlockGrowthOptions = nest_options(BlockGrowthOptions)
    search: SearchOptions = nest_options(SearchOptions)
    adjustment: AdjustOptions = nest_options(AdjustOptions)
    hold_out: float = hold_out_option()
    output: BlockOutput = nest_options(BlockOutput)


ALGORITHM = Algorithm(
    name="triangulate", title="Triangulate block", group="Triangulation",
    summary="Tie points and GCPs to refined RPCs, residual layers and a report",
    help=(
        "The main job. Finds tie points between overlapping images, takes ground control points from a vector layer or "
        "CSV, corrects all RPCs in one bundle block adjustment and reports how well the check points agree. "
        "GCPs may also come from an orthoimage (`reference`, with `dem`). "
        "Without any GCP the block is held where its RPCs put it, and the images fit one another. "
        "The refined images are ready for gdalwarp -rpc."
    ),
    options=TriangulateOptions,
    examples=(
        "hrsi triangulate block/image_*.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --dem block/dem.tif --height-datum ellipsoidal --output-dir result",
        "hrsi triangulate block --dem block/dem.tif --height-datum ellipsoidal --sigma-dem 2 --output-dir relative",
    ),
    layers=("block.gpkg|layername=images", "block.gpkg|layername=ground_points", "block.gpkg|layername=residuals_utm"),
    images_made="Refined images",
)  # fmt: skip
