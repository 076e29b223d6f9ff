"""One image of a block as SVG: its picture, residuals on it, their systematic part, and where tie points lie."""

import html
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from .arrows import choose_round_length, make_arrow_path

CARD_WIDTH, CARD_MARGIN, CARD_KEY = 360.0, 14.0, 24.0
CARD_ARROW = 26.0  # drawing units of the typical residual
CARD_CUT = 80.0  # the longest arrow


@thresholds
class CARD:
    """From where on the mean residual of a cell is drawn as systematic."""

    fewest_residuals: int = threshold(3, "residuals", "fewest residuals of a cell with a mean")
    mean_sigmas: float = threshold(2.0, "sigma", "standard errors of a significant mean", "normal distribution: 5 %")


@dataclass(frozen=True, eq=False)
class ImageCard:
    """What is drawn of an image.

    image : its id; extent : (2, 2) first and last sample and line
    xy, residual_px : (n, 2) measurements that are drawn one by one; groups : (n,) gcp, check, tie or outlier
    points : (n,) numbers of their points on the page; -1 without
    total : measurements there are, of which these are drawn
    counts, rays : (rows, columns) tie points in each part of the image, and on how many images they are on the average
    means, mean_sigmas : (rows, columns, 2) mean residual of each part of the image, and its standard error; NaN with
    too few
    picture : the page's element with the image's picture; empty without
    picture_size : pixels of the picture that the whole image takes, across and down
    """

    image: str
    extent: np.ndarray
    xy: np.ndarray
    residual_px: np.ndarray
    groups: np.ndarray
    points: np.ndarray
    total: int
    counts: np.ndarray
    rays: np.ndarray
    means: np.ndarray
    mean_sigmas: np.ndarray
    picture: str = ""
    picture_size: tuple[float, float] = (1.0, 1.0)


def draw_image_card(card: ImageCard, typical_px: float) -> str:
    """Return an image's residuals over its picture and tie points; what is shown of them the page's style chooses.

    card : what to draw; typical_px : residual that sets the scale of the arrows, one for all images of a page
    """
    size = np.maximum(card.extent[1] - card.extent[0] + 1.0, 1.0)
    scale = (CARD_WIDTH - 2.0 * CARD_MARGIN) / float(max(size))
    width, height = size * scale
    per_px = CARD_ARROW / typical_px if typical_px > 0.0 else 0.0
    frame = f'x="{CARD_MARGIN}" y="{CARD_MARGIN}" width="{width:.1f}" height="{height:.1f}"'
    label = html.escape(f"Residuals on {card.image}")
    box = f"0 0 {width + 2.0 * CARD_MARGIN:.0f} {height + 2.0 * CARD_MARGIN + CARD_KEY:.0f}"
    place = (card.xy - card.extent[0] + 0.5) * scale + CARD_MARGIN
    return "".join([
        f'<svg class="card" viewBox="{box}" role="img" aria-label="{label}"><rect class="ground" {frame}/>',
        _draw_picture(card, float(width), float(height)),
        *_draw_cells(card, float(width), float(height)),
        f'<rect class="frame" {frame}/><g class="field">',
        *_draw_mean_residuals(card, float(width), float(height), per_px),
        '</g><g class="vectors">',
        *_draw_residuals(card, place, per_px),
        "</g>",
        *_draw_key(typical_px, per_px, float(height) + 2.0 * CARD_MARGIN + CARD_KEY - 12.0),
        "</svg>",
    ])  # fmt: skip


def _draw_picture(card: ImageCard, width: float, height: float) -> str:
    if not card.picture:
        return ""
    across, down = width / card.picture_size[0], height / card.picture_size[1]
    matrix = f"translate({CARD_MARGIN} {CARD_MARGIN}) scale({across:.5g} {down:.5g})"
    return f'<use href="#{html.escape(card.picture)}" transform="{matrix}"/>'


def _draw_cells(card: ImageCard, width: float, height: float) -> Iterable[str]:
    """Draw the parts of the image, stronger for more tie points and, in a second group, for more rays."""
    rows, columns = card.counts.shape
    if not card.counts.any():
        return
    most, most_rays = max(int(card.counts.max()), 1), max(float(np.nanmax(card.rays)), 3.0)
    for kind in ("count", "rays"):
        yield f'<g class="cells {kind}">'
        for row in range(rows):
            for column in range(columns):
                count, rays = int(card.counts[row, column]), float(card.rays[row, column])
                share = np.sqrt(count / most) if kind == "count" else max(rays - 1.0, 0.0) / (most_rays - 1.0)
                opacity = f' fill-opacity="{0.12 + 0.6 * share:.2f}"' if count else ' class="empty"'
                x, y = CARD_MARGIN + column * width / columns, CARD_MARGIN + row * height / rows
                title = f"{count} tie points" + (f", {rays:.1f} images each" if count else "")
                path = f"M{x:.1f} {y:.1f}h{width / columns:.1f}v{height / rows:.1f}h-{width / columns:.1f}z"
                yield f'<path d="{path}"{opacity}><title>{title}</title></path>'
        yield "</g>"


def _draw_mean_residuals(card: ImageCard, width: float, height: float, per_px: float) -> Iterable[str]:
    """Draw the mean residual of each part, faint where it is no more than chance."""
    rows, columns = card.means.shape[:2]
    sure = (np.abs(card.means) > CARD.mean_sigmas * card.mean_sigmas).any(axis=2)
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
    share = min(1.0, CARD_CUT / length) if length else 1.0
    return dx * share, dy * share


def _draw_key(typical_px: float, per_px: float, y: float) -> Iterable[str]:
    if per_px > 0.0:
        length = choose_round_length(1.5 * typical_px)
        yield f'<path class="scale" d="{make_arrow_path(CARD_MARGIN, y, length * per_px, 0.0)}"/>'
        yield f'<text x="{CARD_MARGIN + length * per_px + 8.0:.1f}" y="{y + 4.0:.1f}">{length:g} px</text>'
