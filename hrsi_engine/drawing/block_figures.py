"""The figures of a block's report: map, image cards, chips of points, histograms, surfaces.

The card of an image shows its picture, the residuals of its points, and the mean residuals of its parts.
"""

import html
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np

from ..foundation.thresholds import SIGNIFICANCE
from .block_map import BlockMap, MapDrawing, draw_map
from .plots import choose_round_length, compute_typical_length, draw_histogram, make_arrow_path
from .target_chips import TargetChip, draw_target_chip

CARD_WIDTH, CARD_MARGIN, CARD_KEY = 360.0, 14.0, 24.0


@dataclass(frozen=True, eq=False)
class ImageCard:
    """Contents of the card of an image.

    image : its id; extent : (2, 2) first and last sample and line
    xy, residual_px : (n, 2) measurements that are drawn singly; groups : (n,) gcp, check, tie or outlier
    points : (n,) numbers of their points on the page; -1 without a number
    total : number of all measurements, of which those in xy are a selection
    means, mean_sigmas : (rows, columns, 2) mean residual of each part of the image, and its standard error; NaN
    with too few residuals
    picture : name of the SVG element with the picture of the image; empty without a picture
    picture_size : width and height of the complete image in pixels of the picture
    """

    image: str
    extent: np.ndarray
    xy: np.ndarray
    residual_px: np.ndarray
    groups: np.ndarray
    points: np.ndarray
    total: int
    means: np.ndarray
    mean_sigmas: np.ndarray
    picture: str = ""
    picture_size: tuple[float, float] = (1.0, 1.0)


def draw_image_card(card: ImageCard, typical_px: float) -> str:
    """Return an image's residuals over its picture as SVG; the style sheet of the page selects what is visible.

    card : its contents; typical_px : residual that sets the scale of the arrows, one for all images of a page
    """
    size = np.maximum(card.extent[1] - card.extent[0] + 1.0, 1.0)
    scale = (CARD_WIDTH - 2.0 * CARD_MARGIN) / float(max(size))
    width, height = size * scale
    per_px = 26.0 / typical_px if typical_px > 0.0 else 0.0  # drawing units of the typical residual
    frame = f'x="{CARD_MARGIN}" y="{CARD_MARGIN}" width="{width:.1f}" height="{height:.1f}"'
    label = html.escape(f"Residuals on {card.image}")
    box = f"0 0 {width + 2.0 * CARD_MARGIN:.0f} {height + 2.0 * CARD_MARGIN + CARD_KEY:.0f}"
    across, down = width / card.picture_size[0], height / card.picture_size[1]
    matrix = f"translate({CARD_MARGIN} {CARD_MARGIN}) scale({across:.5g} {down:.5g})"
    place = (card.xy - card.extent[0] + 0.5) * scale + CARD_MARGIN
    key = ""
    if per_px > 0.0:
        length, y = choose_round_length(1.5 * typical_px), float(height) + 2.0 * CARD_MARGIN + CARD_KEY - 12.0
        key = (
            f'<path class="scale" d="{make_arrow_path(CARD_MARGIN, y, length * per_px, 0.0)}"/>'
            f'<text x="{CARD_MARGIN + length * per_px + 8.0:.1f}" y="{y + 4.0:.1f}">{length:g} px</text>'
        )
    return "".join(
        [
            f'<svg class="card" viewBox="{box}" role="img" aria-label="{label}"><rect class="ground" {frame}/>',
            f'<use href="#{html.escape(card.picture)}" transform="{matrix}"/>' if card.picture else "",
            f'<rect class="frame" {frame}/><g class="field">',
            *_draw_mean_residuals(card, float(width), float(height), per_px),
            '</g><g class="vectors">',
            *_draw_residuals(card, place, per_px),
            "</g>",
            key,
            "</svg>",
        ]
    )


def _draw_mean_residuals(card: ImageCard, width: float, height: float, per_px: float) -> Iterable[str]:
    """Yield the mean residual of each part as an arrow, marked by a class if it is not significant."""
    rows, columns = card.means.shape[:2]
    sure = (np.abs(card.means) > SIGNIFICANCE.sigmas * card.mean_sigmas).any(axis=2)
    for row, column in np.argwhere(np.isfinite(card.means).all(axis=2)).tolist():
        x = CARD_MARGIN + (column + 0.5) * width / columns
        y = CARD_MARGIN + (row + 0.5) * height / rows
        dx, dy = card.means[row, column]
        path = make_arrow_path(x, y, *_cut_arrow(dx * per_px, dy * per_px))
        kind = "mean" if sure[row, column] else "mean chance"
        yield f'<path class="{kind}" d="M{x:.1f},{y:.1f}h0{path}"><title>mean {dx:.2f}, {dy:.2f} px</title></path>'


