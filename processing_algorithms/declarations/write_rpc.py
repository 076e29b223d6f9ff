"""`write-rpc`: an RPC into a GeoTIFF, a sidecar or a VRT, and the original back."""

from __future__ import annotations

from ...hrsi_engine.foundation.options import nest_options, option, options
from ..interface.declare import Algorithm, Kind
from ..interface.option_groups import Common, images_option

#: What the output of an image is called, by way of writing; None is the image itself.
OUTPUT_ENDINGS: dict[str, str | None] = {
    "copy": ".tif", "in-place": None, "vrt": ".vrt", "sidecar": "_RPC.TXT", "rpb": ".RPB", "xml": ".xml",
    "geom": ".geom", "json": ".json",
}  # fmt: skip


@options(kw_only=True)
class WriteRpcOptions:
    """What `write-rpc` takes."""

    images: tuple[str, ...] = images_option("Images, or RPC files alone (then `write` cannot be copy or vrt)")
    rpc: str | None = option(
        None,
        "File with the RPC to write, or a folder of RPC files named like the images; default: the image's own RPC",
        kind=Kind.FILE,
        metavar="FILE|DIR",
    )
    write: str = option("copy", "Where the RPC goes", choices=tuple(OUTPUT_ENDINGS))
    restore: bool = option(False, "Bring back the RPC from before the first writing in place")
    output_dir: str | None = option(
        None, "Directory for copies, VRTs and sidecars; created where missing", kind=Kind.OUTPUT_DIR, metavar="DIR"
    )
    overwrite: bool = option(False, "Replace files of an earlier run")
    common: Common = nest_options(Common)


ALGORITHM = Algorithm(
    name="write-rpc", title="Write RPC", group="RPC",
    summary="Put an RPC into a GeoTIFF, a sidecar or a VRT; `restore` brings the original back",
    help=(
        "Writes the RPC of any file that HRSI reads (or the image's own, wherever it is kept) for one or more images. "
        "copy writes a GeoTIFF with the pixels, compression and overviews of the image; in-place changes the image "
        "itself and keeps its original RPC in it, so that `restore` brings it back bit by bit; vrt writes a virtual "
        "image; sidecar, rpb, xml, geom and json write a _RPC.TXT, .RPB, ISD XML (ASP), .geom (Orfeo ToolBox) or rpcm "
        "JSON file, beside the image unless an output directory is given (docs/bridges.md says who reads what). "
        "Everything is read again and compared; a file that exists is replaced in one step."
    ),
    options=WriteRpcOptions,
    images_made="Images with their RPCs",
    examples=(
        "hrsi write-rpc block/image_1.tif --rpc adjusted/image_1.tif --write sidecar --output-dir rpcs",
        "hrsi write-rpc block/image_1.tif --rpc adjusted/image_1.tif --write vrt --output-dir virtual",
    ),
)  # fmt: skip
