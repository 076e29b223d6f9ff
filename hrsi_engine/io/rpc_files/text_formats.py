"""RPC files that are plain text or JSON: reading, and writing with all digits; unknown errors are omitted.

* ``.RPB`` (QuickBird, WorldView, GaoFen): ``name = value;`` in groups, polynomials as lists in brackets.
* ``_RPC.TXT`` / ``_rpc.txt`` (GeoEye, IKONOS, SkySat, ZY-3, OrbView) and KOMPSAT's ``.rpc``: ``NAME: value unit``. The
  two are one format, but GDAL reads the vendor's XML after the first and before the second.
* ``.geom`` of the Orfeo ToolBox and OSSIM: ``name: value`` in lower case, image coordinates from 0. The file describes
  the full scene, also next to a crop; an accuracy of 0 means unknown.
* JSON of the rpcm package and the DFC2019 / IARPA datasets: an object ``rpc`` with ``row_offset``, ``col_num`` …
"""

import json
import os
import re
from collections.abc import Mapping

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.json_values import json_text
from . import fields
from .content import positive_size, read_text, siblings
from .fields import ERRORS, GDAL_NAMES, POLYNOMIALS, SCALARS, RpcReader, RpcReading, Text, values_by_number

#: RPC field -> its name in the file.
RPB_NAMES = {
    "err_bias": "errBias", "err_rand": "errRand",
    "line_off": "lineOffset", "samp_off": "sampOffset",
    "lat_off": "latOffset", "long_off": "longOffset", "height_off": "heightOffset",
    "line_scale": "lineScale", "samp_scale": "sampScale",
    "lat_scale": "latScale", "long_scale": "longScale", "height_scale": "heightScale",
    "line_num": "lineNumCoef", "line_den": "lineDenCoef", "samp_num": "sampNumCoef", "samp_den": "sampDenCoef",
}  # fmt: skip
#: Marks of files that HRSI wrote, by format: `restore` may remove such files, and a run may replace them.
MARKS = {"rpb": 'writtenBy = "HRSI";', "rpc-txt": "WRITTEN_BY: HRSI", "geom": "written_by:  HRSI",
         "rpcm-json": '"written_by": "HRSI"'}  # fmt: skip

# ---- .RPB ----------------------------------------------------------------------------------------------------------

_RPB_ENTRY = re.compile(r"(?<!\w)(\w+)\s*=\s*(?:\(([^()]*)\)|([^;\n(]*))")


def read_rpb(path: str) -> RpcReading:
    """Return the RPC of an ``.RPB`` file."""
    keys = {name: title.lower() for name, title in RPB_NAMES.items()}
    found = ((name.lower(), listed or scalar) for name, listed, scalar in _RPB_ENTRY.findall(read_text(path)))
    entries = fields.entries_of(path, found, keys.values())
    values: dict[str, Text | None] = {name: entries.get(keys[name]) for name in (*ERRORS, *SCALARS)}
    for name in POLYNOMIALS:
        listed = entries.get(keys[name])
        values[name] = None if listed is None else [item.strip() for item in listed.split(",")]
    rpc, sensor = fields.rpc_from_text(path, values, RPB_NAMES), entries.get("satid", "").strip(' "')
    return RpcReading(rpc, _read_imd_size(path), sensor=sensor)


def _read_imd_size(path: str) -> tuple[int, int] | None:
    """Return samples and lines from the ``.IMD`` file of the same product; None if there is none."""
    imd = siblings(path).get(os.path.splitext(os.path.basename(path))[0].lower() + ".imd")
    text = "" if imd is None else read_text(imd)
    stated = (re.search(rf"\b{name}\s*=\s*(\d+)", text) for name in ("numColumns", "numRows"))
    return positive_size(*(None if match is None else match[1] for match in stated))


def rpb_text(rpc: RPC) -> str:
    """Return the content of an ``.RPB`` file."""
    lines = [MARKS["rpb"], 'satId = "";', 'bandId = "";', 'SpecId = "RPC00B";', "BEGIN_GROUP = IMAGE"]
    known = [name for name in ERRORS if getattr(rpc, name) is not None]
    lines += [f"\t{RPB_NAMES[name]} = {getattr(rpc, name)!r};" for name in (*known, *SCALARS)]
    for name in POLYNOMIALS:
        listed = ",\n\t\t\t".join(map(repr, getattr(rpc, name).tolist()))
        lines.append(f"\t{RPB_NAMES[name]} = (\n\t\t\t{listed});")
    return "\n".join([*lines, "END_GROUP = IMAGE", "END;"]) + "\n"


RPB = RpcReader(
    ".RPB", lambda stem: (f"{stem}.rpb",),
    lambda name, head: name.endswith(".rpb") or (b"lineNumCoef" in head and b"BEGIN_GROUP" in head), read_rpb,
)  # fmt: skip

# ---- _RPC.TXT ------------------------------------------------------------------------------------------------------

#: Names of the coefficients of each polynomial.
_NUMBERED = {name: tuple(f"{GDAL_NAMES[name]}_{i}" for i in range(1, 21)) for name in POLYNOMIALS}


def read_rpc_txt(path: str) -> RpcReading:
    """Return the RPC of a ``_RPC.TXT`` file; units after the numbers are ignored."""
    # Name and value are separated by a colon, an equals sign or blanks
    lines = (line.replace("=", " ", 1).replace(":", " ", 1).strip() for line in read_text(path).splitlines())
    parts = (line.partition(" ") for line in lines)
    entries = fields.entries_of(path, ((name.upper(), value.strip()) for name, _, value in parts), GDAL_NAMES.values())
    values: dict[str, Text | None] = {name: entries.get(GDAL_NAMES[name]) for name in (*ERRORS, *SCALARS)}
    values |= {name: [entries[key] for key in _NUMBERED[name] if key in entries] or None for name in POLYNOMIALS}
    return RpcReading(fields.rpc_from_text(path, values))


