"""``.geom`` of the Orfeo ToolBox and OSSIM: ``name: value`` in lower case, image coordinates from 0.

The file describes the full scene, also beside a crop; 0 for an accuracy means that nothing is known.
"""

from ...camera.rpc import RPC
from .content import positive_size, read_text
from .fields import ERRORS, POLYNOMIALS, SCALARS, entries_of, rpc_from_text, values_by_number
from .reading import RpcReader, RpcReading

GEOM_NAMES = {name: name for name in SCALARS} | {name: f"{name}_coeff" for name in POLYNOMIALS}
#: In files from here: they may be replaced.
WRITTEN_BY = "written_by:  HRSI"
GEOM_NAMES |= {"err_bias": "bias_error", "err_rand": "rand_error"}


def read(path: str) -> RpcReading:
    """Return the RPC of a ``.geom`` file and the scene's size where it is written there."""
    parts = (line.partition(":") for line in read_text(path).splitlines())
    entries = entries_of(path, ((name.strip(), value.strip()) for name, _, value in parts), GEOM_NAMES.values())
    values: dict[str, str | list[str] | None] = {name: entries.get(GEOM_NAMES[name]) for name in SCALARS}
    values |= {name: values_by_number(entries, f"{GEOM_NAMES[name]}_", range(20), width=2) for name in POLYNOMIALS}
    values |= {name: text for name in ERRORS if (text := entries.get(GEOM_NAMES[name], "0")).strip("0. ")}
    return RpcReading(
        rpc_from_text(path, values, GEOM_NAMES),
        positive_size(entries.get("number_samples"), entries.get("number_lines")),
    )


def text_of(rpc: RPC) -> str:
    """Return the content of a ``.geom`` file, all digits: OSSIM's projection of an RPC, which OTB takes as a sensor."""
    lines = ["type:  ossimRpcProjection", "polynomial_format:  B", WRITTEN_BY]
    lines += [f"{GEOM_NAMES[name]}:  {getattr(rpc, name) or 0.0!r}" for name in ERRORS]
    lines += [f"{GEOM_NAMES[name]}:  {getattr(rpc, name)!r}" for name in SCALARS]
    for name in POLYNOMIALS:
        lines += [f"{GEOM_NAMES[name]}_{i:02d}:  {value!r}" for i, value in enumerate(getattr(rpc, name).tolist())]
    return "\n".join(lines) + "\n"


def _recognises(name: str, head: bytes) -> bool:
    return name.endswith(".geom")


READER = RpcReader("OTB .geom", lambda stem: (f"{stem}.geom",), _recognises, read)
