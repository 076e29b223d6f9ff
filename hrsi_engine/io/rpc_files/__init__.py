"""RPC files: reads all formats of image deliveries, and writes RPCs.

`read_rpc` finds the RPC of an image or of an RPC file alone, with its source; `RPC_READERS` is the table of formats.
Writers check what they wrote by reading it again, and replace files in one step, so that a killed process leaves the
old file or the new one.
"""

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "fields": "FoundRpc RpcReader",
        "find": "RPC_READERS read_back_px read_rpc read_rpc_or_none rpc_for_image rpc_in_folder"
        " rpc_of_dataset rpc_reader_of",
        "placement": "describe_map_evidence difference_px find_placement_doubt",
        "sidecars": "set_aside_conflicting_rpcs",
        "write": "KEEPS_NONE Lineage prepare_geotiff_copy prepare_in_place prepare_restoring prepare_sidecar"
        " require_in_place write_geotiff_copy write_rpc_text write_vrt",
    },
)
