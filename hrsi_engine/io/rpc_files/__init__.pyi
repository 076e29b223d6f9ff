"""RPC files: reads all formats of image deliveries, and writes RPCs.

`read_rpc` finds the RPC of an image or of an RPC file alone, with its source; `RPC_READERS` is the table of formats.
Writers check what they wrote by reading it again, and replace files in one step, so that a killed process leaves the
old file or the new one.
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .fields import FoundRpc as FoundRpc
from .fields import RpcReader as RpcReader
from .find import RPC_READERS as RPC_READERS
from .find import read_back_px as read_back_px
from .find import read_rpc as read_rpc
from .find import read_rpc_or_none as read_rpc_or_none
from .find import rpc_for_image as rpc_for_image
from .find import rpc_in_folder as rpc_in_folder
from .find import rpc_of_dataset as rpc_of_dataset
from .find import rpc_reader_of as rpc_reader_of
from .placement import describe_map_evidence as describe_map_evidence
from .placement import difference_px as difference_px
from .placement import find_placement_doubt as find_placement_doubt
from .sidecars import set_aside_conflicting_rpcs as set_aside_conflicting_rpcs
from .write import KEEPS_NONE as KEEPS_NONE
from .write import Lineage as Lineage
from .write import prepare_geotiff_copy as prepare_geotiff_copy
from .write import prepare_in_place as prepare_in_place
from .write import prepare_restoring as prepare_restoring
from .write import prepare_sidecar as prepare_sidecar
from .write import require_in_place as require_in_place
from .write import write_geotiff_copy as write_geotiff_copy
from .write import write_rpc_text as write_rpc_text
from .write import write_vrt as write_vrt
