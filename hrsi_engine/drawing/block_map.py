"""A map of the block as SVG: footprints, points, residual arrows and the scales of map and arrows."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from shapely.geometry import Polygon

from ..block.block import Role
from ..block.footprints import ring_of
from ..ground.geodesy import LocalFrame, continuous_longitudes

_WIDTH, _MARGIN = 900.0, 40.0  # SVG units
_ARROW = 45.0  # length of the 90th percentile of the residuals
_MOST_LABELS = 150  # more would cover the map
_CLASSES = {Role.GCP: "gcp", Role.CHECK: "check", Role.TIE: "tie"}


@dataclass(frozen=True, eq=False)
class BlockMap:
    """What the map of a report shows.

    Parameters
    ----------
    footprints : mapping of str to shapely.geometry.Polygon
        In degrees of lon and lat, by image id.
    lonlat : (m, 2) ndarray
        Lon, lat of the points.
    roles : (m,) ndarray
        Values of `Role`.
    residual_en_m : (m, 2) ndarray
        East, north; NaN without.
    ids : (m,) ndarray of str
        Their names.
    """

    footprints: Mapping[str, Polygon]
    lonlat: np.ndarray
    roles: np.ndarray
    residual_en_m: np.ndarray
    ids: np.ndarray


@dataclass(frozen=True)
class _View:
    """From degrees to the drawing: east and north metres about the block's middle, y downwards."""

    frame: LocalFrame
    west_m: float
    north_m: float
    units_per_metre: float

    def __call__(self, lonlat: np.ndarray) -> np.ndarray:
        flat = np.column_stack([lonlat[:, :2], np.zeros(len(lonlat))])
        local = self.frame.from_ground(flat)[:, :2]
        return _MARGIN + self.units_per_metre * (local - [self.west_m, self.north_m]) * [1.0, -1.0]


def block_map_svg(data: BlockMap) -> str:
    """Return the map as an SVG element; ids are escaped. Empty where there is nothing to show.

    Parameters
    ----------
    data : BlockMap
        What to draw.

    Returns
    -------
    str
        An SVG element.
    """
    rings = {name: ring_of(polygon) for name, polygon in data.footprints.items() if not polygon.is_empty}
    here = np.flatnonzero(np.isfinite(data.lonlat).all(axis=1))
    places = np.vstack([*rings.values(), data.lonlat[here]]) if rings or len(here) else np.empty((0, 2))
    if not len(places):
        return ""
    # A view that shows all places, and the drawing's height
    frame = LocalFrame(float(continuous_longitudes(places[:, 0]).mean()), float(places[:, 1].mean()))
    local = frame.from_ground(np.column_stack([places, np.zeros(len(places))]))[:, :2]
    low, high = local.min(axis=0), local.max(axis=0)
    extent = np.maximum(high - low, 1.0)
    scale = min((_WIDTH - 2.0 * _MARGIN) / extent[0], (_WIDTH - 2.0 * _MARGIN) / extent[1])
    slack = (_WIDTH - 2.0 * _MARGIN) / scale - extent[0]  # a tall block stands in the middle
    view, height = _View(frame, low[0] - slack / 2.0, high[1], scale), extent[1] * scale + 2.0 * _MARGIN
    # Drawing units per metre of residual; None without residuals
    length = np.linalg.norm(data.residual_en_m[np.isfinite(data.residual_en_m).all(axis=1)], axis=1)
    typical = float(np.percentile(length, 90.0)) if len(length) else 0.0
    arrow_scale = _ARROW / typical if typical > 0.0 else None
    parts = [
        *_footprints(rings, view),
        *_points(data, here, view, arrow_scale),
        *_scales(view.units_per_metre, arrow_scale, height),
    ]
    size = f'viewBox="0 0 {_WIDTH:.0f} {height + 50.0:.0f}"'
    return f'<svg class="map" {size} role="img" aria-label="Map of the block">\n' + "\n".join(parts) + "\n</svg>"


