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
from ...interface.option_groups import Common, ResultFolder


@options
class ViewOptions:
    """Which sensor looks from where."""

    sensor: str = option("pleiades", "Sensor that takes the images", choices=SENSOR_NAMES)
    images: int = option(2, "Number of images of each place and date", minimum=1, maximum=50, metavar="N")
    dates: int = option(
        1,
        "Number of dates over a year, each seen from another side under its own sun; 1 takes all images on one day",
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
        2000, "Samples, and lines where those are not given, of each image", minimum=64, unit="px", metavar="PX"
    )
    lines: int = option(0, "Lines of each image; 0 takes the samples", minimum=0, unit="px", metavar="PX")
    along: tuple[str, ...] = option(
        (), "Off-nadir angles along the track, one for each image of a place", unit="deg", metavar="A,B,…"
    )
    across: float = option(
        0.0, "Off-nadir angle to the right of the track", minimum=-50.0, maximum=50.0, unit="deg", metavar="DEG"
    )
    heading: float = option(HEADING_DEG, "Azimuth of the flight, and of the lines", unit="deg", metavar="DEG")
    strips: int = option(1, "Strips beside each other", minimum=1, advanced=True, metavar="N")
    places: int = option(1, "Places along each strip", minimum=1, advanced=True, metavar="N")
    overlap: float = option(
        STRIP_OVERLAP,
        "Share by which neighbouring places overlap",
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
    jitter: float = option(
        0.0,
        "Amplitude of the attitude's vibration, unknown to the vendor",
        minimum=0.0,
        unit="px",
        advanced=True,
        metavar="PX",
    )
    jitter_period: float = option(
        2000.0, "Period of the vibration", minimum=50.0, unit="lines", advanced=True, metavar="LINES"
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
    pixels: bool = option(True, "Render the images; without, RPC files stand for them")
    ms: bool = option(False, "Render multispectral images of larger pixels too")
    ortho: bool = option(False, "Write an orthophoto of the scene, georeferenced and free of errors")
    folder: ResultFolder = nest_options(ResultFolder)
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="simulate", title="Simulate block", group="Laboratory",
    summary="A synthetic block with images, DEM, GCPs, noise and full truth",
    help=(
        "Takes pushbroom images of a fractal, textured ground through an exact physical camera, with RPCs whose "
        "orbit and attitude are wrong as a vendor's are. Writes images, terrain (ellipsoidal heights), ground points, "
        "image points and the truth of all of them, to test methods and to plan blocks.\n\n"
        "With `dates` the images are taken over a year: shading and cast shadows as the sun stands, crops and leaves "
        "by the season, ploughed fields, snow, buildings that stand up and of which some are built or torn down, cars, "
        "haze and gain. truth.gpkg then says what changed when.\n\n"
        "With `laser_passes` a laser altimeter flies over it: laser.csv holds its points as SlideRule writes them, "
        "with the noise and misfits of real ICESat-2 segments, and true_laser.gpkg what each met. With `free_dem` and "
        "`free_ortho` free_dem.tif is a DEM with the errors of Copernicus GLO-30 (ellipsoidal heights; by what it is "
        "displaced stands in truth.json), and free_ortho.tif an orthoimage in four bands, from another season and some "
        "metres beside the truth; what free_ortho.tif is off by stands in report.json."
    ),
    options=SimulateOptions,
    examples=(
        "hrsi simulate --images 2 --size 160 --gcps 8 --checks 4 --ties 20 --ortho --output-dir block",
    ),
    main=("images", "size", "along", "sensor", "gcps", "checks", "ties", "ortho"),
    layers=(
        "truth.gpkg|layername=true_ground_points",
        "truth.gpkg|layername=true_image_points",
        "truth.gpkg|layername=objects",
    ),
)  # fmt: skip
