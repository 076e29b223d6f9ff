"""Texts of XML elements, and the files of a folder."""

import os
import time
from collections.abc import Sequence
from functools import lru_cache

from osgeo import gdal

from ..opening.datasets import call_quiet
from ..opening.files import Element

SETTLED_NS = 2_000_000_000  # a folder is cached if it is unchanged for longer than the resolution of file times


def element_text(root: Element, name: str) -> str | None:
    """Return the text of the first element with this name anywhere below ``root``."""
    element = next(root.iter(name), None)
    return None if element is None else (element.text or "")


def texts_below(root: Element) -> dict[str, str]:
    """Return name -> text of the first element with this name, for all elements below ``root``."""
    return {element.tag: element.text or "" for element in reversed([*root.iter()])}


def positive_size(samples: str | None, lines: str | None) -> tuple[int, int] | None:
    """Return an image size given as text, None unless both are whole numbers above zero."""
    try:
        size = int(samples or ""), int(lines or "")
    except ValueError:
        return None
    return size if min(size) > 0 and max(size) < 2**31 else None


def siblings(path: str) -> dict[str, str]:
    """Return the files in the folder of ``path``: name in lower case -> full path.

    Case may matter in a file system, and vendors write ``_RPC.TXT`` and ``_rpc.txt``. Of names that differ in case
    only, the first in sorted order (capitals) is used.
    """
    folder = os.path.dirname(path)
    if folder.startswith("/vsi"):
        return _by_lower_case(folder, call_quiet(gdal.ReadDir, folder) or [])
    try:
        status = os.stat(folder or ".")
        settled = time.time_ns() - status.st_mtime_ns > SETTLED_NS
        list_files = _list_folder if settled else _list_folder.__wrapped__
        return list_files(folder, (status.st_dev, status.st_ino, status.st_mtime_ns))
    except OSError:
        return {}


@lru_cache(maxsize=8)
def _list_folder(folder: str, _identity: tuple[int, int, int]) -> dict[str, str]:
    return _by_lower_case(folder, os.listdir(folder or "."))


def _by_lower_case(folder: str, names: Sequence[str]) -> dict[str, str]:
    return {name.lower(): os.path.join(folder, name) for name in sorted(names, reverse=True)}