def _footprints(rings: Mapping[str, np.ndarray], view: _View) -> Iterable[str]:
    for name, ring in rings.items():
        outline = view(ring)
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in outline)
        yield f'<polygon class="footprint" points="{path}"><title>{html.escape(name)}</title></polygon>'
    if len(rings) <= _MOST_LABELS:
        corners = [view(ring)[np.argmin(view(ring).sum(axis=1))] for ring in rings.values()]  # upper left
        for name, (x, y) in zip(rings, _apart(corners), strict=True):
            yield f'<text class="image" x="{x + 4.0:.1f}" y="{y + 14.0:.1f}">{html.escape(name)}</text>'


def _apart(corners: Sequence[np.ndarray]) -> list[tuple[float, float]]:
    """Return places of labels that begin at the corners, moved down where they would cover another."""
    placed: list[tuple[float, float]] = []
    for x, corner_y in corners:
        y = corner_y
        while any(abs(x - other_x) < 120.0 and abs(y - other_y) < 13.0 for other_x, other_y in placed):
            y += 2.0
        placed.append((x, y))
    return placed


def _points(data: BlockMap, here: np.ndarray, view: _View, arrow_scale: float | None) -> Iterable[str]:
    place = view(data.lonlat[here])
    labelled = len(here) <= _MOST_LABELS
    for row, (x, y) in zip(here, place, strict=True):
        role, name = _CLASSES[Role(int(data.roles[row]))], html.escape(str(data.ids[row]))
        east, north = data.residual_en_m[row]
        moved = arrow_scale is not None and math.isfinite(east) and math.isfinite(north)
        title = f"{name} ({role})" + (f": east {east:.3f} m, north {north:.3f} m" if moved else "")
        if moved and arrow_scale is not None:
            yield _arrow(role, x, y, east * arrow_scale, -north * arrow_scale)
        yield f'<circle class="{role}" cx="{x:.1f}" cy="{y:.1f}" r="3"><title>{title}</title></circle>'
        if labelled:
            yield f'<text class="id" x="{x + 5.0:.1f}" y="{y - 5.0:.1f}">{name}</text>'


def _arrow(role: str, x: float, y: float, dx: float, dy: float) -> str:
    """Return a line with a head whose size does not depend on the length."""
    length = math.hypot(dx, dy)
    if length < 0.5:
        return ""
    ux, uy = dx / length, dy / length
    head = min(7.0, 0.6 * length)
    tip = (x + dx, y + dy)
    sides = [(tip[0] - head * (ux + 0.45 * s * uy), tip[1] - head * (uy - 0.45 * s * ux)) for s in (1.0, -1.0)]
    points = [(x, y), tip, sides[0], tip, sides[1]]
    path = "M" + "L".join(f"{px:.1f},{py:.1f}" for px, py in points)
    return f'<path class="arrow {role}" d="{path}"/>'


def _scales(units_per_metre: float, arrow_scale: float | None, height: float) -> Iterable[str]:
    """Draw the map's scale bar and, beside it, an arrow of a round length."""
    distance = _round_length(150.0 / units_per_metre)
    bar = distance * units_per_metre
    y = height + 20.0
    yield f'<path class="scale" d="M{_MARGIN},{y - 5.0}v5h{bar:.1f}v-5"/>'
    yield f'<text class="scale" x="{_MARGIN}" y="{y + 18.0}">{_metres(distance)} on the ground</text>'
    if arrow_scale is not None:
        residual = _round_length(1.3 * _ARROW / arrow_scale)
        x = _WIDTH / 2.0
        yield _arrow("scale", x, y, residual * arrow_scale, 0.0)
        yield f'<text class="scale" x="{x:.1f}" y="{y + 18.0}">residual of {_metres(residual)}</text>'


def _round_length(longest: float) -> float:
    """Return the longest of 1, 2, 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= longest * 1.000001)


def _metres(length: float) -> str:
    for unit, size in (("km", 1000.0), ("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if length >= size:
            return f"{length / size:g} {unit}"
    return f"{length:g} m"
