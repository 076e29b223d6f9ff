"""Map of the block as SVG: pictures, footprints, tie points, known points with their residuals, and scales.

The page's script (``map_controls.js`` of `io.pages`) pans and zooms it. Point marks have the same size at every zoom:
each is drawn at (0, 0) of its own SVG group, which is moved to the point's position.
"""

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from shapely.geometry import Polygon

from ..block.block import Role
from ..block.imaging_geometry import list_corners
from ..foundation.large_arrays import finite_rows
from ..ground.geodesy import LocalFrame, continuous_longitudes
from .plots import choose_round_length, make_arrow_path

_WIDTH, _MARGIN = 900.0, 40.0  # SVG units
_ARROW, _LONGEST_ARROW = 45.0, 130.0  # length of the 90th percentile of the residuals; limit of all arrows
_MOST_LABELS = 30  # names of images are drawn up to this number; more would cover the map
_CELL, _LARGEST_DOT = 20.0, 4.5  # side of a cell of tie points, and largest radius of its dot, SVG units
#: Marks of points: one shape for each role, so that roles can be distinguished without colour.
POINT_MARKS = {
    "gcp": '<path class="dot" d="M0-6L5.2 3H-5.2z"/>',
    "check": '<path class="dot" d="M-3.8-3.8h7.6v7.6h-7.6z"/>',
    "tie": '<circle class="dot" r="2.6"/>',
    "held_out": '<circle class="dot" r="2.6"/>',
}
_GRID = 9  # nodes along each axis, to which the polynomials of the graticule are fitted


@dataclass(frozen=True, eq=False)
class TieField:
    """Tie points that are drawn by cells: positions, and the values by which cells are coloured.

    lonlat : (t, 2) lon, lat; residual_px : (t,) root mean square of a point's image residuals
    sigma_m : (t,) standard deviation of its position; rays : (t,) number of images in which it is measured
    """

    lonlat: np.ndarray
    residual_px: np.ndarray
    sigma_m: np.ndarray
    rays: np.ndarray


@dataclass(frozen=True, eq=False)
class GroundPicture:
    """A picture that is placed on the map: the SVG element ``name``, and lon, lat (4, 2) of its corners.

    ``size`` is in pixels of the picture; the corners are upper left, upper right, lower right and lower left. A
    ``hidden`` picture is shown when its image is selected.
    """

    name: str
    image: str
    size: tuple[float, float]
    corners: np.ndarray
    hidden: bool = False


@dataclass(frozen=True, eq=False)
class BlockMap:
    """Contents of the map of a report.

    footprints : polygons in degrees lon, lat, by image id; lonlat : (m, 2) lon, lat of the points
    roles : (m,) values of `Role`; residual_en_m : (m, 2) east, north, NaN without residual; ids : (m,) point ids
    residual_h_m : (m,) up, NaN without residual; ties : tie points drawn by cells; pictures : the background
    arrows : meaning of an arrow, for the legend
    """

    footprints: Mapping[str, Polygon]
    lonlat: np.ndarray
    roles: np.ndarray
    residual_en_m: np.ndarray
    ids: np.ndarray
    residual_h_m: np.ndarray | None = None
    ties: TieField | None = None
    pictures: Sequence[GroundPicture] = ()
    arrows: str = "residual"


@dataclass(frozen=True, eq=False)
class MapDrawing:
    """SVG of the map, and the data for its script: transformations, scales, statistics of the cells."""

    svg: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _MapView:
    """Transformation from degrees to drawing units: topocentric east and north, with y downwards."""

    frame: LocalFrame
    west_m: float
    north_m: float
    units_per_metre: float
    height: float  # height of the drawing without the legend

    def __call__(self, lonlat: np.ndarray) -> np.ndarray:
        local = self.frame.from_ground(np.column_stack([lonlat[:, :2], np.zeros(len(lonlat))]))[:, :2]
        return _MARGIN + self.units_per_metre * (local - [self.west_m, self.north_m]) * [1.0, -1.0]

    def to_lonlat(self, place: np.ndarray) -> np.ndarray:
        """Return lon, lat ``(k, 2)`` of positions ``(k, 2)`` in the drawing."""
        local = (place - _MARGIN) / self.units_per_metre * [1.0, -1.0] + [self.west_m, self.north_m]
        return self.frame.to_ground(np.column_stack([local, np.zeros(len(local))]))[:, :2]


