"""What GIS software shows of a result: its layers, and quick-looks of its images before and after the adjustment.

Of a folder that `init` has understood, it shows the footprints and quick-looks of the images, the points and the DEM.
"""

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ...hrsi_engine.block.imaging_geometry import compute_footprint
from ...hrsi_engine.ground.geodesy import WGS84, WGS84_3D
from ...hrsi_engine.io.geopackage.layer_tables import layer_names, text_columns
from ...hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from ...hrsi_engine.io.rasters.images import close_images, open_image
from ...hrsi_engine.io.rasters.quick_looks import write_quick_look
from ..interface.declare import QUICK_LOOKS, STATES

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
    try:
        for name, entry in list(entries.items())[:MOST_IMAGES]:
            image = open_image(entry["path"])
            if image.raster is not None:
                os.makedirs(os.path.join(folder, QUICK_LOOKS), exist_ok=True)
                for state, rpc in zip(STATES, (image.rpc, open_image(entry["output"]).rpc), strict=True):
                    path = os.path.join(folder, QUICK_LOOKS, f"{name}_{state}.tif")
                    write_quick_look(image, rpc, heights[name], path)
    finally:
        close_images()


def write_folder_map(shown: Mapping[str, Any], folder: str) -> list[str]:
    """Write layers of a folder that `init` understood, and return all sources for a map, the lowest first.

    shown : the entry ``map`` of the report of `init`; folder : of the new files
    Raises `OutputError` if a file cannot be written.
    """
    try:
        images = [open_image(path) for path in shown["images"]]
        outlines = [compute_footprint(image, image.middle_height_m) for image in images]
        columns = {"id": np.array([image.id for image in images]), "path": np.array([image.path for image in images])}
        layers = [Layer("images", "Polygon", WGS84, outlines, columns)]
        points = shown["points"]
        if points["id"]:
            texts = {key: np.array(points[key]) for key in ("id", "file")}
            layers.append(Layer("ground_points", "PointZ", WGS84_3D, np.array(points["position"]), texts))
        path = os.path.join(folder, "folder.gpkg")
        write_geopackage(path, layers)
        quick_looks = []
        for image in [image for image in images if image.raster is not None][:MOST_IMAGES]:
            quick_looks.append(os.path.join(folder, f"{image.id}.tif"))
            write_quick_look(image, image.rpc, image.middle_height_m, quick_looks[-1])
    finally:
        close_images()
    return [*shown["dems"], *quick_looks, *(f"{path}|layername={layer.name}" for layer in layers)]
