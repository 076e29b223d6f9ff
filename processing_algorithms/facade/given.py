"""What people give in Python, as the declared options take it: by kind of option."""

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import Block, GroundPoints, Image, ImagePoints
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.io.point_files import PointsInMemory
from ...hrsi_engine.io.rasters.images import ImageInMemory, path_of
from ..interface.declare import Algorithm, Kind


def _images(given: Any) -> Any:
    """Return images by the names under which they are opened; those in memory go with their names."""
    several = isinstance(given, (list, tuple))
    return [_image(one) for one in (given if several else [given])]


def _image(given: Any) -> str:
    if isinstance(given, RPC):
        return ImageInMemory(Image("image", given))
    if isinstance(given, Image):
        return ImageInMemory(given)
    inner = getattr(given, "rpc", None)
    if isinstance(inner, RPC):  # what `read_rpc` returns
        return ImageInMemory(Image("image", inner, getattr(given, "size", None)))
    return path_of(given)


def _points(given: Any) -> Any:
    return given if isinstance(given, (str, os.PathLike)) else PointsInMemory(given)


#: What becomes of a value by the kind of its option; others are taken as they are.
TAKEN: dict[Kind, Callable[[Any], Any]] = {Kind.IMAGES: _images, Kind.RASTER: path_of, Kind.POINTS: _points}


def convert_options(algorithm: Algorithm, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by keyword as their declaration takes them.

    ``given`` has None for what is not given. A `Block` as images brings its points with it.
    """
    options = {key: value for key, value in given.items() if value is not None}
    kinds = {param.key: param.kind for param in algorithm.params}
    if isinstance(block := options.get("images"), Block):
        brought = {key: value for key, value in _points_of(block).items() if key in kinds and value is not None}
        options = {**brought, **options, "images": block.images}
    return {
        key: TAKEN[kinds[key]](value) if key in kinds and kinds[key] in TAKEN else value
        for key, value in options.items()
    }


def _points_of(block: Block) -> dict[str, GroundPoints | ImagePoints | None]:
    """Return the known points of a block and all its measurements, by the options that take them."""
    known, rows = block.points.select(block.known), block.measurements
    names = np.array([image.id for image in block.images])
    ids = block.points.ids[rows.point]
    measured = ImagePoints(ids, names[rows.image], rows.xy, rows.sigma_px, rows.kind, rows.quality)
    return {"gcps": known if len(known) else None, "image_points": measured}
