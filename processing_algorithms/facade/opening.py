"""What people give in Python, as the declared options take it: images opened, and values by kind of option."""

import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import ArrayRaster, Block, Image, ImagePoints
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.point_files import PointsInMemory
from ...hrsi_engine.io.rasters.images import ImageInMemory, open_image, path_of, resampling_doubt
from ...hrsi_engine.io.rpc_files import read_rpc
from ..interface.declare import Algorithm, Kind

_log = logging.getLogger("hrsi")


def open(source: Any, rpc: Any = None, id: str | None = None) -> Any:
    """Open an image with its RPC, or several.

    Parameters
    ----------
    source : path, rasterio dataset, xarray object, array, Image, or a sequence of them
        An image that GDAL opens, or an RPC file alone (``_RPC.TXT``, ``.RPB``, DIMAP or ISD XML, ``.geom``); an array
        ``(lines, samples)`` of grey values, which needs ``rpc``.
    rpc : RPC or path, optional
        A camera to be used instead of the image's own; an RPC, what `read_rpc` returned, or a file.
    id : str, optional
        Name in the block; by default the file's stem without a trailing ``_RPC``.

    Returns
    -------
    Image or list of Image
        With ``rpc``, ``size`` and a way to the pixels; a list for a sequence.

    Raises
    ------
    InputError
        The file is missing, is neither an image nor an RPC file, or has no RPC.
    """
    if isinstance(source, (list, tuple)):
        if rpc is not None or id is not None:
            raise InputError("`rpc` and `id` belong to one image: open it by itself")
        return [open(one) for one in source]
    camera = _camera_of(rpc)
    if camera is None and isinstance(rpc, (str, os.PathLike)):
        camera = read_rpc(os.fspath(rpc)).rpc
    if camera is None and rpc is not None:
        raise InputError(f"`rpc` is a {type(rpc).__name__}: give an RPC, a file, or an image")
    if isinstance(source, np.ndarray):
        if camera is None or source.ndim != 2:
            raise InputError(f"an image given as an array {source.shape} needs `rpc`, and the shape (lines, samples)")
        return Image(id or "image", camera, (source.shape[1], source.shape[0]), raster=ArrayRaster(source))
    image = source if isinstance(source, Image) else open_image(source)
    if camera is None and (ignored := resampling_doubt(image)):
        _log.warning(f"{image.id}: {ignored}")
    return replace(image, rpc=camera or image.rpc, id=id or image.id)


def _camera_of(given: Any) -> RPC | None:
    """Return the RPC that is given as such, or within something read: an image, or what `read_rpc` returns."""
    inner = given if isinstance(given, RPC) else getattr(given, "rpc", None)
    return inner if isinstance(inner, RPC) else None


def _image(given: Any) -> str:
    camera = _camera_of(given)
    if camera is None:
        return path_of(given)
    return ImageInMemory(given if isinstance(given, Image) else Image("image", camera, getattr(given, "size", None)))


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
