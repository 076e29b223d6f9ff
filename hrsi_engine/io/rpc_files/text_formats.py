"""RPC files that are plain text or JSON: reading, and writing with all digits; unknown errors are omitted.

* ``.RPB`` (QuickBird, WorldView, GaoFen): ``name = value;`` in groups, polynomials as lists in brackets.
* ``_RPC.TXT`` / ``_rpc.txt`` (GeoEye, IKONOS, SkySat, ZY-3, OrbView) and KOMPSAT's ``.rpc``: ``NAME: value unit``. The
  two are one format, but GDAL reads the vendor's XML after the first and before the second. What ``gdalinfo`` prints is
  read, too: ``NAME=value``, with 20 numbers behind the name of a polynomial.
* ``.geom`` of the Orfeo ToolBox and OSSIM: ``name: value`` in lower case, image coordinates from 0. The file describes
  the full scene, also next to a crop; an accuracy of 0 means unknown.
* ``rpc_param.yaml`` of Orthority, with a part for each image name, whose names are those of GDAL in lower case.
* ``RPC-*.txt`` of ALOS PRISM and AVNIR-2: one record of numbers in fields of fixed width. (JAXA, NEB-070062B.)
* JSON of the rpcm package and the DFC2019 / IARPA datasets: an object ``rpc`` with ``row_offset``, ``col_num`` …
"""

import itertools
import os
import re
from collections.abc import Mapping
from functools import partial

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.json_values import json_text
from ..opening.files import read_json, read_text
from . import fields
from .content import positive_size, siblings
from .fields import ERRORS, GDAL_NAMES, POLYNOMIALS, SCALARS, FoundRpc, RpcReader, Text

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
MARKS = {
    "rpb": 'writtenBy = "HRSI";',
    "rpc-txt": "WRITTEN_BY: HRSI",
    "geom": "written_by:  HRSI",
    "rpcm-json": '"written_by": "HRSI"',
    "isd": "<!-- writtenBy HRSI -->",
}

# ---- .RPB ----------------------------------------------------------------------------------------------------------

_RPB_ENTRY = re.compile(r"(?<!\w)(\w+)\s*=\s*(?:\(([^()]*)\)|([^;\n(]*))")


def read_rpb(path: str) -> FoundRpc:
    """Return the RPC of an ``.RPB`` file."""
    names = {title.lower(): title for title in RPB_NAMES.values()}
    pairs = ((name.lower(), value_list or scalar) for name, value_list, scalar in _RPB_ENTRY.findall(read_text(path)))
    entries = fields.entries_of(path, pairs, names)
    rpc = fields.rpc_from_entries(path, {names[key]: text for key, text in entries.items() if key in names}, RPB_NAMES)
    sensor = entries.get("satid", "").strip(' "')
    # Samples and lines from the ``.IMD`` file of the same product
    imd = siblings(path).get(os.path.splitext(os.path.basename(path))[0].lower() + ".imd")
    text = "" if imd is None else read_text(imd)
    stated = (re.search(rf"\b{name}\s*=\s*(\d+)", text) for name in ("numColumns", "numRows"))
    size = positive_size(*(None if match is None else match[1] for match in stated))
    return FoundRpc(rpc, stated_size=size, sensor=sensor)


def rpb_text(rpc: RPC) -> str:
    """Return the content of an ``.RPB`` file."""
    lines = [MARKS["rpb"], 'satId = "";', 'bandId = "";', 'SpecId = "RPC00B";', "BEGIN_GROUP = IMAGE"]
    stated_errors = [name for name in ERRORS if getattr(rpc, name) is not None]
    lines += [f"\t{RPB_NAMES[name]} = {getattr(rpc, name)!r};" for name in (*stated_errors, *SCALARS)]
    for name in POLYNOMIALS:
        value_list = ",\n\t\t\t".join(map(repr, getattr(rpc, name).tolist()))
        lines.append(f"\t{RPB_NAMES[name]} = (\n\t\t\t{value_list});")
    return "\n".join([*lines, "END_GROUP = IMAGE", "END;"]) + "\n"


