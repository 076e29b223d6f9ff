"""Reads texts and opens rasters within their size limits; invalid files raise `InputError`."""

import json
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from osgeo import gdal

from ...foundation.errors import InputError
from .budgets import MOST_BYTES, require_raster, require_size
from .datasets import check_advice, gdal_messages, open_dataset, read_head


def read_bytes(path: str, kind: str = "RPC") -> bytes:
    """Return the content of a file, also of one in GDAL's virtual file systems (``/vsizip/…``).

    ``kind`` is the kind of its content, a key of `budgets.MOST_BYTES`. Raises `InputError` if it cannot be read or is
    too large.
    """
    require_size(path, kind)
    return read_head(path, MOST_BYTES[kind])


def read_text(path: str, kind: str = "RPC") -> str:
    """Return a file's text, as UTF-8 or, if that fails, as Latin-1, which cannot fail; raises as `read_bytes`."""
    content = read_bytes(path, kind)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def read_json(path: str, kind: str) -> Any:
    """Return the content of a JSON file (UTF-8, with or without a byte order mark); raises as `read_bytes`."""
    try:
        return json.loads(read_bytes(path, kind).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # the last: brackets nested thousands deep
        raise InputError(f"{path}: is no JSON that can be read ({error}): obtain the file again") from None


def open_raster(path: str) -> gdal.Dataset:
    """Return an image opened by GDAL; raise `InputError` if it is no image."""
    dataset, message = open_dataset(path)
    if dataset is None and not path.startswith("/vsi") and ":" not in path and not os.path.exists(path):
        raise InputError(f"{path}: no such file: check the path")
    if dataset is None or dataset.RasterCount < 1:
        reason = f" ({message})" if message else ""
        raise InputError(f"{path}: neither an image nor an RPC file{reason}: {check_advice(path, 'check the file')}")
    require_raster(path, dataset)
    return dataset


def read_pixels(
    path: str, dataset: gdal.Dataset, bands: Sequence[int], window: tuple[int, int, int, int], masked: bool, **how: Any
) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Return the values of bands in a window, and the mask of the first of them if ``masked`` (0: invalid).

    window : first sample, first line, samples, lines; how : further arguments of GDAL's ``ReadAsArray``
    Raises `InputError` if the pixels cannot be read.
    """
    found: list[np.ndarray | None] = []
    with gdal_messages() as messages:
        found += [dataset.GetRasterBand(number).ReadAsArray(*window, **how) for number in bands]
        found += [dataset.GetRasterBand(bands[0]).GetMaskBand().ReadAsArray(*window, **how)] if masked else []
    read = [values for values in found if values is not None]
    if len(read) < len(bands) + masked:
        raise InputError(
            f"{path}: pixels at sample {window[0]}, line {window[1]} cannot be read ({messages.reason}): obtain the "
            "file again"
        )
    return (read[:-1], read[-1]) if masked else (read, None)
