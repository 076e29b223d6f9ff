"""``.RPB`` (QuickBird, WorldView, GaoFen): ``name = value;`` in groups, polynomials as lists in brackets."""

import re

from ...camera.rpc import RPC
from .content import read_text
from .fields import ERRORS, POLYNOMIALS, SCALARS, entries_of, rpc_from_text
from .reading import RpcReader, RpcReading

#: RPC field -> its name in the file.
RPB_NAMES = {
    "err_bias": "errBias", "err_rand": "errRand",
    "line_off": "lineOffset", "samp_off": "sampOffset",
    "lat_off": "latOffset", "long_off": "longOffset", "height_off": "heightOffset",
    "line_scale": "lineScale", "samp_scale": "sampScale",
    "lat_scale": "latScale", "long_scale": "longScale", "height_scale": "heightScale",
    "line_num": "lineNumCoef", "line_den": "lineDenCoef", "samp_num": "sampNumCoef", "samp_den": "sampDenCoef",
}  # fmt: skip
#: First line of files from here: `restore` may take them away again.
WRITTEN_BY = 'writtenBy = "HRSI";'
_ENTRY = re.compile(r"(?<!\w)(\w+)\s*=\s*(?:\(([^()]*)\)|([^;\n(]*))")


def read(path: str) -> RpcReading:
    """Return the RPC of an ``.RPB`` file."""
    keys = {name: title.lower() for name, title in RPB_NAMES.items()}
    found = ((name.lower(), listed or scalar) for name, listed, scalar in _ENTRY.findall(read_text(path)))
    entries = entries_of(path, found, keys.values())
    values: dict[str, str | list[str] | None] = {name: entries.get(keys[name]) for name in (*ERRORS, *SCALARS)}
    for name in POLYNOMIALS:
        listed = entries.get(keys[name])
        values[name] = None if listed is None else [item.strip() for item in listed.split(",")]
    return RpcReading(rpc_from_text(path, values, RPB_NAMES), sensor=entries.get("satid", "").strip(' "'))


def text_of(rpc: RPC) -> str:
    """Return the content of an ``.RPB`` file, all digits; unknown errors are left out."""
    lines = [WRITTEN_BY, 'satId = "";', 'bandId = "";', 'SpecId = "RPC00B";', "BEGIN_GROUP = IMAGE"]
    known = [name for name in ERRORS if getattr(rpc, name) is not None]
    lines += [f"\t{RPB_NAMES[name]} = {getattr(rpc, name)!r};" for name in (*known, *SCALARS)]
    for name in POLYNOMIALS:
        listed = ",\n\t\t\t".join(map(repr, getattr(rpc, name).tolist()))
        lines.append(f"\t{RPB_NAMES[name]} = (\n\t\t\t{listed});")
    return "\n".join([*lines, "END_GROUP = IMAGE", "END;"]) + "\n"


def _recognises(name: str, head: bytes) -> bool:
    return name.endswith(".rpb") or (b"lineNumCoef" in head and b"BEGIN_GROUP" in head)


READER = RpcReader(".RPB", lambda stem: (f"{stem}.rpb",), _recognises, read)