RPB = RpcReader(
    ".RPB",
    lambda stem: (f"{stem}.rpb",),
    lambda name, head: name.endswith(".rpb") or (b"lineNumCoef" in head and b"BEGIN_GROUP" in head),
    read_rpb,
)

# ---- _RPC.TXT ------------------------------------------------------------------------------------------------------

#: Names of the coefficients of each polynomial.
_NUMBERED = {name: tuple(f"{GDAL_NAMES[name]}_{i}" for i in range(1, 21)) for name in POLYNOMIALS}


def read_rpc_txt(path: str) -> FoundRpc:
    """Return the RPC of a ``_RPC.TXT`` file; units after the numbers are ignored."""
    # Name and value are separated by a colon, an equals sign or blanks
    lines = (line.replace("=", " ", 1).replace(":", " ", 1).strip() for line in read_text(path).splitlines())
    parts = (line.partition(" ") for line in lines)
    entries = fields.entries_of(path, ((name.upper(), value.strip()) for name, _, value in parts), GDAL_NAMES.values())
    return FoundRpc(fields.rpc_from_entries(path, entries, numbers=[f"_{number}" for number in range(1, 21)]))


def rpc_txt_text(rpc: RPC, lineage: Mapping[str, str] | None = None) -> str:
    """Return the content of a ``_RPC.TXT`` file, with ``lineage`` by name at its end."""
    lines = [f"{GDAL_NAMES[name]}: {getattr(rpc, name)!r}" for name in SCALARS]
    for name, keys in _NUMBERED.items():
        lines += [f"{key}: {value!r}" for key, value in zip(keys, getattr(rpc, name).tolist(), strict=True)]
    lines += [f"{GDAL_NAMES[name]}: {value!r}" for name in ERRORS if (value := getattr(rpc, name)) is not None]
    lineage_lines = [f"{name}: {' '.join(value.split())}" for name, value in (lineage or {}).items()]
    return "\n".join([*lines, MARKS["rpc-txt"], *lineage_lines]) + "\n"


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


def read_geom(path: str) -> FoundRpc:
    """Return the RPC of a ``.geom`` file, and the scene's size if the file states it."""
    parts = (line.partition(":") for line in read_text(path).splitlines())
    entries = fields.entries_of(path, ((name.strip(), value.strip()) for name, _, value in parts), GEOM_NAMES.values())
    rpc = fields.rpc_from_entries(path, entries, GEOM_NAMES, [f"_{number:02d}" for number in range(20)], True)
    return FoundRpc(rpc, stated_size=positive_size(entries.get("number_samples"), entries.get("number_lines")))


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
    "line": "row",
    "samp": "col",
    "lat": "lat",
    "long": "lon",
    "height": "alt",
    "off": "offset",
    "scale": "scale",
    "num": "num",
    "den": "den",
}
RPCM_NAMES = {name: "_".join(_PARTS[part] for part in name.split("_")) for name in (*SCALARS, *POLYNOMIALS)}
RPCM_NAMES |= {"err_bias": "err_bias", "err_rand": "err_rand"}


def read_rpcm_json(path: str) -> FoundRpc:
    """Return the RPC of an rpcm JSON file, the document or its member ``rpc``, or of ``gdalinfo -json``."""
    document = read_json(path, "RPC")
    if not isinstance(document, dict):
        raise InputError(f"{path}: an object with the member 'rpc' is needed")
    by_gdal = document.get("metadata")
    if isinstance(by_gdal, dict) and isinstance(by_gdal.get("RPC"), dict):
        texts = {name: str(text) for name, text in by_gdal["RPC"].items()}
        size = document.get("size")
        stated = positive_size(*map(str, size)) if isinstance(size, list) and len(size) == 2 else None
        return FoundRpc(fields.rpc_from_entries(path, texts), stated_size=stated)
    members = document.get("rpc", document)
    if not isinstance(members, dict):
        raise InputError(f"{path}: the member 'rpc' is not an object: obtain the file again")
    size = positive_size(str(document.get("width")), str(document.get("height")))
    return FoundRpc(fields.rpc_from_json(path, members, RPCM_NAMES), stated_size=size)


