"""`strip`: parts or tiles of one strip as one image with one RPC."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm
from ..interface.option_groups import Common, ResultFolder, compression_option, images_option
from .crop import FORMAT_ENDINGS


@options(kw_only=True)
class StripOptions:
    """What `strip` takes."""

    images: tuple[str, ...] = images_option(
        "Parts of one strip, or tiles of one scene; RPC files alone give the RPC only"
    )
    id: str | None = option(
        None, "Id of the strip, which names the files; by default that of the first part and _strip", metavar="ID"
    )
    format: str = option(
        "vrt",
        "A virtual image that reads the parts, a tiled GeoTIFF, or a cloud-optimised one with overviews",
        choices=tuple(FORMAT_ENDINGS),
    )
    compression: str = compression_option()
    folder: ResultFolder = nest_options(ResultFolder)
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="strip",
    title="Join strip",
    group="RPC",
    summary="Parts or tiles of one strip as one image with one RPC",
    help=(
        "Joins the parts in which a strip was delivered (WorldView's P001, P002 …) or the tiles of a scene (R1C1 …) to "
        "one image, a virtual one unless pixels of its own are asked for, and gives it one RPC. Where the parts lie "
        "follows from the product or from their RPCs; where they overlap the later one is on top. Tiles with one RPC "
        "have it exactly; other RPCs are fitted together, and the report states how far the fit is from each part. "
        "Where that is more than 0.1 px a warning says so, and the grid that the RPC was fitted to is written as a "
        "table. Refined parts give a refined strip. RPC files alone whose size is known (ISD, DIMAP) give the strip's "
        "_RPC.TXT."
    ),
    options=StripOptions,
    images_made="Strips",
    examples=("hrsi strip delivery/*_P001.TIF delivery/*_P002.TIF --output-dir strip",),
)  # fmt: skip
