"""The RPC of an image that was cut from another one: shifted, scaled or refitted.

For a chip in a NITF file GDAL returns the RPC00B of the full image. ICHIPB (STDI-0002, appendix B) has the corners of
the chip (OP) and their positions in the full image (FI), both from the outer corner of the first pixel, so that its
centre is 0.5. If the four pairs are a shift and a scale along each axis, OFF and SCALE of the RPC are changed exactly;
rotated or warped chips are refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...camera.rpc import RPC
from ...camera.rpc_fit import refit_rpc
from ...foundation.errors import InputError, SolveError
from ...foundation.thresholds import EQUALITY
from ..opening.files import parse_finite


@dataclass(frozen=True, eq=False)
class CropPlace:
    """Place of an image in its scene: ``scene = matrix @ image + first``, both from the centre of the first pixel."""

    matrix: np.ndarray
    first: np.ndarray

    @classmethod
    def from_corner(cls, matrix: np.ndarray, corner: np.ndarray) -> CropPlace:
        """Return the place of a crop whose first pixel's outer corner is ``corner``, from the scene's outer corner."""
        return cls(matrix, corner + matrix @ [0.5, 0.5] - 0.5)

    @property
    def moves(self) -> bool:
        """Whether the place is not the identity: the image does not begin with its scene, or has other pixels."""
        return bool((self.matrix != np.eye(2)).any() or self.first.any())

    @property
    def mirrored(self) -> bool:
        """Whether the image is a mirror image."""
        return bool(np.linalg.det(self.matrix) < 0.0)

    def to_scene(self, image: np.ndarray) -> np.ndarray:
        """Return coordinates in the scene ``(n, 2)`` from coordinates in the image."""
        return np.asarray(image @ self.matrix.T + self.first)

    def from_scene(self, scene: np.ndarray) -> np.ndarray:
        """Return coordinates in the image ``(n, 2)`` from coordinates in the scene."""
        return np.asarray((scene - self.first) @ np.linalg.inv(self.matrix).T)

    def __str__(self) -> str:
        text = f"at sample {self.first[0]:g}, line {self.first[1]:g} of its scene"
        if (self.matrix == np.eye(2)).all():
            return text
        (a, b), (c, d) = self.matrix.tolist()
        if not b and not c:
            return f"{text}, a pixel {abs(a):g} x {abs(d):g} of the scene's{', mirrored' if a * d < 0.0 else ''}"
        return f"{text}, turned or sheared by ({a:g} {b:g}; {c:g} {d:g})"


def crop_rpc(rpc: RPC, place: CropPlace, size: tuple[int, int]) -> RPC:
    """Return the RPC of a crop from that of its scene: exact, or to 0.001 px for a rotated or sheared crop.

    Raises `InputError` if no RPC approximates the crop.
    """
    (a, b), (c, d) = place.matrix.tolist()
    if not b and not c:
        return rpc.resample((a, d), (float(place.first[0]), float(place.first[1])))
    corners = place.to_scene(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * (np.array(size) - 1.0))
    low, high = corners.min(axis=0), corners.max(axis=0)
    area = float(low[0]), float(high[0]), float(low[1]), float(high[1])
    inverse = np.linalg.inv(place.matrix).T
    try:
        found = refit_rpc(rpc, lambda scene, ground: (scene - place.first) @ inverse, area, rpc.height_range)
    except SolveError as error:
        raise InputError(f"no RPC of the crop {place}: {error}") from error
    if not found.max_px <= EQUALITY.file_px:
        raise InputError(
            f"no RPC follows the crop {place} ({found.max_px:.3g} px difference): write an RPC of these pixels into "
            "the image"
        )
    return found.rpc


def apply_ichipb(path: str, rpc: RPC, metadata: Mapping[str, str]) -> tuple[RPC, str]:
    """Return the RPC of a chip's own pixels and a note; the RPC unchanged and "" if the file has no ICHIPB.

    Raises `InputError` if the chip is rotated or warped relative to the full image, or a field is no number.
    """
    if "ICHIP_OP_COL_11" not in metadata:
        return rpc, ""
    (sample, sample_scale), (line, line_scale) = (_fit_axis(path, metadata, axis) for axis in ("COL", "ROW"))
    chip = rpc.resample((sample_scale, line_scale), (sample, line))
    return chip, f"ICHIPB applied: the chip begins at sample {sample:g}, line {line:g} of the full image"


def _fit_axis(path: str, metadata: Mapping[str, str], axis: str) -> tuple[float, float]:
    """Return (shift, scale) of full = shift + scale * chip, in coordinates from the centre of the first pixel."""
    fields = [f"ICHIP_{side}_{axis}_{corner}" for side in ("OP", "FI") for corner in ("11", "12", "21", "22")]
    values = {name: parse_finite(metadata.get(name, "")) for name in fields}
    if None in values.values():
        missing = next(name for name, value in values.items() if value is None)
        raise InputError(f"{path}: ICHIPB field {missing} is missing or no number: obtain the file again")
    chip, full = np.array([*values.values()], dtype=np.float64).reshape(2, 4) - 0.5
    extent = chip.max() - chip.min()
    if not extent > 0.0:
        raise InputError(f"{path}: ICHIPB gives the chip no extent along {axis}: the file is damaged, obtain it again")
    first, last = chip.argmin(), chip.argmax()
    scale = (full[last] - full[first]) / extent
    shift = full[first] - scale * chip[first]
    if not scale > 0.0 or np.abs(shift + scale * chip - full).max() > EQUALITY.written_px:
        raise InputError(f"{path}: ICHIPB turns or warps the chip, which is not supported: use the full image")
    return float(shift), float(scale)
