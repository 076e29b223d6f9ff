"""RPC files: reading every format that images are delivered with, and writing RPCs back.

`read_rpc` finds the RPC of an image or of an RPC file alone and says where it came from; `RPC_READERS` is the table of
formats. The writers check what they wrote by reading it again and replace files in one step, so that a killed
process leaves the old file or the new one.
"""

from .compare import difference_px, read_back_px
from .find import RPC_READERS, read_rpc, read_rpc_or_none, rpc_for_image, rpc_in_folder, rpc_of_dataset, rpc_reader_of
from .in_place import (
    KEEPS_NONE,
    prepare_in_place,
    prepare_restoring,
    prepare_sidecar,
    require_in_place,
    restore,
    write_in_place,
    write_sidecar,
)
from .reading import FoundRpc, RpcReader, RpcReading
from .sidecars import free_the_way
from .write import Lineage, prepare_geotiff_copy, write_geotiff_copy, write_rpb, write_rpc_text, write_vrt

__all__ = [
    "KEEPS_NONE",
    "RPC_READERS",
    "FoundRpc",
    "Lineage",
    "RpcReader",
    "RpcReading",
    "difference_px",
    "free_the_way",
    "prepare_geotiff_copy",
    "prepare_in_place",
    "prepare_restoring",
    "prepare_sidecar",
    "read_back_px",
    "read_rpc",
    "read_rpc_or_none",
    "require_in_place",
    "restore",
    "rpc_for_image",
    "rpc_in_folder",
    "rpc_of_dataset",
    "rpc_reader_of",
    "write_geotiff_copy",
    "write_in_place",
    "write_rpb",
    "write_rpc_text",
    "write_sidecar",
    "write_vrt",
]  # fmt: skip
