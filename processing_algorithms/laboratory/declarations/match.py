"""`match`: corresponding points of two images without RPC, by control networks (thesis chapter 3)."""

from __future__ import annotations

from ....hrsi_engine.foundation.options import nest_options, options
from ....hrsi_engine.laboratory.control_network.options import ControlNetworkOptions
from ...interface import option_groups as groups
from ...interface.declare import Algorithm

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


ALGORITHM = Algorithm(
    name="match",
    title="Match two images",
    group="Image points",
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
)
