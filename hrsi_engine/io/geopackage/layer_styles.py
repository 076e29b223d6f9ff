"""QGIS styles of the result's layers: residual arrows whose scale suits the data, footprints, points.

The styles are QML templates in ``styles/``, made for QGIS 3.22 and later. The arrow of the 90th percentile has a fixed
length on the screen; the legend states how many metres or pixels that is.
"""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from html import escape
from typing import Any, NamedTuple

import numpy as np

from ..templates import make_environment
from .typed_rows import write_titles

GROUND_ARROW_MM, IMAGE_ARROW_MM = 8.0, 4.0  #: length of the 90th percentile; image residuals are closer together
MOST_ON_MAP = 1500  #: most points or arrows that one map shows; more cannot be distinguished
LAYER_COLORS = {
    "gcp": "21,101,168,255",
    "check": "26,127,75,255",
    "outlier": "215,25,28,255",
    "tie": "120,130,140,255",
    "held_out": "152,78,163,255",
}

#: Colours of the reasons why laser points are not used.
REASON_COLORS = (
    "215,25,28,255",
    "253,141,60,255",
    "152,78,163,255",
    "166,86,40,255",
    "247,129,191,255",
    "90,90,90,255",
)

#: Colours from points below a surface to points above it.
SURFACE_COLORS = (
    "33,102,172,255",
    "103,169,207,255",
    "209,229,240,255",
    "150,150,150,255",
    "253,219,199,255",
    "239,138,98,255",
    "178,24,43,255",
)

LayerColumns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Style:
    """A QGIS style (QML) and what it shows."""

    qml: str
    description: str = ""


def default_style(name: str, fields: LayerColumns, width_m: float) -> Style | None:
    """Return the style of a layer with these fields, ``width_m`` wide on the ground; None if HRSI has none for it."""
    if name not in STYLES or not NEEDED.get(name, frozenset()) <= fields.keys():
        return None
    style = STYLES[name](fields, width_m)
    # The style names the fields in forms and tables with words and units
    entries = "".join(
        f'<alias index="{number}" field="{escape(name)}" name="{escape(title)}"/>'
        for number, (name, title) in enumerate(write_titles(fields).items())
    )
    head = style.qml.replace('styleCategories="', 'styleCategories="Fields|', 1)
    return replace(style, qml=head.replace("</qgis>", f"<aliases>{entries}</aliases>\n</qgis>"))


class Share(NamedTuple):
    """Tie points that are drawn between two map scales (denominators): one of ``every``."""

    every: int
    nearest: int
    farthest: int


def shares(count: int, width_m: float) -> list[Share]:
    """Return how ``count`` points are thinned by the map scale, so that a map is legible and drawn quickly.

    ``width_m`` is the width of the points' area on the ground: a map of all of it, 0.25 m wide, and any map at a larger
    scale, shows between 150 and `MOST_ON_MAP` points, or all if there are fewer.
    """
    result, nearest, step = [], 0, 1
    while count > MOST_ON_MAP * step:
        farthest = max(round(width_m / 0.25 * math.sqrt(MOST_ON_MAP * step / count)), nearest + 1)
        result.append(Share(step, nearest, farthest))
        nearest, step = farthest, 10 * step
    return [*result, Share(step, nearest, 0)]  # 0: no limit


def _residuals(fields: LayerColumns, width_m: float) -> Style:
    ground, image = np.isin(fields["level"], ("ground",)), np.isin(fields["level"], ("image",))
    is_good = ~np.isin(fields["flag"], ("outlier",))
    on_ground = _typical(fields["residual_east_m"], fields["residual_north_m"], ground & is_good)
    in_image = _typical(fields["residual_sample_px"], fields["residual_line_px"], image & is_good)
    return _render_style(
        "residuals.qml.j2",
        "Residual arrows (observed - computed)",
        **_arrows("ground", on_ground, GROUND_ARROW_MM, "m"),
        **_arrows("image", in_image, IMAGE_ARROW_MM, "px"),
        image_shares=shares(int(np.sum(image)), width_m),
        has_ground=bool(np.any(ground & np.isfinite(fields["residual_east_m"]))),
    )


def _image_points(fields: LayerColumns, width_m: float) -> Style:
    is_good = ~np.isin(fields["flag"], ("outlier", "rejected"))
    typical = _typical(fields["residual_sample_px"], fields["residual_line_px"], is_good)
    return _render_style(
        "image_points.qml.j2",
        "Image residuals",
        image_shares=shares(len(is_good), width_m),
        **_arrows("image", typical, IMAGE_ARROW_MM, "px"),
    )


def _misregistration(fields: LayerColumns, width_m: float) -> Style:
    is_before = fields["state"] == "before"
    typical = _typical(fields["east_m"], fields["north_m"], is_before if is_before.any() else ~is_before)
    return _render_style(
        "misregistration.qml.j2",
        "Shifts between orthoimages (second - first)",
        **_arrows("ground", typical, GROUND_ARROW_MM, "m"),
        has_before=bool(is_before.any()),
    )


