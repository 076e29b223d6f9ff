"""`localize`: image points to the ground."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import POINTS, Common, OptionalFolder, TerrainOptions, images_option

LAYERS_FILE = "points.gpkg"


@options(kw_only=True)
class LocalizeOptions:
    """What `localize` takes."""

    images: tuple[str, ...] = images_option("Images with RPC, or RPC files alone")
    points: str | None = option(
        None, "Image points: a vector layer or CSV; by default lines on standard input", kind=Kind.POINTS, piped=True,
        metavar=POINTS,
    )  # fmt: skip
    terrain: TerrainOptions = nest_options(TerrainOptions)
    folder: OptionalFolder = nest_options(OptionalFolder)
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="localize", title="Localize image points", group="RPC",
    summary="Image points to the ground, at a height or on a DEM, for a point file or as a filter",
    help=(
        "Follows the rays of image points to the ground. Points come from a vector layer or CSV with the fields sample "
        "and line (and image, where several are given), or as lines 'sample line [height]' on standard input; then "
        "lines 'lon lat height' (WGS84 degrees, ellipsoidal metres) are printed, with what follows the coordinates, "
        "and 'nan' where there is no ground position. A point's own ellipsoidal height counts before the DEM and "
        "`height`. On a DEM the first hit of the ray from above counts. Sample 0, line 0 is the CENTRE of the first "
        "pixel (GDAL's pixel and line are 0.5 larger)."
    ),
    options=LocalizeOptions,
    examples=(
        "echo 40 60 | hrsi localize block/image_1.tif --dem block/dem.tif --height-datum ellipsoidal",
    ),
    layers=(f"{LAYERS_FILE}|layername=ground_points",),
)  # fmt: skip
