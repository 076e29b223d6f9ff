"""`refine-rpc`: one image or several, each by itself, from ground control points only."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.refinement.options import RefineOptions
from ..interface.declare import Algorithm
from ..interface.option_groups import BlockOutput, PointFiles, images_option


@options(kw_only=True)
class RefineAlgorithmOptions:
    """What `refine-rpc` takes."""

    images: tuple[str, ...] = images_option()
    points: PointFiles = nest_options(PointFiles)
    refinement: RefineOptions = nest_options(RefineOptions)
    compare: bool = option(False, "Tabulate all models on the same control and check points")
    output: BlockOutput = nest_options(BlockOutput)


ALGORITHM = Algorithm(
    name="refine-rpc", title="Refine RPC", group="Triangulation",
    summary="Refined RPCs of single images from ground control points",
    help=(
        "Corrects the RPC of each image by itself, from the GCPs measured on it. The model auto chooses what predicts "
        "GCPs best from the others, names GCPs that disagree and leaves them out; generic corrects position and "
        "attitude of a pseudo sensor. Writes refined RPCs, residual layers and a report; `compare` adds a table of all "
        "models with the same control and check points."
    ),
    options=RefineAlgorithmOptions,
    examples=(
        "hrsi refine-rpc block/image_1.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --height-datum ellipsoidal --compare --write none --output-dir refined",
    ),
    layers=("block.gpkg|layername=images", "block.gpkg|layername=ground_points", "block.gpkg|layername=residuals_utm"),
    images_made="Refined images",
)  # fmt: skip
