"""The figures of a block's report: its map, its images, chips of points, distributions, before and after."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .block_map import BlockMap, MapDrawing, draw_map
from .distribution_plots import draw_histogram, draw_qq_plot
from .image_cards import ImageCard, draw_image_card
from .residual_plots import compute_typical_length
from .target_chips import TargetChip, draw_target_chip

MAP_NAME = "block-map"


@dataclass(frozen=True, eq=False)
class PointChip:
    """The surroundings of a point on an image, and its residual there.

    id, image, role : of the point, of the image, gcp or check; point : its number on the page, -1 without
    residual_px : (2,) observed - computed; outlier : whether it is an outlier
    chip : pixels, measured and computed position, outline
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
    """A small picture of an image that map and cards share: the page's element ``name``, and its ``data:`` URI.

    Its ``size`` is in its own pixels; the whole image takes ``covers`` of them, as the last of an edge may be missing.
    """

    name: str
    image: str
    size: tuple[int, int]
    covers: tuple[float, float]
    uri: str


@dataclass(frozen=True, eq=False)
class SurfacePicture:
    """A surface that images were matched with: pictures as ``data:`` URI, width and height in px.

    scores : scatter by displacement, up to ``search_m`` along each axis, north up
    residuals : of tie points above the surface, before and after, from ``-limit_m`` to ``limit_m``
    """

    images: tuple[str, ...]
    scores: tuple[str, int, int]
    residuals: Sequence[tuple[str, int, int]]
    search_m: float
    limit_m: float


@dataclass(frozen=True, eq=False)
class ReportFigures:
    """Contents of the figures of a block's report.

    points : columns of the points on the map, in its order, for the page's script
    pictures : of some images; cards : images with their residuals
    surfaces : what surfaces say of parts of the block
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
    """Return the drawings for the page's template; arrows have one scale for all images."""
    residuals = [card.residual_px for card in figures.cards if len(card.residual_px)]
    typical = compute_typical_length(np.vstack(residuals)) if residuals else 0.0
    block = draw_map(figures.map, MAP_NAME) if figures.map is not None else MapDrawing()
    return {
        "block_map": block.svg,
        "script_data": {"map": block.data, **figures.points} if block.svg and figures.points else None,
        "pictures": figures.pictures,
        "surfaces": figures.surfaces,
        "cards": [(card, draw_image_card(card, typical)) for card in figures.cards],
        "distributions": [
            (axis, draw_histogram(values, f"Histogram, {axis}"), draw_qq_plot(values, f"Q-Q, {axis}"))
            for axis, values in figures.normalised.items()
            if len(values)
        ],
        "chips": [(chip, draw_target_chip(chip.chip)) for chip in figures.chips],
    }