def draw_map(data: BlockMap, name: str = "") -> MapDrawing:
    """Return the map and the data of its script for panning and zooming; an empty drawing if there are no positions.

    ``name`` is the id of the SVG element, for the script.
    """
    rings = {image: list_corners(polygon) for image, polygon in data.footprints.items() if not polygon.is_empty}
    located = np.flatnonzero(finite_rows(data.lonlat))
    ties = data.ties.lonlat if data.ties is not None else np.empty((0, 2))
    places = np.vstack([*rings.values(), data.lonlat[located], ties[finite_rows(ties)]])
    if not len(places):
        return MapDrawing()
    # View that shows all positions (lon, lat)
    frame = LocalFrame(float(continuous_longitudes(places[:, 0]).mean()), float(places[:, 1].mean()))
    local = frame.from_ground(np.column_stack([places, np.zeros(len(places))]))[:, :2]
    low, high = local.min(axis=0), local.max(axis=0)
    extent = np.maximum(high - low, 1.0)
    scale = min((_WIDTH - 2.0 * _MARGIN) / extent[0], (_WIDTH - 2.0 * _MARGIN) / extent[1])
    slack = (_WIDTH - 2.0 * _MARGIN) / scale - extent[0]  # centres a block that is higher than wide
    view = _MapView(frame, low[0] - slack / 2.0, high[1], scale, max(extent[1] * scale + 2.0 * _MARGIN, 320.0))
    # Drawing units per metre of residual; None without residuals
    residual = data.residual_en_m[finite_rows(data.residual_en_m)]
    typical = float(np.percentile(np.linalg.norm(residual, axis=1), 90.0)) if len(residual) else 0.0
    arrow_scale = _ARROW / typical if typical > 0.0 else None
    cells, figures = _draw_cells(data.ties, view) if data.ties is not None else ([], {})
    parts = [
        f'<rect class="ground" x="0" y="0" width="{_WIDTH:.0f}" height="{view.height:.0f}"/>',
        '<g class="view">',
        *_draw_pictures(data.pictures, view),
        *_draw_footprints(rings, list(data.footprints), view),
        '<g class="graticule"></g><g class="cells">',
        *cells,
        "</g>",
        *_draw_image_names(rings, view),
        '<g class="points">',
        *_draw_points(data, located, view, arrow_scale),
        "</g></g>",
        *_draw_scales(view, arrow_scale, data.arrows),
    ]
    id_attribute = f' id="{html.escape(name)}"' if name else ""
    size = f'viewBox="0 0 {_WIDTH:.0f} {view.height + 50.0:.0f}"'
    # The text alternative
    count = {role: int((data.roles[located] == role).sum()) for role in Role}
    if data.ties is not None:
        count[Role.TIE] = len(ties)
    words = {Role.GCP: "control", Role.CHECK: "check", Role.TIE: "tie", Role.HELD_OUT: "held-out tie"}
    counts = [f"{count[role]} {word} points" for role, word in words.items() if count[role]]
    label = f"Map of the block: {', '.join([f'{len(data.footprints)} images', *counts])}; north is up"
    svg = f'<svg class="map"{id_attribute} {size} role="img" aria-label="{label}">\n'
    to_degrees, to_drawing = _fit_polynomials(view)
    return MapDrawing(
        svg + "\n".join(parts) + "\n</svg>",
        {
            "width": _WIDTH,
            "height": round(view.height, 1),
            "unitsPerMetre": view.units_per_metre,
            "origin": [view.frame.lon_deg, view.frame.lat_deg],
            "toDegrees": to_degrees,
            "toDrawing": to_drawing,
            "cells": figures,
        },
    )


def _fit_polynomials(view: _MapView) -> tuple[list[list[float]], list[list[float]]]:
    """Return the coefficients of 1, u, v, u², uv, v² of the transformations from drawing to degrees and back.

    u and v are hundreds of drawing units, or degrees from the frame's origin. Over a block of 1000 km they are
    accurate to one drawing unit, which is sufficient for a graticule and the position under the pointer.
    """
    axes = np.linspace(0.0, _WIDTH, _GRID), np.linspace(0.0, view.height, _GRID)
    place = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    lonlat = view.to_lonlat(place)
    degrees = np.column_stack([continuous_longitudes(lonlat[:, 0]), lonlat[:, 1]])
    degrees -= [360.0 * np.round((degrees[:, 0].mean() - view.frame.lon_deg) / 360.0), 0.0]
    degrees -= [view.frame.lon_deg, view.frame.lat_deg]
    return _fit_quadratic(place / 100.0, degrees), _fit_quadratic(degrees, place)


