"""Pixels as SVG: chips with the fitted curve and the edge points of a target, pairs of windows with their matches."""

import base64
import colorsys
import struct
import zlib
from dataclasses import dataclass

import numpy as np

from ..foundation.errors import InputError
from ..foundation.pixel_filters import reduce_by_area, reduce_mask

CHIP_SIDE_PX = 220.0  # of a chip on the page


@dataclass(frozen=True, eq=False)
class TargetChip:
    """What a chip shows, in image coordinates.

    grey : (lines, samples) around the target, None without pixels; origin : (2,) sample and line of its first pixel
    edges : (k, 2) edge points; used : (k,) True for those the fit kept; curves : polylines ``(m, 2)`` of the fit
    position : (2,) the target, NaN where refused; computed : (2,) where the adjusted block expects it
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
        shown = np.vstack([chip.edges, *chip.curves]) if len(chip.edges) else np.zeros((1, 2))
        origin = shown.min(axis=0) - 3.0
        size = shown.max(axis=0) + 3.0 - origin
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
    for (x, y), used in zip(place(chip.edges), chip.used, strict=True):
        parts.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="1.8" fill="{"#21c17a" if used else "#e03131"}"/>')
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
    """Return grey values as the base64 text of a PNG, stretched between percentiles of the valid ones."""
    return base64.b64encode(encode_png(stretch_grey(grey, valid))).decode("ascii")


def stretch_grey(grey: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """Return grey values as bytes, stretched between percentiles of the valid ones."""
    known = grey if valid is None or not valid.any() else grey[valid]
    low, high = np.percentile(known, (0.5, 99.5))
    stretched = np.clip((grey.astype(np.float64) - low) * (255.0 / max(float(high - low), 1e-9)), 0.0, 255.0)
    return stretched.astype(np.uint8)


def encode_png(grey: np.ndarray) -> bytes:
    """Return a grey image ``(lines, samples)``, uint8 or uint16, as a PNG file (ISO/IEC 15948), rows unfiltered."""
    lines, samples = grey.shape
    values = grey.astype(grey.dtype.newbyteorder(">")).view(np.uint8).reshape(lines, -1)
    rows = np.hstack([np.zeros((lines, 1), dtype=np.uint8), values])  # each begins with the number of its filter
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
    """Return the grey image ``(lines, samples)`` of what `encode_png` has made; raise `InputError` for all else."""
    try:
        samples, lines, bits, *rest = struct.unpack(">IIBBBBB", png[16:29])
        (length,) = struct.unpack(">I", png[33:37])
        width = samples * bits // 8 + 1
        rows = zlib.decompressobj().decompress(png[41 : 41 + length], lines * width)  # and no more
        values = np.frombuffer(rows, dtype=np.uint8).reshape(lines, width)
        if bits not in (8, 16) or any(rest) or values[:, 0].any():
            raise ValueError("another kind of PNG")
        return np.ascontiguousarray(values[:, 1:]).view(f">u{bits // 8}").astype(f"u{bits // 8}")
    except (struct.error, ValueError, zlib.error) as error:
        raise InputError(f"pixels of a chip cannot be read ({error}): save the chip again") from None


PICTURES_GAP = 12.0


@dataclass(frozen=True, eq=False)
class PictureSide:
    """One window of a pair of images.

    grey : (lines, samples) grey values; valid : (lines, samples) True where they count
    origin : (2,) sample and line of the first pixel; points : (k, 2) sample, line of the correspondences
    """

    grey: np.ndarray
    valid: np.ndarray
    origin: np.ndarray
    points: np.ndarray


def draw_pair(first: PictureSide, second: PictureSide) -> str:
    """Return the picture: corresponding points have the same colour and some the same number.

    Colours follow the position in the first window, so that wrong neighbours would show.

    first, second : the two windows; row k of their points belongs together
    """
    scale = 900.0 / float(max(*first.grey.shape, *second.grey.shape))
    sizes = [np.array(side.grey.shape[::-1]) * scale for side in (first, second)]
    width, height = sizes[0][0] + PICTURES_GAP + sizes[1][0], max(size[1] for size in sizes)
    # The rows of up to 40 correspondences spread over the window: the first one of each cell, 7 along its longer side
    cell = np.floor((first.points - first.origin) / (max(first.grey.shape) / 7)).astype(int)
    heads = np.unique(cell, axis=0, return_index=True)[1] if len(cell) else np.empty(0, dtype=int)
    number_points = np.sort(heads)[:40]
    # A colour for each point: the hue runs with the sample, the lightness with the line
    share = (first.points - first.origin) / np.maximum(np.array(first.grey.shape[::-1]), 1)
    rgb = [colorsys.hls_to_rgb(0.85 * float(x), 0.4 + 0.3 * float(y), 1.0) for x, y in np.clip(share, 0.0, 1.0)]
    colours = ["#" + "".join(f"{round(255 * channel):02x}" for channel in colour) for colour in rgb]
    parts = [f'<svg class="plot" viewBox="0 0 {width:.1f} {height:.1f}">']
    for left, side, size in zip((0.0, sizes[0][0] + PICTURES_GAP), (first, second), sizes, strict=True):
        places = (side.points - side.origin + 0.5) * scale + (left, 0.0)
        radius = 3.4 if len(places) < 800 else 1.9
        marks = [
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{colour}"/>'
            for (x, y), colour in zip(places, colours, strict=True)
        ]
        grey, valid = np.where(side.valid, side.grey, 0).astype(np.float32), side.valid
        if scale < 1.0:
            smaller = round(grey.shape[1] * scale), round(grey.shape[0] * scale)
            grey, valid = reduce_by_area(grey, smaller), reduce_mask(valid, smaller)
        parts += [
            f'<image x="{left:.1f}" width="{size[0]:.1f}" height="{size[1]:.1f}" preserveAspectRatio="none" '
            f'href="data:image/png;base64,{encode_grey_png(grey, valid)}"/>',
            *marks,
            *[
                f'<text x="{x + 4:.1f}" y="{y - 4:.1f}" style="font-size:16px;fill:#fff;stroke:#000;stroke-width:3px;'
                f'paint-order:stroke">{number + 1}</text>'
                for number, (x, y) in enumerate(places[number_points])
            ],
        ]
    return "".join([*parts, "</svg>"])
