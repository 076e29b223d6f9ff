"""`measure-targets`: sub-pixel centres and corners near approximate positions, or from hand-measured edge points."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ...hrsi_engine.measurement.targets.options import TargetOptions
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import (
    POINTS,
    Common,
    ResultFolder,
    ground_crs_option,
    height_datum_option,
    report_option,
)

AUTOMATIC_KIND = "auto"


LAYERS_FILE, LAYER = "targets.gpkg", "targets"


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


ALGORITHM = Algorithm(
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
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip
