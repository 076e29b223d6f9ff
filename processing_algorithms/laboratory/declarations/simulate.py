"""`simulate`: a synthetic block with images, DEM, GCPs, noise and full truth."""

from __future__ import annotations

from typing import Any

from ....hrsi_engine.foundation.options import nest_options, option, options
from ....hrsi_engine.laboratory.simulation.options import (
    HEADING_DEG,
    SENSOR_NAMES,
    STRIP_OVERLAP,
    FreeDemSpec,
    FreeOrthoSpec,
    LaserSpec,
    Noise,
    PointCounts,
    SceneSpec,
)
from ...interface.declare import Algorithm
from ...interface.option_groups import ResultFolder


@options
class ViewOptions:
    """Which sensor looks from where."""

    sensor: str = option("pleiades", "Sensor of the images", choices=SENSOR_NAMES)
    images: int = option(2, "Number of images of each place and date", minimum=1, maximum=50, metavar="N")
    dates: int = option(
        1,
        "Number of dates in a year, each with another viewing direction and sun position; 1: all images on one day",
        minimum=1,
        maximum=366,
        metavar="N",
    )
    off_nadir: float = option(
        20.0,
        "Largest off-nadir angle of the views of many dates",
        minimum=0.0,
        maximum=35.0,
        unit="deg",
        advanced=True,
        metavar="DEG",
    )
    size: int = option(
        2000, "Samples of each image, and lines if they are not given", minimum=64, unit="px", metavar="PX"
    )
    lines: int = option(0, "Lines of each image; 0: equal to the samples", minimum=0, unit="px", metavar="PX")
    along: tuple[str, ...] = option(
        (), "Off-nadir angles along the track, one for each image of a place", unit="deg", metavar="A,B,…"
    )
    across: float = option(
        0.0, "Off-nadir angle to the right of the track", minimum=-50.0, maximum=50.0, unit="deg", metavar="DEG"
    )
    heading: float = option(HEADING_DEG, "Azimuth of the flight direction", unit="deg", metavar="DEG")
    strips: int = option(1, "Number of adjacent strips", minimum=1, advanced=True, metavar="N")
    places: int = option(1, "Number of scenes along each strip", minimum=1, advanced=True, metavar="N")
    overlap: float = option(
        STRIP_OVERLAP,
        "Overlap of neighbouring scenes, as a share",
        minimum=0.0,
        maximum=0.9,
        advanced=True,
        metavar="SHARE",
    )


def _error_option(what: str, unit: str) -> Any:
    return option(
        (),
        f"Error of the vendor's {what}, the same for all images, instead of a random one",
        unit=unit,
        advanced=True,
        metavar="A,B,C",
    )


@options
class VendorErrorOptions:
    """Errors of the vendor's orientation that are not random."""

    vendor_position: tuple[str, ...] = _error_option("position east, north and up", "m")
    vendor_position_drift: tuple[str, ...] = _error_option("position, its change over the image", "m")
    vendor_attitude: tuple[str, ...] = _error_option("roll, pitch and yaw", "rad")
    vendor_attitude_drift: tuple[str, ...] = _error_option("roll, pitch and yaw, their change over the image", "rad")
    jitter: tuple[str, ...] = option(
        (),
        "Vibration of the attitude, which the RPCs do not include: amplitude in px, period in lines, and so on; or a "
        "CSV file with the columns line, across and along (px)",
        advanced=True,
        metavar="PX,LINES,…|FILE",
    )
    jitter_period: float = option(
        2000.0,
        "Period of a vibration that `jitter` gives none",
        minimum=50.0,
        unit="lines",
        advanced=True,
        metavar="LINES",
    )


@options(kw_only=True)
class SimulateOptions:
    """What `simulate` takes."""

    views: ViewOptions = nest_options(ViewOptions)
    scene: SceneSpec = nest_options(SceneSpec)
    points: PointCounts = nest_options(PointCounts)
    noise: Noise = nest_options(Noise)
    vendor: VendorErrorOptions = nest_options(VendorErrorOptions)
    laser: LaserSpec = nest_options(LaserSpec)
    free_dem: FreeDemSpec = nest_options(FreeDemSpec)
    free_ortho: FreeOrthoSpec = nest_options(FreeOrthoSpec)
    pixels: bool = option(True, "Render the images; otherwise only RPC files are written")
    ms: bool = option(False, "Also render multispectral images with larger pixels")
    ortho: bool = option(False, "Write an orthoimage of the scene without errors")
    folder: ResultFolder = nest_options(ResultFolder)


ALGORITHM = Algorithm(
    name="simulate",
    title="Simulate block",
    group="Laboratory",
    summary="A synthetic block with images, DEM, GCPs, noise and full truth",
    help=(
        "Simulates pushbroom images of a fractal, textured terrain with an exact physical camera. The RPCs have "
        "errors of orbit and attitude like those of a vendor. Writes images, terrain (ellipsoidal heights), ground "
        "points, image points and the truth of all of them, to test methods and to plan blocks.\n\nWith `dates` the "
        "images are distributed over a year. Shading and cast shadows follow the sun; crops, leaves, ploughed fields "
        "and snow follow the season. Buildings have heights, and some are built or demolished; there are also cars, "
        "haze and gain. truth.gpkg contains all changes with their dates.\n\nWith `laser_passes` there are passes of "
        "a laser altimeter: laser.csv contains its points in the format of SlideRule, with the noise and misfits of "
        "real ICESat-2 segments, and true_laser.gpkg their true surface. `free_dem` writes free_dem.tif, a DEM with "
        "the errors of Copernicus GLO-30 (ellipsoidal heights; its displacement is in truth.json). `free_ortho` "
        "writes free_ortho.tif, an orthoimage in four bands of another season with errors of some metres, which are "
        "in report.json."
    ),
    options=SimulateOptions,
    examples=("hrsi simulate --images 2 --size 160 --gcps 8 --checks 4 --ties 20 --ortho --output-dir block",),
    main=("images", "size", "along", "sensor", "gcps", "checks", "ties", "ortho"),
    layers=(
        "truth.gpkg|layername=true_ground_points",
        "truth.gpkg|layername=true_image_points",
        "truth.gpkg|layername=objects",
    ),
)
