"""Image chips as SVG: grey values around a target, with the fitted curve and its edge points."""

import base64
import struct
import zlib
from dataclasses import dataclass

import numpy as np

from ..foundation.errors import InputError

CHIP_SIDE_PX = 220.0  # side of a chip on the page


@dataclass(frozen=True, eq=False)
class TargetChip:
    """Contents of a chip, in image coordinates.

    grey : (lines, samples) around the target, None without pixels; origin : (2,) sample and line of the first pixel
    edges : (k, 2) edge points; used : (k,) True for those used in the fit; curves : polylines ``(m, 2)`` of the fit
    position : (2,) measured target, NaN if not measured; computed : (2,) position computed by the adjustment
    """

    grey: np.ndarray | None
    origin: np.ndarray
    edges: np.ndarray
    used: np.ndarray
    curves: tuple[np.ndarray, ...]
    position: np.ndarray
    computed: np.ndarray | None = None


def draw_target_chip(chip: TargetChip) -> str:
    """Return the chip as an SVG element."""
    if chip.grey is not None:
        origin, size = chip.origin, np.array([chip.grey.shape[1], chip.grey.shape[0]], dtype=np.float64)
    else:
        outline = np.vstack([chip.edges, *chip.curves]) if len(chip.edges) else np.zeros((1, 2))
        origin = outline.min(axis=0) - 3.0
        size = outline.max(axis=0) + 3.0 - origin
    scale = CHIP_SIDE_PX / float(max(size))
    width, height = size * scale
    parts = [
        f'<svg class="chip" width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.1f} {height:.1f}" '
        'role="img" aria-label="Pixels around the point">'
    ]
    if chip.grey is not None:
        parts.append(
            f'<image width="{width:.1f}" height="{height:.1f}" image-rendering="pixelated" '
            f'preserveAspectRatio="none" href="data:image/png;base64,{encode_grey_png(chip.grey)}"/>'
        )

    def place(xy: np.ndarray) -> np.ndarray:
        return (xy - origin + 0.5) * scale

    for curve in chip.curves:
        path = " ".join(f"{x:.2f},{y:.2f}" for x, y in place(curve))
        parts.append(f'<polyline points="{path}" fill="none" stroke="#ffb000" stroke-width="1.5"/>')
    for (x, y), is_used in zip(place(chip.edges), chip.used, strict=True):
        parts.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="1.8" fill="{"#21c17a" if is_used else "#e03131"}"/>')
    if np.isfinite(chip.position).all():
        x, y = place(chip.position)
        parts.append(f'<path d="M{x - 6:.2f},{y:.2f}h12M{x:.2f},{y - 6:.2f}v12" stroke="#e03131" stroke-width="1.2"/>')
    if chip.computed is not None and np.isfinite(chip.computed).all():
        (x, y), (from_x, from_y) = place(chip.computed), place(chip.position)
        line = f'<path d="M{from_x:.2f},{from_y:.2f}L{x:.2f},{y:.2f}" stroke="#37d0e6" stroke-width="1.6"/>'
        ring = f'<circle cx="{x:.2f}" cy="{y:.2f}" r="5" fill="none" stroke="#37d0e6" stroke-width="1.6"/>'
        parts.append(line + ring)
    return "".join([*parts, "</svg>"])


def encode_grey_png(grey: np.ndarray, valid: np.ndarray | None = None) -> str:
    """Return grey values as a PNG in base64 text, stretched between percentiles of the valid ones."""
    return base64.b64encode(encode_png(stretch_grey(grey, valid))).decode("ascii")


def stretch_grey(grey: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """Return grey values as uint8, stretched linearly between the 0.5 and 99.5 % percentiles of the valid ones."""
    valid_grey = grey if valid is None or not valid.any() else grey[valid]
    low, high = np.percentile(valid_grey, (0.5, 99.5))
    stretched = np.clip((grey.astype(np.float64) - low) * (255.0 / max(float(high - low), 1e-9)), 0.0, 255.0)
    return stretched.astype(np.uint8)


def encode_png(grey: np.ndarray) -> bytes:
    """Return a grey image ``(lines, samples)``, uint8 or uint16, as a PNG file (ISO/IEC 15948), rows unfiltered."""
    lines, samples = grey.shape
    values = grey.astype(grey.dtype.newbyteorder(">")).view(np.uint8).reshape(lines, -1)
    rows = np.hstack([np.zeros((lines, 1), dtype=np.uint8), values])  # each row begins with its filter type, 0
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", samples, lines, 8 * grey.itemsize, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows.tobytes())),
        (b"IEND", b""),
    ]
    chunks = [
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        for name, content in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def decode_png(png: bytes) -> np.ndarray:
    """Return the grey image ``(lines, samples)`` of a PNG written by `encode_png`; raise `InputError` for others."""
    try:
        samples, lines, bits, *flags = struct.unpack(">IIBBBBB", png[16:29])
        (length,) = struct.unpack(">I", png[33:37])
        width = samples * bits // 8 + 1
        rows = zlib.decompressobj().decompress(png[41 : 41 + length], lines * width)  # no more than needed
        values = np.frombuffer(rows, dtype=np.uint8).reshape(lines, width)
        if bits not in (8, 16) or any(flags) or values[:, 0].any():
            raise ValueError("another kind of PNG")
        return np.ascontiguousarray(values[:, 1:]).view(f">u{bits // 8}").astype(f"u{bits // 8}")
    except (struct.error, ValueError, zlib.error) as error:
        raise InputError(f"pixels of a chip cannot be read ({error}): save the chip again") from None