def _draw_residuals(card: ImageCard, place: np.ndarray, per_px: float) -> Iterable[str]:
    rows = zip(place, card.residual_px * per_px, card.groups.tolist(), card.points.tolist(), strict=True)
    for (x, y), (dx, dy), group, point in rows:
        number = f' data-p="{point}"' if point >= 0 else ""
        path = make_arrow_path(x, y, *_cut_arrow(dx, dy), head=5.0)
        yield f'<path class="v {group}"{number} d="M{x:.1f},{y:.1f}h0{path}"/>'


def _cut_arrow(dx: float, dy: float) -> tuple[float, float]:
    length = float(np.hypot(dx, dy))
    share = min(1.0, 80.0 / length) if length else 1.0  # length of the longest arrow in drawing units
    return dx * share, dy * share


# ---- the report ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PointChip:
    """The surroundings of a point in an image, and its residual there.

    id, image, role : id of the point, id of the image, gcp or check; point : its number on the page, or -1
    residual_px : (2,) observed - computed; outlier : whether it is an outlier
    chip : pixels, measured and computed position, fitted curve
    """

    id: str
    image: str
    role: str
    point: int
    residual_px: np.ndarray
    outlier: bool
    chip: TargetChip


@dataclass(frozen=True, eq=False)
class Picture:
    """A small picture of an image, used by map and cards: ``name`` of its SVG element, and its ``data:`` URI.

    ``size`` is in pixels of the picture; the complete image has ``covers`` of them, since the last ones may be partial.
    """

    name: str
    image: str
    size: tuple[int, int]
    covers: tuple[float, float]
    uri: str


@dataclass(frozen=True, eq=False)
class SurfacePicture:
    """Result of matching images with a surface: pictures as ``data:`` URI, width and height in px.

    scores : scatter as a function of the displacement, up to ``search_m`` along each axis, north up
    residuals : tie point heights above the surface, before and after, from ``-limit_m`` to ``limit_m``
    """

    images: tuple[str, ...]
    scores: tuple[str, int, int]
    residuals: Sequence[tuple[str, int, int]]
    search_m: float
    limit_m: float


@dataclass(frozen=True, eq=False)
class ReportFigures:
    """Contents of the figures of a block's report.

    points : columns of the points of the map, in its order, for the script of the page
    pictures : pictures of some images; cards : images with their residuals
    surfaces : results of surface matching, by parts of the block
    chips : known points and outliers on images with pixels; normalised : (n,) normalised residuals by axis
    """

    map: BlockMap | None = None
    points: Mapping[str, Any] = field(default_factory=dict)
    pictures: Sequence[Picture] = ()
    cards: Sequence[ImageCard] = ()
    chips: Sequence[PointChip] = ()
    normalised: Mapping[str, np.ndarray] = field(default_factory=dict)
    surfaces: Sequence[SurfacePicture] = ()


def draw_figures(figures: ReportFigures) -> dict[str, Any]:
    """Return the drawings for the template of the page; the arrows have the same scale on all images."""
    residuals = [card.residual_px for card in figures.cards if len(card.residual_px)]
    typical = compute_typical_length(np.vstack(residuals)) if residuals else 0.0
    block = draw_map(figures.map, "block-map") if figures.map is not None else MapDrawing()
    return {
        "block_map": block.svg,
        "script_data": {"map": block.data, **figures.points} if block.svg and figures.points else None,
        "pictures": figures.pictures,
        "surfaces": figures.surfaces,
        "cards": [(card, draw_image_card(card, typical)) for card in figures.cards],
        "distributions": [
            (axis, draw_histogram(values, f"Histogram, {axis}"))
            for axis, values in figures.normalised.items()
            if len(values)
        ],
        "drawn_groups": Counter(group for card in figures.cards for group in card.groups.tolist()),
        "chips": [
            (role, [(chip, draw_target_chip(chip.chip)) for chip in group])
            for (role, _), group in groupby(figures.chips, key=lambda chip: (chip.role, chip.id))
        ],
    }
