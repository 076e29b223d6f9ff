"""DIMAP RPC XML of Airbus: V2 (SPOT 6/7, Pleiades; first pixel is (1, 1)) and V3 (Pleiades Neo; (0, 0)).

The version decides about the origin, as in GDAL: the validity domain (FIRST_ROW, FIRST_COL) agrees with it in
whole scenes, but may also begin at -27 or inside the scene. Only the ground-to-image half is used (``Inverse_Model``
in V2, ``GroundtoImage_Values`` in V3). The ERR_BIAS of these files is the fit of the RPC in pixels, not the accuracy
on the ground: it is not taken over.
"""

from __future__ import annotations

import os
import re

from ...foundation.errors import InputError
from .content import Element, element_text, positive_size, read_xml, siblings
from .fields import POLYNOMIALS, SCALARS, numbered_values, rpc_from_text, shorten
from .reading import Origin, RpcReader, RpcReading

DIMAP_NAMES = {name: name.upper() for name in SCALARS} | {name: f"{name.upper()}_COEFF" for name in POLYNOMIALS}
DIMAP_NAMES |= {"err_bias": "ERR_BIAS", "err_rand": "ERR_RAND"}
#: Elements with the ground-to-image coefficients and the image's validity domain, V2 then V3.
_GROUND_TO_IMAGE = ("Inverse_Model", "GroundtoImage_Values")
_TILE = re.compile(r"_r(\d{1,3})c(\d{1,3})$")
_IMAGE_DOMAIN = ("Direct_Model_Validity_Domain", "ImagetoGround_Validity_Domain")


def read(path: str) -> RpcReading:
    """Return the RPC of a DIMAP RPC file and the size of its scene."""
    root = read_xml(path)
    model = _first(root, _GROUND_TO_IMAGE)
    validity = next(root.iter("RFM_Validity"), None)
    if model is None or validity is None:
        raise InputError(f"{path}: {' or '.join(_GROUND_TO_IMAGE)} or RFM_Validity is missing: name the RPC_*.XML file")
    coefficients = {element.tag: element.text or "" for element in model}
    values: dict[str, str | list[str] | None] = {name: element_text(validity, DIMAP_NAMES[name]) for name in SCALARS}
    values |= {name: numbered_values(coefficients, f"{DIMAP_NAMES[name]}_", range(1, 21)) for name in POLYNOMIALS}
    rpc = rpc_from_text(path, values, DIMAP_NAMES)
    # Sample and line of the first pixel's centre as this version counts: 1 or 0
    version = next((element.get("version", "") for element in root.iter("METADATA_FORMAT")), "")
    first = {"2": 1, "3": 0}.get(version.strip()[:1])
    if first is None:
        raise InputError(f"{path}: METADATA_FORMAT version is {shorten(version)!r}: DIMAP versions 2 and 3 are known")
    return RpcReading(rpc.shift(-first, -first), _size(_domain(root), first))


def _first(root: Element, names: tuple[str, ...]) -> Element | None:
    return next((element for name in names for element in root.iter(name)), None)


def _domain(root: Element) -> dict[str, str]:
    element = _first(root, _IMAGE_DOMAIN)
    return {} if element is None else {child.tag: (child.text or "").strip() for child in element}


def _size(domain: dict[str, str], first: int) -> tuple[int, int] | None:
    """Return the scene's size where the validity domain begins at the first pixel."""
    if domain.get("FIRST_COL") != str(first) or domain.get("FIRST_ROW") != str(first):
        return None
    last = positive_size(domain.get("LAST_COL"), domain.get("LAST_ROW"))
    return None if last is None else (last[0] - first + 1, last[1] - first + 1)


def _recognises(name: str, head: bytes) -> bool:
    if name.startswith("rpc_") and name.endswith(".xml"):
        return b"<isd" not in head.lower()
    return b"<Dimap_Document" in head and b"Rational_Function_Model" in head


def _beside(stem: str) -> tuple[str, ...]:
    """Return RPC_x.xml for IMG_x and its tiles IMG_x_R1C1, and the image's own stem."""
    product = _TILE.sub("", stem.removeprefix("img_"))
    names = [f"rpc_{product}.xml", f"rpc_{stem.removeprefix('img_')}.xml", f"{stem}_rpc.xml", f"{stem}.xml"]
    return tuple(dict.fromkeys(names))


def tile_origin(image_path: str, side_file: str) -> Origin:
    """Return the scene's (sample, line) of the first pixel of a tile ``IMG_x_R2C3``; (0, 0) for other names.

    The tile size stands in the product's ``DIM_x.XML``. Raises `InputError` where that is missing.
    """
    match = _TILE.search(os.path.splitext(os.path.basename(image_path))[0].lower())
    row, column = (int(match[1]), int(match[2])) if match else (1, 1)
    if (row, column) == (1, 1):
        return 0.0, 0.0
    name = "dim_" + os.path.basename(side_file).lower().removeprefix("rpc_")
    product = siblings(side_file).get(name)
    if product is None:
        raise InputError(f"{image_path}: is a tile, and {name} with the tile size is not beside it: put it there")
    size = next(read_xml(product).iter("NTILES_SIZE"), None)
    tile = None if size is None else positive_size(size.get("ncols"), size.get("nrows"))
    if tile is None:
        raise InputError(f"{product}: NTILES_SIZE with ncols and nrows is missing: get the file again")
    return float((column - 1) * tile[0]), float((row - 1) * tile[1])


READER = RpcReader("DIMAP RPC XML", _beside, _recognises, read, tile_origin)
