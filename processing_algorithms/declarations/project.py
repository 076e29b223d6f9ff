"""`project`: ground points into images."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import POINTS, Common, OptionalFolder, TerrainOptions, ground_crs_option, images_option

LAYERS_FILE = "points.gpkg"


@options(kw_only=True)
class ProjectOptions:
    """What `project` takes."""

    images: tuple[str, ...] = images_option("Images with RPC, or RPC files alone")
    points: str | None = option(
        None, "Ground points: a vector layer or CSV; by default lines on standard input", kind=Kind.POINTS, piped=True,
        metavar=POINTS,
    )  # fmt: skip
    ground_crs: str | None = ground_crs_option()
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: OptionalFolder = nest_options(OptionalFolder)
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="project", title="Project ground points", group="RPC",
    summary="Ground points to image coordinates, for a point file or as a filter",
    help=(
        "Computes where ground points lie in one or more images. Points come from a vector layer or CSV, or as lines "
        "'lon lat height' (WGS84 degrees, ellipsoidal metres) on standard input; then lines 'sample line' are printed, "
        "with what follows the coordinates. Sample 0, line 0 is the CENTRE of the first pixel (GDAL's pixel and line "
        "are 0.5 larger). Points without a height take it from the DEM or from `height`."
    ),
    options=ProjectOptions,
    examples=(
        "hrsi project block/image_1.tif --points block/ground_points.csv --height-datum ellipsoidal",
        "echo 2.35 48.85 60 | hrsi project block/image_1.tif",
    ),
    layers=(f"{LAYERS_FILE}|layername=image_points",),
)  # fmt: skip