def _ground_points(fields: LayerColumns, width_m: float) -> Style:
    ties = int(np.sum(np.isin(fields["role"], ("tie",))))
    return _render_style("ground_points.qml.j2", "Control, check and tie points", tie_shares=shares(ties, width_m))


def _tie_points(fields: LayerColumns, width_m: float) -> Style:
    pairs = int(np.sum(fields["views"] == 2)) if "views" in fields else 0
    return _render_style("tie_points.qml.j2", "Tie points by number of images", pair_shares=shares(pairs, width_m))


def _interest_points(fields: LayerColumns, width_m: float) -> Style:
    kind = fields.get("kind", np.empty(0, dtype=str))
    corner, strong = kind == "corner", kind == "super"
    return _render_style(
        "interest_points.qml.j2",
        "Corners and gravity centres",
        corner_shares=shares(int(corner.sum()), width_m),
        super_shares=shares(int(strong.sum()), width_m),
        centre_shares=shares(int(np.sum(~corner & ~strong)), width_m),
    )


def _thin_points(color: str, size_mm: float) -> Callable[[LayerColumns, float], Style]:
    """Return a style for many points with equal symbols."""

    def style(fields: LayerColumns, width_m: float) -> Style:
        count = len(next(iter(fields.values()), ()))
        return _render_style(
            "points.qml.j2", "Points", color=LAYER_COLORS[color], size=size_mm, point_shares=shares(count, width_m)
        )

    return style


def _laser_points(fields: LayerColumns, width_m: float) -> Style:
    reason = fields.get("reason", np.empty(0, dtype=str))
    is_used, reasons = reason == "", sorted(set(reason[reason != ""].tolist()))
    return _render_style(
        "laser_points.qml.j2",
        "Laser points: used, and left out with the reason",
        used_shares=shares(int(is_used.sum()), width_m),
        out_shares=shares(int((~is_used).sum()), width_m),
        reasons=[(cause, REASON_COLORS[number % len(REASON_COLORS)]) for number, cause in enumerate(reasons)],
    )


def _surface_residuals(fields: LayerColumns, width_m: float) -> Style:
    above = fields["residual_height_m"]
    typical = _typical(above, np.zeros(len(above)), np.ones(len(above), dtype=bool))
    bounds = [-1.0, -0.5, -0.2, 0.2, 0.5, 1.0]
    return _render_style(
        "surface_residuals.qml.j2",
        "Tie points above and below the surface",
        steps=[*zip([None, *bounds], [*bounds, None], SURFACE_COLORS, strict=True)],
        typical=typical,
        point_shares=shares(len(above), width_m),
    )


#: Fields that a style needs: other algorithms write layers of the same names with positions alone.
NEEDED: dict[str, frozenset[str]] = {
    "ground_points": frozenset({"role"}),
    "laser_points": frozenset({"used", "reason"}),
    "image_points": frozenset({"flag", "residual_sample_px", "residual_line_px"}),
}
STYLES: dict[str, Callable[[LayerColumns, float], Style]] = {
    "images": lambda _fields, _width_m: _render_style("images.qml.j2", "Footprints"),
    "seamlines": lambda _fields, _width_m: _render_style("images.qml.j2", "Seamlines"),
    "ground_points": _ground_points,
    "image_points": _image_points,
    "interest_points": _interest_points,
    "gcps": _thin_points("gcp", 2.4),
    "laser_points": _laser_points,
    "surface_residuals": _surface_residuals,
    "targets": _thin_points("check", 2.0),
    "tie_points": _tie_points,
    "misregistration_utm": _misregistration,
    "misregistration_wgs84": _misregistration,
    "residuals_wgs84": _residuals,
    "residuals_utm": _residuals,
}


def _typical(x: np.ndarray, y: np.ndarray, rows: np.ndarray) -> float:
    """Return the 90th percentile of the lengths of vectors; 1 if it is zero or there is none."""
    length = np.hypot(x[rows], y[rows])
    length = length[np.isfinite(length)]
    typical = float(np.percentile(length, 90.0)) if len(length) else 0.0
    return typical if typical > 0.0 else 1.0


def _arrows(kind: str, typical: float, arrow_mm: float, unit: str) -> dict[str, str]:
    """Return the scale of arrows of a kind, and the legend's text on their length."""
    return {f"{kind}_scale": f"{arrow_mm / typical:.6g}", f"{kind}_key": f"{arrow_mm:g} mm = {typical:.2g} {unit}"}


def _render_style(template: str, description: str, **values: Any) -> Style:
    text = _environment().get_template(template).render(**LAYER_COLORS, **values)
    return Style("\n".join(line for line in text.splitlines() if line.strip()), description)


@cache
def _environment() -> Any:
    return make_environment(os.path.join(os.path.dirname(__file__), "styles"), {}, strict=True)
