"""Image points: the algorithms that find or measure them."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.measurement.control_network.options import ControlNetworkOptions
from ...hrsi_engine.measurement.interest_points.options import DETECTOR_SETS, DetectionOptions
from ...hrsi_engine.measurement.targets.options import TargetOptions
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    POINTS,
    Common,
    MandatoryDem,
    MandatoryReference,
    ResultFolder,
    SearchOptions,
    TerrainOptions,
    band_option,
    ground_crs_option,
    height_datum_option,
    images_option,
    report_option,
    strict_datum_option,
    window_option,
)

TIES_FILE, TIES_LAYER = "block.gpkg", "tie_points"


@options(kw_only=True)
class TiePointsOptions:
    """What `tie-points` takes."""

    images: tuple[str, ...] = images_option("Images with RPC")
    add_to: str | None = option(
        None,
        "Output directory of an earlier search, whose images these join: its tie points are kept, and only pairs with "
        "new images are matched",
        metavar="DIR",
    )
    terrain: TerrainOptions = nest_options(TerrainOptions)
    search: SearchOptions = nest_options(SearchOptions)
    csv: bool = option(False, "Write the measurements as CSV too")
    folder: ResultFolder = nest_options(ResultFolder)


TIE_POINTS = Algorithm(
    name="tie-points", title="Find tie points", group="Image points",
    summary="Automatic tie points over a block",
    help=(
        "Finds points that are on two or more images of a block. Overlaps are found at the true height of the "
        "ground, from a DEM or from the images themselves; what the RPCs are off is learnt at a low resolution; then "
        "windows of every image are matched with all images that show them, to a fraction of a pixel, with the "
        "standard deviation of each position. Points are spread evenly. Images of any size are read by windows; "
        "pairs and windows are independent parts, done by the threads of this machine or the workers of a Dask "
        "scheduler. What is finished is kept: the same command continues a run that was stopped.\n\n"
        "The result goes into adjust and triangulate as their `tie_points`. Sample 0, line 0 is the CENTRE of the "
        "first pixel."
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

    images: tuple[str, ...] = images_option("Images with RPC and pixels")
    reference: MandatoryReference = nest_options(MandatoryReference)
    dem: MandatoryDem = nest_options(MandatoryDem)
    height_datum: str = height_datum_option()
    strict_datum: bool = strict_datum_option()
    sigma_dem: float | None = option(
        None, "Standard deviation of the DEM's heights; by default from the size of its cells", minimum=1e-6, unit="m",
        metavar="M",
    )  # fmt: skip
    folder: ResultFolder = nest_options(ResultFolder)


GCPS_FROM_REFERENCE = Algorithm(
    name="gcps-from-reference", title="GCPs from reference image", group="Image points",
    summary="GCPs by matching raw images to a reference orthoimage and DEM",
    help=(
        "Finds textured places of an orthoimage in raw images, to a fraction of a pixel: RPC and DEM predict what each "
        "image should show, and matching finds it there. RPCs may be off by hundreds of pixels, the orthoimage may be "
        "of another season or sensor and coarser than the images. Matches that do not follow one bias of the image "
        "are left out. The GCPs have their position from the orthoimage, their height from the DEM (above the "
        "ellipsoid), and sigmas such that all points of the reference together count as what they share: 0.8 of its "
        "sigma and a little more, because errors of an orthoimage are alike over wide areas. A reference that lies "
        "farther beside the RPCs than ERR_BIAS and its own sigma explain is named.\n\n"
        "The layer gcps is ready for adjust and triangulate; triangulate with its `reference` does both in one go."
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

    images: tuple[str, ...] = images_option("Images, with or without RPC")
    detector: str = option("all", "What to find", choices=tuple(DETECTOR_SETS))
    window: str | None = window_option("Only this window of the image")
    band: int = band_option()
    sun_azimuth: float | None = option(
        None,
        "Azimuth of the sun when the images were taken, clockwise from north, where their deliveries tell neither that "
        "nor the time: flags dark centres that are shadows", minimum=0.0, maximum=360.0, unit="deg",
    )  # fmt: skip
    detection: DetectionOptions = nest_options(DetectionOptions)
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: ResultFolder = nest_options(ResultFolder)


INTEREST_POINTS = Algorithm(
    name="interest-points", title="Detect interest points", group="Image points",
    summary="Corners, super points and gravity centres of images as a point layer",
    help=(
        "Finds corners (Harris or Foerstner) and gravity centres of closed bright or dark objects: roundabouts, tanks, "
        "roofs, pools, ponds, trees, plots, and of bright and dark spots inside a closed outline (blobs). The quality "
        "of a centre is its chance to be found again in another view, measured on real pairs of one date: of those "
        "of the default 56 to 76 in 100 were. Positions are to a fraction of a pixel and come with their standard "
        "deviation, size, orientation and quality. Thresholds follow from each image's own statistics, relative to "
        "the surroundings of every pixel, so that forest, field and city all deliver points. Images of any size are "
        "read in overlapping windows; the result does not depend on them. Nodata and saturated areas are left out.\n\n"
        "Where the sun stood is read from the delivery (MEANSUNAZ, SUN_AZIMUTH, Sun Angle Azimuth), else follows from "
        "the time and place of the acquisition. Then the field `shadow` says of dark centres whether they are the "
        "shadow side of something (yes, no; unknown without an RPC or the sun). On real images half to nine in ten "
        "of those flagged owe it to the sun; they are found again as often as others, so their quality is not lower. "
        "Across dates with another sun they move, and are the first to leave out.\n\n"
        "The layer lies at the points' ground positions where the image has an RPC (at its mean height, a given "
        "height or a DEM), and it can be used as image points again. Sample 0, line 0 is the CENTRE of the first pixel."
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

    images: tuple[str, ...] = images_option("Images, with or without RPC")
    window_1: str | None = window_option("Only this window of the first image")
    window_2: str | None = window_option("Only this window of the second image")
    band: int = band_option("Band of the images")
    matching: ControlNetworkOptions = nest_options(ControlNetworkOptions)
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option("Write report.html with a picture of both windows")


MATCH = Algorithm(
    name="match", title="Match two images", group="Image points",
    summary="Corresponding points of two images or windows without RPC, by control networks",
    help=(
        "Finds hundreds to thousands of corresponding points in two images of the same ground, whatever their "
        "rotation: the strongest interest points form a network whose shape is looked for in the other image; all "
        "others are found from its nodes, compared by their grey values and measured to a fraction of a pixel. No RPC "
        "is needed. "
        "Where the texture repeats, so that the network fits in several places, the status is 'ambiguous'; where it "
        "fits nowhere, 'no match'; then there are no correspondences, the report says why, and the command ends with "
        "exit code 1.\n\n"
        "Windows are read as a whole: choose them with `window_1` and `window_2` in large images. Sample 0, line 0 is "
        "the CENTRE of the first pixel."
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
        None, "Approximate positions, on images or on the ground", kind=Kind.POINTS, metavar=POINTS
    )
    edges: str | None = option(
        None, "Hand-measured edge points, those of a target under one id", kind=Kind.POINTS, metavar="FILE"
    )
    kind: str = option(
        AUTOMATIC_KIND,
        "What the targets are; auto takes the field kind, and centres where there is none",
        choices=(AUTOMATIC_KIND, "center", "corner"),
    )
    target: TargetOptions = nest_options(TargetOptions)
    ground_crs: str | None = ground_crs_option()
    height_datum: str = height_datum_option()
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option("Write report.html with a chip of every target")
    common: Common = nest_options(Common)


MEASURE_TARGETS = Algorithm(
    name="measure-targets", title="Measure targets", group="Image points",
    summary="Sub-pixel centre or corner near given positions, or from hand-measured edge points",
    help=(
        "Measures points that were clicked roughly: the centre of a round or otherwise closed object (an ellipse or "
        "rectangle through its sub-pixel edge points), or the corner where two straight edges meet (a line through "
        "three edge points or more each). Stray edge points are left out, every point gets its standard deviation, and "
        "a point is refused where the feature is not there; an object that does not cover the position must be a clear "
        "one. Positions come from a point file with sample and line, or from ground points that the images' RPCs "
        "project.\n\n"
        "With `edges` no pixels are needed: the edge points of a file (id, image, sample, line) are evaluated, six or "
        "more around an ellipse, or three or more on each of two lines. The report shows a chip of every target."
    ),
    options=MeasureTargetsOptions,
    examples=(
        "hrsi measure-targets block/image_*.tif --points block/ground_points.csv "
        "--height-datum ellipsoidal --output-dir targets",
    ),
    layers=(f"{TARGETS_FILE}|layername={TARGETS_LAYER}",),
)  # fmt: skip

ALGORITHMS = (TIE_POINTS, GCPS_FROM_REFERENCE, INTEREST_POINTS, MATCH, MEASURE_TARGETS)
