"""JSON of the rpcm package and the DFC2019 / IARPA data sets: an object ``rpc`` with ``row_offset``, ``col_num`` …"""

import json

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.json_values import json_text
from .content import positive_size, read_text
from .fields import POLYNOMIALS, SCALARS, json_members, rpc_from_json
from .reading import RpcReader, RpcReading

#: In files from here: they may be replaced.
WRITTEN_BY = '"written_by": "HRSI"'
_PARTS = {
    "line": "row", "samp": "col", "lat": "lat", "long": "lon", "height": "alt",
    "off": "offset", "scale": "scale", "num": "num", "den": "den",
}  # fmt: skip
RPCM_NAMES = {name: "_".join(_PARTS[part] for part in name.split("_")) for name in (*SCALARS, *POLYNOMIALS)}
RPCM_NAMES |= {"err_bias": "err_bias", "err_rand": "err_rand"}


def read(path: str) -> RpcReading:
    """Return the RPC of an rpcm JSON file and its image's size; the RPC may stand alone or under ``rpc``."""
    try:
        document = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}): get the file again") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: an object with the member 'rpc' is needed")
    members = document.get("rpc", document)
    if not isinstance(members, dict):
        raise InputError(f"{path}: the member 'rpc' is not an object: get the file again")
    size = positive_size(str(document.get("width")), str(document.get("height")))
    return RpcReading(rpc_from_json(path, members, RPCM_NAMES), size)


def text_of(rpc: RPC) -> str:
    """Return the content of an rpcm JSON file, all digits; unknown errors are left out."""
    return json_text({"written_by": "HRSI", "rpc": json_members(rpc, RPCM_NAMES)}, indent=1) + "\n"


def _recognises(name: str, head: bytes) -> bool:
    return name.endswith(".json") and b"row_offset" in head


READER = RpcReader("rpcm JSON", lambda stem: (f"{stem}.json",), _recognises, read)
