"""ISD XML of DigitalGlobe / Maxar (WorldView, GeoEye): ``<isd>`` with an ``<RPB>`` part.

A product in tiles, ``…_R1C2-…_P001.TIF``, has one file ``…-…_P001.XML``, whose ``<TIL>`` part places them.
"""

import os
import re

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from .content import element_text, finite_number, positive_size, read_xml
from .fields import ERRORS, POLYNOMIALS, SCALARS, rpc_from_text
from .reading import Origin, RpcReader, RpcReading

#: The root element, in any namespace.
ISD = re.compile(rb"<([\w.-]+:)?isd[\s>]", re.IGNORECASE)
#: In files from here: they may be replaced.
WRITTEN_BY = "<!-- writtenBy HRSI -->"
ISD_NAMES = {
    "err_bias": "ERRBIAS", "err_rand": "ERRRAND",
    "line_off": "LINEOFFSET", "samp_off": "SAMPOFFSET",
    "lat_off": "LATOFFSET", "long_off": "LONGOFFSET", "height_off": "HEIGHTOFFSET",
    "line_scale": "LINESCALE", "samp_scale": "SAMPSCALE",
    "lat_scale": "LATSCALE", "long_scale": "LONGSCALE", "height_scale": "HEIGHTSCALE",
    "line_num": "LINENUMCOEF", "line_den": "LINEDENCOEF", "samp_num": "SAMPNUMCOEF", "samp_den": "SAMPDENCOEF",
}  # fmt: skip


_TILE = re.compile(r"_(r\d{1,3}c\d{1,3})(?=-)")


def read(path: str) -> RpcReading:
    """Return the RPC of an ISD XML file and the size of its image (NUMCOLUMNS, NUMROWS)."""
    root = read_xml(path)
    part = next(root.iter("RPB"), None)
    if part is None:
        raise InputError(f"{path}: the RPB element is missing: this product was delivered without RPC")
    values: dict[str, str | list[str] | None] = {name: element_text(part, ISD_NAMES[name]) for name in SCALARS}
    values |= {name: text for name in ERRORS if (text := element_text(part, ISD_NAMES[name]) or "").strip("0. ")}
    for name in POLYNOMIALS:
        values[name] = (element_text(part, ISD_NAMES[name]) or "").split()
    size = positive_size(element_text(root, "NUMCOLUMNS"), element_text(root, "NUMROWS"))
    return RpcReading(rpc_from_text(path, values, ISD_NAMES), size, sensor=element_text(root, "SATID") or "")


def text_of(rpc: RPC) -> str:
    """Return the content of an ISD XML file that holds an RPC and nothing else, all digits."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<isd>", f" {WRITTEN_BY}", " <RPB>", "  <SPECID>RPC00B</SPECID>"]
    lines.append("  <IMAGE>")
    for name in (*ERRORS, *SCALARS):  # GDAL wants all of them; an accuracy that is not known is 0
        lines.append(f"   <{ISD_NAMES[name]}>{getattr(rpc, name) or 0.0!r}</{ISD_NAMES[name]}>")
    for name in POLYNOMIALS:
        numbers = " ".join(map(repr, getattr(rpc, name).tolist()))
        tag = ISD_NAMES[name]
        lines.append(f"   <{tag}List><{tag}>{numbers}</{tag}></{tag}List>")
    return "\n".join([*lines, "  </IMAGE>", " </RPB>", "</isd>"]) + "\n"


def _recognises(name: str, head: bytes) -> bool:
    return ISD.search(head[:2000]) is not None


def _side_names(stem: str) -> tuple[str, ...]:
    """Return the image's own stem, and for a tile that of its product."""
    return tuple(f"{name}.xml" for name in dict.fromkeys([stem, _TILE.sub("", stem)]))


def _find_tile(image_path: str, side_file: str) -> Origin | None:
    """Return the product's (sample, line) of the first pixel of a tile ``…_R1C2-…``; None for other names.

    Raises `InputError` where the product's file does not place the tile.
    """
    tile = _TILE.search(os.path.basename(image_path).lower())
    if tile is None:
        return None
    for listed in read_xml(side_file).iter("TILE"):
        named = _TILE.search((element_text(listed, "FILENAME") or "").lower())
        sample, line = (finite_number(element_text(listed, name)) for name in ("ULCOLOFFSET", "ULROWOFFSET"))
        if named is not None and named[1] == tile[1] and sample is not None and line is not None:
            return sample, line
    raise InputError(f"{image_path}: is a tile that {os.path.basename(side_file)} does not place: get that file again")


READER = RpcReader("ISD XML", _side_names, _recognises, read, _find_tile)
