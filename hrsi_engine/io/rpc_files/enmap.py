"""EnMAP's ``METADATA.XML`` of level 1B: an RPC for each band, ``navigation/RPC/bandID``, rows and columns from 0.

The bands of the VNIR camera come first, then those of SWIR. Of an image the first band is read, so that its RPC is that
of the image's first band. Source: EnMAP HSI Level 1B product specification, EN-PCV-ICD-2009.
"""

import os
import re

from ...foundation.errors import InputError
from .content import element_text, positive_size, read_xml
from .fields import POLYNOMIALS, SCALARS, rpc_from_text, values_by_number
from .reading import RpcReader, RpcReading

ENMAP_NAMES = {
    name: name.upper().replace("LINE", "ROW").replace("SAMP", "COL") for name in (*SCALARS, *POLYNOMIALS)
} | {"err_bias": "ERR_BIAS", "err_rand": "ERR_RAND"}  # fmt: skip
#: The root element, in any namespace.
_DOCUMENT = re.compile(rb"<([\w.-]+:)?level_X[\s>]")
METADATA, SPECTRAL = "-metadata", "-spectral_image"
SWIR = "_swir"


def read(path: str) -> RpcReading:
    """Return the RPC of the first band and the size of its image; raise `InputError` where there is none."""
    return _read_camera(path, swir=False)


def read_beside(image_path: str, path: str) -> RpcReading:
    """Return the RPC of an image's first band: the first of SWIR for an image of that name."""
    return _read_camera(path, os.path.splitext(image_path)[0].lower().endswith(SWIR))


def _read_camera(path: str, swir: bool) -> RpcReading:
    root = read_xml(path)
    bands = [band for model in root.iter("RPC") for band in model.iter("bandID")]
    if not bands:
        raise InputError(f"{path}: EnMAP metadata without navigation/RPC: only products of level 1B have RPCs")
    before = "0" if not swir else next((element.text or "" for vnir in root.iter("vnir")
                                        for element in vnir.iter("channels")), "")  # fmt: skip
    number = int(before) if before.strip().isdigit() else -1
    if not 0 <= number < len(bands):
        raise InputError(f"{path}: has {len(bands)} RPCs and does not say which is the image's: get the file again")
    entries = {element.tag.upper().replace("_", ""): element.text or "" for element in bands[number]}
    values: dict[str, str | list[str] | None] = {key: entries.get(ENMAP_NAMES[key].replace("_", "")) for key in SCALARS}
    for name in POLYNOMIALS:
        key = ENMAP_NAMES[name].replace("_", "")
        values[name] = values_by_number(entries, key, range(1, 21)) or values_by_number(entries, key, range(1, 21), 2)
    size = positive_size(element_text(root, "widthOfScene"), element_text(root, "heightOfScene"))
    return RpcReading(rpc_from_text(path, values, ENMAP_NAMES), size)


def _recognises(name: str, head: bytes) -> bool:
    return name.endswith(".xml") and _DOCUMENT.search(head[:4000]) is not None and b"EnMAP" in head


def _side_names(stem: str) -> tuple[str, ...]:
    product, _, rest = stem.partition(SPECTRAL)
    return (f"{product}{METADATA}.xml",) if rest else ()


READER = RpcReader("EnMAP metadata", _side_names, _recognises, read, is_product=lambda _: True, read_beside=read_beside)