def rpc_txt_text(rpc: RPC, lineage: Mapping[str, str] | None = None) -> str:
    """Return the content of a ``_RPC.TXT`` file, with ``lineage`` by name at its end."""
    lines = [f"{GDAL_NAMES[name]}: {getattr(rpc, name)!r}" for name in SCALARS]
    for name, keys in _NUMBERED.items():
        lines += [f"{key}: {value!r}" for key, value in zip(keys, getattr(rpc, name).tolist(), strict=True)]
    lines += [f"{GDAL_NAMES[name]}: {value!r}" for name in ERRORS if (value := getattr(rpc, name)) is not None]
    told = [f"{name}: {' '.join(value.split())}" for name, value in (lineage or {}).items()]
    return "\n".join([*lines, MARKS["rpc-txt"], *told]) + "\n"


def _is_rpc_txt(name: str, head: bytes) -> bool:
    first = rb"(LINE_OFF|LINE_NUM_COEFF_1)[:=\s]"
    return name.endswith("_rpc.txt") or (name.endswith(".txt") and bool(re.search(first, head, re.IGNORECASE)))


RPC_TXT = RpcReader("_RPC.TXT", lambda stem: (f"{stem}_rpc.txt",), _is_rpc_txt, read_rpc_txt)
#: Files of KOMPSAT and SkySat, and RPCs that sat-bundleadjust adjusted (``.rpc_adj``).
KOMPSAT = RpcReader(
    ".rpc", lambda stem: (f"{stem}.rpc",), lambda name, head: name.endswith((".rpc", ".rpc_adj")), read_rpc_txt
)

# ---- .geom ---------------------------------------------------------------------------------------------------------

GEOM_NAMES = {name: name for name in SCALARS} | {name: f"{name}_coeff" for name in POLYNOMIALS}
GEOM_NAMES |= {"err_bias": "bias_error", "err_rand": "rand_error"}


def read_geom(path: str) -> RpcReading:
    """Return the RPC of a ``.geom`` file, and the scene's size if the file states it."""
    parts = (line.partition(":") for line in read_text(path).splitlines())
    entries = fields.entries_of(path, ((name.strip(), value.strip()) for name, _, value in parts), GEOM_NAMES.values())
    values: dict[str, Text | None] = {name: entries.get(GEOM_NAMES[name]) for name in SCALARS}
    values |= {name: values_by_number(entries, f"{GEOM_NAMES[name]}_", range(20), width=2) for name in POLYNOMIALS}
    values |= {name: text for name in ERRORS if (text := entries.get(GEOM_NAMES[name], "0")).strip("0. ")}
    size = positive_size(entries.get("number_samples"), entries.get("number_lines"))
    return RpcReading(fields.rpc_from_text(path, values, GEOM_NAMES), size)


def geom_text(rpc: RPC) -> str:
    """Return the content of a ``.geom`` file: OSSIM's projection of an RPC, which OTB reads as a sensor model."""
    lines = ["type:  ossimRpcProjection", "polynomial_format:  B", MARKS["geom"]]
    lines += [f"{GEOM_NAMES[name]}:  {getattr(rpc, name) or 0.0!r}" for name in ERRORS]
    lines += [f"{GEOM_NAMES[name]}:  {getattr(rpc, name)!r}" for name in SCALARS]
    for name in POLYNOMIALS:
        lines += [f"{GEOM_NAMES[name]}_{i:02d}:  {value!r}" for i, value in enumerate(getattr(rpc, name).tolist())]
    return "\n".join(lines) + "\n"


GEOM = RpcReader("OTB .geom", lambda stem: (f"{stem}.geom",), lambda name, head: name.endswith(".geom"), read_geom)

# ---- JSON of rpcm --------------------------------------------------------------------------------------------------

_PARTS = {
    "line": "row", "samp": "col", "lat": "lat", "long": "lon", "height": "alt",
    "off": "offset", "scale": "scale", "num": "num", "den": "den",
}  # fmt: skip
RPCM_NAMES = {name: "_".join(_PARTS[part] for part in name.split("_")) for name in (*SCALARS, *POLYNOMIALS)}
RPCM_NAMES |= {"err_bias": "err_bias", "err_rand": "err_rand"}


def read_rpcm_json(path: str) -> RpcReading:
    """Return the RPC of an rpcm JSON file and its image's size; the RPC may be the document or its member ``rpc``."""
    try:
        document = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}): obtain the file again") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: an object with the member 'rpc' is needed")
    members = document.get("rpc", document)
    if not isinstance(members, dict):
        raise InputError(f"{path}: the member 'rpc' is not an object: obtain the file again")
    size = positive_size(str(document.get("width")), str(document.get("height")))
    return RpcReading(fields.rpc_from_json(path, members, RPCM_NAMES), size)


def rpcm_json_text(rpc: RPC) -> str:
    """Return the content of an rpcm JSON file."""
    return json_text({"written_by": "HRSI", "rpc": fields.json_members(rpc, RPCM_NAMES)}, indent=1) + "\n"


RPCM_JSON = RpcReader(
    "rpcm JSON", lambda stem: (f"{stem}.json",), lambda name, head: name.endswith(".json") and b"row_offset" in head,
    read_rpcm_json,
)  # fmt: skip
