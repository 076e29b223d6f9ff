"""`evaluate`: how well RPCs fit, several sets of them side by side on the same tracks, ground points and DEM."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import DemOptions, PointFiles, ResultFolder, SearchOptions, images_option, report_option

AUTOMATIC_TRACKS, NO_TRACKS = "auto", "none"
OWN = "own"  #: name of the set of the images' own RPCs
LAYERS_FILE = "evaluation.gpkg"


@options(kw_only=True)
class EvaluateOptions:
    """What `evaluate` takes."""

    images: tuple[str, ...] = images_option()
    rpcs: tuple[str, ...] = option(
        (),
        f"A further set of RPCs: its name, and the directory that holds an RPC or an image with RPC for each image, "
        f"under the image's name; given again for each set. The images' own RPCs are the set {OWN!r}",
        kind=Kind.FOLDERS,
        metavar="NAME=DIR",
    )
    tracks: str = option(
        AUTOMATIC_TRACKS,
        f"Points on two images or more: {AUTOMATIC_TRACKS} finds them in the images, {NO_TRACKS} does without, FILE "
        "reads them", kind=Kind.POINTS, metavar=f"{AUTOMATIC_TRACKS}|{NO_TRACKS}|FILE",
    )  # fmt: skip
    used_points: str | None = option(
        None, "Image points that an adjustment of these RPCs used (block.gpkg): tracks near one of them take no part",
        kind=Kind.POINTS, metavar="FILE",
    )  # fmt: skip
    apart_px: float = option(
        10.0, "How far from `used_points` a track must be, on each of its images", name="apart", minimum=0.0, unit="px",
        advanced=True, metavar="PX",
    )  # fmt: skip
    reject: float = option(
        6.0, "Leave out tracks with a residual of so many sigmas under every set of RPCs: wrong matches; 0 keeps all",
        minimum=0.0, unit="sigma", advanced=True, metavar="SIGMAS",
    )  # fmt: skip
    points: PointFiles = nest_options(PointFiles)
    dem: DemOptions = nest_options(DemOptions)
    search: SearchOptions = nest_options(SearchOptions)
    folder: ResultFolder = nest_options(ResultFolder)
    report: bool = report_option()


ALGORITHM = Algorithm(
    name="evaluate", title="Evaluate RPCs", group="RPC",
    summary="How well RPCs fit: tracks, ground points, a DEM; several sets side by side",
    help=(
        "Answers whether RPCs are better than others: those of the images as they are, refined ones, another tool's "
        "(`rpcs` NAME=DIR, once for each set). All sets are judged by the same points. Nothing is adjusted.\n\n"
        "Each track is predicted on each of its images from a ground point that the other images alone intersect "
        "(strict leave-one-out; three images or more), fitted by all its rays, and taken pair by pair across the "
        "epipolar lines. Wrong matches are left out only where they fit under no set of RPCs. Known ground points, "
        "control and check apart, are compared in pixels and metres, heights of the tracks with a DEM.\n\n"
        "The RPCs should not have seen the tracks: give points that took no part in the adjustment, or name those that "
        "did by `used_points`."
    ),
    options=EvaluateOptions,
    examples=(
        "hrsi evaluate block/image_*.tif --rpcs refined=adjusted --tracks block/image_points.csv "
        "--height-datum ellipsoidal --output-dir evaluation",
    ),
    layers=(f"{LAYERS_FILE}|layername=images",),
)  # fmt: skip
