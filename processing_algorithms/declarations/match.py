"""`match`: two images, or a window of each, without RPC, by control networks (thesis chapter 3)."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, options
from ...hrsi_engine.measurement.control_network.options import ControlNetworkOptions
from ..interface.declare import Algorithm
from ..interface.option_groups import (
    ResultFolder,
    TerrainOptions,
    band_option,
    images_option,
    report_option,
    window_option,
)

LAYERS_FILE, LAYER = "match.gpkg", "correspondences"


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


ALGORITHM = Algorithm(
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
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip
