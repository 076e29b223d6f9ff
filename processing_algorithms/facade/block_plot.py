"""A picture of an adjusted block: its image points on the map, before and after the adjustment.

"Before" are the residuals by the delivered RPCs, "after" those of the report; both at the adjusted positions of the
points, so that they differ by the correction of the RPCs alone.
"""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.catalogue.block_records import read_record
from ...hrsi_engine.io.geopackage.layer_tables import read_layer_table
from ..files.result_folder import PAGE_FILE

ARROW_SHARE = 0.1  # length of a large arrow (nine of ten are shorter) over the width of the map


class PageMap(str):
    """The map of a report's page as SVG, which notebooks show."""

    def _repr_svg_(self) -> str:
        return str(self)


def plot_block(folder: Path) -> Any:
    """Return a figure of matplotlib with two maps of the block in a result folder.

    Without matplotlib it is the map of the report's page; raises `InputError` if there is no page.
    """
    try:
        pyplot = import_module("matplotlib.pyplot")
    except ImportError:
        page = folder / PAGE_FILE
        drawn = re.search(r"<svg class=\"map\".*?</svg>", page.read_text("utf-8"), re.DOTALL) if page.exists() else None
        if drawn is None:
            raise InputError("plot needs matplotlib: install it, or set `report`") from None
        return PageMap(drawn[0])
    record = read_record(str(folder))
    layers = record.layer("image_points").partition("|")[0]
    table, footprints = read_layer_table(layers, "image_points"), read_layer_table(layers, "images")["geometry"]
    place = np.column_stack([table["lon"], table["lat"], table["height"]])
    after = np.column_stack([table["residual_sample_px"], table["residual_line_px"]])
    before, measured = np.full_like(after, np.nan), np.column_stack([table["sample"], table["line"]])
    for image in record.images:
        rows = table["image"] == image.id
        before[rows] = measured[rows] - image.rpc.project(place[rows])
    figure, axes = pyplot.subplots(1, 2, figsize=(11.0, 5.5), sharex=True, sharey=True, layout="constrained")
    for axis, residual, title in zip(axes, (before, after), ("before", "after"), strict=True):
        _draw_map(axis, footprints, place, residual, title)
        for role in dict.fromkeys(table["role"].tolist()):
            rows = table["role"] == role
            axis.plot(*place[rows, :2].T, ".", markersize=4.0, label=role)
    axes[0].set_ylabel("latitude")
    axes[1].legend(loc="best", fontsize="small")
    return figure


def _draw_map(axis: Any, footprints: Any, place: np.ndarray, residual: np.ndarray, title: str) -> None:
    """Draw footprints, and residuals (n, 2) in pixels as arrows: sample to the right, line downwards."""
    for footprint in footprints:
        axis.plot(*footprint.exterior.xy, color="0.7", linewidth=0.8)
    length = np.hypot(*residual.T)
    known = np.isfinite(length) & (length > 0.0)
    rms = float(np.sqrt(np.mean(length[known] ** 2))) if known.any() else 0.0
    if known.any():
        arrows = axis.quiver(
            *place[known, :2].T, residual[known, 0], -residual[known, 1], color="0.3", angles="uv",
            scale=float(np.quantile(length[known], 0.9)) / ARROW_SHARE, scale_units="width", width=0.002,
        )  # fmt: skip
        axis.quiverkey(arrows, 0.85, 1.03, float(f"{rms:.1g}"), f"{rms:.1g} px", labelpos="E")
    axis.set_title(f"{title}: RMS {rms:.2g} px", loc="left")
    axis.set_xlabel("longitude")
    axis.locator_params(axis="x", nbins=4)
    axis.set_aspect(1.0 / np.cos(np.radians(float(np.mean(place[:, 1])))))
