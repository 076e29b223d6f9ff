"""`interest-points`: corners, super points and gravity centres of images."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.measurement.interest_points.options import DETECTOR_SETS, DetectionOptions
from ..interface.declare import Algorithm
from ..interface.option_groups import ResultFolder, TerrainOptions, band_option, images_option, window_option

LAYERS_FILE, LAYER = "interest_points.gpkg", "interest_points"


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


ALGORITHM = Algorithm(
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
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip
