"""Checks that a file can be opened: it must be a regular file, and its name valid text.

A named pipe, socket or device that the user names, or that has the name of a side file of an image (``a_RPC.TXT``,
``a.tif.aux.xml``), would block GDAL and every other reader for ever. `require_plain` is called before a file is
opened, `require_plain_around` before GDAL opens a file and looks for its side files.
"""

import html
import os
import re
import stat
from functools import lru_cache

from ...foundation.errors import InputError

_SOURCE = re.compile(rb"<Source(?:Filename|Dataset)[^>]*>([^<]+)<")
MOST_OF_VRT = 2**25  # bytes of a VRT that are searched: enough for a mosaic of 100 000 tiles
DEEPEST_VRT = 4  # levels of nested VRTs
_KINDS = ((stat.S_ISFIFO, "a named pipe"), (stat.S_ISSOCK, "a socket"),
          (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"))  # fmt: skip


def require_plain(path: str) -> None:
    """Raise `InputError` for a pipe, socket or device, and for a name that is not UTF-8; a missing file is accepted.

    For a path into an archive, the archive is checked.
    """
    try:
        path.encode()
    except UnicodeEncodeError:
        printable = path.encode("utf-8", "backslashreplace").decode()
        raise InputError(f"{printable}: its name is no UTF-8, which GDAL and all results need: rename it") from None
    if "\0" in path:
        raise InputError(f"{path!r}: no file has such a name: correct it")
    way = next((way for way in ("/vsizip/", "/vsitar/", "/vsigzip/") if path.startswith(way)), "")
    place = path.removeprefix(way)
    while way and len(place) > 1 and not os.path.exists(place):
        place = os.path.dirname(place)
    kind = "" if place.startswith("/vsi") else _special_kind(place)
    of_the_shell = place.startswith(("/dev/fd/", "/dev/stdin", "/proc/self/fd/"))  # `<(…)` of a shell: its writer ends
    if kind and not (kind == "a named pipe" and of_the_shell):
        raise InputError(f"{path}: is {kind}, which may never end: name a file, or remove it")


def require_plain_around(path: str) -> None:
    """Raise `InputError` if a file, or a file in its folder that GDAL may open with it, is a pipe, socket or device."""
    require_plain(path)
    folder, name = os.path.split(path)
    if name.lower().endswith(".vrt") and os.path.isfile(path):
        _require_plain_sources(path, folder, 0)
    try:
        changed = os.stat(folder or ".").st_mtime_ns
        names = () if path.startswith("/vsi") else _special_names(folder or ".", changed)
    except OSError:  # not a folder on disk
        return
    stem = os.path.splitext(name)[0].lower()
    for neighbour in names:
        # GDAL looks for files with these endings under names that differ from the image's
        if stem in neighbour.lower() or neighbour.lower().endswith((".xml", ".dim", ".imd")):
            require_plain(os.path.join(folder, neighbour))


def _require_plain_sources(path: str, folder: str, depth: int) -> None:
    """Raise `InputError` if a VRT, or a VRT among its sources, has a pipe, socket or device as a source."""
    with open(path, "rb") as file:
        sources = _SOURCE.findall(file.read(MOST_OF_VRT))
    for source in {html.unescape(source.decode(errors="replace")).strip() for source in sources}:
        for place in {source, os.path.join(folder, source)}:  # relative to the working folder, or to the VRT's
            require_plain(place)
            if place.lower().endswith(".vrt") and os.path.isfile(place) and depth < DEEPEST_VRT:
                _require_plain_sources(place, os.path.dirname(place), depth + 1)


def _special_kind(path: str) -> str:
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # broken links: opening them fails at once
        return ""
    return next((word for is_kind, word in _KINDS if is_kind(mode)), "")


@lru_cache(maxsize=64)
def _special_names(folder: str, _changed_ns: int) -> tuple[str, ...]:
    """Return the names in a folder that are no regular files; cached for all images in the folder."""
    with os.scandir(folder) as entries:
        others = [
            one for one in entries if not (one.is_file(follow_symlinks=False) or one.is_dir(follow_symlinks=False))
        ]
    return tuple(one.name for one in others if _special_kind(one.path))