def _fit_quadratic(uv: np.ndarray, values: np.ndarray) -> list[list[float]]:
    u, v = uv.T
    terms = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    scale = np.abs(terms).max(axis=0)
    solved = np.linalg.lstsq(terms / scale, values, rcond=None)[0] / scale[:, None]
    return [[float(f"{value:.12g}") for value in column] for column in solved.T]


def _draw_pictures(pictures: Sequence[GroundPicture], view: _MapView) -> Iterable[str]:
    """Yield pictures, placed by the affine transformation that fits their corners best (least squares)."""
    yield '<g class="pictures">'
    for picture in pictures:
        width, height = picture.size
        pixel = np.array([[0.0, 0.0, 1.0], [width, 0.0, 1.0], [width, height, 1.0], [0.0, height, 1.0]])
        matrix = np.linalg.lstsq(pixel, view(picture.corners), rcond=None)[0]
        numbers = " ".join(f"{value:.6g}" for value in matrix.ravel())
        class_attribute = ' class="hidden"' if picture.hidden else ""
        name, image = html.escape(picture.name), html.escape(picture.image)
        yield f'<use{class_attribute} href="#{name}" data-image="{image}" transform="matrix({numbers})"/>'
    yield "</g>"


def _draw_footprints(rings: Mapping[str, np.ndarray], images: Sequence[str], view: _MapView) -> Iterable[str]:
    number = {image: place for place, image in enumerate(images)}
    yield '<g class="footprints">'
    outlines = list(rings.values())
    if len(rings) > _MOST_LABELS:
        outlines = [ring[:: max(1, len(ring) // 8)] for ring in outlines]
    ends = np.cumsum([0, *map(len, outlines)]).tolist()
    corners = view(np.concatenate(outlines)).tolist() if outlines else []
    for image, start, end in zip(rings, ends[:-1], ends[1:], strict=True):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners[start:end])
        title = f"<title>{html.escape(image)}</title>"
        yield f'<polygon class="footprint" data-i="{number[image]}" points="{path}">{title}</polygon>'
    yield "</g>"


def _draw_image_names(rings: Mapping[str, np.ndarray], view: _MapView) -> Iterable[str]:
    if len(rings) <= _MOST_LABELS:
        placed: list[tuple[float, float]] = []
        for image, ring in rings.items():
            x, y = view(ring)[np.argmin(view(ring).sum(axis=1))]  # upper left corner; moved down beyond other names
            while any(abs(x - other_x) < 120.0 and abs(y - other_y) < 15.0 for other_x, other_y in placed):
                y += 2.0
            placed.append((x, y))
            text = f'<text class="image mark" x="4" y="14">{html.escape(image)}</text>'
            yield f'<g transform="translate({x:.1f} {y:.1f})">{text}</g>'


def _draw_cells(ties: TieField, view: _MapView) -> tuple[list[str], dict[str, Any]]:
    """Return a dot for each cell with tie points, its area by their number; and their statistics, by cell."""
    is_located = finite_rows(ties.lonlat)
    cell = np.floor(view(ties.lonlat[is_located]) / _CELL).astype(np.int64)
    columns = int(np.ceil(_WIDTH / _CELL))
    code, cell_index, count = np.unique(cell[:, 1] * columns + cell[:, 0], return_inverse=True, return_counts=True)

    def mean(values: np.ndarray, power: float = 1.0) -> list[float | None]:
        is_finite = np.isfinite(values)
        total = np.bincount(cell_index[is_finite], np.asarray(values[is_finite], dtype=np.float64) ** power, len(code))
        number = np.bincount(cell_index[is_finite], minlength=len(code))
        with np.errstate(invalid="ignore"):
            return [
                float(f"{value:.3g}") if math.isfinite(value) else None for value in (total / number) ** (1.0 / power)
            ]

    radius = np.maximum(_LARGEST_DOT * np.sqrt(count / max(int(count.max(initial=1)), 1)), 0.8)
    parts = [
        f'<path data-c="{number}" d="M{(place % columns + 0.5) * _CELL - r:.1f} {(place // columns + 0.5) * _CELL:.1f}'
        f'a{r:.1f} {r:.1f} 0 1 0 {2 * r:.1f} 0a{r:.1f} {r:.1f} 0 1 0 {-2 * r:.1f} 0z"/>'
        for number, (place, r) in enumerate(zip(code.tolist(), radius.tolist(), strict=True))
    ]
    figures = {
        "count": count.tolist(),
        "residual": mean(ties.residual_px[is_located], 2.0),
        "sigma": mean(ties.sigma_m[is_located]),
        "rays": mean(ties.rays[is_located]),
    }
    return parts, figures


def _draw_points(data: BlockMap, located: np.ndarray, view: _MapView, arrow_scale: float | None) -> Iterable[str]:
    height = data.residual_h_m if data.residual_h_m is not None else np.full(len(data.ids), np.nan)
    for row, (x, y) in zip(located.tolist(), view(data.lonlat[located]), strict=True):
        role, name = Role(int(data.roles[row])).label, html.escape(str(data.ids[row]))
        east, north = data.residual_en_m[row]
        has_arrow = arrow_scale is not None and math.isfinite(east) and math.isfinite(north)
        title = f"{name} ({role})" + (f": east {east:.3f} m, north {north:.3f} m" if has_arrow else "")
        marks = []
        if has_arrow and arrow_scale is not None:
            marks.append(_draw_residual("arrow flat", east * arrow_scale, -north * arrow_scale))
        if arrow_scale is not None and math.isfinite(height[row]):
            marks.append(_draw_residual("arrow lift", 0.0, -height[row] * arrow_scale))
        yield (
            f'<g class="pt {role}" data-p="{row}" transform="translate({x:.1f} {y:.1f})"><g class="mark">'
            f"{''.join(marks)}{POINT_MARKS[role]}<title>{title}</title></g></g>"
        )


def _draw_residual(kind: str, dx: float, dy: float) -> str:
    """Return the residual of a point as an arrow; an arrow longer than `_LONGEST_ARROW` is cut and drawn dashed."""
    length = math.hypot(dx, dy)
    cut = min(1.0, _LONGEST_ARROW / length) if length else 1.0
    path = make_arrow_path(0.0, 0.0, dx * cut, dy * cut)
    return f'<path class="{kind}{" cut" if cut < 1.0 else ""}" d="{path}"/>' if path else ""


def _draw_scales(view: _MapView, arrow_scale: float | None, arrows: str) -> Iterable[str]:
    """Yield the scale bar of the map, the scale of the residual arrows, and the north arrow."""
    distance = choose_round_length(150.0 / view.units_per_metre)
    bar = distance * view.units_per_metre
    y = view.height + 20.0
    yield f'<rect class="legend" x="0" y="{view.height:.1f}" width="{_WIDTH:.0f}" height="50"/>'
    yield f'<path class="scale length" d="M{_MARGIN},{y - 5.0:.1f}v5h{bar:.1f}v-5"/>'
    yield f'<text class="scale length" x="{_MARGIN}" y="{y + 18.0:.1f}">{_format_metres(distance)} on the ground</text>'
    if arrow_scale is not None:
        residual = choose_round_length(1.3 * _ARROW / arrow_scale)
        x = _WIDTH / 2.0
        yield f'<path class="scale" d="{make_arrow_path(x, y, residual * arrow_scale, 0.0)}"/>'
        yield f'<text class="scale" x="{x:.1f}" y="{y + 18.0:.1f}">{arrows} of {_format_metres(residual)}</text>'
    x = _WIDTH - _MARGIN
    yield f'<path class="scale north" d="{make_arrow_path(x, y + 16.0, 0.0, -26.0)}"/>'
    yield f'<text class="scale" x="{x - 16.0:.1f}" y="{y + 14.0:.1f}">N</text>'


def _format_metres(length: float) -> str:
    for unit, size in (("km", 1000.0), ("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if length >= size:
            return f"{length / size:g} {unit}"
    return f"{length:g} m"
