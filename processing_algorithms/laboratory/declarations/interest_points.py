"""`interest-points`: corners, super points and gravity centres of images (thesis chapters 2 and 3)."""

from __future__ import annotations

from ....hrsi_engine.foundation.options import nest_options, option, options
from ....hrsi_engine.laboratory.interest_points.options import DETECTOR_SETS, DetectionOptions
from ...interface import option_groups as groups
from ...interface.declare import Algorithm

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
        "time; used to flag dark centres that are shadows",
        minimum=0.0,
        maximum=360.0,
        unit="deg",
    )
    detection: DetectionOptions = nest_options(DetectionOptions)
    terrain: groups.TerrainOptions = nest_options(groups.TerrainOptions)
    folder: groups.ResultFolder = nest_options(groups.ResultFolder)


ALGORITHM = Algorithm(
    name="interest-points",
    title="Detect interest points",
    group="Image points",
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
)
