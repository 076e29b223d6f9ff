"""Image points: the algorithms that find or measure them."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.measurement.control_network.options import ControlNetworkOptions
from ...hrsi_engine.measurement.interest_points.options import DETECTOR_SETS, DetectionOptions
from ...hrsi_engine.measurement.targets.options import TargetOptions
from ..interface import option_groups as groups
from ..interface.declare import Algorithm, Kind

TIES_FILE, TIES_LAYER = "block.gpkg", "tie_points"


@options(kw_only=True)
class TiePointsOptions:
    """What `tie-points` takes."""

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
    name="tie-points", title="Find tie points", group="Image points",
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
)  # fmt: skip


GCPS_FILE, GCPS_LAYER = "gcps.gpkg", "gcps"


@options(kw_only=True)
class GcpsFromReferenceOptions:
    """What `gcps-from-reference` takes."""

    images: tuple[str, ...] = groups.images_option("Images with RPC and pixels")
    reference: groups.MandatoryReference = nest_options(groups.MandatoryReference)
    dem: groups.MandatoryDem = nest_options(groups.MandatoryDem)
    height_datum: str = groups.height_datum_option()
    strict_datum: bool = groups.strict_datum_option()
    sigma_dem: float | None = option(
        None, "Standard deviation of the heights of the DEM; by default from its cell size", minimum=1e-6, unit="m",
        metavar="M",
    )  # fmt: skip
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


GCPS_FROM_REFERENCE = Algorithm(
    name="gcps-from-reference", title="GCPs from reference image", group="Image points",
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
)  # fmt: skip


INTEREST_POINTS_FILE, INTEREST_POINTS_LAYER = "interest_points.gpkg", "interest_points"


@options(kw_only=True)
class InterestPointsOptions:
    """What `interest-points` takes."""

    images: tuple[str, ...] = groups.images_option("Images, with or without RPC")
    detector: str = option("all", "Kind of interest points", choices=tuple(DETECTOR_SETS))
    window: str | None = groups.window_option("Only this window of the image")
    band: int = groups.band_option()
    sun_azimuth: float | None = option(
        None,
        "Azimuth of the sun at the acquisition, clockwise from north, if the delivery contains neither it nor the "
        "time; used to flag dark centres that are shadows", minimum=0.0, maximum=360.0, unit="deg",
    )  # fmt: skip
    detection: DetectionOptions = nest_options(DetectionOptions)
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


INTEREST_POINTS = Algorithm(
    name="interest-points", title="Detect interest points", group="Image points",
    summary="Corners, super points and gravity centres of images as a point layer",
    help=(
        "Finds corners (Harris or Foerstner) and gravity centres of closed bright or dark objects: roundabouts, "
        "tanks, roofs, pools, ponds, trees, plots, and bright and dark spots with a closed outline (blobs). The "
        "quality of a centre is the probability that it is found again in another view, measured on real pairs of one "
        "date: 56 to 76 % for the default. Positions have sub-pixel accuracy, with standard deviation, size, "
        "orientation and quality. Thresholds follow from the statistics of each image in the surroundings of every "
        "pixel, so that forest, fields and cities all have points. Images of any size are read in overlapping "
        "windows; the result does not depend on them. Nodata and saturated areas are excluded.\n\nThe position of the "
        "sun is read from the delivery (MEANSUNAZ, SUN_AZIMUTH, Sun Angle Azimuth), or computed from time and place "
        "of the acquisition. The field `shadow` marks dark centres that are the shadow side of an object (yes, no; "
        "unknown without an RPC or the sun). On real images 50 to 90 % of the marked centres are shadows. In images "
        "of one date they are as repeatable as others, so their quality is not lower. Between dates with different "
        "sun positions they move, and should be excluded first.\n\nFor an image with RPC the layer has the ground "
        "positions of the points (at its mean height, a given height or a DEM). It can be used as image points again. "
        "Sample 0, line 0 is the CENTRE of the first pixel."
    ),
    options=InterestPointsOptions,
    examples=(
        "hrsi interest-points block/image_1.tif --detector centres --dem block/dem.tif "
        "--height-datum ellipsoidal --output-dir interest",
    ),
    layers=(f"{INTEREST_POINTS_FILE}|layername={INTEREST_POINTS_LAYER}",),
)  # fmt: skip


MATCH_FILE, MATCH_LAYER = "match.gpkg", "correspondences"


@options(kw_only=True)
class MatchAlgorithmOptions:
    """What `match` takes."""

    images: tuple[str, ...] = groups.images_option("Images, with or without RPC")
    window_1: str | None = groups.window_option("Only this window of the first image")
    window_2: str | None = groups.window_option("Only this window of the second image")
    band: int = groups.band_option("Band of the images")
    matching: ControlNetworkOptions = nest_options(ControlNetworkOptions)
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)
    report: bool = groups.report_option("Write report.html with a picture of both windows")


MATCH = Algorithm(
    name="match", title="Match two images", group="Image points",
    summary="Corresponding points of two images or windows, without RPC, by control networks",
    help=(
        "Finds hundreds to thousands of corresponding points in two images of the same ground with any rotation. The "
        "strongest interest points form a network whose shape is searched in the other image. All other points are "
        "found from its nodes, compared by their grey values and measured with sub-pixel accuracy. No RPC is needed. "
        "If the network fits in several places, because of repeated texture, the status is 'ambiguous'; if it fits "
        "nowhere, 'no match'. In both cases there are no correspondences, the report gives the reason, and the exit "
        "code is 1.\n\nWindows are read completely: choose them with `window_1` and `window_2` in large images. "
        "Sample 0, line 0 is the CENTRE of the first pixel."
    ),
    options=MatchAlgorithmOptions,
    examples=(
        "hrsi match block/image_1.tif block/image_2.tif --window-1 0,0,150,150 --window-2 0,0,150,150 "
        "--output-dir matches",
    ),
    layers=(f"{MATCH_FILE}|layername={MATCH_LAYER}",),
)  # fmt: skip


AUTOMATIC_KIND = "auto"


TARGETS_FILE, TARGETS_LAYER = "targets.gpkg", "targets"


@options(kw_only=True)
class MeasureTargetsOptions:
    """What `measure-targets` takes."""

    images: tuple[str, ...] = option((), "Images; not needed with `edges`", kind=Kind.IMAGES, metavar="IMAGE")
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
    common: groups.Common = nest_options(groups.Common)


MEASURE_TARGETS = Algorithm(
    name="measure-targets", title="Measure targets", group="Image points",
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
)  # fmt: skip

ALGORITHMS = (TIE_POINTS, GCPS_FROM_REFERENCE, INTEREST_POINTS, MATCH, MEASURE_TARGETS)
