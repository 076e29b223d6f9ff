"""Two windows of images side by side as SVG, with their corresponding points."""

import colorsys
from dataclasses import dataclass

import numpy as np

from ...hrsi_engine.drawing.target_chips import encode_grey_png
from ...hrsi_engine.foundation.pixel_filters import reduce_by_area, reduce_mask

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
