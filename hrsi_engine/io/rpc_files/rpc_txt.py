"""``_RPC.TXT`` / ``_rpc.txt`` (GeoEye, IKONOS, SkySat, ZY-3, OrbView) and KOMPSAT's ``.rpc``: ``NAME: value unit``.

The two are one format, but GDAL takes the vendor's XML between them.
"""

import re
from collections.abc import Iterator, Mapping

from ...camera.rpc import RPC
from .content import read_text
from .fields import ERRORS, GDAL_NAMES, POLYNOMIALS, SCALARS, entries_of, rpc_from_text
from .reading import RpcReader, RpcReading

#: In files from here, below the numbers: `restore` may take them away again.
WRITTEN_BY = "WRITTEN_BY: HRSI"
NOTHING: Mapping[str, str] = {}
#: The names of each polynomial's coefficients.
_NUMBERED = {name: tuple(f"{GDAL_NAMES[name]}_{i}" for i in range(1, 21)) for name in POLYNOMIALS}
_MARK = re.compile(rb"(LINE_OFF|LINE_NUM_COEFF_1)[:=\s]", re.IGNORECASE)


def read(path: str) -> RpcReading:
    """Return the RPC of a ``_RPC.TXT`` file; units behind the numbers are skipped."""
    entries = entries_of(path, _split_entries(read_text(path)), GDAL_NAMES.values())
    values: dict[str, str | list[str] | None] = {name: entries.get(GDAL_NAMES[name]) for name in (*ERRORS, *SCALARS)}
    values |= {name: [entries[key] for key in _NUMBERED[name] if key in entries] or None for name in POLYNOMIALS}
    return RpcReading(rpc_from_text(path, values))


def _split_entries(text: str) -> Iterator[tuple[str, str]]:
    """Yield each name (capitals) with the text of its value; a colon, an equals sign or blanks stand between them."""
    for line in text.splitlines():
        name, _, value = line.replace("=", " ", 1).replace(":", " ", 1).strip().partition(" ")
        yield name.upper(), value.strip()


def text_of(rpc: RPC, lineage: Mapping[str, str] = NOTHING) -> str:
    """Return the content of a ``_RPC.TXT`` file, all digits; unknown errors are left out, ``lineage`` comes last."""
    lines = [f"{GDAL_NAMES[name]}: {getattr(rpc, name)!r}" for name in SCALARS]
    for name, keys in _NUMBERED.items():
        lines += [f"{key}: {value!r}" for key, value in zip(keys, getattr(rpc, name).tolist(), strict=True)]
    lines += [f"{GDAL_NAMES[name]}: {value!r}" for name in ERRORS if (value := getattr(rpc, name)) is not None]
    told = [f"{name}: {' '.join(value.split())}" for name, value in lineage.items()]
    return "\n".join([*lines, WRITTEN_BY, *told]) + "\n"


def _recognises(name: str, head: bytes) -> bool:
    return name.endswith("_rpc.txt") or (name.endswith(".txt") and bool(_MARK.search(head)))


READER = RpcReader("_RPC.TXT", lambda stem: (f"{stem}_rpc.txt",), _recognises, read)
KOMPSAT = RpcReader(".rpc", lambda stem: (f"{stem}.rpc",), lambda name, head: name.endswith(".rpc"), read)
