"""RPC00B of NITF files, with ICHIPB applied: GDAL gives the RPC of the full image even for a chip.

ICHIPB (STDI-0002, appendix B) lists the four corners of the chip (OP) and their place in the full image (FI), both
counted from the outer corner of the first pixel, so that 0.5 is its centre. Where the four pairs are a shift and a
scale along each axis, the RPC's OFF and SCALE take it exactly; chips that are turned or warped are refused.
"""

from collections.abc import Mapping

import numpy as np

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...foundation.thresholds import threshold, thresholds
from ..opening.numbers import parse_finite

CORNERS = ("11", "12", "21", "22")


@thresholds
class CHIP:
    """Which chips of NITF files are shifted and scaled only."""

    corner_px: float = threshold(
        1e-6, "px", "largest misfit of a shift and scale to the corners in ICHIPB", "rounding of the fields"
    )


def apply_ichipb(path: str, rpc: RPC, metadata: Mapping[str, str]) -> tuple[RPC, str]:
    """Return the RPC of a chip's own pixels and a note; unchanged and "" where the file has no ICHIPB.

    Raises `InputError` where the chip is turned or warped against the full image, or a field is no number.
    """
    if "ICHIP_OP_COL_11" not in metadata:
        return rpc, ""
    axes = [_shift_and_scale(path, metadata, axis) for axis in ("COL", "ROW")]
    (sample, sample_scale), (line, line_scale) = axes
    chip = rpc.resample((sample_scale, line_scale), (sample, line))
    return chip, f"ICHIPB applied: the chip begins at sample {sample:g}, line {line:g} of the full image"


def _shift_and_scale(path: str, metadata: Mapping[str, str], axis: str) -> tuple[float, float]:
    """Return (shift, scale) of full = shift + scale * chip, in coordinates from the pixel centre."""
    chip = np.array([_read_field(path, metadata, f"ICHIP_OP_{axis}_{corner}") for corner in CORNERS]) - 0.5
    full = np.array([_read_field(path, metadata, f"ICHIP_FI_{axis}_{corner}") for corner in CORNERS]) - 0.5
    extent = chip.max() - chip.min()
    if not extent > 0.0:
        raise InputError(f"{path}: ICHIPB gives the chip no extent along {axis}: the file is damaged, get it again")
    first, last = chip.argmin(), chip.argmax()
    scale = (full[last] - full[first]) / extent
    shift = full[first] - scale * chip[first]
    if not scale > 0.0 or np.abs(shift + scale * chip - full).max() > CHIP.corner_px:
        raise InputError(f"{path}: ICHIPB turns or warps the chip, which is not supported: use the full image")
    return float(shift), float(scale)


def _read_field(path: str, metadata: Mapping[str, str], name: str) -> float:
    value = parse_finite(metadata.get(name, ""))
    if value is None:
        raise InputError(f"{path}: ICHIPB field {name} is missing or no number: get the file again")
    return value
