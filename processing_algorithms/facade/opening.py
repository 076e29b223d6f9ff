"""Opening images, for people in Python."""

import logging
import os
from dataclasses import replace
from typing import Any

import numpy as np

from ...hrsi_engine.block.block import ArrayRaster, Image
from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.rasters.images import open_image, resampling_doubt
from ...hrsi_engine.io.rpc_files import read_rpc

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
    camera = None if rpc is None else rpc_of(rpc)
    if isinstance(source, np.ndarray):
        if camera is None or source.ndim != 2:
            raise InputError(f"an image given as an array {source.shape} needs `rpc`, and the shape (lines, samples)")
        return Image(id or "image", camera, (source.shape[1], source.shape[0]), raster=ArrayRaster(source))
    image = source if isinstance(source, Image) else open_image(source)
    if camera is None and (ignored := resampling_doubt(image)):
        _log.warning(f"{image.id}: {ignored}")
    return replace(image, rpc=camera or image.rpc, id=id or image.id)


def rpc_of(given: Any) -> RPC:
    """Return the RPC that is given as such, within something read, or as a file."""
    if isinstance(given, RPC):
        return given
    inner = getattr(given, "rpc", None)
    if isinstance(inner, RPC):
        return inner
    if isinstance(given, (str, os.PathLike)):
        return read_rpc(os.fspath(given)).rpc
    raise InputError(f"`rpc` is a {type(given).__name__}: give an RPC, a file, or an image")
