"""`adjust`: the block adjustment from existing image points."""

from __future__ import annotations

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    NO_TIES,
    BlockGrowthOptions,
    BlockOutput,
    DemOptions,
    LaserFile,
    PointFiles,
    hold_out_option,
    images_option,
)


@options(kw_only=True)
class AdjustAlgorithmOptions:
    """What `adjust` takes."""

    images: tuple[str, ...] = images_option()
    points: PointFiles = nest_options(PointFiles)
    tie_points: str = option(
        NO_TIES,
        f"FILE of further image points, measured on two or more images, or folder of a result; {NO_TIES} does without",
        kind=Kind.POINTS,
        metavar=f"{NO_TIES}|FILE",
    )
    dem: DemOptions = nest_options(DemOptions)
    laser: LaserFile = nest_options(LaserFile)
    growth: BlockGrowthOptions = nest_options(BlockGrowthOptions)
    adjustment: AdjustOptions = nest_options(AdjustOptions)
    hold_out: float = hold_out_option()
    output: BlockOutput = nest_options(BlockOutput)


ALGORITHM = Algorithm(
    name="adjust", title="Adjust block", group="Triangulation",
    summary="Bundle block adjustment from existing image points",
    help=(
        "Corrects the RPCs of all images of a block together, from ground control points, tie points or both, "
        "and reports how well the check points agree. Writes refined RPCs, residual layers and a report."
    ),
    options=AdjustAlgorithmOptions,
    examples=(
        "hrsi adjust block/image_*.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --height-datum ellipsoidal --output-dir adjusted",
        "hrsi adjust block/image_*.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --height-datum ellipsoidal --dry-run --output-dir checked",
    ),
    layers=("block.gpkg|layername=images", "block.gpkg|layername=ground_points", "block.gpkg|layername=residuals_utm"),
    images_made="Refined images",
)  # fmt: skip
