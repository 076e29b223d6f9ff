"""Declarations of the algorithms that adjust the RPCs of images."""

from __future__ import annotations

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.refinement.model_table import RefineOptions
from ..interface import option_groups as groups
from ..interface.declare import Algorithm, Kind

#: Layers of an adjusted block that are shown on a map.
BLOCK_LAYERS = tuple(f"block.gpkg|layername={name}" for name in ("images", "ground_points", "residuals_utm"))


@options(kw_only=True)
class TriangulateOptions:
    """Options of `triangulate`."""

    images: tuple[str, ...] = groups.images_option()
    points: groups.PointFiles = nest_options(groups.PointFiles)
    tie_points: str = option(
        groups.AUTOMATIC_TIES,
        f"Tie points: {groups.AUTOMATIC_TIES} finds them in the images, {groups.NO_TIES} uses none, FILE or the folder "
        "of a result contains them",
        kind=Kind.POINTS,
        metavar=f"{groups.AUTOMATIC_TIES}|{groups.NO_TIES}|FILE",
    )
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    surface: groups.SurfaceFile = nest_options(groups.SurfaceFile)
    laser: groups.LaserFile = nest_options(groups.LaserFile)
    reference: groups.ReferenceImage = nest_options(groups.ReferenceImage)
    growth: groups.BlockGrowthOptions = nest_options(groups.BlockGrowthOptions)
    search: groups.SearchOptions = nest_options(groups.SearchOptions)
    adjustment: AdjustOptions = nest_options(AdjustOptions)
    hold_out: float = groups.hold_out_option()
    output: groups.BlockOutput = nest_options(groups.BlockOutput)


TRIANGULATE = Algorithm(
    name="triangulate",
    title="Triangulate block",
    group="Triangulation",
    summary="Refined RPCs of a block from tie points and GCPs, with residual layers and a report",
    help=(
        "Finds tie points between overlapping images, reads GCPs from a vector layer or CSV, corrects all RPCs in one "
        "bundle block adjustment and reports the accuracy at check points. GCPs can also be measured in an orthoimage "
        "(`reference`, with `dem`). Without GCPs the position of the block follows from its RPCs, or from the relief "
        "of a `surface`, and the relative accuracy of the images is improved. The refined images can be used with "
        "gdalwarp -rpc."
    ),
    options=TriangulateOptions,
    examples=(
        "hrsi triangulate block/image_*.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --dem block/dem.tif --height-datum ellipsoidal --output-dir result",
        "hrsi triangulate block --dem block/dem.tif --height-datum ellipsoidal --sigma-dem 2 --output-dir relative",
    ),
    main=("gcps", "image-points", "tie-points", "dem", "dem-datum", "height-datum", "gcp-ids", "model"),
    layers=BLOCK_LAYERS,
    images_made="Refined images",
)


@options(kw_only=True)
class AdjustAlgorithmOptions:
    """Options of `adjust`."""

    images: tuple[str, ...] = groups.images_option()
    points: groups.PointFiles = nest_options(groups.PointFiles)
    tie_points: str = option(
        groups.NO_TIES,
        "Tie points: FILE with points measured in two or more images, or folder of a result; "
        f"{groups.NO_TIES} uses none",
        kind=Kind.POINTS,
        metavar=f"{groups.NO_TIES}|FILE",
    )
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    surface: groups.SurfaceFile = nest_options(groups.SurfaceFile)
    laser: groups.LaserFile = nest_options(groups.LaserFile)
    growth: groups.BlockGrowthOptions = nest_options(groups.BlockGrowthOptions)
    adjustment: AdjustOptions = nest_options(AdjustOptions)
    hold_out: float = groups.hold_out_option()
    output: groups.BlockOutput = nest_options(groups.BlockOutput)


ADJUST = Algorithm(
    name="adjust",
    title="Adjust block",
    group="Triangulation",
    summary="Bundle block adjustment from existing image points",
    help=(
        "Corrects the RPCs of all images of a block in one adjustment, from GCPs, tie points or both, and reports the "
        "accuracy at check points. Writes refined RPCs, residual layers and a report."
    ),
    options=AdjustAlgorithmOptions,
    examples=(
        "hrsi adjust block/image_*.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --height-datum ellipsoidal --output-dir adjusted",
        "hrsi adjust block/image_*.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --height-datum ellipsoidal --dry-run --output-dir checked",
    ),
    main=("gcps", "image-points", "tie-points", "dem", "height-datum", "gcp-ids", "check-ids", "model"),
    layers=BLOCK_LAYERS,
    images_made="Refined images",
)


@options(kw_only=True)
class RefineAlgorithmOptions:
    """Options of `refine-rpc`."""

    images: tuple[str, ...] = groups.images_option()
    points: groups.PointFiles = nest_options(groups.PointFiles)
    dem: groups.DemOptions = nest_options(groups.DemOptions)
    refinement: RefineOptions = nest_options(RefineOptions)
    compare: bool = option(False, "Add a table of all models with the same GCPs and check points")
    coefficient_covariance: str | None = option(
        None,
        "Covariance matrix of the normalised coefficients of the RPC, for the direct methods: a text file of 78 "
        "lines with 78 numbers, sample numerator, sample denominator, line numerator, line denominator",
        kind=Kind.FILE,
        advanced=True,
    )
    output: groups.BlockOutput = nest_options(groups.BlockOutput)


REFINE_RPC = Algorithm(
    name="refine-rpc",
    title="Refine RPC",
    group="Triangulation",
    summary="Refined RPCs of single images from ground control points",
    help=(
        "Corrects the RPC of each image separately, from the GCPs measured in it. auto chooses the model with the "
        "smallest leave-one-out error of the GCPs, and rejects GCPs that contradict the others; generic corrects "
        "position and attitude of a pseudo sensor. Writes refined RPCs, residual layers and a report; `compare` adds "
        "a table of all models with the same GCPs and check points."
    ),
    options=RefineAlgorithmOptions,
    examples=(
        "hrsi refine-rpc block/image_1.tif --gcps block/ground_points.csv "
        "--image-points block/image_points.csv --height-datum ellipsoidal --compare --write none --output-dir refined",
    ),
    main=("gcps", "image-points", "gcp-ids", "check-ids", "height-datum", "model", "compare", "write"),
    layers=BLOCK_LAYERS,
    images_made="Refined images",
)

ALGORITHMS = (TRIANGULATE, ADJUST, REFINE_RPC)
