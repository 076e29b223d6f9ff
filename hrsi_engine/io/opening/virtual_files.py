"""Whole files in GDAL's virtual file systems: object stores (``/vsis3/…``), archives, servers, memory.

An object store takes a file whole or not at all, when it is closed; it has no folders, only names with slashes.
"""

from collections.abc import Iterable
from typing import Any

from osgeo import gdal

from ...foundation.errors import OutputError
from .datasets import gdal_messages, quiet

VIRTUAL = "/vsi"


def virtual_status(path: str) -> Any | None:
    """Return GDAL's status of a virtual path (``/vsizip/…``, ``/vsicurl/…``), None where nothing is there, quietly."""
    with quiet():
        try:
            return gdal.VSIStatL(path)
        except RuntimeError:  # GDAL with exceptions enabled
            return None


def read_virtual(path: str, most: int | None = None) -> bytes | None:
    """Return a file's content, at ``most`` so many bytes from its beginning; None where it cannot be read."""
    if most is None:
        status = virtual_status(path)
        if status is None:
            return None
        most = status.size
    with quiet():
        try:
            handle = gdal.VSIFOpenL(path, "rb")
        except RuntimeError:  # GDAL with exceptions enabled
            return None
        if handle is None:
            return None
        content = bytes(gdal.VSIFReadL(1, most, handle) or b"")
        gdal.VSIFCloseL(handle)
    return content


def write_virtual(path: str, blocks: Iterable[bytes]) -> None:
    """Write a file from blocks of bytes; raise `OutputError` where it cannot be written."""
    written = False
    with gdal_messages() as messages:
        handle = gdal.VSIFOpenL(path, "wb")
        if handle is not None:
            written = all(gdal.VSIFWriteL(block, 1, len(block), handle) == len(block) for block in blocks)
            written &= gdal.VSIFCloseL(handle) == 0
    if not written:
        reason = messages[-1] if messages else "it takes no new files"
        raise OutputError(f"{path}: cannot be written ({reason}): choose another `output_dir`")


def list_virtual(folder: str) -> list[str]:
    """Return the names in a folder as they are now, whatever GDAL remembers of it; none where there is no folder."""
    names: list[str] = []
    with gdal_messages():
        gdal.VSICurlPartialClearCache(folder)
        names = gdal.ReadDir(folder) or []
    return [name for name in names if name not in (".", "..")]


def remove_virtual(folder: str) -> None:
    """Remove a folder with all that is in it; what cannot be removed stays."""
    with gdal_messages():
        gdal.RmdirRecursive(folder)
