"""`rpc-info`: how images see the ground and each other, and whether their RPCs are sound."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import Common, OptionalFolder, TerrainOptions, images_option

LAYERS_FILE = "rpc_info.gpkg"


@options(kw_only=True)
class RpcInfoOptions:
    """What `rpc-info` takes."""

    images: tuple[str, ...] = images_option()
    terrain: TerrainOptions = nest_options(TerrainOptions)
    crs: str | None = option(
        None,
        "List the coordinate operations between this CRS and WGS84 at the images' place: which one is taken, and which "
        "lack their grid (EPSG:code or WKT)", kind=Kind.CRS, metavar="CRS",
    )  # fmt: skip
    folder: OptionalFolder = nest_options(OptionalFolder)
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="rpc-info", title="RPC information", group="RPC",
    summary="Footprint, GSD, incidence and azimuth, pair convergence and B/H, overlaps, RPC sanity",
    help=(
        "Says for each image where it lies, the ground size of a pixel along line and sample, the incidence angle (at "
        "the ground, between the ray to the satellite and the vertical) and the azimuth (from the target to the "
        "satellite, clockwise from north); and for each pair the convergence angle, B/H (distance of the two rays at "
        "unit height above the ground) and which share of each image the other one sees on the terrain. Overlap "
        "depends on the terrain's height: give a DEM or a height. Warns of RPCs that are damaged, swapped, used "
        "beyond their heights, or of another image."
    ),
    options=RpcInfoOptions,
    examples=(
        "hrsi rpc-info block/image_*.tif --dem block/dem.tif --height-datum ellipsoidal",
        "hrsi rpc-info block/image_*.tif --crs EPSG:23030",
    ),
    layers=(f"{LAYERS_FILE}|layername=images",),
)  # fmt: skip
