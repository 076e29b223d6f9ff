"""ISD XML of DigitalGlobe / Maxar (WorldView, GeoEye): ``<isd>`` with an ``<RPB>`` part."""

from __future__ import annotations

from ...errors import InputError
from .content import element_text, positive_size, read_xml
from .fields import ERRORS, POLYNOMIALS, SCALARS, rpc_from_text
from .reading import Reader, Reading

NAMES = {
    "err_bias": "ERRBIAS", "err_rand": "ERRRAND",
    "line_off": "LINEOFFSET", "samp_off": "SAMPOFFSET",
    "lat_off": "LATOFFSET", "long_off": "LONGOFFSET", "height_off": "HEIGHTOFFSET",
    "line_scale": "LINESCALE", "samp_scale": "SAMPSCALE",
    "lat_scale": "LATSCALE", "long_scale": "LONGSCALE", "height_scale": "HEIGHTSCALE",
    "line_num": "LINENUMCOEF", "line_den": "LINEDENCOEF", "samp_num": "SAMPNUMCOEF", "samp_den": "SAMPDENCOEF",
}  # fmt: skip


def read(path: str) -> Reading:
    """Return the RPC of an ISD XML file and the size of its image (NUMCOLUMNS, NUMROWS)."""
    root = read_xml(path)
    part = next(root.iter("RPB"), None)
    if part is None:
        raise InputError(f"{path}: the RPB element is missing: this product was delivered without RPC")
    values: dict[str, str | list[str] | None] = {name: element_text(part, NAMES[name]) for name in (*ERRORS, *SCALARS)}
    for name in POLYNOMIALS:
        values[name] = (element_text(part, NAMES[name]) or "").split()
    size = positive_size(element_text(root, "NUMCOLUMNS"), element_text(root, "NUMROWS"))
    return Reading(rpc_from_text(path, values, NAMES), size)


def _recognises(name: str, head: bytes) -> bool:
    return b"<isd" in head.lower()[:2000]


READER = Reader("ISD XML", lambda stem: (f"{stem}.xml",), _recognises, read)
