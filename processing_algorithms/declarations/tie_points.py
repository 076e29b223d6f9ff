"""`tie-points`: automatic tie points over a block, as layers and files that `adjust` and `triangulate` take."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm
from ..interface.option_groups import ResultFolder, SearchOptions, TerrainOptions, images_option

LAYERS_FILE, LAYER = "block.gpkg", "tie_points"


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


ALGORITHM = Algorithm(
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
    layers=(f"{LAYERS_FILE}|layername={LAYER}",),
)  # fmt: skip
