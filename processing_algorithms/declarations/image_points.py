"""Declarations of the algorithms that find or measure image points."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.measurement.targets.options import TargetOptions
from ..interface import option_groups as groups
from ..interface.declare import Algorithm, Kind

TIES_FILE, TIES_LAYER = "block.gpkg", "tie_points"


@options(kw_only=True)
class TiePointsOptions:
    """Options of `tie-points`."""

    images: tuple[str, ...] = groups.images_option("Images with RPC")
    add_to: str | None = option(
        None,
        "Output directory of an earlier search, to which the images are added: its tie points are kept, and only "
        "pairs with new images are matched",
        metavar="DIR",
    )
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    search: groups.SearchOptions = nest_options(groups.SearchOptions)
    csv: bool = option(False, "Also write the measurements as CSV")
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


TIE_POINTS = Algorithm(
    name="tie-points",
    title="Find tie points",
    group="Image points",
    summary="Automatic tie points of a block",
    help=(
        "Finds points that are visible in two or more images of a block. Overlaps are computed at the height of the "
        "ground, from a DEM or from the images themselves, and the errors of the RPCs are estimated at a low "
        "resolution. Windows of every image are then matched with all images that show them, with sub-pixel accuracy "
        "and a standard deviation of each position. Points are spread evenly. Images of any size are read by windows. "
        "Pairs and windows are independent parts, processed by threads of this machine or by workers of a Dask "
        "scheduler. Finished parts are kept, so that the same command continues a run that was stopped.\n\nThe result "
        "is the input `tie_points` of adjust and triangulate. Sample 0, line 0 is the CENTRE of the first pixel."
    ),
    options=TiePointsOptions,
    examples=(
        "hrsi tie-points block/image_*.tif --dem block/dem.tif --height-datum ellipsoidal --csv --output-dir ties",
    ),
    layers=(f"{TIES_FILE}|layername={TIES_LAYER}",),
)


GCPS_FILE, GCPS_LAYER = "gcps.gpkg", "gcps"


@options(kw_only=True)
class GcpsFromReferenceOptions:
    """Options of `gcps-from-reference`."""

    images: tuple[str, ...] = groups.images_option("Images with RPC and pixels")
    reference: groups.MandatoryReference = nest_options(groups.MandatoryReference)
    dem: groups.MandatoryDem = nest_options(groups.MandatoryDem)
    height_datum: str = groups.height_datum_option()
    strict_datum: bool = groups.strict_datum_option()
    sigma_dem: float | None = option(
        None,
        "Standard deviation of the heights of the DEM; by default from its cell size",
        minimum=1e-6,
        unit="m",
        metavar="M",
    )
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


GCPS_FROM_REFERENCE = Algorithm(
    name="gcps-from-reference",
    title="GCPs from reference image",
    group="Image points",
    summary="GCPs by matching raw images to a reference orthoimage and DEM",
    help=(
        "Finds textured windows of an orthoimage in raw images with sub-pixel accuracy: RPC and DEM predict the "
        "content of each image, and matching measures its position. The RPCs may have errors of hundreds of pixels; "
        "the orthoimage may be of another season or sensor and coarser than the images. Matches that contradict the "
        "common bias of the image are rejected. The GCPs have the position of the orthoimage and the ellipsoidal "
        "height of the DEM. Errors of an orthoimage are correlated over large areas. The sigmas are therefore chosen "
        "so that all points together have the weight of their common error, 0.8 of the sigma of the reference. A "
        "warning is given if the reference differs from the RPCs by more than ERR_BIAS and its sigma allow.\n\nThe "
        "layer gcps is an input of adjust and triangulate; triangulate with `reference` does both in one run."
    ),
    options=GcpsFromReferenceOptions,
    examples=(
        "hrsi gcps-from-reference block/image_*.tif --reference block/orthophoto.tif "
        "--dem block/dem.tif --height-datum ellipsoidal --output-dir control",
    ),
    layers=(f"{GCPS_FILE}|layername={GCPS_LAYER}",),
)


AUTOMATIC_KIND = "auto"


TARGETS_FILE, TARGETS_LAYER = "targets.gpkg", "targets"


@options(kw_only=True)
class MeasureTargetsOptions:
    """Options of `measure-targets`."""

    images: tuple[str, ...] = option((), "Images; not needed with `edges`", kind=Kind.IMAGES)
    points: str | None = option(
        None, "Approximate positions, on images or on the ground", kind=Kind.POINTS, metavar=groups.POINTS
    )
    edges: str | None = option(
        None, "Edge points measured by hand; those of one target have one id", kind=Kind.POINTS, metavar="FILE"
    )
    kind: str = option(
        AUTOMATIC_KIND,
        "Kind of targets; auto uses the field kind, or centres without it",
        choices=(AUTOMATIC_KIND, "center", "corner"),
    )
    target: TargetOptions = nest_options(TargetOptions)
    ground_crs: str | None = groups.ground_crs_option()
    height_datum: str = groups.height_datum_option()
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option("Write report.html with a chip of every target")


MEASURE_TARGETS = Algorithm(
    name="measure-targets",
    title="Measure targets",
    group="Image points",
    summary="Sub-pixel centre or corner near given positions, or from edge points measured by hand",
    help=(
        "Measures targets near approximate positions. A centre is that of an ellipse or rectangle through the "
        "sub-pixel edge points of a closed object. A corner is the intersection of two straight edges, with at least "
        "three edge points each. Outlying edge points are rejected, and every point has a standard deviation. A point "
        "is refused if there is no such object; an object that does not cover the position must have a clear edge. "
        "Positions are read from a point file with sample and line, or projected from ground points with the RPCs of "
        "the images.\n\n`edges` needs no pixels: the edge points of a file (id, image, sample, line) are used, at "
        "least six around an ellipse, or three on each of two lines. The report shows a chip of every target."
    ),
    options=MeasureTargetsOptions,
    examples=(
        "hrsi measure-targets block/image_*.tif --points block/ground_points.csv "
        "--height-datum ellipsoidal --output-dir targets",
    ),
    layers=(f"{TARGETS_FILE}|layername={TARGETS_LAYER}",),
)

ALGORITHMS = (TIE_POINTS, GCPS_FROM_REFERENCE, MEASURE_TARGETS)
