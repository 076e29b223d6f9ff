"""What GIS software shows of a result: its layers, and quick-looks of its images before and after the adjustment."""

import os
from collections.abc import Iterable
from typing import Any

from ...hrsi_engine.io.geopackage.layer_tables import layer_names, text_columns
from ...hrsi_engine.io.rasters.images import open_image
from ...hrsi_engine.io.rasters.quick_looks import write_quick_look

QUICK_LOOKS, STATES = "quick_looks", ("before", "after")
MOST_IMAGES = 12  # of a block: more would cover each other


def list_written_layers(folder: str, layers: Iterable[str]) -> list[str]:
    """Return the sources (``FILE|layername=L``) of those layers below a folder that exist."""
    sources = [os.path.join(folder, layer) for layer in layers]
    parts = [source.partition("|layername=") for source in sources]
    return [
        source
        for source, (path, _, name) in zip(sources, parts, strict=True)
        if os.path.exists(path) and name in layer_names(path)
    ]


def write_quick_looks(report: dict[str, Any], folder: str) -> None:
    """Write quick-looks of the adjusted images with pixels into ``QUICK_LOOKS``, by the given and by the refined RPCs.

    Without refined RPCs there are none. Raises `OutputError` if GDAL fails.
    """
    entries = {name: one for name, one in report.get("images", {}).items() if one.get("output") and one.get("path")}
    if not entries:
        return
    table = text_columns(os.path.join(folder, "block.gpkg"), "images", ("id", "footprint_height_m"))
    heights = dict(zip(table["id"], map(float, table["footprint_height_m"]), strict=True))
    for name, entry in list(entries.items())[:MOST_IMAGES]:
        image = open_image(entry["path"])
        if image.raster is not None:
            os.makedirs(os.path.join(folder, QUICK_LOOKS), exist_ok=True)
            for state, rpc in zip(STATES, (image.rpc, open_image(entry["output"]).rpc), strict=True):
                path = os.path.join(folder, QUICK_LOOKS, f"{name}_{state}.tif")
                write_quick_look(image, rpc, heights[name], path)
