"""What people give in Python, as the declared options take it: by kind of option."""

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Block, Image, ImagePoints
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.io.point_files import PointsInMemory
from ...hrsi_engine.io.rasters.images import ImageInMemory, path_of
from ..interface.declare import Algorithm, Kind


def _image(given: Any) -> str:
    if isinstance(given, RPC):
        return ImageInMemory(Image("image", given))
    if isinstance(given, Image):
        return ImageInMemory(given)
    inner = getattr(given, "rpc", None)
    if isinstance(inner, RPC):  # what `read_rpc` returns
        return ImageInMemory(Image("image", inner, getattr(given, "size", None)))
    return path_of(given)


#: What becomes of a value by the kind of its option, others stay as they are; images in memory go with their names.
TAKEN: dict[Kind, Callable[[Any], Any]] = {
    Kind.IMAGES: lambda given: [_image(one) for one in (given if isinstance(given, (list, tuple)) else [given])],
    Kind.RASTER: path_of,
    Kind.POINTS: lambda given: given if isinstance(given, (str, os.PathLike)) else PointsInMemory(given),
}


def convert_options(algorithm: Algorithm, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by keyword as their declaration takes them.

    ``given`` has None for what is not given. A `Block` as images brings its points with it.
    """
    options = {key: value for key, value in given.items() if value is not None}
    kinds = {param.key: param.kind for param in algorithm.params}
    if isinstance(block := options.get("images"), Block):
        # Its known points and all its measurements, by the options that take them
        known, rows = block.points.select(block.known), block.measurements
        names = np.array([image.id for image in block.images])
        ids = block.points.ids[rows.point]
        measured = ImagePoints(ids, names[rows.image], rows.xy, rows.sigma_px, rows.kind, rows.quality)
        brought = {"gcps": known if len(known) else None, "image_points": measured}
        given = {key: value for key, value in brought.items() if key in kinds and value is not None}
        options = {**given, **options, "images": block.images}
    return {
        key: TAKEN[kinds[key]](value) if key in kinds and kinds[key] in TAKEN else value
        for key, value in options.items()
    }
