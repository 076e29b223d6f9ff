"""Crops: the RPC of a full scene next to an image cut from it, whose position in the scene is in its geotransform.

A geotransform without a coordinate system transforms the image's pixels to the scene's: a shift or, if the crop was
reduced, enlarged, mirrored or rotated, an affine map. Its pixels refer to the corner. Lines increase downwards, or
upwards as negative numbers. Airbus products start at 0.5, because the centre of their first pixel is 1; other programs
start at 0. Both mean the first pixel (0, 0): a fraction of 0.5 is subtracted. A geotransform with a coordinate system,
or whose pixel size is not one of scene pixels (degrees, metres of a map), belongs to a map and is not used here.

An RPC *inside* the image (GeoTIFF tag, NITF, VRT, PAM) is that of its pixels and is never moved. An RPC *next to* it
may be of the scene or of the crop (written for the crop by GDAL or by this program). OFF - SCALE distinguishes them: it
is the first sample and line for which the RPC was made, near 0 in a scene's RPC and different in one that was moved. If
neither is possible, the image is refused: at the position (0, 0) it would have an error of kilometres.

For a chip in a NITF file GDAL returns the RPC00B of the full image. ICHIPB (STDI-0002, appendix B) has the corners of
the chip (OP) and their positions in the full image (FI), both from the outer corner of the first pixel, so that its
centre is 0.5. If the four pairs are a shift and a scale along each axis, OFF and SCALE of the RPC are changed exactly;
rotated or warped chips are refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...block.imaging_geometry import GEOMETRY
from ...camera.rpc import RPC
from ...camera.rpc_fit import refit_rpc
from ...foundation.errors import InputError, SolveError
from ...foundation.thresholds import threshold, thresholds
from ..opening.numbers import parse_finite

Geotransform = tuple[float, float, float, float, float, float]


@thresholds
class CROPS:
    """Limits for the position of a crop in its scene, from its geotransform and the RPC next to it."""

    range_share: float = threshold(0.02, "", "tolerance of the ends of an RPC's range, relative to the range")
    pixel_scales: tuple[float, float] = threshold(
        (1.0 / 32.0, 128.0), "scene px", "smallest and largest pixel of an image, in pixels of its scene"
    )
    same_end_share: float = threshold(0.05, "", "largest relative difference in size of a scene and its image")
    first_px: float = threshold(
        2.0, "px", "smallest origin of a crop with another pixel size; below, the RPC's origin is ambiguous"
    )
    turned_px: float = threshold(1e-3, "px", "largest error of the RPC of a rotated or sheared crop")
    chip_corner_px: float = threshold(
        1e-6, "px", "largest residual of a shift and scale at the corners in ICHIPB of a NITF file", "rounding of the "
        "fields"
    )  # fmt: skip


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


def crop_place(geotransform: Geotransform | None, has_crs: bool) -> CropPlace | None:
    """Return the position of a crop in its scene from its geotransform; None if that does not refer to a scene."""
    if geotransform is None or has_crs or not np.isfinite(geotransform).all():
        return None
    x, dx, x_by_row, y, y_by_column, dy = geotransform
    matrix, corner = np.array([[dx, x_by_row], [y_by_column, dy]], dtype=np.float64), np.array([x, y])
    if not CROPS.pixel_scales[0] <= np.sqrt(abs(np.linalg.det(matrix))) <= CROPS.pixel_scales[1]:
        return None
    if dy < 0.0 and y <= 0.0:  # lines upwards, as negative numbers
        matrix, corner = matrix * [[1.0], [-1.0]], corner * [1.0, -1.0]
    corner = np.where(corner % 1.0 == 0.5, corner - 0.5, corner)
    return CropPlace.from_corner(matrix, corner)


def require_place_in_scene(rpc: RPC, geotransform: Geotransform | None, has_crs: bool, size: tuple[int, int]) -> None:
    """Raise `InputError` for a crop whose geotransform does not give its position in the scene; map grids are valid."""
    if geotransform is not None and not has_crs and _begins_a_larger_scene(rpc, size):
        low, high = _range_of(rpc)
        raise InputError(
            f"its RPC is of a scene of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} px, and its geotransform "
            f"{tuple(geotransform)} does not give a position in it: set it to the first sample and line of the crop, "
            "or write the RPC of these pixels into the image"
        )


def _begins_a_larger_scene(rpc: RPC, size: tuple[int, int]) -> bool:
    low, high = _range_of(rpc)
    extent = high - low
    begins_at_zero = (np.abs(low) <= CROPS.range_share * extent).all()
    return bool(begins_at_zero and (np.array(size) < GEOMETRY.crop_share * extent).any())


def is_of_full_scene(rpc: RPC, place: CropPlace, size: tuple[int, int]) -> bool:
    """Return whether the RPC next to a crop is that of the full scene; otherwise it is the crop's own.

    Raises `InputError` if it can be neither, or if both are possible.
    """
    low, high = _range_of(rpc)
    slack = CROPS.range_share * (high - low)
    in_scene = place.to_scene(_corners_of(np.zeros(2), np.array(size) - 1.0))
    inside = (in_scene.min(axis=0) >= low - slack).all() and (in_scene.max(axis=0) <= high + slack).all()
    if not inside:
        if _begins_a_larger_scene(rpc, size):
            raise InputError(
                f"its RPC is of a scene of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} px, and its geotransform is "
                f"outside of it ({place}): correct it, or write the RPC of these pixels into the image"
            )
        return False
    if place.mirrored:
        # Whether the RPC's image is a mirror image of the ground; that of a sensor is never
        middle = np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]])
        _, by_ground = rpc.project_with_metric_jacobian(middle)
        return not bool(np.linalg.det(by_ground[0, :, :2]) > 0.0)
    # a scene's RPC begins at 0; a moved one begins at the scene's first pixel, in coordinates of the crop
    own_begin = place.to_scene(_corners_of(low, high)).min(axis=0)
    told = np.abs(place.first) > CROPS.first_px * np.abs(place.matrix).max() * (place.matrix != np.eye(2)).any()
    nearer = np.sign(np.abs(own_begin) - np.abs(low)) * told
    if (nearer < 0.0).any() or (nearer > 0.0).any():
        return not (nearer < 0.0).any()
    # An image that begins with its scene: does the range end with the image, in the scene?
    extent = high - low
    of_scene = (np.abs(high - in_scene.max(axis=0)) < CROPS.same_end_share * extent).all()
    of_image = (np.abs(high - np.array(size)) < CROPS.same_end_share * extent).all()
    if of_scene != of_image:
        return bool(of_scene)
    raise InputError(
        f"according to its geotransform it is {place}, but it is not known whether the RPC file belongs to the scene "
        "or to these pixels: write the RPC of these pixels into the image (write-rpc), or remove the geotransform"
    )


def crop_rpc(rpc: RPC, place: CropPlace, size: tuple[int, int]) -> RPC:
    """Return the RPC of a crop from that of its scene: exact, or to 0.001 px for a rotated or sheared crop.

    Raises `InputError` if no RPC approximates the crop.
    """
    (a, b), (c, d) = place.matrix.tolist()
    if not b and not c:
        return rpc.resample((a, d), (float(place.first[0]), float(place.first[1])))
    corners = place.to_scene(_corners_of(np.zeros(2), np.array(size) - 1.0))
    low, high = corners.min(axis=0), corners.max(axis=0)
    area = float(low[0]), float(high[0]), float(low[1]), float(high[1])
    inverse = np.linalg.inv(place.matrix).T
    try:
        found = refit_rpc(rpc, lambda scene, ground: (scene - place.first) @ inverse, area, rpc.height_range)
    except SolveError as error:
        raise InputError(f"no RPC of the crop {place}: {error}") from error
    if not found.max_px <= CROPS.turned_px:
        raise InputError(
            f"no RPC follows the crop {place} ({found.max_px:.3g} px difference): write an RPC of these pixels into "
            "the image"
        )
    return found.rpc


def _range_of(rpc: RPC) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and last sample and line for which an RPC was made: OFF - SCALE and OFF + SCALE."""
    off, scale = np.array([rpc.samp_off, rpc.line_off]), np.abs([rpc.samp_scale, rpc.line_scale])
    return off - scale, off + scale


def _corners_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])


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
    if not scale > 0.0 or np.abs(shift + scale * chip - full).max() > CROPS.chip_corner_px:
        raise InputError(f"{path}: ICHIPB turns or warps the chip, which is not supported: use the full image")
    return float(shift), float(scale)