def rpcm_json_text(rpc: RPC) -> str:
    """Return the content of an rpcm JSON file."""
    return json_text({"written_by": "HRSI", "rpc": fields.json_members(rpc, RPCM_NAMES)}, indent=1) + "\n"


RPCM_JSON = RpcReader(
    "rpcm JSON",
    lambda stem: (f"{stem}.json",),
    lambda name, head: name.endswith(".json") and (b"row_offset" in head or b'"LINE_NUM_COEFF"' in head),
    read_rpcm_json,
)

# ---- Orthority -----------------------------------------------------------------------------------------------------

_YAML_NAMES = {name: title.lower() for name, title in GDAL_NAMES.items()} | {"size": "im_size"}
_YAML_PART = re.compile(r"^([^\s#][^\n]*?)\s*:\s*$", re.MULTILINE)
_YAML_LIST = re.compile(r":[ \t]*((?:\n[ \t]*- [^\n]+)+)")  # one number a line
_YAML_ENTRY = re.compile(r"^[ \t]+(\w+)[ \t]*:[ \t]*(?:\[([^\]]*)\]|([^\s\[#]+))", re.MULTILINE)


def read_orthority(image_path: str, path: str) -> FoundRpc:
    """Return the RPC of the part for an image; without image path, the file must have one part."""
    text = _YAML_LIST.sub(lambda yaml_entries: f": [{','.join(yaml_entries[1].split()[1::2])}]", read_text(path))
    _, *texts = _YAML_PART.split(text)
    parts = {name.strip("'\""): text for name, text in zip(texts[::2], texts[1::2], strict=True)}
    matches = [name for name in parts if not image_path or os.path.basename(name) == os.path.basename(image_path)]
    if len(matches) != 1:
        name = os.path.basename(image_path) or "one image"
        value_list = ", ".join(parts) or "none"
        raise InputError(f"{path}: has {len(matches)} RPCs for {name} (parts: {value_list}): keep one of that name")
    yaml_entries = _YAML_ENTRY.findall(parts[matches[0]])
    entries = {key: value_list or scalar for key, value_list, scalar in yaml_entries}
    size = [*entries.get("im_size", "").split(","), "", ""]
    return FoundRpc(fields.rpc_from_entries(path, entries, _YAML_NAMES), stated_size=positive_size(size[0], size[1]))


ORTHORITY = RpcReader(
    "Orthority RPC",
    lambda stem: (f"{stem}.yaml", "rpc_param.yaml", "rpc_param.yml"),
    lambda name, head: name.endswith((".yaml", ".yml")) and b"line_num_coeff" in head,
    partial(read_orthority, ""),
    read_beside=read_orthority,
)

# ---- ALOS ----------------------------------------------------------------------------------------------------------

_ALOS_WIDTHS = (6, 5, 8, 9, 5, 6, 5, 8, 9, 5, *(12,) * 80)
_ALOS_ENDS = (*itertools.accumulate(_ALOS_WIDTHS),)


def read_alos(path: str) -> FoundRpc:
    """Return the RPC of a record of fixed width: offsets, scales and coefficients in the order of GeoTIFF."""
    text = read_text(path)
    texts = [text[end - width : end].strip() for end, width in zip(_ALOS_ENDS, _ALOS_WIDTHS, strict=True)]
    values: dict[str, Text | None] = dict(zip(SCALARS, texts, strict=False))
    values |= {name: texts[10 + 20 * number : 30 + 20 * number] for number, name in enumerate(POLYNOMIALS)}
    return FoundRpc(fields.rpc_from_text(path, values))


ALOS = RpcReader(
    "ALOS RPC",
    lambda stem: (f"rpc{stem.removeprefix('img')}.txt",),
    lambda name, head: name.startswith("rpc") and re.match(rb"[\d+. -]{66}[\d+.E -]{24}", head) is not None,
    read_alos,
)
